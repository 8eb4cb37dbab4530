//! Which stages the options select.

use crate::toy::{Study, computed, entry};
use mammotwin_data::{Failure, progress::Silent, store::State};

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| name.to_string()).collect()
}

#[test]
fn force_computes_one_stage_anew() {
    let mut study = Study::new();
    study.run();
    study.options.force = names(&["segment:prone"]);
    assert_eq!(computed(&study.run()), ["segment:prone"]);
    study.options.force = names(&["segment"]);
    assert_eq!(computed(&study.run()), ["segment:prone", "segment:supine"]);
}

#[test]
fn from_computes_a_stage_and_what_follows_anew() {
    let mut study = Study::new();
    study.run();
    study.options.from = names(&["segment:supine"]);
    assert_eq!(computed(&study.run()), ["segment:supine", "join", "measure"]);
    study.options.until = names(&["join"]);
    assert_eq!(computed(&study.run()), ["segment:supine", "join"]);
}

#[test]
fn until_stops_after_a_stage_and_needs_no_other() {
    let mut study = Study::new();
    study.options.until = names(&["segment:supine"]);
    let pass = study.run();
    assert_eq!(computed(&pass), ["segment:supine"]);
    assert_eq!(entry(&pass, "segment:prone").state, State::Missing);
    assert!(pass.outcome.is_pending());
    study.options.until = names(&["join"]);
    assert_eq!(computed(&study.run()), ["segment:prone", "join"]);
}

#[test]
fn only_refuses_to_compute_what_the_stage_needs() {
    let mut study = Study::new();
    study.options.only = names(&["join"]);
    let failure = study.run_with(&Silent).unwrap_err();
    assert!(matches!(failure, Failure::Usage(_)), "{failure}");
    assert!(failure.to_string().contains("segment:prone, which is missing"), "{failure}");
    assert_eq!(study.results().len(), 0);
    study.options.only.clear();
    study.run();
    study.options.only = names(&["join"]);
    assert_eq!(computed(&study.run()), ["join"]);
}

#[test]
fn an_unknown_stage_is_refused_with_the_known_ones() {
    let mut study = Study::new();
    study.options.from = names(&["mesh"]);
    let text = study.run_with(&Silent).unwrap_err().to_string();
    assert!(text.contains("\"mesh\"") && text.contains("segment:prone, segment:supine, join"));
    assert!(!study.file("out").exists());
}
