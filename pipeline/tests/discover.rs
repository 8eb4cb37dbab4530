//! `discover` on volunteers with and without a hidden effect: the smallest part of the benchmark.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{fs, process::Command};

/// Rows of `trials.csv` of a kind: verdict, ranked effects.
fn rows<'a>(table: &'a str, tier: &str) -> Vec<(&'a str, &'a str)> {
    let columns = |line: &'a str| line.split(',').collect::<Vec<_>>();
    let rows = table.lines().skip(1).map(columns).filter(|row| row[0] == tier);
    rows.map(|row| (row[4], row[5])).collect()
}

#[test]
fn a_hidden_limit_of_stretch_is_named_and_nothing_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .args(["study", "discovery", "--preset", "tiny", "--seeds", "3", "--draws", "12"])
        .args(["--effects", "limit_chain", "--sigmas", "10", "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let table = fs::read_to_string(folder.path().join("trials.csv")).unwrap();

    // One in a hundred is a false alarm by design; of 24, three or more would be 0.2 % chance.
    let null = rows(&table, "null");
    assert_eq!(null.len(), 24);
    let alarms = null.iter().filter(|(verdict, _)| *verdict != "no_discrepancy").count();
    assert!(alarms <= 2, "{alarms} of 24");

    let decoys = rows(&table, "decoy");
    let physics = |(verdict, _): &&(&str, &str)| matches!(*verdict, "named" | "ambiguous");
    assert!(decoys.iter().filter(physics).count() <= 1, "{decoys:?}");

    // At ten standard deviations all but a few are seen, and the best explanation is the truth.
    let hidden = rows(&table, "single");
    assert_eq!(hidden.len(), 12);
    let seen = hidden.iter().filter(|(verdict, _)| *verdict != "no_discrepancy").count();
    assert!(seen >= 11, "{seen} of 12");
    let right = hidden.iter().filter(|(_, ranked)| ranked.starts_with("limit_chain")).count();
    assert!(right >= 10, "{right} of 12: {hidden:?}");
    let page = fs::read_to_string(folder.path().join("discovery-benchmark.md")).unwrap();
    assert!(page.contains("| limit_chain | 10 |"));
}
