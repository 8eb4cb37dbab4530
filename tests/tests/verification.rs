//! The verification problems of the mechanics, counted from the tests that solve them.
//!
//! A test says what it verifies in lines `/// Verifies: problem | source | tolerance`; the table of
//! `docs/verification-problems.md` is made of them, so that it cannot list what no test asserts.
//! After a change: `MAMMOTWIN_WRITE=1 cargo test --release --workspace --test verification`.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

const MARK: &str = "/// Verifies: ";
/// Where tests may say so.
const CRATES: [&str; 5] = ["data", "imaging", "solver", "stages", "pipeline"];
/// As many problems are wanted.
const WANTED: usize = 60;

struct Problem {
    file: String,
    test: String,
    slow: bool,
    /// Problem, source, tolerance.
    cells: [String; 3],
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().into()
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Problems of a file, each with the test that follows it.
fn problems(file: &str, text: &str) -> Vec<Problem> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let marked = lines.iter().enumerate().filter(|(_, line)| line.starts_with(MARK));
    let problem = |(at, line): (usize, &&str)| {
        let cells: Vec<String> = line[MARK.len()..].split(" | ").map(Into::into).collect();
        let cells = cells.try_into().unwrap_or_else(|_| panic!("{file}: {line}: three parts"));
        let item: Vec<&&str> = lines[at..].iter().take_while(|l| !l.starts_with("fn ")).collect();
        assert!(item.iter().any(|l| **l == "#[test]"), "{file}: {line}: no test follows");
        let name = lines[at + item.len()].trim_start_matches("fn ");
        let test = name.split('(').next().unwrap().to_owned();
        let slow = item.iter().any(|l| l.starts_with("#[ignore"));
        Problem { file: file.to_owned(), test, slow, cells }
    };
    marked.map(problem).collect()
}

fn table(all: &[Problem]) -> String {
    let tests = all.iter().map(|p| (&p.file, &p.test)).collect::<std::collections::BTreeSet<_>>();
    let slow = all.iter().filter(|p| p.slow).count();
    let mut page = format!(
        "# Verification problems\n\n{} problems of the mechanics in {} tests, each with what it is compared with and the \
         tolerance that is asserted. Made from the tests by `cargo test --release --workspace --test verification`, which \
         fails when this table is not theirs; `cargo test --release --workspace` solves them, but for {slow} slow ones \
         (`-- --ignored`). Measured values: [verification.md](verification.md).\n\n\
         | problem | source | tolerance | test |\n|---|---|---|---|\n",
        all.len(),
        tests.len()
    );
    for Problem { file, test, slow, cells: [problem, source, tolerance] } in all {
        let slow = if *slow { " (slow)" } else { "" };
        let place = format!("`{file}`, `{test}`{slow}");
        writeln!(page, "| {problem} | {source} | {tolerance} | {place} |").unwrap();
    }
    page
}

#[test]
fn the_table_lists_what_the_tests_assert() {
    let mut files = Vec::new();
    for part in CRATES.iter().flat_map(|part| [format!("{part}/src"), format!("{part}/tests")]) {
        sources(&root().join(part), &mut files);
    }
    files.sort();
    let mut all = Vec::new();
    for path in &files {
        let name = path.strip_prefix(root()).unwrap().to_string_lossy().into_owned();
        all.extend(problems(&name, &fs::read_to_string(path).unwrap()));
    }
    println!("{} verification problems", all.len());
    // None is left out: the crate with the last one in its tests.
    assert!(all.iter().any(|one| one.file.starts_with("pipeline/tests/")));
    assert!(all.len() >= WANTED, "{} problems", all.len());
    for one in &all {
        assert!(one.cells.iter().all(|cell| !cell.trim().is_empty()), "{}: {}", one.file, one.test);
    }
    let page = root().join("docs/verification-problems.md");
    if std::env::var_os("MAMMOTWIN_WRITE").is_some() {
        fs::write(&page, table(&all)).unwrap();
    }
    let written = fs::read_to_string(&page).unwrap_or_default();
    assert!(written == table(&all), "docs/verification-problems.md is old: MAMMOTWIN_WRITE=1");
}

#[test]
#[should_panic(expected = "no test follows")]
fn a_claim_without_a_test_is_refused() {
    problems("x.rs", "/// Verifies: a | b | c\nfn helper() {}\n");
}
