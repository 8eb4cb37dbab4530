//! Why a result is not fresh: which field of its key changed.

use super::{Entry, Source, State, Store};
use serde_json::{Value, json};
use std::{collections::BTreeMap, fmt};

/// One field of a key that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// `parameters.size_mm`, `version`, `inputs.0 (segment:prone)`.
    pub field: String,
    /// Value in the earlier key; `absent` when it had none.
    pub old: String,
    /// Value now.
    pub new: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} -> {}", self.field, self.old, self.new)
    }
}

/// How a call differs from the last one of its instance that gave a result.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The instance.
    pub instance: String,
    /// How its result stands.
    pub state: State,
    /// Fields that changed since the last result of another key; `None` when there is no such
    /// result.
    pub changes: Option<Vec<Change>>,
}

/// Compares a call with the most recent earlier key of its instance.
pub fn explain(store: &Store, entry: &Entry) -> Explanation {
    let now = entry.key.as_ref().map(|key| key.text.as_str());
    let mut earlier = store.earlier(&entry.stage, &entry.label).into_iter();
    let other = earlier.find(|earlier| Some(earlier.key.as_str()) != now);
    let changes = other.map(|earlier| {
        let old: Value = serde_json::from_str(&earlier.key).unwrap_or_default();
        compare(&old, &earlier.record.inputs, entry)
    });
    Explanation { instance: entry.instance.clone(), state: entry.state.clone(), changes }
}

fn compare(old: &Value, old_names: &BTreeMap<String, String>, entry: &Entry) -> Vec<Change> {
    let new = json!({ "version": entry.version, "parameters": entry.parameters });
    let old_rest = json!({ "version": old["version"], "parameters": old["parameters"] });
    let (old_fields, new_fields) = (flat(&old_rest), flat(&new));
    let mut names: Vec<_> = old_fields.keys().chain(new_fields.keys()).collect();
    names.sort();
    names.dedup();
    let value = |fields: &BTreeMap<String, String>, name: &String| {
        fields.get(name).cloned().unwrap_or_else(|| "absent".into())
    };
    let fields = names.into_iter().map(|name| Change {
        field: name.clone(),
        old: value(&old_fields, name),
        new: value(&new_fields, name),
    });
    let mut changes: Vec<_> = fields.filter(|change| change.old != change.new).collect();
    changes.extend(compare_inputs(&old["inputs"], old_names, &entry.sources));
    changes
}

fn compare_inputs(
    old: &Value,
    old_names: &BTreeMap<String, String>,
    sources: &[Source],
) -> Vec<Change> {
    let mut changes = Vec::new();
    for Source { position, name, content } in sources {
        let before = old[position].as_str();
        if content.as_deref() == before && content.is_some() {
            continue;
        }
        changes.push(Change {
            field: input_field(position, name),
            old: before.map_or("absent".into(), short),
            new: content.as_deref().map_or("not computed yet".into(), short),
        });
    }
    for (position, content) in old.as_object().into_iter().flatten() {
        if sources.iter().all(|source| source.position != *position) {
            let name = old_names.get(position).map_or("", String::as_str);
            let old = content.as_str().map_or_else(String::new, short);
            changes.push(Change { field: input_field(position, name), old, new: "absent".into() });
        }
    }
    changes
}

fn input_field(position: &str, name: &str) -> String {
    if name.is_empty() {
        format!("inputs.{position}")
    } else {
        format!("inputs.{position} ({name})")
    }
}

/// The first digits of a content hash.
fn short(content: &str) -> String {
    content.chars().take(16).collect()
}

/// All leaves of a JSON value by their path.
fn flat(value: &Value) -> BTreeMap<String, String> {
    fn visit(path: &str, value: &Value, leaves: &mut BTreeMap<String, String>) {
        match value {
            Value::Object(members) if !members.is_empty() => {
                for (name, member) in members {
                    let dot = if path.is_empty() { "" } else { "." };
                    visit(&format!("{path}{dot}{name}"), member, leaves);
                }
            }
            Value::Array(items) if !items.is_empty() => {
                for (n, item) in items.iter().enumerate() {
                    visit(&format!("{path}[{n}]"), item, leaves);
                }
            }
            leaf => {
                leaves.insert(path.to_owned(), leaf.to_string());
            }
        }
    }
    let mut leaves = BTreeMap::new();
    visit("", value, &mut leaves);
    leaves
}
