//! Landmarks from CSV tables and from the markups files of 3D Slicer.
//!
//! | ending      | content                                                         |
//! |-------------|-----------------------------------------------------------------|
//! | `.csv`      | `name,x_mm,y_mm,z_mm`, right-anterior-superior                  |
//! | `.fcsv`     | Slicer 4; states `CoordinateSystem`: 0 or RAS, 1 or LPS         |
//! | `.mrk.json` | Slicer 5; states `coordinateSystem`: `RAS` or `LPS`             |

use crate::{Failure, Vec3, landmarks::Landmarks};
use std::{
    collections::BTreeMap,
    io::{Read, Write},
    path::{Path, PathBuf},
};

/// First line of a CSV table of landmarks.
pub const CSV_HEADER: &str = "name,x_mm,y_mm,z_mm";
/// Larger files are no landmarks (bytes).
const MOST_BYTES: u64 = 4 << 20;

/// Why landmarks were not read or written, in one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LandmarkError {
    /// The file system refused.
    #[error("{}: {cause}", path.display())]
    Io {
        /// File that was touched.
        path: PathBuf,
        /// What the operating system said.
        cause: String,
    },
    /// The content cannot be meant.
    #[error("{}: {what}", path.display())]
    Content {
        /// File that was read or should have been written.
        path: PathBuf,
        /// Where and what, and how to mend it.
        what: String,
    },
}

impl From<LandmarkError> for Failure {
    fn from(error: LandmarkError) -> Self {
        match error {
            LandmarkError::Io { path, cause } => Self::Io { path, cause },
            content => Self::BadInput(content.to_string()),
        }
    }
}

/// Reads landmarks in RAS mm; the format is that of the file's ending.
///
/// # Errors
/// When the file is not what its ending says, gives no coordinate system, repeats a name, or
/// holds a position that is not finite.
pub fn read(path: &Path) -> Result<Landmarks, LandmarkError> {
    let io = |error: std::io::Error| LandmarkError::Io {
        path: path.to_owned(),
        cause: error.to_string(),
    };
    let content = |what| LandmarkError::Content { path: path.to_owned(), what };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(io)?;
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(content(format!("is larger than {MOST_BYTES} bytes; give landmarks")));
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| content("is no UTF-8 text; save it as UTF-8".into()))?;
    let text = text.trim_start_matches('\u{feff}');
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let points = if name.ends_with(".fcsv") {
        fcsv(text)
    } else if name.ends_with(".json") {
        markups(text)
    } else {
        csv(text)
    };
    points.map_err(content)
}

/// Writes landmarks as CSV; reading them gives the same numbers.
///
/// # Errors
/// When a name has a comma, a quote or a control character, or the file system refuses.
pub fn write_csv(path: &Path, landmarks: &Landmarks) -> Result<(), LandmarkError> {
    let mut text = format!("{CSV_HEADER}\n");
    for (name, p) in &landmarks.0 {
        check_name(name).map_err(|what| LandmarkError::Content { path: path.to_owned(), what })?;
        text += &format!("{name},{},{},{}\n", p.x, p.y, p.z);
    }
    let save = || -> std::io::Result<()> {
        let mut file = std::fs::File::create(path)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()
    };
    save().map_err(|e| LandmarkError::Io { path: path.to_owned(), cause: e.to_string() })
}

/// Collects points and refuses what cannot be meant.
#[derive(Default)]
struct Points(BTreeMap<String, Vec3>);

impl Points {
    fn add(&mut self, place: &str, name: &str, point: Vec3) -> Result<(), String> {
        let name = name.trim().trim_matches('"').trim();
        check_name(name).map_err(|what| format!("{place}: {what}"))?;
        if !point.iter().all(|x| x.is_finite() && x.abs() < 1e5) {
            return Err(format!("{place}: the position of {name} is no point in mm; give numbers"));
        }
        if self.0.insert(name.into(), point).is_some() {
            return Err(format!("{place}: {name} is there twice; give each landmark its own name"));
        }
        Ok(())
    }

    fn all(self) -> Result<Landmarks, String> {
        if self.0.is_empty() {
            return Err("holds no landmark; give at least one".into());
        }
        Ok(Landmarks(self.0))
    }
}

fn check_name(name: &str) -> Result<(), String> {
    let odd = |c: char| c.is_control() || c == ',' || c == '"';
    if name.is_empty() || name.len() > 200 || name.chars().any(odd) {
        return Err(format!("{name:?} is no name; use letters, digits and _"));
    }
    Ok(())
}

fn number(place: &str, word: &str) -> Result<f64, String> {
    let word = word.trim();
    word.parse().map_err(|_| format!("{place}: {word:?} is no number; write it like -12.5"))
}

/// Lines with something on them, numbered from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty())
}

fn csv(text: &str) -> Result<Landmarks, String> {
    let mut rows = lines(text).filter(|(_, line)| !line.starts_with('#'));
    let header: String = rows.next().map_or("", |(_, line)| line).split_whitespace().collect();
    if header != CSV_HEADER {
        return Err(format!("the first line must be {CSV_HEADER}"));
    }
    let mut points = Points::default();
    for (n, line) in rows {
        let place = format!("line {n}");
        let cells: Vec<&str> = line.split(',').collect();
        let [name, x, y, z] = cells[..] else {
            return Err(format!("{place}: has {} cells, not 4", cells.len()));
        };
        let point = Vec3::new(number(&place, x)?, number(&place, y)?, number(&place, z)?);
        points.add(&place, name, point)?;
    }
    points.all()
}

/// Signs that bring a stated coordinate system to RAS.
fn to_ras(system: &str) -> Result<Vec3, String> {
    match system.trim() {
        "RAS" | "0" => Ok(Vec3::new(1.0, 1.0, 1.0)),
        "LPS" | "1" => Ok(Vec3::new(-1.0, -1.0, 1.0)),
        other => Err(format!("the coordinate system {other:?} is unknown; use RAS or LPS")),
    }
}

fn fcsv(text: &str) -> Result<Landmarks, String> {
    let stated = |key: &str| {
        lines(text).find_map(|(_, line)| {
            let (found, value) = line.strip_prefix('#')?.split_once('=')?;
            (found.trim() == key).then(|| value.trim().to_owned())
        })
    };
    let system = stated("CoordinateSystem")
        .ok_or("no line says `# CoordinateSystem = `; save it from Slicer again")?;
    let signs = to_ras(&system)?;
    let columns =
        stated("columns").ok_or("no line says `# columns = `; save it from Slicer again")?;
    let column = |name: &str| {
        let place = columns.split(',').position(|column| column.trim() == name);
        place.ok_or_else(|| format!("`# columns` has no {name}; save it from Slicer again"))
    };
    let [x, y, z, label] = [column("x")?, column("y")?, column("z")?, column("label")?];
    let mut points = Points::default();
    for (n, line) in lines(text).filter(|(_, line)| !line.starts_with('#')) {
        let place = format!("line {n}");
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |at: usize| {
            cells.get(at).copied().ok_or_else(|| format!("{place}: has only {} cells", cells.len()))
        };
        let mut point = Vec3::zeros();
        for (axis, at) in [x, y, z].into_iter().enumerate() {
            point[axis] = number(&place, cell(at)?)?;
        }
        points.add(&place, cell(label)?, point.component_mul(&signs))?;
    }
    points.all()
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct MarkupsFile {
    markups: Vec<Markup>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct Markup {
    coordinate_system: Option<String>,
    coordinate_units: Option<serde_json::Value>,
    #[serde(default)]
    control_points: Vec<ControlPoint>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct ControlPoint {
    label: String,
    position: Option<[f64; 3]>,
    position_status: Option<String>,
}

fn markups(text: &str) -> Result<Landmarks, String> {
    let file: MarkupsFile =
        serde_json::from_str(text).map_err(|error| format!("is no markups file: {error}"))?;
    let mut points = Points::default();
    for markup in file.markups {
        let system = markup.coordinate_system.as_deref();
        let signs =
            to_ras(system.ok_or("coordinateSystem is missing; save it from Slicer again")?)?;
        if let Some(units) = markup.coordinate_units.filter(|units| units != "mm") {
            return Err(format!("coordinateUnits is {units}; save it in mm"));
        }
        let placed = |point: &ControlPoint| {
            point.position_status.as_deref().is_none_or(|status| status == "defined")
        };
        for point in markup.control_points.iter().filter(|point| placed(point)) {
            let Some(position) = point.position else {
                return Err(format!("{}: has no position; place it or delete it", point.label));
            };
            let point_ras = Vec3::from(position).component_mul(&signs);
            points.add("controlPoints", &point.label, point_ras)?;
        }
    }
    points.all()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(name: &str, text: &str) -> Result<Landmarks, LandmarkError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn the_three_formats_agree_on_right_and_left() {
        let csv =
            "\u{feff}name,x_mm,y_mm,z_mm\r\n# note\r\nchest_a,10.5,-20,30\r\nb, -1 ,2,3e0\r\n";
        let expected = read_text("a.csv", csv).unwrap();
        assert_eq!(expected.0["chest_a"], Vec3::new(10.5, -20.0, 30.0));
        let fcsv = |system: &str, a: &str, b: &str| {
            format!(
                "# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n\
                 # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n\
                 1,{a},0,0,0,1,1,1,0,chest_a,,\n2,{b},0,0,0,1,1,1,0,b,,\n"
            )
        };
        for system in ["LPS", "1"] {
            let text = fcsv(system, "-10.5,20,30", "1,-2,3");
            assert_eq!(read_text("a.fcsv", &text).unwrap(), expected);
        }
        for system in ["RAS", "0"] {
            let text = fcsv(system, "10.5,-20,30", "-1,2,3");
            assert_eq!(read_text("a.fcsv", &text).unwrap(), expected);
        }
        let json = r#"{"@schema": "x", "markups": [{"type": "Fiducial",
            "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": [
            {"id": "1", "label": "chest_a", "position": [-10.5, 20, 30], "positionStatus": "defined"},
            {"id": "2", "label": "b", "position": [1, -2, 3]},
            {"id": "3", "label": "later", "positionStatus": "undefined"}]}]}"#;
        assert_eq!(read_text("a.mrk.json", json).unwrap(), expected);
    }

    #[test]
    fn a_table_survives_the_round_trip_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.csv");
        let mut landmarks = Landmarks::default();
        landmarks.0.insert("nipple_right".into(), Vec3::new(0.1 + 0.2, -1.0 / 3.0, 1e-7));
        landmarks.0.insert("chest_1".into(), Vec3::new(-0.0, 123.456, 9e4));
        write_csv(&path, &landmarks).unwrap();
        assert_eq!(read(&path).unwrap(), landmarks);
        landmarks.0.insert("a,b".into(), Vec3::zeros());
        assert!(write_csv(&path, &landmarks).is_err());
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_its_place() {
        let check = |name: &str, text: &str, words: &str| {
            let error = read_text(name, text).unwrap_err().to_string();
            assert!(error.contains(words) && !error.contains('\n'), "{error}");
        };
        let row = |row: &str| format!("{CSV_HEADER}\n{row}\n");
        check("a.csv", "a,1,2,3\n", "first line");
        check("a.csv", &row(""), "no landmark");
        check("a.csv", &row("a,1,2"), "line 2: has 3 cells");
        check("a.csv", &row("a,1,2,x"), "line 2: \"x\" is no number");
        check("a.csv", &row("a,1,2,NaN"), "no point in mm");
        check("a.csv", &row("a,1,2,3\na,1,2,3"), "line 3: a is there twice");
        check("a.csv", &row(",1,2,3"), "is no name");
        check("a.fcsv", "1,2,3\n", "CoordinateSystem");
        check("a.fcsv", "# CoordinateSystem = IJK\n", "unknown");
        check("a.mrk.json", "{}", "no markups file");
        let json = r#"{"markups": [{"controlPoints": []}]}"#;
        check("a.mrk.json", json, "coordinateSystem is missing");
    }
}
