//! `mammotwin segment`: labels of single images, with pictures to look at.

use super::write;
use crate::{
    cli::SegmentArguments,
    display::Task,
    segmentation::overlay::{behind_tip, overlay},
};
use mammotwin_data::{
    Failure,
    io::nifti::{self, Version},
    labels::{Side, Tissue},
    progress::{Part, Progress},
};
use mammotwin_imaging::mri::{
    breast::{Volumes, sides},
    segment::{Options, Segmentation, segment_marked},
};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Segments each image and writes `NAME_labels.nii.gz` and `NAME.png`, with cuts through both breasts, for
/// each, and `volumes.csv`. An image that is refused does not keep the others from being done.
pub fn segment(arguments: &SegmentArguments) -> Result<(), Failure> {
    let SegmentArguments { images, scribbles, out, json, .. } = arguments;
    if scribbles.is_some() && images.len() > 1 {
        return Err(Failure::Usage("--scribbles: marks are of one image; give one".into()));
    }
    let names = images.iter().map(|image| stem(image)).collect::<Result<Vec<_>, _>>()?;
    if let Some(twice) = names.iter().enumerate().find(|(n, name)| names[..*n].contains(name)) {
        let text =
            format!("two images are called {}; rename one, or give it to another call", twice.1);
        return Err(Failure::Usage(text));
    }
    if let Some(none) = images.iter().chain(scribbles).find(|path| !path.exists()) {
        return Err(Failure::BadInput(format!("{}: no such file", none.display())));
    }
    let there = names.iter().map(|name| labels_of(out, name)).find(|labels| labels.exists());
    if let Some(labels) = there.filter(|_| !arguments.force) {
        return Err(Failure::Usage(format!(
            "{}: is there already, perhaps corrected by hand; give another --out, or --force",
            labels.display()
        )));
    }
    fs::create_dir_all(out).map_err(|cause| Failure::io(out, cause))?;
    let task = Task::new("segment");
    let (mut facts, mut refused) = (Vec::new(), None);
    for (n, (path, name)) in images.iter().zip(&names).enumerate() {
        let share = |n: usize| n as f64 / images.len() as f64;
        let part = Part { whole: &task, from: share(n), to: share(n + 1) };
        match one(path, name, scribbles.as_deref(), out, &part) {
            Ok(found) => facts.push(found),
            Err(cause @ Failure::Io { .. }) => return Err(cause),
            Err(cause) => {
                facts.push(json!({ "image": name, "refused": cause.to_string() }));
                refused.get_or_insert(cause);
            }
        }
    }
    drop(task);
    write(&out.join("volumes.csv"), table(&facts))?;
    if *json {
        tell!("{:#}", Value::from(facts));
    } else {
        facts.iter().for_each(say);
        tell!("{}: labels, pictures, volumes.csv", out.display());
    }
    refused.map_or(Ok(()), Err)
}

/// Where the labels of an image go.
fn labels_of(out: &Path, name: &str) -> PathBuf {
    out.join(format!("{name}_labels.nii.gz"))
}

/// What the files of an image are called.
fn stem(image: &Path) -> Result<String, Failure> {
    let name = image.file_name().unwrap_or_default().to_string_lossy();
    let stem = [".nii.gz", ".nii"].iter().find_map(|ending| name.strip_suffix(ending));
    stem.map(str::to_owned).ok_or_else(|| {
        Failure::Usage(format!("{}: give a NIfTI image, .nii or .nii.gz", image.display()))
    })
}

fn one(
    path: &Path,
    name: &str,
    scribbles: Option<&Path>,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Value, Failure> {
    let image = nifti::read(path)?;
    let scribbles = scribbles.map(nifti::read_scribbles).transpose()?;
    let found = segment_marked(&image, scribbles.as_ref(), &Options::default(), progress)
        .map_err(|cause| Failure::BadInput(format!("{}: {cause}", path.display())))?;
    let labels = &found.labels;
    nifti::write_labels(&labels_of(out, name), labels, Version::One)?;
    let sides = [Side::Right, Side::Left];
    let rows: Vec<_> =
        sides.into_iter().filter_map(|side| Some((labels, behind_tip(labels, side)?))).collect();
    write(&out.join(format!("{name}.png")), overlay(&image, &rows).png())?;
    Ok(facts(name, &found))
}

const MM3_PER_ML: f64 = 1000.0;

/// Columns of the table, after the name: keys of [`facts`].
const COLUMNS: [&str; 8] = [
    "breast_right_ml",
    "breast_left_ml",
    "gland_right_percent",
    "gland_left_percent",
    "muscle_ml",
    "wall_seen_percent",
    "muscle_rear_seen_percent",
    "refused",
];

fn facts(name: &str, found: &Segmentation) -> Value {
    let labels = &found.labels;
    let sides = sides(labels);
    let [right, left] = [Side::Right, Side::Left].map(|side| Volumes::of(labels, &sides, side));
    let muscle = labels.values.iter().filter(|tissue| **tissue == Tissue::PectoralMuscle).count();
    let percent = |volumes: &Volumes| volumes.gland_share().map(|share| 100.0 * share);
    let warnings: Vec<String> = found.warnings.iter().map(ToString::to_string).collect();
    json!({
        "image": name,
        "breast_right_ml": right.total_mm3() / MM3_PER_ML,
        "breast_left_ml": left.total_mm3() / MM3_PER_ML,
        "gland_right_percent": percent(&right),
        "gland_left_percent": percent(&left),
        "muscle_ml": muscle as f64 * labels.grid.voxel_mm3() / MM3_PER_ML,
        "wall_seen_percent": 100.0 * found.wall_seen,
        "muscle_rear_seen_percent": 100.0 * found.muscle_rear_seen,
        "warnings": warnings,
    })
}

fn table(facts: &[Value]) -> String {
    let mut text = format!("image,{}\n", COLUMNS.join(","));
    for fact in facts {
        let cell = |key: &str| match &fact[key] {
            Value::Number(number) => format!("{:.2}", number.as_f64().unwrap_or(f64::NAN)),
            Value::String(words) => format!("\"{}\"", words.replace('"', "\"\"")),
            _ => String::new(),
        };
        let cells: Vec<String> = COLUMNS.iter().map(|column| cell(column)).collect();
        text += &format!("{},{}\n", cell("image"), cells.join(","));
    }
    text
}

fn say(fact: &Value) {
    let name = fact["image"].as_str().unwrap_or_default();
    if let Some(why) = fact["refused"].as_str() {
        tell!("{name}: refused: {why}");
        return;
    }
    let number = |key: &str| fact[key].as_f64().unwrap_or(f64::NAN);
    tell!(
        "{name}: breasts {:.0} and {:.0} ml (right, left), gland {:.0} and {:.0} %, muscle {:.0} ml",
        number("breast_right_ml"),
        number("breast_left_ml"),
        number("gland_right_percent"),
        number("gland_left_percent"),
        number("muscle_ml")
    );
    for warning in fact["warnings"].as_array().into_iter().flatten() {
        tell!("  {}", warning.as_str().unwrap_or_default());
    }
}
