//! Records of `study force-curve`, their figure, and what the command refuses.

use mammotwin::force_curve::{Band, band, csv, read_record, record_table};
use mammotwin_stages::force_curve::record::{Channel, Reading};
use std::{fs, process::Command};

#[test]
fn records_are_read_and_what_cannot_be_meant_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record.csv");
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        read_record(&path)
    };
    let text = "# unit 3\nthickness_mm,force_n,tilt_deg\n60,12.5,\n\n 50.5 , 40, 1.5\n";
    let found = read(text).unwrap();
    assert_eq!(found.0.len(), 3);
    assert_eq!(found.0[2], Reading { thickness_mm: 50.5, channel: Channel::Tilt, value: 1.5 });
    assert_eq!(read(&record_table(&found)).unwrap(), found);
    for (text, word) in [
        ("60,12.5\n", "first line"),
        ("thickness_mm,force_n,force_n\n60,1,1\n", "first line"),
        ("thickness_mm,tilt_deg\n60,1\n", "first line"),
        ("thickness_mm,force_n\n", "no force"),
        ("thickness_mm,force_n\n60;12\n", "line 2"),
        ("thickness_mm,force_n\n60,12\nnan,3\n", "line 3"),
        ("thickness_mm,force_n,tilt_deg\n60,12,90\n", "tilt_deg"),
        ("thickness_mm,force_n\n60,1200\n", "0 to 500"),
    ] {
        let said = read(text).unwrap_err().to_string();
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn a_figure_shows_record_band_and_both_curves() {
    let figure = Band {
        title: "a < b".into(),
        record: vec![(60.0, 5.0, true), (50.0, 20.0, false)],
        model: vec![[60.0, 4.0, 5.0, 0.5], [50.0, 15.0, 20.0, 0.8]],
        with: Some("with limit_chain 0.200".into()),
        another: false,
    };
    let svg = band(&figure);
    assert!(svg.contains("a &lt; b") && svg.contains("limit_chain 0.200"));
    assert_eq!(svg.matches("<circle").count(), 2);
    assert_eq!(svg.matches("<polyline").count(), 2);
    // The highest thing is the upper end of the band, below the top margin.
    assert!(svg.contains("<polygon"));
    assert!(
        csv(&figure).lines().last().is_some_and(|line| line == "50.000,15.0000,20.0000,0.8000")
    );
}

#[test]
fn what_cannot_be_meant_is_refused_before_anything_is_computed() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("study.toml"), "schema = 1\n").unwrap();
    for (arguments, code, says) in [
        (&["study.toml"][..], 2, "--record"),
        (&["--record", "curve.csv"], 2, "STUDY.toml"),
        (&["--draws", "0"], 2, "--draws"),
        (&["--size-mm", "2"], 2, "--size-mm"),
        (&["--stiffer", "0"], 2, "--stiffer"),
        (&["--preset", "medium"], 2, "medium"),
        (&["--thickness-error-mm", "0"], 2, "above 0"),
        (&["study.toml", "--record", "curve.csv"], 65, "study.toml"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_mammotwin"))
            .args(["study", "force-curve"])
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "something was written");
}
