//! Several processes on one study, and processes that are killed.

use crate::toy::{Study, computed};
use mammotwin_data::{
    progress::Silent,
    store::{Drive, Options, State, Store, Wait, execute},
};
use std::{
    fs,
    path::PathBuf,
    process::{Child, Command, Stdio},
    thread,
    time::Instant,
};

/// Not a test of its own: what the other processes of the tests below do.
#[test]
fn child() {
    let Some(base) = std::env::var_os("TOY_STUDY").map(PathBuf::from) else { return };
    let (store, options) = (Store::open(&base.join("out")), Options::default());
    let drive = Drive { store: &store, base: &base, options: &options, listener: &Silent };
    let pass = execute(&drive, |run| crate::toy::graph(&Default::default(), run)).unwrap();
    for instance in computed(&pass) {
        println!("\ncomputed {instance}");
    }
}

fn spawn(study: &Study) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "process::child", "--nocapture"])
        .env("TOY_STUDY", study.folder.path())
        .env("TOY_SLOW", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn long_study() -> Study {
    let study = Study::new();
    fs::write(study.file("prone.txt"), "abc".repeat(15)).unwrap();
    fs::write(study.file("supine.txt"), "cba".repeat(15)).unwrap();
    study
}

#[test]
fn a_killed_process_leaves_nothing_that_the_next_one_trusts() {
    let whole = long_study();
    whole.run();
    let clock = Instant::now();
    assert!(spawn(&long_study()).wait().unwrap().success());
    let duration = clock.elapsed();

    let mut torn = 0;
    for n in 0..25 {
        let study = long_study();
        let mut child = spawn(&study);
        thread::sleep(duration.mul_f64(f64::from(n * 7 % 25) / 25.0));
        child.kill().unwrap();
        child.wait().unwrap();
        torn += usize::from(study.files().iter().any(|p| p.to_str().unwrap().contains(".part/")));
        study.run();
        assert_eq!(study.results(), whole.results(), "killed at moment {n}");
        assert!(study.files().iter().all(|p| !p.to_str().unwrap().contains(".part/")));
    }
    assert!(torn >= 3, "only {torn} of 25 kills hit a process that was writing");
}

#[test]
fn concurrent_processes_compute_each_result_once() {
    let study = long_study();
    let children: Vec<_> = (0..4).map(|_| spawn(&study)).collect();
    let mut all = Vec::new();
    for child in children {
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success());
        let text = String::from_utf8(output.stdout).unwrap();
        all.extend(text.lines().filter_map(|l| Some(l.strip_prefix("computed ")?.to_owned())));
    }
    all.sort();
    assert_eq!(all, ["join", "measure", "segment:prone", "segment:supine"]);
    assert!(study.files().iter().all(|path| path.extension().unwrap() != "lock"));
}

#[test]
fn a_busy_result_is_seen_and_can_be_refused() {
    let mut study = long_study();
    let mut child = spawn(&study);
    let holder = loop {
        let states = study.plan().entries.into_iter().map(|entry| entry.state);
        if let Some(State::Running(holder)) = states.into_iter().next() {
            break holder;
        }
        assert!(child.try_wait().unwrap().is_none(), "the child was never seen at work");
    };
    assert!(holder.contains(&format!("process {} on ", child.id())), "{holder}");
    study.options.wait = Wait::Refuse;
    let failure = study.run_with(&Silent).unwrap_err();
    assert_eq!(failure.exit_code(), 75, "{failure}");
    assert!(failure.to_string().contains(&child.id().to_string()), "{failure}");
    child.kill().unwrap();
    child.wait().unwrap();
    study.run();
}
