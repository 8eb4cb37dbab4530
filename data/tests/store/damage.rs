//! Damaged and half-written results.

use crate::toy::{Study, computed, entry};
use mammotwin_data::{
    Failure,
    progress::Silent,
    store::{State, verify},
};
use std::{
    fs::{self, File},
    path::Path,
    time::{Duration, SystemTime},
};

fn flip(path: &Path, bit: usize) {
    let mut bytes = fs::read(path).unwrap();
    let at = bit % (8 * bytes.len());
    bytes[at / 8] ^= 1 << (at % 8);
    fs::write(path, bytes).unwrap();
}

#[test]
fn every_one_of_fifty_flipped_bits_is_found_and_mended() {
    let study = Study::new();
    study.run();
    let good = study.results();
    let files = study.files();
    assert_eq!(files.len(), 12, "result, key and record of four stages: {files:?}");
    for n in 0..50 {
        let path = &files[n * 7 % files.len()];
        flip(path, n * 7919);
        let (count, damages) = verify(&study.store());
        assert_eq!((count, damages.len()), (4, 1), "flip {n} of {}", path.display());
        assert!(path.starts_with(&damages[0].folder));
        let damaged =
            study.plan().entries.into_iter().find(|entry| matches!(entry.state, State::Damaged(_)));
        let instance = damaged.expect("the plan sees the damage").instance;
        assert_eq!(computed(&study.run()), [instance.as_str()]);
        assert_eq!(study.results(), good, "flip {n} of {}", path.display());
    }
}

#[test]
fn a_result_is_checked_when_it_is_read_although_its_file_looks_unchanged() {
    let mut study = Study::new();
    study.run();
    let path = study
        .files()
        .into_iter()
        .find(|p| p.to_str().unwrap().contains("prone") && p.ends_with("result.txt"))
        .unwrap();
    // Old enough to be remembered by its time of change.
    let then = SystemTime::now() - Duration::from_secs(3600);
    let age = || File::options().write(true).open(&path).unwrap().set_modified(then).unwrap();
    age();
    study.run();
    flip(&path, 1);
    age();
    assert_eq!(entry(&study.plan(), "segment:prone").state, State::Fresh, "not read, not noticed");
    study.plan.separator = "--";
    let mended = study.run();
    assert_eq!(mended.outcome.load().unwrap().0, "10");
    assert_eq!(verify(&study.store()).1, []);
}

#[test]
fn a_truncated_or_missing_part_of_a_result_is_recomputed() {
    let study = Study::new();
    study.run();
    let good = study.results();
    for path in study.files() {
        fs::write(&path, "").unwrap();
        study.run();
        assert_eq!(study.results(), good);
        fs::remove_file(&path).unwrap();
        study.run();
        assert_eq!(study.results(), good);
    }
}

#[test]
fn a_full_disk_publishes_nothing() {
    let mut study = Study::new();
    fs::write(study.file("prone.txt"), "xyz!bc").unwrap();
    study.plan.threshold = '!';
    let failure = study.run_with(&Silent).unwrap_err();
    assert!(matches!(failure, Failure::Io { .. }) && failure.exit_code() == 74, "{failure}");
    assert_eq!(study.results().len(), 0);
    let left = study.files();
    assert!(left.iter().all(|p| p.to_str().unwrap().ends_with(".failed.json")), "{left:?}");
}

#[test]
fn a_failed_stage_says_why_until_it_succeeds() {
    let mut study = Study::new();
    study.plan.refuse = 9;
    let failure = study.run_with(&Silent).unwrap_err();
    assert_eq!(
        (failure.to_string().as_str(), failure.exit_code()),
        ("measure: an unlucky length", 70)
    );
    let plan = study.plan();
    assert_eq!(entry(&plan, "measure").state, State::Failed("measure: an unlucky length".into()));
    assert_eq!(entry(&plan, "join").state, State::Fresh);
    study.plan.refuse = 8;
    assert_eq!(computed(&study.run()), ["measure"]);
}
