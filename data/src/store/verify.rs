//! Reads everything in a store again and compares it with what was noted.

use super::{
    Store,
    hashes::hash_file,
    place::{read_record, result_folders},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// A result that does not hold what was stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Folder of the result.
    pub folder: PathBuf,
    /// What is wrong.
    pub why: String,
}

/// Reads all results. Returns how many there are, and which are damaged.
pub fn verify(store: &Store) -> (usize, Vec<Damage>) {
    let folders: Vec<_> = stage_folders(store).iter().flat_map(|f| result_folders(f)).collect();
    let mut damages = Vec::new();
    for folder in &folders {
        if let Some(why) = damage(folder) {
            damages.push(Damage { folder: folder.clone(), why });
        }
    }
    (folders.len(), damages)
}

/// Folders of stages, in the order of their names.
pub(super) fn stage_folders(store: &Store) -> Vec<PathBuf> {
    let entries = fs::read_dir(store.cache()).into_iter().flatten().flatten();
    let mut folders: Vec<_> = entries.map(|e| e.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

fn damage(folder: &Path) -> Option<String> {
    let Some(record) = read_record(folder) else { return Some("record.json is damaged".into()) };
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    match hash_file(&folder.join("key.json")) {
        Err(failure) => return Some(failure.to_string()),
        Ok(digest) if !name.ends_with(&digest[..16]) => {
            return Some("key.json is damaged".into());
        }
        Ok(_) => {}
    }
    match hash_file(&folder.join(&record.file)) {
        Err(failure) => Some(failure.to_string()),
        Ok(content) if content != record.content => Some(format!("{} is damaged", record.file)),
        Ok(_) => None,
    }
}
