//! House rules that a compiler cannot check.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{
    fs,
    path::{Path, PathBuf},
};

/// A file longer than this holds two ideas.
const MAX_LINES: usize = 500;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a crate lies in the workspace").into()
}

/// All Rust files of the project below `folder`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') {
                sources(&path, found);
            }
        } else if name.ends_with(".rs") {
            found.push(path);
        }
    }
}

fn check(wrong: impl Fn(&Path, &str) -> Option<String>) {
    let mut files = Vec::new();
    for part in ["data", "imaging", "solver", "stages", "pipeline", "tests"] {
        sources(&root().join(part), &mut files);
    }
    assert!(files.len() > 50, "the sources were not found");
    files.sort();
    let complaints: Vec<String> = files
        .iter()
        .filter_map(|path| {
            let text = fs::read_to_string(path).unwrap();
            wrong(path, &text).map(|why| format!("{}: {why}", path.display()))
        })
        .collect();
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
}

#[test]
fn every_file_is_short_and_says_what_it_is() {
    check(|_, text| {
        if text.lines().count() > MAX_LINES {
            return Some(format!("over {MAX_LINES} lines; split it"));
        }
        (!text.starts_with("//! ")).then(|| "begin with a `//!` sentence".into())
    });
}

#[test]
fn every_law_meets_the_battery() {
    check(|path, text| {
        let is_law = path.ends_with("law.rs") || path.ends_with("materials/mod.rs");
        let law = text.contains("impl InvariantEnergy for") && !is_law;
        (law && !text.contains("testing::check(")).then(|| "call `testing::check`".into())
    });
}

#[test]
fn imaging_and_solver_touch_no_file_and_no_clock() {
    check(|path, text| {
        let part = path.strip_prefix(root()).ok()?;
        let pure = part.starts_with("imaging/src") || part.starts_with("solver/src");
        let words = ["std::fs", "std::time", "std::env", "std::process"];
        let word = words.iter().find(|word| text.contains(*word));
        word.filter(|_| pure).map(|word| format!("{word} in a pure crate"))
    });
}
