//! What a result depends on, as text that a person can read.

use super::{Source, Stage};
use crate::Failure;
use serde_json::{Map, Value, json};

/// `stage`, `version`, `parameters` and content hashes of the `inputs`, as sorted JSON.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// The text of `key.json`.
    pub text: String,
    /// BLAKE3 of the text, in hexadecimal; 16 digits of it name the result's folder.
    pub digest: String,
}

impl Key {
    /// The key of a call; `None` while an input is pending.
    pub fn of<S: Stage>(stage: &S, sources: &[Source]) -> Result<Option<Self>, Failure> {
        let mut inputs = Map::new();
        for source in sources {
            let Some(content) = &source.content else { return Ok(None) };
            inputs.insert(source.position.clone(), Value::from(content.as_str()));
        }
        let value = json!({
            "stage": S::NAME,
            "version": S::VERSION,
            "parameters": parameters(stage)?,
            "inputs": inputs,
        });
        let text = format!("{:#}\n", sorted(value));
        let digest = blake3::hash(text.as_bytes()).to_hex().to_string();
        Ok(Some(Self { text, digest }))
    }

    /// The first 16 digits of the digest.
    pub fn short(&self) -> &str {
        &self.digest[..16]
    }
}

/// The parameters of a stage as sorted JSON.
pub(super) fn parameters<S: Stage>(stage: &S) -> Result<Value, Failure> {
    let value = serde_json::to_value(stage);
    value
        .map(sorted)
        .map_err(|cause| Failure::BadInput(format!("{}: parameters: {cause}", S::NAME)))
}

/// The same JSON with the members of all objects in the order of their names, whatever order
/// `serde_json` was built to keep.
fn sorted(value: Value) -> Value {
    match value {
        Value::Object(members) => {
            let mut members: Vec<_> = members.into_iter().collect();
            members.sort_by(|a, b| a.0.cmp(&b.0));
            Value::Object(members.into_iter().map(|(name, v)| (name, sorted(v))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(sorted).collect()),
        other => other,
    }
}
