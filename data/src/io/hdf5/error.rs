//! Why an HDF5 file could not be written or read.

use crate::Failure;
use std::path::{Path, PathBuf};

/// Names the file, the dataset and the cause.
#[derive(Debug, thiserror::Error)]
pub enum Hdf5Error {
    /// The operating system or the HDF5 library refused.
    #[error("{}: {what}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        what: String,
        /// What the library said.
        cause: String,
    },
    /// There is no such dataset.
    #[error("{}: no dataset {name}; was it written by another version?", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// Path of the dataset.
        name: String,
    },
    /// A dataset has another shape or another type of number than is needed.
    #[error("{}: {name} is {found}, but {expected} is needed", path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// Path of the dataset.
        name: String,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// Values contradict each other; the file is damaged or was changed by hand.
    #[error("{}: {name}: {why}; the file is damaged, make it anew", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Path of the dataset or group.
        name: String,
        /// The contradiction.
        why: String,
    },
}

impl Hdf5Error {
    pub(super) fn io(path: &Path, what: &str, cause: ::hdf5::Error) -> Self {
        Self::Io { path: path.to_owned(), what: what.into(), cause: shortened(&cause.to_string()) }
    }

    pub(super) fn invalid(path: &Path, name: &str, why: impl std::fmt::Display) -> Self {
        Self::Invalid { path: path.to_owned(), name: name.into(), why: why.to_string() }
    }
}

impl From<Hdf5Error> for Failure {
    fn from(error: Hdf5Error) -> Self {
        match error {
            Hdf5Error::Io { path, what, cause } => Self::io(path, format!("{what}: {cause}")),
            other => Self::BadInput(other.to_string()),
        }
    }
}

/// The operating system's words when the library's text holds them, else the whole text.
fn shortened(cause: &str) -> String {
    let system = cause.split_once("error message = '").and_then(|(_, rest)| rest.split_once('\''));
    system.map_or(cause, |(words, _)| words).to_string()
}
