//! The program from outside: exit codes, and one line on standard error that says what to do.

use std::{
    fs,
    path::Path,
    process::{Command, Output, Stdio},
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

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut run = Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .arg("effects")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(run.stdout.take());
    let done = run.wait_with_output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
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
    refused(STUDY, &["segment", "study.toml"], 2, &["study.toml", "NIfTI"]);
    refused(STUDY, &["segment", "no.nii"], 65, &["no.nii"]);
    refused(STUDY, &["segment", "a/x.nii", "b/x.nii.gz"], 2, &["called x", "rename"]);
    let marked = ["segment", "a.nii", "b.nii", "--scribbles", "m.nii"];
    refused(STUDY, &marked, 2, &["--scribbles", "one image"]);
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
        &["discover", "study.toml", "--effects", "limit_chain,magic"],
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
        "demo",
        "synth",
        "run",
        "report",
        "map",
        "score",
        "status",
        "explain",
        "check",
        "verify",
        "gc",
        "inspect",
        "segment",
        "effects",
        "discover",
        "study",
        "bids",
        "completions",
        "man",
    ] {
        assert!(text.contains(&format!("  {command} ")), "{text}");
        let help = mammotwin(&[command, "--help"], Path::new("."));
        assert!(help.status.success() && help.stdout.len() > 100, "{command}");
        let help = String::from_utf8(help.stdout).unwrap();
        let example = format!("\n  mammotwin {command}");
        assert!(help.contains("Example") && help.contains(&example), "{command}: {help}");
    }
    assert!(text.contains("Examples:\n  mammotwin "), "{text}");
}

#[test]
fn shells_and_man_know_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for (shell, mark) in [
        ("bash", "complete -F _mammotwin"),
        ("zsh", "#compdef mammotwin"),
        ("fish", "complete -c mammotwin"),
    ] {
        let output = mammotwin(&["completions", shell], folder.path());
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains(mark), "{shell}");
        for word in ["synth", "discover", "bids", "held-out"] {
            assert!(text.contains(word), "{shell}: {word}");
        }
    }
    let page = String::from_utf8(mammotwin(&["man"], folder.path()).stdout).unwrap();
    assert!(page.contains(".TH mammotwin 1") && page.contains("Exit codes"), "{page}");
    assert!(mammotwin(&["man", "--out", "pages"], folder.path()).status.success());
    for name in ["mammotwin.1", "mammotwin-run.1", "mammotwin-study-dose.1"] {
        assert!(folder.path().join("pages").join(name).exists(), "{name}");
    }
}

#[test]
fn a_refused_study_shows_its_line_to_people_and_one_line_to_programs() {
    let folder = tempfile::tempdir().unwrap();
    let study = STUDY.replace("posture", "gravity");
    fs::write(folder.path().join("study.toml"), study).unwrap();
    let asked = |excerpt: &str, command: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_mammotwin"))
            .args([command, "study.toml"])
            .env("MAMMOTWIN_EXCERPT", excerpt)
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(65));
        String::from_utf8(output.stderr).unwrap()
    };
    let error = asked("always", "run");
    let lines: Vec<&str> = error.lines().skip(1).collect();
    assert_eq!(lines, ["  |", "6 | gravity = \"prone\"", "  | ^^^^^^^"]);
    assert_eq!(asked("never", "run").lines().count(), 1);
    // Files that cannot be what the study says are marked, too.
    fs::write(folder.path().join("study.toml"), STUDY).unwrap();
    let error = asked("always", "check");
    assert!(error.starts_with("mammotwin: study.toml: line 5: poses.prone.image: "), "{error}");
    assert!(error.contains("5 | image = \"no such.nii.gz\"\n  | ^^^^^\n"), "{error}");
}

#[test]
fn a_log_is_written_and_quiet_is_quiet() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("study.toml"), STUDY).unwrap();
    let output = mammotwin(&["--log", "log.txt", "check", "study.toml"], folder.path());
    assert_eq!(output.status.code(), Some(65));
    let log = fs::read_to_string(folder.path().join("log.txt")).unwrap();
    assert!(log.contains("ERROR") && log.contains("poses.prone.image"), "{log}");
    let output = mammotwin(&["--log", "no/log.txt", "check", "study.toml"], folder.path());
    assert_eq!(output.status.code(), Some(74));
    let quiet = ["man", "--quiet", "--out", "pages"];
    let output = mammotwin(&quiet, folder.path());
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty());
}

#[test]
fn a_surface_that_casts_no_shadow_is_refused() {
    let corners = [[0.0, 10.0, 10.0], [40.0, 10.0, 10.0], [0.0, 50.0, 10.0], [0.0, 10.0, 50.0]];
    let solid = |facets: &[[usize; 3]]| {
        let facet = |f: &[usize; 3]| {
            let vertex = |n: &usize| {
                format!("vertex {} {} {}\n", corners[*n][0], corners[*n][1], corners[*n][2])
            };
            let loops: String = f.iter().map(vertex).collect();
            format!("facet normal 0 0 0\nouter loop\n{loops}endloop\nendfacet\n")
        };
        format!("solid x\n{}endsolid x\n", facets.iter().map(facet).collect::<String>())
    };
    let outward = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
    let inward = outward.map(|[a, b, c]| [a, c, b]);
    let arguments = ["study", "projection", "--surface", "study.toml", "--out", "out"];
    refused(&solid(&outward[1..]), &arguments, 65, &["study.toml", "not closed"]);
    refused(&solid(&inward), &arguments, 65, &["study.toml", "inside out"]);
    refused("no solid", &arguments, 65, &["study.toml", "no STL file"]);
}
