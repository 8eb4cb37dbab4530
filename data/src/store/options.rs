//! Which stages of a study a run computes.
//!
//! | option      | computed anew though fresh | computed where missing          | left alone      |
//! |-------------|----------------------------|---------------------------------|-----------------|
//! | (none)      |                            | all                             |                 |
//! | `--force S` | S                          | all                             |                 |
//! | `--from S`  | S and all that follows it  | all                             |                 |
//! | `--until S` |                            | S and all that it needs         | everything else |
//! | `--only S`  | S                          | nothing: what S needs must be there | everything else |
//!
//! `S` is a stage (`segment`: all its instances) or an instance (`segment:prone`). *Follows* and
//! *needs* are taken from the graph, not from the order of the calls. `--from`, `--until` and
//! `--force` combine. A result that was edited by hand is never computed anew.

use super::{Entry, State, Wait};
use crate::Failure;
use std::collections::BTreeSet;

/// What the command line asks for; each list holds stages or instances.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Compute these and all that follow them anew.
    pub from: Vec<String>,
    /// Stop after these.
    pub until: Vec<String>,
    /// Compute these alone.
    pub only: Vec<String>,
    /// Compute these anew.
    pub force: Vec<String>,
    /// What to do when another process computes the same result.
    pub wait: Wait,
}

/// The instances that the options select.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Computed anew though fresh.
    pub anew: BTreeSet<String>,
    /// Computed when missing; `None` for all.
    pub allowed: Option<BTreeSet<String>>,
}

impl Selection {
    /// Whether an instance may be computed.
    pub fn allows(&self, instance: &str) -> bool {
        self.allowed.as_ref().is_none_or(|allowed| allowed.contains(instance))
    }
}

impl Options {
    /// The instances of a planned graph that these options select.
    pub fn select(&self, entries: &[Entry]) -> Result<Selection, Failure> {
        let named = |names: &[String]| named(names, entries);
        let mut selection = Selection { anew: named(&self.force)?, allowed: None };
        selection.anew.extend(downstream(named(&self.from)?, entries));
        if !self.until.is_empty() {
            selection.allowed = Some(upstream(named(&self.until)?, entries));
        }
        if !self.only.is_empty() {
            let only = named(&self.only)?;
            refuse_missing_inputs(&only, entries)?;
            selection.anew.extend(only.iter().cloned());
            selection.allowed = Some(only);
        }
        if let Some(allowed) = &selection.allowed {
            selection.anew.retain(|instance| allowed.contains(instance));
        }
        Ok(selection)
    }
}

fn named(names: &[String], entries: &[Entry]) -> Result<BTreeSet<String>, Failure> {
    let mut found = BTreeSet::new();
    for name in names {
        let hits = entries.iter().filter(|entry| entry.stage == *name || entry.instance == *name);
        let hits: Vec<_> = hits.map(|entry| entry.instance.clone()).collect();
        if hits.is_empty() {
            let known: Vec<_> = entries.iter().map(|entry| entry.instance.as_str()).collect();
            let text = format!("no stage {name:?} in this study; there are: {}", known.join(", "));
            return Err(Failure::Usage(text));
        }
        found.extend(hits);
    }
    Ok(found)
}

/// `start` and everything that reads it, directly or not.
fn downstream(start: BTreeSet<String>, entries: &[Entry]) -> BTreeSet<String> {
    let mut found = start;
    // A stage is called after what it needs: one pass in the order of the calls is enough.
    for entry in entries {
        if entry.needs.iter().any(|need| found.contains(need)) {
            found.insert(entry.instance.clone());
        }
    }
    found
}

/// `start` and everything that it reads, directly or not.
fn upstream(start: BTreeSet<String>, entries: &[Entry]) -> BTreeSet<String> {
    let mut found = start;
    for entry in entries.iter().rev() {
        if found.contains(&entry.instance) {
            found.extend(entry.needs.iter().cloned());
        }
    }
    found
}

fn refuse_missing_inputs(only: &BTreeSet<String>, entries: &[Entry]) -> Result<(), Failure> {
    let needed = upstream(only.clone(), entries);
    let lacking = entries.iter().find(|entry| {
        needed.contains(&entry.instance)
            && !only.contains(&entry.instance)
            && !matches!(entry.state, State::Fresh | State::Edited { .. })
    });
    match lacking {
        None => Ok(()),
        Some(entry) => Err(Failure::Usage(format!(
            "--only needs {}, which is {}; use --until, which computes it too",
            entry.instance, entry.state
        ))),
    }
}
