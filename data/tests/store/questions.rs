//! What the store answers: explain, collect.

use crate::toy::{Study, computed};
use mammotwin_data::store::{collect, explain, rubbish};
use std::fs;

fn changes(study: &Study, instance: &str) -> Vec<String> {
    let plan = study.plan();
    let explanation = explain(&study.store(), crate::toy::entry(&plan, instance));
    let changes = explanation.changes.expect("an earlier result");
    changes.iter().map(ToString::to_string).collect()
}

#[test]
fn explain_names_the_field_that_changed() {
    let mut study = Study::new();
    study.run();
    study.plan.separator = "--";
    assert_eq!(changes(&study, "join"), ["parameters.separator: \"+\" -> \"--\""]);
    let measure = changes(&study, "measure");
    assert_eq!(measure.len(), 1);
    assert!(measure[0].starts_with("inputs.0 (join): "), "{measure:?}");
    assert!(measure[0].ends_with(" -> not computed yet"), "{measure:?}");
    fs::write(study.file("supine.txt"), "aaac").unwrap();
    let segment = changes(&study, "segment:supine");
    assert_eq!(segment.len(), 1);
    assert!(segment[0].starts_with("inputs.0 (poses.supine.image): "), "{segment:?}");
    let join = changes(&study, "join");
    assert!(join[1].starts_with("inputs.0.1 (segment:supine): "), "{join:?}");
}

#[test]
fn collecting_drops_what_no_key_needs_and_nothing_else() {
    let mut study = Study::new();
    study.run();
    assert_eq!(rubbish(&study.store(), &study.plan().entries), []);
    let first = study.results();
    study.plan.separator = "--";
    // The measure's key is not known yet: its old result may turn out to be the right one.
    let entries = study.plan().entries;
    let found = rubbish(&study.store(), &entries);
    assert_eq!(found.len(), 1);
    assert!(found[0].path.to_str().unwrap().contains("/join/"));
    study.run();
    let entries = study.plan().entries;
    let dropped = collect(&study.store(), &entries).unwrap();
    assert_eq!(dropped.len(), 2);
    assert!(dropped.iter().all(|rubbish| rubbish.bytes > 0));
    assert_eq!(computed(&study.run()), [""; 0]);
    assert_eq!(study.results().len(), first.len());
}
