//! Records of a compression with more than forces, tables and figures of what they tell.

mod figure;

pub use figure::{Band, band, csv};

use mammotwin_data::Failure;
use mammotwin_stages::force_curve::record::{Channel, Reading, Record};
use std::{fs, path::Path};

/// Larger files are no records (bytes).
const MOST_BYTES: u64 = 1 << 20;
/// First columns of a record.
const FIRST: &str = "thickness_mm,force_n";

/// Reads a record: a CSV table `thickness_mm,force_n` with, if measured, `contact_area_mm2`, `extent_mm`,
/// `tilt_deg`; cells may be empty, lines that begin with # are left out.
///
/// # Errors
/// [`Failure::BadInput`] with the line that cannot be meant.
pub fn read_record(path: &Path) -> Result<Record, Failure> {
    let refuse = |why: String| Failure::BadInput(format!("{}: {why}", path.display()));
    let size = fs::metadata(path).map_err(|cause| Failure::io(path, cause))?.len();
    if size > MOST_BYTES {
        return Err(refuse(format!("{size} bytes; a record is a short table {FIRST}")));
    }
    let bytes = fs::read(path).map_err(|cause| Failure::io(path, cause))?;
    let text = String::from_utf8(bytes).map_err(|_| refuse("is not text".into()))?;
    let lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header = lines.next().map(|(_, line)| line.trim_start_matches('\u{feff}'));
    let columns = header.and_then(columns).ok_or_else(|| {
        let known: Vec<&str> = Channel::ALL[1..].iter().map(|c| c.column()).collect();
        refuse(format!("first line: write {FIRST} and any of: {}", known.join(", ")))
    })?;
    let mut readings: Vec<Reading> = Vec::new();
    for (number, line) in lines {
        let refuse = |why: String| refuse(format!("line {number}: {why}"));
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != columns.len() + 1 {
            let count = columns.len() + 1;
            return Err(refuse(format!("{} cells instead of {count}", cells.len())));
        }
        let number = |name: &str, cell: &str, [least, most]: [f64; 2]| {
            let value = cell.parse::<f64>().ok().filter(|v| (least..=most).contains(v));
            value.ok_or_else(|| refuse(format!("{name}: write a number from {least} to {most}")))
        };
        let thickness_mm = number("thickness_mm", cells[0], [5.0, 200.0])?;
        for (channel, cell) in columns.iter().zip(&cells[1..]).filter(|(_, cell)| !cell.is_empty())
        {
            let value = number(channel.column(), cell, bounds(*channel))?;
            readings.push(Reading { thickness_mm, channel: *channel, value });
        }
    }
    let record = Record::new(readings);
    if record.forces() == 0 {
        return Err(refuse("holds no force".into()));
    }
    Ok(record)
}

/// What the columns behind the thickness are.
fn columns(header: &str) -> Option<Vec<Channel>> {
    let mut names = header.split(',').map(str::trim);
    if names.next() != Some("thickness_mm") {
        return None;
    }
    let of = |name: &str| Channel::ALL.into_iter().find(|channel| channel.column() == name);
    let columns: Vec<Channel> = names.map(of).collect::<Option<_>>()?;
    let mut once = columns.clone();
    once.sort_unstable();
    once.dedup();
    (columns.first() == Some(&Channel::Force) && once.len() == columns.len()).then_some(columns)
}

/// Values that can be meant.
fn bounds(channel: Channel) -> [f64; 2] {
    match channel {
        Channel::Force => [0.0, 500.0],
        Channel::Area => [0.0, 100_000.0],
        Channel::Extent => [0.0, 300.0],
        Channel::Tilt => [-40.0, 40.0],
    }
}

/// A record as it is read.
pub fn record_table(record: &Record) -> String {
    let names: Vec<&str> = Channel::ALL.iter().map(|channel| channel.column()).collect();
    let mut text = format!("thickness_mm,{}\n", names.join(","));
    let mut thicknesses: Vec<f64> = record.0.iter().map(|r| r.thickness_mm).collect();
    thicknesses.dedup();
    for h in thicknesses {
        let cell = |channel: &Channel| {
            let here = record.0.iter().find(|r| r.thickness_mm == h && r.channel == *channel);
            here.map_or(String::new(), |r| format!("{:.4}", r.value.max(bounds(*channel)[0])))
        };
        let cells: Vec<String> = Channel::ALL.iter().map(cell).collect();
        text += &format!("{h:.3},{}\n", cells.join(","));
    }
    text
}
