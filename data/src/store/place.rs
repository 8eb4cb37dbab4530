//! The store: where results lie on disk, and whether one is there.

use super::{Artifact, Key, Record, Stored, hashes::Hashes, record::FailedRecord};
use crate::Failure;
use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// The results of one study, in one output folder. Nothing is written outside of it.
#[derive(Debug, Clone)]
pub struct Store {
    /// The output folder.
    pub out: PathBuf,
    pub(super) hashes: Arc<Hashes>,
}

/// Where the result of one key lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Slot {
    /// `OUT/cache/segment/prone-0123456789abcdef`.
    pub folder: PathBuf,
}

/// What lies there.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Found {
    Fresh(Record),
    Missing,
    /// Why it cannot be used.
    Damaged(String),
}

/// A result of any key.
#[derive(Debug, Clone)]
pub(super) struct Earlier {
    pub folder: PathBuf,
    pub key: String,
    pub record: Record,
}

impl Slot {
    /// `FOLDER.ending`.
    fn beside(&self, ending: &str) -> PathBuf {
        let mut name = self.folder.clone().into_os_string();
        name.push(ending);
        name.into()
    }
    pub fn lock(&self) -> PathBuf {
        self.beside(".lock")
    }
    pub fn failed(&self) -> PathBuf {
        self.beside(".failed.json")
    }
    /// Where the result is written before it is published.
    pub fn part(&self) -> PathBuf {
        self.beside(".part")
    }
    /// Where a result lies while another takes its place.
    pub fn replaced(&self) -> PathBuf {
        self.beside(".replaced")
    }
    /// The failure of the last attempt, if it failed.
    pub fn failure(&self) -> Option<FailedRecord> {
        serde_json::from_slice(&fs::read(self.failed()).ok()?).ok()
    }
}

impl Store {
    /// The store in an output folder, which need not exist: only a run that computes makes it.
    pub fn open(out: &Path) -> Self {
        let hashes = Arc::new(Hashes::open(out.join("cache").join("hashes.json")));
        Self { out: out.to_owned(), hashes }
    }

    /// A handle on a file that a person gave. It is tracked by its content and never copied.
    ///
    /// `name` is the study key, for messages: `poses.prone.image`.
    pub fn external<T: Artifact>(&self, name: &str, path: &Path) -> Result<Stored<T>, Failure> {
        let stat = fs::metadata(path).map_err(|cause| unreadable(name, path, &cause))?;
        if !stat.is_file() {
            return Err(Failure::BadInput(format!("{name}: {}: not a file", path.display())));
        }
        let content = self.hashes.hash(path).map_err(|failure| failure.within(name))?;
        Ok(Stored::known(name, path, &content, &self.hashes))
    }

    /// Writes down which files were hashed, so that the next run need not read them again.
    pub fn keep_hashes(&self) {
        self.hashes.keep();
    }

    pub(super) fn cache(&self) -> PathBuf {
        self.out.join("cache")
    }

    pub(super) fn slot(&self, stage: &str, label: &str, key: &Key) -> Slot {
        let name = match label {
            "" => key.short().to_owned(),
            label => format!("{label}-{}", key.short()),
        };
        Slot { folder: self.cache().join(stage).join(name) }
    }

    /// What lies in a slot.
    pub(super) fn find(&self, slot: &Slot, key: &Key) -> Found {
        if !slot.folder.exists() {
            return Found::Missing;
        }
        let Some(record) = read_record(&slot.folder) else {
            return Found::Damaged("record.json is damaged".into());
        };
        if fs::read(slot.folder.join("key.json")).ok().as_deref() != Some(key.text.as_bytes()) {
            return Found::Damaged("key.json is damaged".into());
        }
        let file = slot.folder.join(&record.file);
        match self.hashes.hash(&file) {
            Err(failure) => Found::Damaged(failure.to_string()),
            Ok(content) if content == record.content => Found::Fresh(record),
            Ok(_) => Found::Damaged(format!("{} is damaged", record.file)),
        }
    }

    /// All results of an instance whose records are intact, the latest first.
    pub(super) fn earlier(&self, stage: &str, label: &str) -> Vec<Earlier> {
        let folders = result_folders(&self.cache().join(stage));
        let mut found: Vec<_> = folders
            .into_iter()
            .filter(|folder| label_of(folder) == Some(label))
            .filter_map(|folder| {
                let key = fs::read_to_string(folder.join("key.json")).ok()?;
                let record = read_record(&folder)?;
                Some(Earlier { folder, key, record })
            })
            .collect();
        found.sort_by(|a, b| {
            let time = |e: &Earlier| e.record.finished_unix_ms;
            time(b).cmp(&time(a)).then_with(|| a.folder.cmp(&b.folder))
        });
        found
    }
}

/// The record in the folder of a result; `None` when it is missing or damaged.
pub(super) fn read_record(folder: &Path) -> Option<Record> {
    Record::parse(&fs::read(folder.join("record.json")).ok()?)
}

/// Folders of results below the folder of a stage, in the order of their names.
pub(super) fn result_folders(stage: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(stage).into_iter().flatten().flatten();
    let mut folders: Vec<_> =
        entries.map(|entry| entry.path()).filter(|path| label_of(path).is_some()).collect();
    folders.sort();
    folders
}

/// The label in the name of a result's folder; `None` for any other folder or file.
pub(super) fn label_of(folder: &Path) -> Option<&str> {
    let name = folder.file_name()?.to_str()?;
    let (label, digits) = name.rsplit_once('-').unwrap_or(("", name));
    let hexadecimal = digits.len() == 16 && digits.bytes().all(|b| b.is_ascii_hexdigit());
    (hexadecimal && folder.is_dir()).then_some(label)
}

fn unreadable(name: &str, path: &Path, cause: &std::io::Error) -> Failure {
    let what = match cause.kind() {
        std::io::ErrorKind::NotFound => "no such file; paths are relative to the study's folder",
        std::io::ErrorKind::PermissionDenied => "may not be read; change its permissions",
        _ => return Failure::io(path, cause).within(name),
    };
    Failure::BadInput(format!("{name}: {}: {what}", path.display()))
}
