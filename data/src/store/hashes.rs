//! Content hashes of files, remembered so that an unchanged file is not read again.
//!
//! A file counts as unchanged while its size, its time of change and its inode are the same.
//! A file that changed in the last two seconds is not remembered: some file systems cannot tell
//! two changes within that time apart. Paths are kept as hashes: a store says nothing about the
//! folders around it.

use crate::Failure;
use std::{
    collections::BTreeMap,
    fs::{self, File},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{Duration, SystemTime},
};

const RACY: Duration = Duration::from_secs(2);

/// When a file was seen, and what it held.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Seen {
    size: u64,
    changed_s: i64,
    changed_ns: i64,
    inode: u64,
    hash: String,
}

#[derive(Debug, Default)]
struct Memory {
    seen: BTreeMap<String, Seen>,
    news: bool,
    damaged: Vec<PathBuf>,
}

/// The hashes of one store.
#[derive(Debug)]
pub(super) struct Hashes {
    file: PathBuf,
    memory: Mutex<Memory>,
}

impl Hashes {
    /// Reads what earlier runs remembered; a missing or damaged file is an empty memory.
    pub fn open(file: PathBuf) -> Self {
        let text = fs::read(&file).unwrap_or_default();
        let seen = serde_json::from_slice(&text).unwrap_or_default();
        Self { file, memory: Mutex::new(Memory { seen, ..Memory::default() }) }
    }

    fn memory(&self) -> std::sync::MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hash of a file's content, from memory when the file did not change.
    pub fn hash(&self, path: &Path) -> Result<String, Failure> {
        let stat = fs::metadata(path).map_err(|cause| Failure::io(path, cause))?;
        let (changed_s, changed_ns) = (stat.mtime(), stat.mtime_nsec());
        let name = place_name(path);
        if let Some(seen) = self.memory().seen.get(&name)
            && (seen.size, seen.inode) == (stat.size(), stat.ino())
            && (seen.changed_s, seen.changed_ns) == (changed_s, changed_ns)
        {
            return Ok(seen.hash.clone());
        }
        let hash = hash_file(path)?;
        let age = stat.modified().ok().and_then(|then| SystemTime::now().duration_since(then).ok());
        if age.is_some_and(|age| age > RACY) {
            let (size, inode) = (stat.size(), stat.ino());
            let seen = Seen { size, changed_s, changed_ns, inode, hash: hash.clone() };
            let mut memory = self.memory();
            memory.seen.insert(name, seen);
            memory.news = true;
        }
        Ok(hash)
    }

    /// Hash of a file's content as it is now.
    pub fn hash_now(&self, path: &Path) -> Result<String, Failure> {
        hash_file(path)
    }

    /// Remembers that a file does not hold what was stored.
    pub fn damaged(&self, path: &Path) {
        let mut memory = self.memory();
        memory.seen.remove(&place_name(path));
        memory.damaged.push(path.to_owned());
        memory.news = true;
    }

    /// Files found damaged since the last call.
    pub fn take_damaged(&self) -> Vec<PathBuf> {
        std::mem::take(&mut self.memory().damaged)
    }

    /// Writes the memory aside and renames it; failing to is no harm.
    pub fn keep(&self) {
        let mut memory = self.memory();
        if !memory.news {
            return;
        }
        memory.news = false;
        let aside = self.file.with_extension(format!("part-{}", std::process::id()));
        let text = serde_json::to_vec(&memory.seen).unwrap_or_default();
        let kept = fs::write(&aside, text).and_then(|()| fs::rename(&aside, &self.file));
        if kept.is_err() {
            let _ = fs::remove_file(&aside);
        }
    }
}

fn place_name(path: &Path) -> String {
    let full = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    blake3::hash(full.as_os_str().as_encoded_bytes()).to_hex()[..32].to_owned()
}

/// BLAKE3 of a file's bytes, in hexadecimal.
pub(super) fn hash_file(path: &Path) -> Result<String, Failure> {
    let mut hasher = blake3::Hasher::new();
    let file = File::open(path).map_err(|cause| Failure::io(path, cause))?;
    hasher.update_reader(file).map_err(|cause| Failure::io(path, cause))?;
    Ok(hasher.finalize().to_hex().to_string())
}
