//! How a run ends when it does not end well.

use crate::study::StudyError;
use std::path::{Path, PathBuf};

/// A refusal that reaches the user as one line: what is wrong, where, and how to mend it.
///
/// Each variant has the exit code of `sysexits.h` that scripts expect.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The command line makes no sense (exit 2).
    #[error("{0}")]
    Usage(String),
    /// A file or a study key is missing, malformed or implausible (exit 65).
    #[error("{0}")]
    BadInput(String),
    /// A study file is refused (exit 65).
    #[error("{}: {error}", path.display())]
    Study {
        /// The study file.
        path: PathBuf,
        /// What is wrong in it.
        error: StudyError,
    },
    /// Physics or numerics refused; the last good state is kept (exit 70).
    #[error("{0}")]
    Numerics(String),
    /// Reading or writing failed (exit 74).
    #[error("{}: {cause}", path.display())]
    Io {
        /// File or folder that was touched.
        path: PathBuf,
        /// What the operating system or the file library said.
        cause: String,
    },
    /// Somebody else holds the lock (exit 75).
    #[error("{0}")]
    Busy(String),
}

impl Failure {
    /// Wraps an error of a file operation on `path`.
    pub fn io(path: impl AsRef<Path>, cause: impl std::fmt::Display) -> Self {
        Self::Io { path: path.as_ref().to_owned(), cause: cause.to_string() }
    }

    /// The line that is to blame, with a mark under the key, where there is one.
    pub fn excerpt(&self) -> Option<&str> {
        match self {
            Self::Study { error, .. } if !error.excerpt.is_empty() => Some(&error.excerpt),
            _ => None,
        }
    }

    /// Process exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::BadInput(_) | Self::Study { .. } => 65,
            Self::Numerics(_) => 70,
            Self::Io { .. } => 74,
            Self::Busy(_) => 75,
        }
    }

    /// The same failure with `context: ` before its text.
    pub fn within(self, context: &str) -> Self {
        match self {
            Self::Usage(text) => Self::Usage(format!("{context}: {text}")),
            Self::BadInput(text) => Self::BadInput(format!("{context}: {text}")),
            Self::Numerics(text) => Self::Numerics(format!("{context}: {text}")),
            Self::Busy(text) => Self::Busy(format!("{context}: {text}")),
            Self::Study { path, error } => {
                let text = format!("{} ({context})", error.text);
                Self::Study { path, error: StudyError { text, ..error } }
            }
            Self::Io { path, cause } => Self::Io { path, cause: format!("{cause} ({context})") },
        }
    }
}
