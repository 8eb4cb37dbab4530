//! `study paddles` and `study positions` on the tiny volunteer, from outside.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Command, Output},
};

fn mammotwin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(arguments).output().unwrap()
}

#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let output = mammotwin(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The rows of a table by their first column; no value has a comma or a line break here.
fn rows(path: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), head.len(), "{line}");
        let named =
            head.iter().zip(&cells).map(|(name, cell)| (name.to_string(), cell.to_string()));
        (cells[0].to_owned(), named.collect())
    };
    lines.map(row).collect()
}

#[test]
fn one_breast_is_compressed_in_several_ways_and_only_once() {
    let folder = tempfile::tempdir().unwrap();
    let volunteer = folder.path().join("volunteer");
    let out = volunteer.to_str().unwrap();
    printed(&["synth", "--preset", "tiny", "--seed", "7", "--poses", "prone,supine", "--out", out]);
    let study = volunteer.join("study.toml");
    let text = fs::read_to_string(&study).unwrap();
    fs::write(
        &study,
        text.replace("paddle = \"rigid\"", "paddle = \"rigid\"\nstart_pose = \"prone\""),
    )
    .unwrap();
    let study = study.to_str().unwrap();

    let paddles = ["study", "paddles", study, "--paddles", "rigid,elastic,curved", "--no-picture"];
    let said = printed(&paddles);
    assert!(!said.starts_with("0 of "), "{said}");
    let place = volunteer.join("out/studies/paddles");
    let table = rows(&place.join("paddles.csv"));
    assert_eq!(table.len(), 3);
    let number = |way: &str, name: &str| table[way][name].parse::<f64>().unwrap();
    for way in ["rigid", "elastic", "curved"] {
        assert_eq!(table[way]["ended_by"], "thickness_mm", "{way}");
        assert!(number(way, "force_n") > 0.0);
        // The mean is over the area that the CSV names: N over cm² is 10 kPa.
        let mean = 10.0 * number(way, "force_n") / number(way, "contact_area_cm2");
        assert!((mean / number(way, "mean_pressure_kpa") - 1.0).abs() < 1e-3, "{way}: {mean}");
        let share = number(way, "juxtathoracic_share");
        assert!((0.0..=1.0).contains(&share), "{share}");
        assert!(number(way, "mean_pressure_kpa") < number(way, "face_peak_pressure_kpa"));
    }
    assert!(number("elastic", "deflection_mm") > 0.0 && number("rigid", "deflection_mm") == 0.0);
    assert!(number("curved", "force_n") < number("rigid", "force_n"));
    for file in ["curves.csv", "comparisons.csv", "paddles.html", "force.svg", "mat_curved.png"] {
        assert!(fs::metadata(place.join(file)).unwrap().len() > 100, "{file}");
    }
    let page = fs::read_to_string(place.join("paddles.html")).unwrap();
    assert!(page.contains("137.21") && page.contains("Effect size") && !page.contains("src=\"/"));

    // All is there: the same files.
    let before = fs::read(place.join("paddles.csv")).unwrap();
    let said = printed(&paddles);
    assert!(said.starts_with("0 of "), "{said}");
    assert_eq!(fs::read(place.join("paddles.csv")).unwrap(), before);

    // One distance is too far: it is named, the others are found.
    let said = printed(&[
        "study",
        "positions",
        study,
        "--distances",
        "190,20,12",
        "--paddles",
        "rigid",
        "--no-picture",
    ]);
    assert!(said.contains("rigid_190mm") && said.contains("failed"), "{said}");
    let table = fs::read_to_string(volunteer.join("out/studies/positions/positions.csv")).unwrap();
    assert_eq!(table.lines().count(), 4, "{table}");

    let unknown = mammotwin(&["study", "paddles", study, "--paddles", "soft"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("rigid, flex, elastic"));
}
