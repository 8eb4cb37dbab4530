//! What a participant's run made, under the names of BIDS derivatives.

use super::dataset::Participant;
use mammotwin_data::{
    Failure, Mat3, Vec3, io::hdf5::Reader, labels::Tissue, rigid::RigidTransform,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Version of BIDS that the names follow.
const BIDS_VERSION: &str = "1.10.0";
/// Name of the folder of the images in addresses (`bids:raw:sub-01/...`).
const RAW: &str = "raw";
/// Colours of the tissues, by label.
const COLORS: [&str; Tissue::ALL.len()] = [
    "#000000", "#E69F00", "#F0C75E", "#56B4E9", "#9AD0F0", "#CC79A7", "#B22222", "#808080",
    "#8B4A2B", "#C8C8C8",
];

/// One column of the table of metrics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Column {
    /// Machine name with its unit.
    #[serde(skip)]
    pub name: String,
    /// What it says.
    #[serde(rename = "LongName")]
    pub long_name: String,
    /// Its unit; `1` for a pure number.
    #[serde(rename = "Units")]
    pub units: String,
    /// Where it comes from.
    #[serde(rename = "Description")]
    pub source: String,
}

/// How the run of a participant ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Status {
    /// All derivatives are there.
    Done,
    /// There are none, or those of an earlier run.
    Failed {
        /// Why.
        message: String,
    },
}

/// Folder of a participant.
pub fn folder(out: &Path, label: &str) -> PathBuf {
    out.join(format!("sub-{label}"))
}

/// Path of a file of a participant: `sub-01/sub-01_SUFFIX`.
pub fn file(out: &Path, label: &str, suffix: &str) -> PathBuf {
    folder(out, label).join(format!("sub-{label}_{suffix}"))
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let done = path.parent().map_or(Ok(()), fs::create_dir_all);
    done.and_then(|()| fs::write(path, text)).map_err(|cause| Failure::io(path, cause))
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    let done = to.parent().map_or(Ok(()), fs::create_dir_all);
    done.and_then(|()| fs::copy(from, to)).map(|_| ()).map_err(|cause| Failure::io(to, cause))
}

/// What stands in the folder of the derivatives for people who find it.
const README: &str = "\
# Derivatives of mammotwin

Breast models and mammography metrics from MRI; for research, not for diagnosis. `sub-LABEL.html` is the report of a
participant, `group.html` that of all. Labels of the segmentations are in `desc-tissues_dseg.tsv`. Transforms are in LPS,
meshes and fields of the results (HDF5) in RAS, both in mm.
";

/// Writes what says that the folder holds derivatives of the folder `bids`.
pub fn describe(out: &Path, bids: &Path) -> Result<(), Failure> {
    let version = env!("CARGO_PKG_VERSION");
    let description = json!({
        "Name": "mammotwin: biomechanical breast models and mammography metrics",
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "derivative",
        "GeneratedBy": [{ "Name": "mammotwin", "Version": version }],
        "DatasetLinks": { RAW: way(out, bids)? },
        "HowToAcknowledge": "Cite the works that the methods in the report of each participant name.",
    });
    write(&out.join("dataset_description.json"), &format!("{description:#}\n"))?;
    let ignored =
        "work\n*.html\n*_results.h5\n*_mammogram.*\n*_metrics.*\n*_status.json\n*_xfm.txt\n";
    write(&out.join(".bidsignore"), ignored)?;
    write(&out.join("README.md"), README)?;
    let mut labels = String::from("index\tname\tcolor\n");
    for (tissue, color) in Tissue::ALL.into_iter().zip(COLORS) {
        let name = serde_json::to_value(tissue).ok();
        let name = name.as_ref().and_then(|name| name.as_str()).unwrap_or_default();
        labels += &format!("{}\t{name}\t{color}\n", tissue.label());
    }
    write(&out.join("desc-tissues_dseg.tsv"), &labels)?;
    let told = json!({
        "Description": "Tissues of the breasts and behind them",
        "SpatialReference": "orig",
    });
    write(&out.join("desc-tissues_dseg.json"), &format!("{told:#}\n"))
}

/// The way from one folder to another, as a relative address.
fn way(from: &Path, to: &Path) -> Result<String, Failure> {
    let absolute = |path: &Path| fs::canonicalize(path).map_err(|cause| Failure::io(path, cause));
    let (from, to) = (absolute(from)?, absolute(to)?);
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(common).map(|_| "..".to_owned());
    let down =
        to.components().skip(common).map(|part| address(part.as_os_str().as_encoded_bytes()));
    let parts: Vec<String> = up.chain(down).collect();
    Ok(if parts.is_empty() { ".".into() } else { parts.join("/") })
}

/// A name as a part of an address.
fn address(name: &[u8]) -> String {
    let part = |byte: &u8| match byte {
        b'-' | b'.' | b'_' | b'~' => char::from(*byte).to_string(),
        byte if byte.is_ascii_alphanumeric() => char::from(*byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    name.iter().map(part).collect()
}

/// Of which image a segmentation is, and whether a person edited it; the rest is told of all at once.
fn segmentation(participant: &Participant, pose: &str, edited: bool) -> Option<String> {
    let image = participant.poses.get(pose)?.strip_prefix(&participant.bids).ok()?;
    let parts = image.components().map(|part| address(part.as_os_str().as_encoded_bytes()));
    let told = json!({
        "Manual": edited,
        "Sources": [format!("bids:{RAW}:{}", parts.collect::<Vec<_>>().join("/"))],
    });
    Some(format!("{told:#}\n"))
}

/// Notes how a run ended.
pub fn note(out: &Path, label: &str, status: &Status) -> Result<(), Failure> {
    let path = file(out, label, "status.json");
    let text = serde_json::to_string_pretty(status).map_err(|cause| Failure::io(&path, cause))?;
    write(&path, &format!("{text}\n"))
}

/// Brings the results of a run folder under their names; `edited` are the poses whose labels a
/// person edited.
pub fn publish(
    run: &Path,
    out: &Path,
    participant: &Participant,
    edited: &[String],
) -> Result<(), Failure> {
    let label = participant.label.as_str();
    let results = run.join("results.h5");
    let read = Reader::open(&results)?;
    let poses = read.names("poses")?;
    let role = |pose: &String| read.text(&format!("poses/{pose}/role"));
    let mut reference = String::new();
    for pose in &poses {
        if role(pose)? == "reference" {
            reference.clone_from(pose);
        }
    }
    let anat = |name: &str| folder(out, label).join("anat").join(format!("sub-{label}_{name}"));
    for pose in &poses {
        let labels = run.join("labels").join(format!("{pose}.nii.gz"));
        if labels.exists() {
            copy(&labels, &anat(&format!("acq-{pose}_desc-tissues_dseg.nii.gz")))?;
            if let Some(told) = segmentation(participant, pose, edited.contains(pose)) {
                write(&anat(&format!("acq-{pose}_desc-tissues_dseg.json")), &told)?;
            }
        }
        if *pose == reference {
            continue;
        }
        let group = format!("poses/{pose}/to_reference");
        let rotation: Vec<[f64; 3]> = read.get(&format!("{group}/rotation"))?;
        let shift: Vec<f64> = read.get(&format!("{group}/translation_mm"))?;
        let ([a, b, c], [x, y, z]) = (&rotation[..], &shift[..]) else {
            return Err(Failure::BadInput(format!("{}: {group}: damaged", results.display())));
        };
        let rotation = Mat3::from_row_slice(&[*a, *b, *c].concat());
        let motion = RigidTransform { rotation, translation: Vec3::new(*x, *y, *z) };
        let name = format!("from-{pose}_to-{reference}_mode-image_xfm.txt");
        write(&anat(&name), &itk(&motion.inverse()))?;
    }
    let pictures = run.join("images");
    if let Ok(entries) = fs::read_dir(&pictures) {
        for entry in entries.flatten() {
            // The phantom's labels stay in the work folder.
            let name = entry.file_name().to_string_lossy().replace('_', "");
            let Some(name) = name.strip_prefix("calcifications") else { continue };
            let name = format!("desc-calcifications{}", name.replacen('.', "_mammogram.", 1));
            copy(&entry.path(), &file(out, label, &name))?;
        }
    }
    copy(&results, &file(out, label, "desc-mammotwin_results.h5"))?;
    copy(&run.join("report.html"), &out.join(format!("sub-{label}.html")))?;
    let (columns, values) = metrics(&read)?;
    let head: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    let row: Vec<String> = values.iter().map(f64::to_string).collect();
    let table = format!("participant_id\t{}\nsub-{label}\t{}\n", head.join("\t"), row.join("\t"));
    write(&file(out, label, "desc-mammotwin_metrics.tsv"), &table)?;
    let path = file(out, label, "desc-mammotwin_metrics.json");
    write(&path, &dictionary(&columns))
}

/// The JSON that tells what the columns of a table are.
pub fn dictionary(columns: &[Column]) -> String {
    let mut all = serde_json::Map::new();
    for column in columns {
        all.insert(column.name.clone(), json!(column));
    }
    format!("{:#}\n", serde_json::Value::from(all))
}

/// An ITK transform: what brings points of the fixed image (LPS mm) to the moving one.
fn itk(motion: &RigidTransform) -> String {
    let flip = Mat3::from_diagonal(&Vec3::new(-1.0, -1.0, 1.0));
    let (turn, shift) = (flip * motion.rotation * flip, flip * motion.translation);
    // Rows of the matrix, which are the columns of its transpose.
    let numbers: Vec<String> =
        turn.transpose().iter().chain(shift.iter()).map(f64::to_string).collect();
    format!(
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
         Parameters: {}\nFixedParameters: 0 0 0\n",
        numbers.join(" ")
    )
}

/// The metrics of a `results.h5`: moduli, distances of the poses, and those of the report.
fn metrics(read: &Reader) -> Result<(Vec<Column>, Vec<f64>), Failure> {
    let (mut columns, mut values) = (Vec::new(), Vec::new());
    let mut add = |name: String, long_name: String, units: &str, source: &str, value: f64| {
        let (units, source) = (units.into(), source.into());
        columns.push(Column { name, long_name, units, source });
        values.push(value);
    };
    for side in ["right", "left"] {
        let value = read.scalar(&format!("calibration/after/young_{side}_kpa"))?;
        let long_name = format!("Young's modulus of the {side} breast");
        add(format!("young_{side}_kpa"), long_name, "kPa", "calibration", value);
    }
    for pose in read.names("poses")? {
        let name = format!("poses/{pose}/after/modified_hausdorff_mm");
        if read.has(&name) {
            let value = read.scalar(&name)?;
            let long_name = format!("Modified Hausdorff distance of the skin, {pose}");
            let name = format!("{pose}_modified_hausdorff_mm");
            add(name, long_name, "mm", "Mîra 2018, eq. A.7", value);
        }
    }
    let [names, long, units, sources] =
        ["name", "long_name", "unit", "source"].map(|name| read.texts(&format!("metrics/{name}")));
    let numbers: Vec<f64> = read.get("metrics/value")?;
    let rows = names?.into_iter().zip(long?).zip(units?.into_iter().zip(sources?)).zip(numbers);
    for (((name, long_name), (units, source)), value) in rows {
        add(name, long_name, &units, &source, value);
    }
    Ok((columns, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_itk_transform_is_in_lps_and_row_by_row() {
        // A quarter turn about x: y goes to z.
        let rotation = Mat3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        let text = itk(&RigidTransform { rotation, translation: Vec3::new(1.0, 2.0, 3.0) });
        let line = text.lines().find(|line| line.starts_with("Parameters")).unwrap();
        // In LPS y has the other sign, so that the turn runs the other way.
        let numbers: Vec<f64> =
            line["Parameters: ".len()..].split(' ').map(|n| n.parse().unwrap()).collect();
        let want = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, -1.0, -2.0, 3.0];
        assert_eq!(numbers, want);
    }
}
