//! How a result becomes visible: wholly or not at all.
//!
//! It is written aside and closed, opened again, forced to disk, and renamed. A process that is
//! killed anywhere on the way leaves a folder that nobody takes for a result.

use super::{
    Artifact, Key, Notes, Record,
    hashes::hash_file,
    place::Slot,
    record::{FailedRecord, now_ms},
};
use crate::Failure;
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::Write,
    path::Path,
};

/// What the computation cost, from what, and what it says.
pub(super) struct Cost {
    pub wall_ms: u64,
    pub peak_memory_bytes: u64,
    pub inputs: BTreeMap<String, String>,
    pub notes: Notes,
}

/// Publishes `output` in `slot`; the caller holds the lock of the slot.
pub(super) fn publish<T: Artifact>(
    slot: &Slot,
    key: &Key,
    output: &T,
    cost: Cost,
) -> Result<Record, Failure> {
    let part = slot.part();
    let published = write_aside(&part, key, output, cost).and_then(|record| {
        swap_in(&part, slot).map_err(|cause| Failure::io(&slot.folder, cause))?;
        Ok(record)
    });
    if published.is_err() {
        let _ = fs::remove_dir_all(&part);
    }
    published
}

fn write_aside<T: Artifact>(
    part: &Path,
    key: &Key,
    output: &T,
    cost: Cost,
) -> Result<Record, Failure> {
    let failed = |cause| Failure::io(part, cause);
    remove_leftover(part).map_err(failed)?;
    fs::create_dir_all(part).map_err(failed)?;
    let file = format!("result.{}", T::EXTENSION);
    let path = part.join(&file);
    output.save(&path)?;
    T::load(&path).map_err(|failure| failure.within("written, but not readable"))?;
    let sync = |path: &Path| File::open(path).and_then(|f| f.sync_all());
    sync(&path).map_err(failed)?;
    let record = Record {
        bytes: fs::metadata(&path).map_err(failed)?.len(),
        content: hash_file(&path)?,
        file,
        wall_ms: cost.wall_ms,
        peak_memory_bytes: cost.peak_memory_bytes,
        finished_unix_ms: now_ms(),
        inputs: cost.inputs,
        notes: cost.notes,
        check: String::new(),
    };
    write_synced(&part.join("key.json"), key.text.as_bytes()).map_err(failed)?;
    write_synced(&part.join("record.json"), record.text().as_bytes()).map_err(failed)?;
    sync(part).map_err(failed)?;
    Ok(record)
}

/// Renames the folder into its place; what lies there goes.
fn swap_in(part: &Path, slot: &Slot) -> std::io::Result<()> {
    let replaced = slot.replaced();
    remove_leftover(&replaced)?;
    if slot.folder.exists() {
        fs::rename(&slot.folder, &replaced)?;
    }
    fs::rename(part, &slot.folder)?;
    if let Some(stage) = slot.folder.parent() {
        File::open(stage)?.sync_all()?;
    }
    remove_leftover(&replaced)?;
    match fs::remove_file(slot.failed()) {
        Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => Err(cause),
        _ => Ok(()),
    }
}

fn remove_leftover(folder: &Path) -> std::io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => Err(cause),
        _ => Ok(()),
    }
}

fn write_synced(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Writes a file that readers see wholly or not at all.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let mut aside = path.as_os_str().to_owned();
    aside.push(format!(".part-{}", std::process::id()));
    let aside = Path::new(&aside);
    let written = write_synced(aside, bytes).and_then(|()| fs::rename(aside, path));
    written.map_err(|cause| {
        let _ = fs::remove_file(aside);
        Failure::io(path, cause)
    })
}

/// Notes why a result could not be computed. A store that cannot be written to says so elsewhere.
pub(super) fn note_failure(slot: &Slot, failure: &Failure) {
    let why = failure.to_string();
    let exit_code = failure.exit_code();
    let record = FailedRecord { why, exit_code, finished_unix_ms: now_ms() };
    let text = serde_json::to_vec_pretty(&record).expect("a record is plain data");
    let _ = write_whole(&slot.failed(), &text);
}
