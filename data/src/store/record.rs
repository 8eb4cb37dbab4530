//! What is noted about a result: how to recognise it, and what it cost.

use std::{collections::BTreeMap, time::SystemTime};

/// What a stage says of its result.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Notes {
    /// What somebody should look at.
    pub warnings: Vec<String>,
    /// How far the result is to be trusted, by name.
    pub values: BTreeMap<String, f64>,
}

impl Notes {
    /// Whether nothing was said.
    pub fn is_empty(&self) -> bool {
        self.warnings.is_empty() && self.values.is_empty()
    }
}

/// The content of `record.json`.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Name of the result's file.
    pub file: String,
    /// Size of the result (bytes).
    pub bytes: u64,
    /// BLAKE3 of the result, in hexadecimal.
    pub content: String,
    /// Wall time of the stage (ms).
    pub wall_ms: u64,
    /// Peak resident memory of the process while the stage ran (bytes); 0 when unknown.
    pub peak_memory_bytes: u64,
    /// When it was done (ms since 1970).
    pub finished_unix_ms: u64,
    /// Names of the inputs by position.
    pub inputs: BTreeMap<String, String>,
    /// What the stage says of the result; equal for equal inputs.
    #[serde(default, skip_serializing_if = "Notes::is_empty")]
    pub notes: Notes,
    /// BLAKE3 of this record with an empty `check`.
    pub check: String,
}

impl Record {
    /// The text of `record.json`, with its check.
    pub(super) fn text(&self) -> String {
        let sealed = Self { check: self.seal(), ..self.clone() };
        format!("{}\n", serde_json::to_string_pretty(&sealed).expect("a record is plain data"))
    }

    /// Reads a record; `None` when a byte of it was changed.
    pub(super) fn parse(text: &[u8]) -> Option<Self> {
        let record: Self = serde_json::from_slice(text).ok()?;
        let intact = record.check == record.seal() && record.text().as_bytes() == text;
        intact.then_some(record)
    }

    fn seal(&self) -> String {
        let open = Self { check: String::new(), ..self.clone() };
        let text = serde_json::to_vec(&open).expect("a record is plain data");
        blake3::hash(&text).to_hex()[..32].to_owned()
    }
}

/// The content of a `.failed.json`: why a result could not be computed.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FailedRecord {
    pub why: String,
    pub exit_code: u8,
    pub finished_unix_ms: u64,
}

/// Now, in ms since 1970.
pub(super) fn now_ms() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since.map_or(0, |since| since.as_millis() as u64)
}

/// Peak resident memory of this process (bytes), in a run since its stage began where the kernel allows; 0 when unknown.
pub fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// Asks the kernel to forget the peak so far; it may refuse, then the peak is that of the run.
pub(super) fn reset_peak_memory() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
