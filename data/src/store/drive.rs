//! Plans and executes a graph.

use super::{Entry, Event, Listener, Options, Run, Selection, Store, run::Mode};
use crate::Failure;
use std::{path::Path, sync::Mutex};

/// What a graph runs with.
#[derive(Clone, Copy)]
pub struct Drive<'a> {
    /// Where results are kept.
    pub store: &'a Store,
    /// Folder of the study.
    pub base: &'a Path,
    /// Which stages to compute.
    pub options: &'a Options,
    /// Who hears what happens.
    pub listener: &'a dyn Listener,
}

/// What a pass over the graph gave.
#[derive(Debug, Clone)]
pub struct Pass<R> {
    /// What the graph returned.
    pub outcome: R,
    /// The calls, in their order.
    pub entries: Vec<Entry>,
    /// What the options select.
    pub selection: Selection,
}

/// Looks what is fresh. Computes nothing and writes nothing; the output folder need not exist.
pub fn plan<R>(
    drive: &Drive<'_>,
    graph: impl Fn(&Run<'_>) -> Result<R, Failure>,
) -> Result<Pass<R>, Failure> {
    let (outcome, entries) = pass(drive, Mode::Plan, &Selection::default(), 0, &graph);
    let outcome = outcome?;
    let selection = drive.options.select(&entries)?;
    Ok(Pass { outcome, entries, selection })
}

/// Computes what the options ask for and what is not there.
///
/// A result that turns out to be damaged when it is read is computed anew.
pub fn execute<R>(
    drive: &Drive<'_>,
    graph: impl Fn(&Run<'_>) -> Result<R, Failure>,
) -> Result<Pass<R>, Failure> {
    let planned = plan(drive, &graph)?;
    let total = planned.entries.len();
    let mut selection = planned.selection;
    let mut chances = total;
    loop {
        let (outcome, entries) = pass(drive, Mode::Execute, &selection, total, &graph);
        drive.store.keep_hashes();
        let damaged = drive.store.hashes.take_damaged();
        match outcome {
            Err(failure) if !damaged.is_empty() && chances > 0 => {
                drive.listener.on(&Event::Damaged { what: "cache", why: &failure.to_string() });
                chances -= 1;
                // What was computed anew before the damage was met need not be once more.
                for entry in entries.iter().filter(|entry| entry.computed) {
                    selection.anew.remove(&entry.instance);
                }
            }
            done => return Ok(Pass { outcome: done?, entries, selection }),
        }
    }
}

fn pass<R>(
    drive: &Drive<'_>,
    mode: Mode,
    selection: &Selection,
    total: usize,
    graph: &impl Fn(&Run<'_>) -> Result<R, Failure>,
) -> (Result<R, Failure>, Vec<Entry>) {
    let Drive { store, base, options, listener } = *drive;
    let (selection, wait, entries) = (selection.clone(), options.wait, Mutex::default());
    let run = Run { store, base, mode, selection, wait, listener, entries, total };
    let outcome = graph(&run);
    let entries = std::mem::take(&mut *run.entries());
    (outcome, entries)
}
