//! Stages, and the store that remembers what they made.
//!
//! The pipeline is one ordinary function whose calls are the graph: each call of [`Run::stage`]
//! finds the result of a [`Stage`] in the [`Store`], or computes it. The function is run twice:
//! once to [`plan`], where nothing is computed and what is not there yet is *pending*, and once to
//! [`execute`].
//!
//! A result is kept under its [`Key`]: the stage's name and version, its parameters, and the
//! *content* hashes (BLAKE3) of its inputs; never a path, a time or a number of threads. Equal
//! content ends a rebuild early.
//!
//! ```text
//! OUT/labels/prone.nii.gz                        copies that a person may edit
//! OUT/cache/segment/prone-0123456789abcdef/      one result
//!     result.nii.gz  key.json  record.json
//! OUT/cache/segment/prone-0123456789abcdef.lock         who computes it now
//! OUT/cache/segment/prone-0123456789abcdef.failed.json  why it could not be computed
//! ```

mod artifacts;
mod drive;
mod explain;
mod gc;
mod hashes;
mod inputs;
mod key;
mod lock;
mod options;
mod place;
mod publish;
mod record;
mod run;
mod stored;
mod verify;
mod visible;

pub use drive::{Drive, Pass, execute, plan};
pub use explain::{Change, Explanation, explain};
pub use gc::{Rubbish, collect, rubbish};
pub use inputs::{Inputs, Source};
pub use key::Key;
pub use lock::Wait;
pub use options::{Options, Selection};
pub use place::Store;
pub use record::{Notes, Record, peak_memory_bytes};
pub use run::{Entry, Event, Listener, Run, State};
pub use stored::Stored;
pub use verify::{Damage, verify};

use crate::{Failure, progress::Progress};
use serde::Serialize;
use std::path::Path;

/// A pure step: same parameters and inputs, same output. The struct's fields are its parameters.
///
/// A stage reads no clock, no environment and no file but its inputs.
pub trait Stage: Serialize + Sync {
    /// Folder in the store and word on the command line.
    const NAME: &'static str;
    /// Raise it when the code starts to give other numbers.
    const VERSION: u32;
    /// The sentence for the methods part of the report, with its citation.
    const METHODS: &'static str;
    /// What it reads: one artifact, or a tuple of them.
    type Input;
    /// What it makes.
    type Output: Artifact;

    /// Does the work.
    fn run(&self, input: &Self::Input, progress: &dyn Progress) -> Result<Self::Output, Failure>;
}

/// Anything a stage reads or makes, kept as one file.
pub trait Artifact: Sized {
    /// Ending of the file's name, without the dot: `json`, `h5`, `nii.gz`.
    const EXTENSION: &'static str;

    /// Writes the artifact to a new file. The same value gives the same bytes.
    /// The file is closed, and errors of closing are reported.
    fn save(&self, path: &Path) -> Result<(), Failure>;

    /// Reads what [`Artifact::save`] wrote.
    fn load(path: &Path) -> Result<Self, Failure>;
}
