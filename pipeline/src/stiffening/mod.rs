//! Jₘ and the place of the paddle from a measured course of force and thickness.

mod gravity;
mod page;
mod posterior;

pub use gravity::{Both, Hanging, gravity_table};
pub use page::{course_table, page, posterior_table, said};
pub use posterior::{Course, Grid, Marginal, Posterior, RecordError};

use mammotwin_data::{
    Failure,
    study::{CompressLaw, CompressPlan, LawName, StopPlan},
};
use std::{fs, path::Path};

/// One point of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// Force (N).
    pub force_n: f64,
}

/// First line of a record.
const HEADER: &str = "thickness_mm,force_n";
/// Larger files are no records (bytes).
const MOST_BYTES: u64 = 1 << 20;
/// How much farther (mm) than a record the model is pressed: forces change with the thickness there too.
const FARTHER_MM: f64 = 0.5;

/// Reads a record: a CSV table `thickness_mm,force_n`; lines that begin with # are left out.
///
/// # Errors
/// [`Failure::BadInput`] with the line that cannot be meant.
pub fn read_record(path: &Path) -> Result<Vec<Measured>, Failure> {
    let refuse = |why: String| Failure::BadInput(format!("{}: {why}", path.display()));
    let size = fs::metadata(path).map_err(|cause| Failure::io(path, cause))?.len();
    if size > MOST_BYTES {
        return Err(refuse(format!("{size} bytes; a record is a short table {HEADER}")));
    }
    let bytes = fs::read(path).map_err(|cause| Failure::io(path, cause))?;
    let text = String::from_utf8(bytes).map_err(|_| refuse("is not text".into()))?;
    let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    let mut lines = lines.by_ref().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    match lines.next() {
        Some((_, line)) if line.trim_start_matches('\u{feff}') == HEADER => {}
        _ => return Err(refuse(format!("first line: write {HEADER}"))),
    }
    let mut record = Vec::new();
    for (number, line) in lines {
        let cells: Vec<Option<f64>> = line.split(',').map(|c| c.trim().parse().ok()).collect();
        let [Some(thickness_mm), Some(force_n)] = cells[..] else {
            return Err(refuse(format!("line {number}: write two numbers, {HEADER}")));
        };
        if !(5.0..=200.0).contains(&thickness_mm) || !(0.0..=500.0).contains(&force_n) {
            let text = "thickness is 5 to 200 mm, force 0 to 500 N";
            return Err(refuse(format!("line {number}: {text}")));
        }
        record.push(Measured { thickness_mm, force_n });
    }
    if record.is_empty() {
        return Err(refuse("holds no point".into()));
    }
    Ok(record)
}

/// The compression of a study with another Jₘ and another place of the paddle, to the smallest
/// thickness of a record.
pub fn way(
    plan: &CompressPlan,
    jm: f64,
    distance_mm: f64,
    record: &[Measured],
) -> (String, CompressPlan) {
    let least = record.iter().map(|m| m.thickness_mm).fold(f64::INFINITY, f64::min);
    let law = CompressLaw { name: LawName::Gent, jm: Some(jm), ..plan.law };
    let stop = StopPlan {
        thickness_mm: Some(least - FARTHER_MM),
        force_n: None,
        mean_pressure_kpa: None,
        peak_pressure_kpa: None,
    };
    let label = format!("jm_{jm}_at_{distance_mm}mm").replace('.', "-");
    (label, CompressPlan { law, stop, chest_wall_distance_mm: distance_mm, ..plan.clone() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    #[test]
    fn records_are_read_and_what_cannot_be_meant_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("record.csv");
        let read = |text: &str| {
            fs::write(&path, text).unwrap();
            read_record(&path)
        };
        let found = read("# unit 3\nthickness_mm,force_n\n60,12.5\n\n 50.5 , 40\n").unwrap();
        assert_eq!(found[1], Measured { thickness_mm: 50.5, force_n: 40.0 });
        for (text, word) in [
            ("60,12.5\n", "first line"),
            ("thickness_mm,force_n\n", "no point"),
            ("thickness_mm,force_n\n60;12\n", "line 2"),
            ("thickness_mm,force_n\n60,12\nnan,3\n", "line 3"),
            ("thickness_mm,force_n\n6,1200\n", "0 to 500 N"),
        ] {
            let said = read(text).unwrap_err().to_string();
            assert!(said.contains(word), "{said}");
        }
    }
}
