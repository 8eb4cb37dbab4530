//! `mammotwin run`: computes a study.

use super::{Opened, open};
use crate::{
    cli::{RunArguments, StudyArguments},
    display::{Display, say},
    graph,
    plausible::findings,
};
use mammotwin_data::{
    Failure,
    progress::Silent,
    store::{self, Drive, Entry, Options, Pass, Selection, State, Wait},
};
use std::{fs, path::PathBuf};

/// Computes a study, or says what it would compute.
pub fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let opened = open(&arguments.study)?;
    let options = options(arguments);
    if arguments.dry_run {
        let plan = plan(&opened, &options)?;
        tell!("{}", describe(&plan.entries, &plan.selection));
        return Ok(());
    }
    let pass = execute(&opened, &options)?;
    summarize(&opened, &pass.entries)
}

/// Makes the report, and what it needs.
pub fn report(arguments: &StudyArguments) -> Result<(), Failure> {
    let opened = open(arguments)?;
    let options = Options { until: vec!["report".into()], ..Options::default() };
    let pass = execute(&opened, &options)?;
    summarize(&opened, &pass.entries)
}

/// Prints what was computed, and the files that a person looks at.
pub fn summarize(opened: &Opened, entries: &[Entry]) -> Result<(), Failure> {
    let computed = entries.iter().filter(|entry| entry.computed).count();
    say(&format!("{computed} of {} stages computed", entries.len()));
    let out = &opened.store.out;
    let hidden = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with('.') || name == "cache"
    };
    let Ok(files) = fs::read_dir(out) else { return Ok(()) };
    let mut files: Vec<_> = files.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| !hidden(path));
    files.sort();
    files.iter().for_each(|path| say(&path.display().to_string()));
    Ok(())
}

/// Computes what the options ask for, with a display on standard error. Unless all is there
/// already, files that cannot be what the study says are refused before anything is written.
pub fn execute(opened: &Opened, options: &Options) -> Result<Pass<graph::Outcome>, Failure> {
    let fresh = |pass: &Pass<_>| pass.entries.iter().all(|entry| entry.state == State::Fresh);
    if !plan(opened, options).is_ok_and(|pass| fresh(&pass)) {
        opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    }
    let display = Display::new();
    let Opened { study, base, store, .. } = opened;
    let drive = Drive { store, base, options, listener: &display };
    store::execute(&drive, |run| graph::run(study, run))
}

/// Looks what is there; writes nothing.
pub fn plan(opened: &Opened, options: &Options) -> Result<Pass<graph::Outcome>, Failure> {
    let Opened { study, base, store, .. } = opened;
    let drive = Drive { store, base, options, listener: &Silent };
    store::plan(&drive, |run| graph::run(study, run))
}

fn options(arguments: &RunArguments) -> Options {
    let RunArguments { from, until, only, force, no_wait, .. } = arguments.clone();
    let wait = if no_wait { Wait::Refuse } else { Wait::Patient };
    Options { from, until, only, force, wait }
}

/// One line a stage: what a run would do.
fn describe(entries: &[Entry], selection: &Selection) -> String {
    let width = entries.iter().map(|entry| entry.instance.len()).max().unwrap_or(0);
    let line = |entry: &Entry| {
        let plan = match &entry.state {
            State::Edited { .. } => "keep: edited by hand".into(),
            _ if !selection.allows(&entry.instance) => format!("leave: {}", entry.state),
            _ if selection.anew.contains(&entry.instance) => "compute: asked for".into(),
            State::Fresh => "reuse".into(),
            State::Stale if entry.key.is_none() => "compute unless its inputs stay equal".into(),
            state => format!("compute: {state}"),
        };
        format!("{:width$}  {plan}", entry.instance)
    };
    entries.iter().map(line).collect::<Vec<_>>().join("\n")
}
