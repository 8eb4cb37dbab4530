//! What is computed again, and what is not.

use crate::toy::{Study, computed, entry};
use mammotwin_data::store::{Event, Listener, State};
use std::{fs, sync::Mutex};

const ALL: [&str; 4] = ["segment:prone", "segment:supine", "join", "measure"];

#[test]
fn equal_keys_are_computed_once() {
    let study = Study::new();
    let first = study.run();
    assert_eq!(computed(&first), ALL);
    assert_eq!(first.outcome.load().unwrap().0, "9");
    let second = study.run();
    assert_eq!(computed(&second), [""; 0]);
    assert_eq!(second.outcome.content(), first.outcome.content());
    assert!(second.outcome.reused && !first.outcome.reused);
}

#[test]
fn a_changed_parameter_reruns_its_stage_and_what_follows() {
    let mut study = Study::new();
    study.run();
    study.plan.separator = "--";
    assert_eq!(computed(&study.run()), ["join", "measure"]);
    study.plan.refuse = 999;
    assert_eq!(computed(&study.run()), ["measure"]);
}

#[test]
fn equal_content_ends_a_rebuild_early() {
    let study = Study::new();
    study.run();
    // A scan that differs only below the threshold gives the same labels.
    fs::write(study.file("prone.txt"), "aaabcabcaa").unwrap();
    assert_eq!(computed(&study.run()), ["segment:prone"]);
}

#[test]
fn moving_the_folder_reruns_nothing() {
    let mut study = Study::new();
    study.run();
    let moved = tempfile::tempdir().unwrap();
    fs::remove_dir(moved.path()).unwrap();
    fs::rename(study.folder.path(), moved.path()).unwrap();
    study.folder = moved;
    assert_eq!(computed(&study.run()), [""; 0]);
}

#[test]
fn a_plan_writes_nothing_and_knows_what_is_pending() {
    let mut study = Study::new();
    let plan = study.plan();
    assert!(!study.file("out").exists());
    assert!(plan.entries.iter().all(|entry| entry.state == State::Missing));
    assert!(plan.outcome.is_pending());
    study.run();
    study.plan.separator = "--";
    let plan = study.plan();
    assert_eq!(entry(&plan, "segment:prone").state, State::Fresh);
    assert_eq!(entry(&plan, "join").state, State::Stale);
    assert_eq!(
        (entry(&plan, "measure").key.clone(), &entry(&plan, "measure").state),
        (None, &State::Stale)
    );
}

/// What stages warned of.
#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Listener for Warnings {
    fn on(&self, event: &Event<'_>) {
        if let Event::Warned { instance, warning } = event {
            self.0.lock().unwrap().push(format!("{instance}: {warning}"));
        }
    }
}

#[test]
fn what_a_stage_warns_of_stays_with_its_result() {
    let study = Study::new();
    let told = || {
        let heard = Warnings::default();
        study.run_with(&heard).unwrap();
        heard.0.into_inner().unwrap()
    };
    fs::write(study.file("prone.txt"), "abcz").unwrap();
    assert_eq!(told(), ["segment:prone: a z"]);
    assert_eq!(told(), ["segment:prone: a z"], "nothing was computed");
    let notes = entry(&study.plan(), "segment:prone").record.as_ref().unwrap().notes.clone();
    assert_eq!((notes.warnings, notes.values["letters"]), (vec!["a z".to_owned()], 4.0));
    fs::write(study.file("prone.txt"), "abc").unwrap();
    assert_eq!(told(), [""; 0]);
}
