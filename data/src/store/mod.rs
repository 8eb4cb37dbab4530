//! Stages, and the store that remembers what they made.

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
