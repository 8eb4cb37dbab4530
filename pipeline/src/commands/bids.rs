//! `mammotwin bids`: a BIDS App.

use super::{open, run};
use crate::{
    bids::{DEFAULT_TEMPLATE, dataset, derivatives, derivatives::Status, group},
    cli::{BidsArguments, BidsLevel, StudyArguments, one_line},
    display::say,
};
use mammotwin_data::{
    Failure,
    store::{Options, State},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Computes participants, or gathers them.
pub fn bids(arguments: &BidsArguments) -> Result<(), Failure> {
    let BidsArguments { bids_dir, out_dir, participant_label, .. } = arguments;
    let labels = dataset::labels(bids_dir, participant_label)?;
    if arguments.level == BidsLevel::Group {
        group::gather(out_dir, &labels)?;
        say(&out_dir.join("group.html").display().to_string());
        return Ok(());
    }
    let template = match &arguments.template {
        None => (PathBuf::from("template"), DEFAULT_TEMPLATE.to_owned()),
        Some(path) => {
            let text = fs::read_to_string(path).map_err(|cause| Failure::io(path, cause))?;
            (path.clone(), text)
        }
    };
    fs::create_dir_all(out_dir).map_err(|cause| Failure::io(out_dir, cause))?;
    derivatives::describe(out_dir, bids_dir)?;
    let work = arguments.work_dir.clone().unwrap_or_else(|| out_dir.join("work"));
    // One participant who cannot be computed does not keep the others.
    let (mut first, mut failed): (Option<Failure>, Vec<&str>) = (None, Vec::new());
    for label in &labels {
        say(&format!("sub-{label}"));
        let status = match participant(arguments, label, (&template.0, &template.1), &work) {
            Ok(()) => Status::Done,
            Err(failure) => {
                let message = one_line(&failure.to_string());
                eprintln!("sub-{label}: {message}");
                first.get_or_insert(failure);
                failed.push(label);
                Status::Failed { message }
            }
        };
        derivatives::note(out_dir, label, &status)?;
    }
    let Some(first) = first else { return Ok(()) };
    let (count, all) = (failed.len(), labels.len());
    Err(first.within(&format!("{count} of {all} participants failed: {}", failed.join(", "))))
}

fn participant(
    arguments: &BidsArguments,
    label: &str,
    template: (&Path, &str),
    work: &Path,
) -> Result<(), Failure> {
    let found = dataset::participant(&arguments.bids_dir, label)?;
    let folder = work.join(format!("sub-{label}"));
    let study = dataset::write_study(&found, template, &folder)?;
    let opened = open(&StudyArguments { study, out: None })?;
    let pass = run::execute(&opened, &Options::default())?;
    let edited = pass.entries.iter().filter(|entry| matches!(entry.state, State::Edited { .. }));
    let edited: Vec<String> = edited.map(|entry| entry.label.clone()).collect();
    derivatives::publish(&opened.store.out, &arguments.out_dir, &found, &edited)
}
