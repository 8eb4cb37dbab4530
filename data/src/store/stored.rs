//! A handle on a file that a stage made or a person gave.

use super::{Artifact, hashes::Hashes};
use crate::Failure;
use std::{
    marker::PhantomData,
    path::{Path, PathBuf},
    sync::Arc,
};

/// A handle on an artifact, loaded when asked.
pub struct Stored<T> {
    /// `segment:prone` for the result of a stage; the study key for a file that a person gave.
    pub name: String,
    /// The file. A pending result has none yet.
    pub path: PathBuf,
    /// Whether this run found it instead of making it.
    pub reused: bool,
    content: Option<String>,
    hashes: Arc<Hashes>,
    kind: PhantomData<fn() -> T>,
}

impl<T> Clone for Stored<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            path: self.path.clone(),
            reused: self.reused,
            content: self.content.clone(),
            hashes: self.hashes.clone(),
            kind: PhantomData,
        }
    }
}

impl<T> std::fmt::Debug for Stored<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let content = self.content.as_deref().unwrap_or("pending");
        write!(f, "Stored({} {content} {})", self.name, self.path.display())
    }
}

impl<T> Stored<T> {
    pub(super) fn pending(name: &str, hashes: &Arc<Hashes>) -> Self {
        Self {
            name: name.into(),
            path: PathBuf::new(),
            reused: false,
            content: None,
            hashes: hashes.clone(),
            kind: PhantomData,
        }
    }

    pub(super) fn known(name: &str, path: &Path, content: &str, hashes: &Arc<Hashes>) -> Self {
        Self {
            path: path.to_owned(),
            reused: true,
            content: Some(content.into()),
            ..Self::pending(name, hashes)
        }
    }

    /// BLAKE3 of the file's bytes, in hexadecimal; `None` while the result is pending.
    pub fn content(&self) -> Option<&str> {
        self.content.as_deref()
    }

    /// Whether it is not computed yet: in a plan, or left out by `--until` and `--only`.
    pub fn is_pending(&self) -> bool {
        self.content.is_none()
    }
}

impl<T: Artifact> Stored<T> {
    /// Reads the file, after a check that its bytes are still those that were stored.
    ///
    /// A damaged result is remembered, so that the run computes it anew.
    pub fn load(&self) -> Result<T, Failure> {
        let Some(content) = &self.content else {
            let text = format!("{}: not computed yet; run the study without --until", self.name);
            return Err(Failure::Usage(text));
        };
        if self.hashes.hash_now(&self.path)? != *content {
            self.hashes.damaged(&self.path);
            let cause = format!("the bytes of {} changed since they were stored", self.name);
            return Err(Failure::io(&self.path, cause));
        }
        T::load(&self.path).map_err(|failure| failure.within(&self.name))
    }
}
