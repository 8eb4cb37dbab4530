//! Collections of unusual, malformed and other people's files that are not kept with the project.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::io::nifti::{self, NiftiError};
use std::path::PathBuf;

#[test]
fn every_row_of_the_collection_is_met() {
    let Some(folder) = std::env::var_os("MAMMOTWIN_DATA") else {
        println!("skipped: no real data");
        return;
    };
    let folder = PathBuf::from(folder).join("data/nifti_edge");
    let table = std::fs::read_to_string(folder.join("expected.csv")).unwrap();
    let whole = nifti::read(&folder.join("int16.nii.gz")).unwrap();
    let same = ["n2_int16.nii", "n2_int16.nii.gz", "pair.hdr", "pair2.hdr", "be_int16.nii"];
    let mut rows = 0;
    for row in table.lines().skip(1) {
        let mut cells = row.split(',');
        let (name, expected) = (cells.next().unwrap(), cells.next().unwrap());
        let read = nifti::read(&folder.join(name));
        match (&read, expected) {
            (Ok(image), "ok" | "ok-abs-or-error" | "ok-convert" | "ok-mm-warn" | "ok-or-error") => {
                assert_eq!(image.grid.shape[..2], [7, 6], "{name}");
                if same.contains(&name) {
                    assert_eq!(image.values, whole.values, "{name}");
                    assert!((image.grid.axes - whole.grid.axes).norm() < 1e-6, "{name}");
                }
            }
            (Ok(_), "error-or-sform") => {}
            (Err(NiftiError::Content { .. }), _) if expected != "ok" => {
                println!("{}", read.unwrap_err());
            }
            _ => panic!("{name}: expected {expected}, got {read:?}"),
        }
        rows += 1;
    }
    assert!(rows >= 34, "only {rows} rows were read");
    let metres = nifti::read(&folder.join("units_m.nii")).unwrap();
    assert!((metres.grid.axes / 1000.0 - whole.grid.axes).norm() < 1e-6);
}

/// Shape, affine and values of every file are those that nibabel reads, or the refusal says why not:
/// `nifti_known.csv`.
#[test]
fn every_file_is_read_as_nibabel_reads_it() {
    let Some(folder) = std::env::var_os("MAMMOTWIN_DATA") else {
        println!("skipped: no real data");
        return;
    };
    let folder = PathBuf::from(folder).join("data");
    let table = include_str!("nifti_known.csv");
    let (mut read, mut refused) = (0, 0);
    for row in table.lines().filter(|line| !line.starts_with('#')).skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let [name, outcome, shape, affine, least, greatest, mean, weighted] = cells[..] else {
            panic!("{row}");
        };
        let found = nifti::read(&folder.join(name));
        if let Some(word) = outcome.strip_prefix("refused:") {
            let why = found.expect_err(name).to_string();
            assert!(why.contains(word), "{name}: {why}");
            refused += 1;
            continue;
        }
        let image = found.unwrap_or_else(|why| panic!("{name}: {why}"));
        let numbers =
            |cell: &str| -> Vec<f64> { cell.split(' ').map(|n| n.parse().unwrap()).collect() };
        let wanted: Vec<usize> = numbers(shape).iter().map(|n| *n as usize).collect();
        assert_eq!(image.grid.shape.to_vec(), wanted, "{name}");
        for (n, wanted) in numbers(affine).into_iter().enumerate() {
            let (row, column) = (n / 4, n % 4);
            let got =
                if column < 3 { image.grid.axes[(row, column)] } else { image.grid.origin[row] };
            let close = (got - wanted).abs() <= 1e-6 * wanted.abs().max(1.0);
            assert!(close, "{name}: affine[{row}][{column}] {got}, nibabel {wanted}");
        }
        let values = || image.values.iter().map(|&v| f64::from(v));
        let weights = |n: usize| (1 + n % 97) as f64;
        let total: f64 = (0..image.values.len()).map(weights).sum();
        let got = [
            values().fold(f64::INFINITY, f64::min),
            values().fold(f64::NEG_INFINITY, f64::max),
            values().sum::<f64>() / image.values.len() as f64,
            values().enumerate().map(|(n, v)| v * weights(n)).sum::<f64>() / total,
        ];
        let scale = got[0].abs().max(got[1].abs()).max(1e-6);
        for (got, cell) in got.into_iter().zip([least, greatest, mean, weighted]) {
            let wanted: f64 = cell.parse().unwrap();
            assert!((got - wanted).abs() <= 2e-7 * scale, "{name}: {got}, nibabel {wanted}");
        }
        read += 1;
    }
    println!("{read} files read as nibabel reads them, {refused} refused");
    assert!(read == 42 && refused == 28, "{read} {refused}");
}
