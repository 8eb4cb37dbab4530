//! The table and the page of all participants.

use super::derivatives::{Column, Status, dictionary, file};
use mammotwin_data::Failure;
use mammotwin_stages::report::group::{GroupInput, GroupMetric, Member, render};
use serde_json::Value;
use std::{collections::BTreeMap, fs, path::Path};

/// Column of the state of a participant.
const STATUS: &str = "status";

/// What is known of one participant.
struct Row {
    label: String,
    status: String,
    columns: Vec<Column>,
    values: BTreeMap<String, String>,
}

/// Gathers the metrics of the participants: `group_metrics.tsv`, `.json`, `group.html`.
pub fn gather(out: &Path, labels: &[String]) -> Result<(), Failure> {
    let rows: Vec<Row> = labels.iter().map(|label| row(out, label)).collect::<Result<_, _>>()?;
    if rows.iter().all(|row| row.values.is_empty()) {
        let why = "no participant has metrics; run the level participant first";
        return Err(Failure::BadInput(format!("{}: {why}", out.display())));
    }
    let mut columns: Vec<Column> = Vec::new();
    for column in rows.iter().flat_map(|row| &row.columns) {
        if !columns.iter().any(|known| known.name == column.name) {
            columns.push(column.clone());
        }
    }
    let mut table = format!("participant_id\t{STATUS}");
    columns.iter().for_each(|column| table += &format!("\t{}", column.name));
    for row in &rows {
        table += &format!("\nsub-{}\t{}", row.label, row.status);
        for column in &columns {
            let value = row.values.get(&column.name).map_or("n/a", String::as_str);
            table += &format!("\t{value}");
        }
    }
    table += "\n";
    let mut told = vec![Column {
        name: STATUS.into(),
        long_name: "How the run ended".into(),
        units: "n/a".into(),
        source: "done, failed, or missing: not run yet".into(),
    }];
    told.extend(columns.iter().cloned());
    let page = render(&page(&rows, &columns))?;
    for (name, text) in [
        ("group_metrics.tsv", table),
        ("group_metrics.json", dictionary(&told)),
        ("group.html", page),
    ] {
        let path = out.join(name);
        fs::write(&path, text).map_err(|cause| Failure::io(&path, cause))?;
    }
    Ok(())
}

fn page(rows: &[Row], columns: &[Column]) -> GroupInput {
    let metric = |column: &Column| GroupMetric {
        name: column.name.clone(),
        long_name: column.long_name.clone(),
        unit: if column.units == "1" { String::new() } else { column.units.clone() },
        values: rows
            .iter()
            .map(|row| row.values.get(&column.name).and_then(|value| value.parse().ok()))
            .collect(),
    };
    let member = |row: &Row| Member {
        name: format!("sub-{}", row.label),
        status: row.status.clone(),
        report: (row.status == "done").then(|| format!("sub-{}.html", row.label)),
    };
    GroupInput {
        members: rows.iter().map(member).collect(),
        metrics: columns.iter().map(metric).collect(),
        program_version: env!("CARGO_PKG_VERSION").into(),
    }
}

fn row(out: &Path, label: &str) -> Result<Row, Failure> {
    let mut row = Row {
        label: label.to_owned(),
        status: "missing".into(),
        columns: Vec::new(),
        values: BTreeMap::new(),
    };
    let path = file(out, label, "status.json");
    let Some(text) = read(&path)? else { return Ok(row) };
    match serde_json::from_str(&text).map_err(|cause| damaged(&path, &cause))? {
        Status::Done => row.status = "done".into(),
        // Numbers of an earlier run are not those of this one.
        Status::Failed { .. } => {
            row.status = "failed".into();
            return Ok(row);
        }
    }
    let path = file(out, label, "desc-mammotwin_metrics.json");
    let text = read(&path)?.ok_or_else(|| damaged(&path, &"no such file"))?;
    let told: BTreeMap<String, Value> =
        serde_json::from_str(&text).map_err(|cause| damaged(&path, &cause))?;
    let path = file(out, label, "desc-mammotwin_metrics.tsv");
    let table = read(&path)?.ok_or_else(|| damaged(&path, &"no such file"))?;
    let mut lines = table.lines().map(|line| line.split('\t').collect::<Vec<_>>());
    let (Some(head), Some(values)) = (lines.next(), lines.next()) else {
        return Err(damaged(&path, &"no line of values"));
    };
    if head.len() != values.len() {
        return Err(damaged(&path, &"head and values differ in length"));
    }
    for (name, value) in head.into_iter().zip(values).skip(1) {
        let told = told.get(name).cloned().ok_or_else(|| damaged(&path, &name))?;
        let column: Column =
            serde_json::from_value(told).map_err(|cause| damaged(&path, &cause))?;
        row.columns.push(Column { name: name.to_owned(), ..column });
        row.values.insert(name.to_owned(), value.to_owned());
    }
    Ok(row)
}

fn read(path: &Path) -> Result<Option<String>, Failure> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(Failure::io(path, cause)),
    }
}

fn damaged(path: &Path, cause: &dyn std::fmt::Display) -> Failure {
    let remedy = "run the participant again";
    Failure::BadInput(format!("{}: damaged: {cause}; {remedy}", path.display()))
}
