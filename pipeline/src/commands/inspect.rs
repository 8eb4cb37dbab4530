//! `mammotwin inspect`: what a file holds.

use crate::cli::InspectArguments;
use mammotwin_data::{
    Failure,
    io::{hdf5, landmarks, nifti},
    labels::Tissue,
};
use serde_json::{Value, json};
use std::path::Path;

/// Prints what a file holds.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    let path = &arguments.file;
    if !path.exists() {
        return Err(Failure::BadInput(format!("{}: no such file", path.display())));
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let ends = |endings: &[&str]| endings.iter().any(|ending| name.ends_with(ending));
    let facts = if ends(&[".h5", ".hdf5"]) {
        results(path)?
    } else if ends(&[".csv", ".fcsv", ".mrk.json"]) {
        json!({ "landmarks_mm": landmarks::read(path)? })
    } else {
        image(path)?
    };
    if arguments.json {
        tell!("{facts:#}");
    } else {
        print(&facts);
    }
    Ok(())
}

fn image(path: &Path) -> Result<Value, Failure> {
    let summary = nifti::inspect(path)?;
    let mut facts = json!(summary);
    // Whole numbers that all are labels: say how many voxels each has.
    if summary.dtype.contains("int") && nifti::read_labels(path).is_ok() {
        let labels = nifti::read_labels(path)?;
        let count = |tissue| labels.values.iter().filter(|t| **t == tissue).count();
        let counts: Vec<_> = Tissue::ALL
            .into_iter()
            .filter(|tissue| count(*tissue) > 0)
            .map(|tissue| json!({ "label": tissue.label(), "tissue": tissue, "voxels": count(tissue) }))
            .collect();
        facts["labels"] = counts.into();
    }
    Ok(facts)
}

fn results(path: &Path) -> Result<Value, Failure> {
    let file = hdf5::Reader::open(path)?;
    let mut names = Vec::new();
    list(&file, "/", &mut names);
    Ok(json!({ "format": "hdf5", "content": names }))
}

fn list(file: &hdf5::Reader, group: &str, names: &mut Vec<String>) {
    // A dataset is no group and has no names.
    for name in file.names(group).unwrap_or_default() {
        let path = format!("{}/{name}", group.trim_end_matches('/'));
        names.push(path.clone());
        list(file, &path, names);
    }
}

/// One line a fact; lists one line an item.
fn print(facts: &Value) {
    for (name, value) in facts.as_object().into_iter().flatten() {
        match value {
            Value::Array(items) if items.iter().any(|item| !item.is_number()) => {
                tell!("{name}:");
                items.iter().for_each(|item| tell!("  {}", plain(item)));
            }
            Value::Object(members) => {
                tell!("{name}:");
                members.iter().for_each(|(name, member)| tell!("  {name}: {}", plain(member)));
            }
            value => tell!("{name}: {}", plain(value)),
        }
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(" "),
        Value::Object(members) => members.values().map(plain).collect::<Vec<_>>().join("  "),
        value => value.to_string(),
    }
}
