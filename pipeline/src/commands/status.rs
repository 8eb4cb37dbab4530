//! `mammotwin status`: how each stage stands.

use super::{open, run::plan};
use crate::cli::{StatusArguments, StudyArguments};
use mammotwin_data::{
    Failure,
    store::{Entry, Options, State},
};
use serde_json::{Map, Value, json};

/// Prints how each stage of each study stands.
pub fn status(arguments: &StatusArguments) -> Result<(), Failure> {
    let StatusArguments { studies, out, json } = arguments;
    let single = studies.len() == 1;
    if !single && out.is_some() {
        return Err(Failure::Usage("--out: give it with a single study".into()));
    }
    let mut answers = Map::new();
    for study in studies {
        let opened = open(&StudyArguments { study: study.clone(), out: out.clone() })?;
        let entries = plan(&opened, &Options::default())?.entries;
        opened.store.keep_hashes();
        if *json {
            let stages = entries.iter().map(as_json).collect();
            answers.insert(study.display().to_string(), stages);
        } else {
            let title = if single { String::new() } else { format!("{}\n", study.display()) };
            tell!("{title}{}", as_table(&entries));
        }
    }
    if *json {
        let of_single = answers.values().next().filter(|_| single).cloned();
        tell!("{:#}", of_single.unwrap_or(Value::Object(answers)));
    }
    Ok(())
}

fn as_json(entry: &Entry) -> Value {
    json!({
        "stage": entry.instance,
        "state": entry.state.to_string(),
        "detail": detail(&entry.state),
        "bytes": entry.record.as_ref().map(|record| record.bytes),
        "wall_ms": entry.record.as_ref().map(|record| record.wall_ms),
        "peak_memory_bytes": entry.record.as_ref().map(|record| record.peak_memory_bytes),
        "content": entry.record.as_ref().map(|record| record.content.clone()),
        "key": entry.key.as_ref().map(|key| key.digest.clone()),
        "needs": entry.needs,
    })
}

fn as_table(entries: &[Entry]) -> String {
    let width = entries.iter().map(|entry| entry.instance.len()).max().unwrap_or(0).max(5);
    let head = format!(
        "{:width$}  {:14}  {:>9}  {:>8}  {:>9}",
        "stage", "state", "size", "time", "memory"
    );
    let line = |entry: &Entry| {
        let state = entry.state.to_string();
        let [size, time, memory] = match &entry.record {
            Some(record) => [
                size(record.bytes),
                format!("{:.1} s", record.wall_ms as f64 / 1000.0),
                size(record.peak_memory_bytes),
            ],
            None => ["", "", ""].map(String::from),
        };
        let line =
            format!("{:width$}  {state:14}  {size:>9}  {time:>8}  {memory:>9}", entry.instance);
        format!("{line}  {}", detail(&entry.state)).trim_end().to_owned()
    };
    std::iter::once(head).chain(entries.iter().map(line)).collect::<Vec<_>>().join("\n")
}

fn detail(state: &State) -> String {
    match state {
        State::Running(holder) => holder.clone(),
        State::Failed(why) | State::Damaged(why) => crate::cli::one_line(why),
        State::Edited { path, inputs_changed: false } => path.display().to_string(),
        State::Edited { path, inputs_changed: true } => {
            format!("{}; made from inputs that have changed since", path.display())
        }
        State::Fresh | State::Stale | State::Missing => String::new(),
    }
}

/// A number of bytes for people.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}
