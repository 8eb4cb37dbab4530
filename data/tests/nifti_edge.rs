//! A collection of unusual and malformed files that is not kept with the project.

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
