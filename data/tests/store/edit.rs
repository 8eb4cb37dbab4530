//! Files that a person edits.

use crate::toy::{Study, computed, entry};
use mammotwin_data::store::State;
use std::fs;

#[test]
fn an_edited_copy_replaces_the_result_and_survives() {
    let mut study = Study::new();
    assert_eq!(study.run().outcome.load().unwrap().0, "9");
    let labels = study.file("out/labels/prone.txt");
    assert_eq!(fs::read_to_string(&labels).unwrap(), "bcbc");
    fs::write(&labels, "bcb").unwrap();

    let state = |inputs_changed| State::Edited { path: labels.clone(), inputs_changed };
    assert_eq!(entry(&study.plan(), "segment:prone").state, state(false));
    let pass = study.run();
    assert_eq!(computed(&pass), ["join", "measure"]);
    assert_eq!(pass.outcome.load().unwrap().0, "8");
    let content = entry(&pass, "segment:prone").record.as_ref().map(|r| r.content.as_str());
    assert_eq!(content, entry(&pass, "join").sources[0].content.as_deref());

    study.options.force = ["segment", "join", "measure"].map(String::from).to_vec();
    assert_eq!(computed(&study.run()), ["segment:supine", "join", "measure"]);
    assert_eq!(fs::read_to_string(&labels).unwrap(), "bcb");

    // Another threshold would give other labels; the edited ones stay, and it is said.
    study.plan.threshold = 'c';
    study.options.force.clear();
    assert_eq!(computed(&study.run()), ["segment:supine", "join", "measure"]);
    assert_eq!(entry(&study.plan(), "segment:prone").state, state(true));
    assert_eq!(fs::read_to_string(&labels).unwrap(), "bcb");

    fs::remove_file(&labels).unwrap();
    assert_eq!(computed(&study.run()), ["segment:prone", "join", "measure"]);
    assert_eq!(fs::read_to_string(&labels).unwrap(), "cc");
}

#[test]
fn an_untouched_copy_follows_the_result() {
    let mut study = Study::new();
    study.run();
    study.plan.threshold = 'c';
    study.run();
    assert_eq!(fs::read_to_string(study.file("out/labels/prone.txt")).unwrap(), "cc");
    study.plan.threshold = 'b';
    study.run();
    assert_eq!(fs::read_to_string(study.file("out/labels/prone.txt")).unwrap(), "bcbc");
    assert_eq!(fs::read_to_string(study.file("out/joined.txt")).unwrap(), "bcbc+bbcc");
}

#[test]
fn without_its_ledger_an_unknown_copy_counts_as_edited() {
    let mut study = Study::new();
    study.run();
    fs::remove_file(study.file("out/.written.json")).unwrap();
    study.plan.threshold = 'c';
    study.run();
    assert_eq!(fs::read_to_string(study.file("out/labels/prone.txt")).unwrap(), "bcbc");
}

#[test]
fn an_exported_file_that_was_changed_is_left() {
    let mut study = Study::new();
    study.run();
    fs::write(study.file("out/joined.txt"), "mine").unwrap();
    study.plan.separator = "--";
    study.run();
    assert_eq!(fs::read_to_string(study.file("out/joined.txt")).unwrap(), "mine");
}
