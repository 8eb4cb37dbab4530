//! The program from outside: exit codes, and one line on standard error that says what to do.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

const STUDY: &str = r#"
schema = 1
subject = { id = "x" }
[poses.prone]
image = "no such.nii.gz"
posture = "prone"
"#;

fn mammotwin(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

#[track_caller]
fn refused(study: &str, arguments: &[&str], code: i32, says: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("study.toml"), study).unwrap();
    let output = mammotwin(arguments, folder.path());
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    for part in says {
        assert!(error.contains(part), "{error:?} does not say {part:?}");
    }
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().flatten().collect();
    assert_eq!(left.len(), 1, "something was written: {left:?}");
}

#[test]
fn bad_input_is_65_and_names_file_key_and_remedy() {
    for command in ["run", "status", "check", "gc"] {
        refused(
            &STUDY.replace("posture", "gravity"),
            &[command, "study.toml"],
            65,
            &["study.toml", "line 6", "poses.prone.gravity", "there are: image, posture"],
        );
    }
    let says = ["poses.prone.image", "no such.nii.gz", "relative to the study"];
    refused(STUDY, &["check", "study.toml"], 65, &says);
    refused(STUDY, &["run", "other.toml"], 65, &["other.toml: no such study file"]);
    refused(STUDY, &["inspect", "no.nii"], 65, &["no.nii: no such file"]);
    refused(STUDY, &["inspect", "study.toml"], 65, &["study.toml"]);
}

#[test]
fn usage_is_2() {
    let here = Path::new(".");
    for arguments in [
        &["run"][..],
        &["walk"],
        &["run", "study.toml", "--only", "a", "--from", "b"],
        &["synth", "--out", "x", "--voxel-mm", "1,2"],
        &["synth", "--out", "x", "--poses", "sitting"],
    ] {
        assert_eq!(mammotwin(arguments, here).status.code(), Some(2), "{arguments:?}");
    }
    assert!(!here.join("x").exists());
}

#[test]
fn every_command_has_help() {
    let help = mammotwin(&["--help"], Path::new("."));
    let text = String::from_utf8(help.stdout).unwrap();
    for command in [
        "demo", "synth", "run", "report", "score", "status", "explain", "check", "verify", "gc",
        "inspect", "study",
    ] {
        assert!(text.contains(&format!("  {command} ")), "{text}");
        let help = mammotwin(&[command, "--help"], Path::new("."));
        assert!(help.status.success() && help.stdout.len() > 100, "{command}");
    }
}
