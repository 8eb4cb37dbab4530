//! Copies of results that a person sees, and may edit.
//!
//! `OUT/.written.json` remembers the content of every copy that was ever written. A file whose
//! content is not among them was changed by hand: it is never overwritten or deleted, and where
//! the graph says [`Run::editable`] it replaces the result of the stage.

use super::{
    Artifact, Event, Inputs, Record, Run, Stage, State, Store, Stored, lock, lock::Wait, publish,
    run::Mode,
};
use crate::Failure;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Component, Path, PathBuf},
};

/// What was written under one name.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    /// Content hashes of all copies ever written.
    contents: Vec<String>,
    /// Digest of the key of the last one.
    key: String,
}

type Ledger = BTreeMap<String, Written>;

/// How a copy stands.
enum Copy {
    Absent,
    Ours { content: String },
    Theirs { content: String, written_from: Option<String> },
}

impl Run<'_> {
    /// Like [`Run::stage`], with a copy of the result at `OUT/VISIBLE.ext` that a person may edit.
    ///
    /// An edited copy is a tracked input in the place of the result; the stage is not computed as
    /// long as it is there, whatever the options say. Deleting it brings the result back.
    pub fn editable<S, I>(
        &self,
        visible: &str,
        label: &str,
        stage: &S,
        inputs: I,
    ) -> Result<Stored<S::Output>, Failure>
    where
        S: Stage,
        I: Inputs<Loaded = S::Input>,
    {
        let name = format!("{visible}.{}", S::Output::EXTENSION);
        let path = inside(&self.store.out, &name)?;
        let (mut entry, slot) = self.look(label, stage, &inputs)?;
        let result = entry.record.as_ref().filter(|_| entry.state == State::Fresh);
        let result = result.map(|record| record.content.clone());
        if let Copy::Theirs { content, written_from } =
            look_at_copy(self.store, &name, &path, result.as_deref())?
        {
            let now = entry.key.as_ref().map(|key| key.digest.clone());
            let inputs_changed = written_from.is_some() && written_from != now;
            let instance = entry.instance.clone();
            if self.mode == Mode::Execute {
                self.listener.on(&Event::Edited {
                    instance: &instance,
                    path: &path,
                    inputs_changed,
                });
            }
            let stored = Stored::known(&instance, &path, &content, &self.store.hashes);
            let bytes = fs::metadata(&path).map_or(0, |stat| stat.len());
            entry.record = Some(Record { file: name, bytes, content, ..Record::default() });
            entry.state = State::Edited { path, inputs_changed };
            self.register(&entry);
            return Ok(stored);
        }
        let number = self.register(&entry);
        let stored = self.settle(&mut entry, slot, number, stage, &inputs);
        let key = entry.key.as_ref().map(|key| key.digest.clone()).unwrap_or_default();
        self.entries()[number - 1] = entry;
        let stored = stored?;
        self.show(&stored, &name, &path, &key)?;
        Ok(stored)
    }

    /// Puts a copy of a result at `OUT/NAME` for a person to find. A file there that was changed
    /// by hand is left, and the listener is told. Returns the place of the copy.
    pub fn export<T: Artifact>(&self, name: &str, stored: &Stored<T>) -> Result<PathBuf, Failure> {
        let path = inside(&self.store.out, name)?;
        self.show(stored, name, &path, "")?;
        Ok(path)
    }

    fn show<T>(
        &self,
        stored: &Stored<T>,
        name: &str,
        path: &Path,
        key: &str,
    ) -> Result<(), Failure> {
        let Some(content) = stored.content() else { return Ok(()) };
        if self.mode == Mode::Plan {
            return Ok(());
        }
        match look_at_copy(self.store, name, path, Some(content))? {
            Copy::Ours { content: shown } if shown == content => Ok(()),
            Copy::Theirs { .. } => {
                self.listener.on(&Event::Kept { path });
                Ok(())
            }
            Copy::Absent | Copy::Ours { .. } => {
                let folder = path.parent().unwrap_or(&self.store.out);
                fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
                let _held = lock::acquire(&ledger_lock(self.store), Wait::Patient, &|_| {})?;
                // First the ledger: a copy that it does not know counts as somebody's work.
                let mut ledger = read_ledger(self.store);
                let written = ledger.entry(name.into()).or_default();
                written.contents.retain(|old| old != content);
                written.contents.push(content.into());
                written.key = key.into();
                write_ledger(self.store, &ledger)?;
                copy_whole(&stored.path, path)
            }
        }
    }
}

/// `out/name`, if that is inside of `out`.
fn inside(out: &Path, name: &str) -> Result<PathBuf, Failure> {
    if Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) {
        return Ok(out.join(name));
    }
    Err(Failure::BadInput(format!("{name:?}: would lie outside of the output folder")))
}

fn look_at_copy(
    store: &Store,
    name: &str,
    path: &Path,
    result: Option<&str>,
) -> Result<Copy, Failure> {
    if !path.exists() {
        return Ok(Copy::Absent);
    }
    let content = store.hashes.hash(path)?;
    let written = read_ledger(store).remove(name);
    let ours = |written: &Written| written.contents.contains(&content);
    if result == Some(content.as_str()) || written.as_ref().is_some_and(ours) {
        return Ok(Copy::Ours { content });
    }
    Ok(Copy::Theirs { content, written_from: written.map(|written| written.key) })
}

fn ledger_path(store: &Store) -> PathBuf {
    store.out.join(".written.json")
}

fn ledger_lock(store: &Store) -> PathBuf {
    store.out.join(".written.lock")
}

fn read_ledger(store: &Store) -> Ledger {
    let text = fs::read(ledger_path(store)).unwrap_or_default();
    serde_json::from_slice(&text).unwrap_or_default()
}

fn write_ledger(store: &Store, ledger: &Ledger) -> Result<(), Failure> {
    let text = serde_json::to_vec_pretty(ledger).expect("a ledger is plain data");
    publish::write_whole(&ledger_path(store), &text)
}

fn copy_whole(from: &Path, to: &Path) -> Result<(), Failure> {
    let mut aside = to.as_os_str().to_owned();
    aside.push(format!(".part-{}", std::process::id()));
    let aside = Path::new(&aside);
    let copied = fs::copy(from, aside)
        .and_then(|_| File::open(aside)?.sync_all())
        .and_then(|()| fs::rename(aside, to));
    copied.map_err(|cause| {
        let _ = fs::remove_file(aside);
        Failure::io(to, cause)
    })
}
