//! One pass over the graph: the calls that the pipeline function makes.

use super::{
    Artifact, Inputs, Key, Notes, Record, Selection, Source, Stage, Store, Stored, Wait, lock,
    place::{Found, Slot},
    publish,
    record::{now_ms, peak_memory_bytes, reset_peak_memory},
};
use crate::{Failure, progress::Progress};
use serde_json::Value;
use std::{
    fmt, fs,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Instant,
};

/// How a result stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum State {
    /// It is there and made from what is there now.
    Fresh,
    /// There is one, made from something else.
    Stale,
    /// There is none.
    Missing,
    /// Another process computes it; says who.
    Running(String),
    /// The last attempt failed; says why.
    Failed(String),
    /// Its bytes are not those that were stored; says which.
    Damaged(String),
    /// A person changed the copy that may be edited, which replaces the result.
    Edited {
        /// The edited file.
        path: PathBuf,
        /// Whether what the stage reads changed since the copy was written.
        inputs_changed: bool,
    },
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fresh => "fresh",
            Self::Stale => "stale",
            Self::Missing => "missing",
            Self::Running(_) => "running",
            Self::Failed(_) => "failed",
            Self::Damaged(_) => "damaged",
            Self::Edited { .. } => "edited by hand",
        })
    }
}

/// One call of the graph.
#[derive(Debug, Clone)]
pub struct Entry {
    /// `segment:prone`, or `mesh` for a stage without a label.
    pub instance: String,
    /// Name of the stage.
    pub stage: String,
    /// Label; may be empty.
    pub label: String,
    /// Version of the stage.
    pub version: u32,
    /// Its sentence for the methods.
    pub methods: &'static str,
    /// Its parameters, sorted.
    pub parameters: Value,
    /// Its inputs.
    pub sources: Vec<Source>,
    /// Instances whose results it reads.
    pub needs: Vec<String>,
    /// Its key; `None` while an input is pending.
    pub key: Option<Key>,
    /// How its result stands after the call.
    pub state: State,
    /// What is noted about the result, or about the last one when it is stale.
    pub record: Option<Record>,
    /// Whether this pass computed it.
    pub computed: bool,
}

/// What happens during a pass.
#[derive(Debug, Clone)]
pub enum Event<'a> {
    /// A stage begins; `number` of `total` calls.
    Started {
        /// Instance.
        instance: &'a str,
        /// Place of the call, from 1.
        number: usize,
        /// Number of calls.
        total: usize,
    },
    /// A stage says where it is.
    Progress {
        /// Instance.
        instance: &'a str,
        /// 0..=1.
        fraction: f64,
        /// What it does.
        doing: &'a str,
    },
    /// A stage is done and its result is published.
    Computed {
        /// Instance.
        instance: &'a str,
        /// What it cost.
        record: &'a Record,
        /// Whether the bytes differ from those that the same key gave before.
        differs: bool,
    },
    /// A stage failed.
    Failed {
        /// Instance.
        instance: &'a str,
    },
    /// The result was there.
    Reused {
        /// Instance.
        instance: &'a str,
    },
    /// A damaged result was found; it is computed anew.
    Damaged {
        /// Instance or file.
        what: &'a str,
        /// What is wrong with it.
        why: &'a str,
    },
    /// A stage warns of its result, which was computed now or before.
    Warned {
        /// Instance.
        instance: &'a str,
        /// What it says.
        warning: &'a str,
    },
    /// Another process computes the same result.
    Waiting {
        /// Instance.
        instance: &'a str,
        /// Who.
        holder: &'a str,
    },
    /// A file that was edited by hand replaces the result.
    Edited {
        /// Instance.
        instance: &'a str,
        /// The file.
        path: &'a Path,
        /// Whether what the stage reads changed since the file was written.
        inputs_changed: bool,
    },
    /// A file in the output folder was changed by hand and is left as it is.
    Kept {
        /// The file.
        path: &'a Path,
    },
}

/// Hears what happens; calls may come from any thread.
pub trait Listener: Sync {
    /// Something happened.
    fn on(&self, event: &Event<'_>);
}

impl Listener for crate::progress::Silent {
    fn on(&self, _event: &Event<'_>) {}
}

/// What a pass does with a result that is not there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// Note it; write nothing.
    Plan,
    /// Compute it.
    Execute,
}

/// A pass over the graph.
pub struct Run<'a> {
    /// Where results are kept.
    pub store: &'a Store,
    /// Folder of the study; paths of inputs are relative to it.
    pub base: &'a Path,
    pub(super) mode: Mode,
    pub(super) selection: Selection,
    pub(super) wait: Wait,
    pub(super) listener: &'a dyn Listener,
    pub(super) entries: Mutex<Vec<Entry>>,
    pub(super) total: usize,
}

struct Reporter<'a> {
    listener: &'a dyn Listener,
    instance: &'a str,
    notes: Mutex<Notes>,
}

impl Reporter<'_> {
    fn notes(&self) -> std::sync::MutexGuard<'_, Notes> {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Reporter<'_> {
    fn report(&self, fraction: f64, doing: &str) {
        self.listener.on(&Event::Progress { instance: self.instance, fraction, doing });
    }

    fn warn(&self, warning: &str) {
        self.notes().warnings.push(warning.into());
    }

    fn note(&self, name: &str, value: f64) {
        // JSON has no other numbers.
        if value.is_finite() {
            self.notes().values.insert(name.into(), value);
        }
    }
}

impl Run<'_> {
    /// Whether this pass only looks: results may be pending and nothing may be written.
    pub fn is_plan(&self) -> bool {
        self.mode == Mode::Plan
    }

    /// The calls so far, in their order.
    pub fn calls(&self) -> Vec<Entry> {
        self.entries().clone()
    }

    /// A file that a person gave; `name` is its study key, `path` is relative to the study.
    pub fn external<T: Artifact>(&self, name: &str, path: &Path) -> Result<Stored<T>, Failure> {
        self.store.external(name, &self.base.join(path))
    }

    /// The result of a stage: found, or computed. `label` tells instances apart (`prone`); it may
    /// be empty. Pending when this pass may not compute it.
    pub fn stage<S, I>(
        &self,
        label: &str,
        stage: &S,
        inputs: I,
    ) -> Result<Stored<S::Output>, Failure>
    where
        S: Stage,
        I: Inputs<Loaded = S::Input>,
    {
        let (mut entry, slot) = self.look(label, stage, &inputs)?;
        let number = self.register(&entry);
        let result = self.settle(&mut entry, slot, number, stage, &inputs);
        self.entries()[number - 1] = entry;
        result
    }

    /// What the store holds for a call, before anything is done about it.
    pub(super) fn look<S, I>(
        &self,
        label: &str,
        stage: &S,
        inputs: &I,
    ) -> Result<(Entry, Option<Slot>), Failure>
    where
        S: Stage,
        I: Inputs<Loaded = S::Input>,
    {
        let instance = instance(S::NAME, label)?;
        let mut sources = Vec::new();
        inputs.sources("", &mut sources);
        let entries = self.entries();
        assert!(entries.iter().all(|e| e.instance != instance), "{instance} is called twice");
        let mut needs: Vec<String> = sources.iter().map(|source| source.name.clone()).collect();
        needs.retain(|name| entries.iter().any(|entry| entry.instance == *name));
        drop(entries);
        let key = Key::of(stage, &sources)?;
        let slot = key.as_ref().map(|key| self.store.slot(S::NAME, label, key));
        let found = match (&slot, &key) {
            (Some(slot), Some(key)) => self.store.find(slot, key),
            _ => Found::Missing,
        };
        let (state, record) = match found {
            Found::Fresh(record) => (State::Fresh, Some(record)),
            Found::Damaged(why) => (State::Damaged(why), None),
            Found::Missing => {
                let last = self.store.earlier(S::NAME, label).into_iter().next();
                let record = last.map(|earlier| earlier.record);
                (self.unready(slot.as_ref(), record.is_some()), record)
            }
        };
        let entry = Entry {
            instance,
            stage: S::NAME.into(),
            label: label.into(),
            version: S::VERSION,
            methods: S::METHODS,
            parameters: super::key::parameters(stage)?,
            sources,
            needs,
            key,
            state,
            record,
            computed: false,
        };
        Ok((entry, slot))
    }

    fn unready(&self, slot: Option<&Slot>, has_earlier: bool) -> State {
        if let (Some(slot), Mode::Plan) = (slot, self.mode) {
            if let Some(holder) = lock::holder(&slot.lock()) {
                return State::Running(holder);
            }
            if let Some(failure) = slot.failure() {
                return State::Failed(failure.why);
            }
        }
        if has_earlier { State::Stale } else { State::Missing }
    }

    /// Notes a call; gives its number, from 1.
    pub(super) fn register(&self, entry: &Entry) -> usize {
        let mut entries = self.entries();
        entries.push(entry.clone());
        entries.len()
    }

    pub(super) fn entries(&self) -> std::sync::MutexGuard<'_, Vec<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Computes the result if it must be and may be.
    pub(super) fn settle<S, I>(
        &self,
        entry: &mut Entry,
        slot: Option<Slot>,
        number: usize,
        stage: &S,
        inputs: &I,
    ) -> Result<Stored<S::Output>, Failure>
    where
        S: Stage,
        I: Inputs<Loaded = S::Input>,
    {
        let (Some(slot), Some(key)) = (slot, entry.key.clone()) else {
            return Ok(Stored::pending(&entry.instance, &self.store.hashes));
        };
        let fresh = entry.state == State::Fresh;
        let anew = self.selection.anew.contains(&entry.instance);
        if self.mode == Mode::Plan || (fresh && !anew) || !self.selection.allows(&entry.instance) {
            if fresh && self.mode == Mode::Execute {
                self.listener.on(&Event::Reused { instance: &entry.instance });
                self.repeat_warnings(entry);
            }
            return Ok(self.handle(entry, &slot));
        }
        if let State::Damaged(why) = &entry.state {
            self.listener.on(&Event::Damaged { what: &entry.instance, why });
        }
        if let Some(stage_folder) = slot.folder.parent() {
            fs::create_dir_all(stage_folder).map_err(|cause| Failure::io(stage_folder, cause))?;
        }
        let asked = now_ms();
        let busy = |holder: &str| {
            self.listener.on(&Event::Waiting { instance: &entry.instance, holder });
        };
        let held = lock::acquire(&slot.lock(), self.wait, &busy)
            .map_err(|failure| failure.within(&entry.instance))?;
        let before = match self.store.find(&slot, &key) {
            Found::Fresh(record) => Some(record),
            _ => None,
        };
        match before {
            // Another process was faster.
            Some(record) if !anew || record.finished_unix_ms > asked => {
                self.listener.on(&Event::Reused { instance: &entry.instance });
                (entry.state, entry.record) = (State::Fresh, Some(record));
            }
            before => {
                let record = self.compute(entry, &slot, &key, number, stage, inputs)?;
                let differs = before.is_some_and(|before| before.content != record.content);
                let instance = &entry.instance;
                self.listener.on(&Event::Computed { instance, record: &record, differs });
                (entry.state, entry.record) = (State::Fresh, Some(record));
                entry.computed = true;
            }
        }
        drop(held);
        self.repeat_warnings(entry);
        Ok(self.handle(entry, &slot))
    }

    /// Tells what the stage warned of when it was computed.
    fn repeat_warnings(&self, entry: &Entry) {
        let instance = &entry.instance;
        for warning in entry.record.iter().flat_map(|record| &record.notes.warnings) {
            self.listener.on(&Event::Warned { instance, warning });
        }
    }

    fn handle<T>(&self, entry: &Entry, slot: &Slot) -> Stored<T> {
        match (&entry.state, &entry.record) {
            (State::Fresh, Some(record)) => {
                let path = slot.folder.join(&record.file);
                let hashes = &self.store.hashes;
                let mut stored = Stored::known(&entry.instance, &path, &record.content, hashes);
                stored.reused = !entry.computed;
                stored
            }
            _ => Stored::pending(&entry.instance, &self.store.hashes),
        }
    }

    fn compute<S, I>(
        &self,
        entry: &Entry,
        slot: &Slot,
        key: &Key,
        number: usize,
        stage: &S,
        inputs: &I,
    ) -> Result<Record, Failure>
    where
        S: Stage,
        I: Inputs<Loaded = S::Input>,
    {
        let instance = entry.instance.as_str();
        self.listener.on(&Event::Started { instance, number, total: self.total.max(number) });
        reset_peak_memory();
        let clock = Instant::now();
        let notes = Mutex::default();
        let reporter = Reporter { listener: self.listener, instance, notes };
        let failed = |failure: Failure| {
            self.listener.on(&Event::Failed { instance });
            failure.within(instance)
        };
        let input = inputs.load().map_err(failed)?;
        let published = stage.run(&input, &reporter).and_then(|output| {
            let inputs = entry.sources.iter().map(|s| (s.position.clone(), s.name.clone()));
            let cost = publish::Cost {
                wall_ms: clock.elapsed().as_millis() as u64,
                peak_memory_bytes: peak_memory_bytes(),
                inputs: inputs.collect(),
                notes: reporter.notes().clone(),
            };
            publish::publish(slot, key, &output, cost)
        });
        published.map_err(failed).inspect_err(|failure| publish::note_failure(slot, failure))
    }
}

/// `stage:label`; refuses a label that could not be part of a file's name.
fn instance(stage: &str, label: &str) -> Result<String, Failure> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if label.starts_with('.') || !label.chars().all(plain) {
        let text = format!("{label:?}: a name may have letters, digits, `-`, `_` and `.` only");
        return Err(Failure::BadInput(text));
    }
    Ok(if label.is_empty() { stage.into() } else { format!("{stage}:{label}") })
}
