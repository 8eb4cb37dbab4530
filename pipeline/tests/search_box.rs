//! `study search-box` on coarse meshes, from outside.

use std::{
    fs,
    process::{Command, Output},
};

fn study(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .args(["study", "search-box"])
        .args(arguments)
        .output()
        .unwrap()
}

#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let output = study(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn runs_are_kept_and_end_in_equilibrium() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let all = ["--out", out, "--runs", "40", "--size-mm", "18", "--stepped-every", "0"];
    let none = printed(&[&all[..], &["--minutes", "0"]].concat());
    assert!(none.starts_with("0 of 40 runs done"), "{none}");
    let said = printed(&all);
    assert!(said.starts_with("40 of 40 runs done"), "{said}");
    let table = || fs::read_to_string(folder.path().join("runs.csv")).unwrap();
    let before = table();
    let lines: Vec<Vec<&str>> = before.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(lines.len(), 41);
    let column = |name: &str| lines[0].iter().position(|cell| *cell == name).unwrap();
    for line in &lines[1..] {
        assert_eq!(line.len(), lines[0].len(), "{line:?}");
        let number = |name: &str| line[column(name)].parse::<f64>().unwrap();
        assert_eq!(line[column("ended")], "yes", "{line:?}");
        assert!(number("residual") <= 1e-6 && number("force_imbalance") <= 1e-3, "{line:?}");
        assert!(number("moment_imbalance") <= 1e-3 && number("min_det_f") > 0.0, "{line:?}");
        assert!(number("gap_mm") <= 0.05 && number("penetration_mm") <= 0.05, "{line:?}");
    }
    // A run that was cut short is made anew, the others are not.
    let one = folder.path().join("runs/0003.json");
    fs::write(&one, "{").unwrap();
    let kept = folder.path().join("runs/0004.json");
    let made = |path| fs::metadata(path).unwrap().modified().unwrap();
    let first = made(&kept);
    printed(&all);
    assert_eq!(made(&kept), first);
    let page = fs::read_to_string(folder.path().join("search-box.md")).unwrap();
    assert!(page.contains("| in equilibrium | 40 |"), "{page}");
    assert!(folder.path().join("search-box.svg").exists());
}

#[test]
fn options_without_sense_are_refused() {
    for wrong in [["--runs", "0"], ["--size-mm", "1"]] {
        let output = study(&wrong);
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&output.stderr).contains(wrong[0]));
    }
}
