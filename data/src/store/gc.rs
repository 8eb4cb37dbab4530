//! Drops results that no current key needs.
//!
//! Kept are: the results of all current keys; results of an instance whose key is not known yet,
//! since one of its inputs is pending; and whatever a process is at work on. Copies that a person
//! may edit are not in the cache and never dropped. One output folder serves one study.

use super::{Entry, Store, lock, place::label_of, verify::stage_folders};
use crate::Failure;
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// Something in the cache that nobody needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rubbish {
    /// File or folder.
    pub path: PathBuf,
    /// Its size (bytes).
    pub bytes: u64,
}

/// What is not needed by a planned graph. Deletes nothing.
pub fn rubbish(store: &Store, entries: &[Entry]) -> Vec<Rubbish> {
    let needed = Needed::of(store, entries);
    let mut found = Vec::new();
    for stage in stage_folders(store) {
        let mut paths: Vec<_> =
            fs::read_dir(&stage).into_iter().flatten().flatten().map(|e| e.path()).collect();
        paths.sort();
        paths.retain(|path| !needed.keeps(&stage, path));
        found.extend(paths.into_iter().map(|path| Rubbish { bytes: size(&path), path }));
    }
    found
}

/// Deletes what is not needed by a planned graph.
pub fn collect(store: &Store, entries: &[Entry]) -> Result<Vec<Rubbish>, Failure> {
    let found = rubbish(store, entries);
    for Rubbish { path, .. } in &found {
        let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        removed.map_err(|cause| Failure::io(path, cause))?;
    }
    Ok(found)
}

struct Needed {
    /// Folders of current results.
    slots: BTreeSet<PathBuf>,
    /// Stage and label of instances whose key is not known yet.
    open: BTreeSet<(String, String)>,
}

impl Needed {
    fn of(store: &Store, entries: &[Entry]) -> Self {
        let mut needed = Self { slots: BTreeSet::new(), open: BTreeSet::new() };
        for entry in entries {
            match &entry.key {
                Some(key) => {
                    needed.slots.insert(store.slot(&entry.stage, &entry.label, key).folder);
                }
                None => {
                    needed.open.insert((entry.stage.clone(), entry.label.clone()));
                }
            }
        }
        needed
    }

    fn keeps(&self, stage: &Path, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        // A label may have dots; the ending of a companion is known.
        let endings = [".lock", ".failed.json", ".part", ".replaced"];
        let ending = endings.into_iter().find(|ending| name.ends_with(ending));
        let folder = stage.join(name.strip_suffix(ending.unwrap_or("")).unwrap_or(&name));
        let mut lock_file = folder.clone().into_os_string();
        lock_file.push(".lock");
        if lock::holder(Path::new(&lock_file)).is_some() {
            return true;
        }
        let current = match ending {
            Some(".failed.json") | None => self.slots.contains(&folder),
            _ => false,
        };
        let stage = stage.file_name().unwrap_or_default().to_string_lossy();
        let open = label_of(path)
            .is_some_and(|label| self.open.contains(&(stage.to_string(), label.to_owned())));
        current || open
    }
}

fn size(path: &Path) -> u64 {
    if !path.is_dir() || path.is_symlink() {
        return fs::symlink_metadata(path).map_or(0, |stat| stat.len());
    }
    fs::read_dir(path).into_iter().flatten().flatten().map(|entry| size(&entry.path())).sum()
}
