//! Finds the participants of a BIDS folder and writes the study of each.

use super::{
    names, refuse,
    sidecar::{self, beside},
};
use mammotwin_data::{
    Failure, Vec3,
    io::{landmarks, nifti},
    landmarks::Landmarks,
};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};
use toml::{Table, Value};

/// Postures that are told by the name of a pose alone.
const POSTURES: [&str; 3] = ["supine", "prone", "upright"];

/// One participant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Participant {
    /// Label without `sub-`.
    pub label: String,
    /// Image of each pose.
    pub poses: BTreeMap<String, PathBuf>,
    /// The BIDS folder that they lie in.
    pub bids: PathBuf,
}

/// The labels of all participants, or those that are wanted, in the order of the folder.
///
/// # Errors
/// When there is none, or a wanted one is not there.
pub fn labels(bids: &Path, wanted: &[String]) -> Result<Vec<String>, Failure> {
    let there: Vec<String> = names(bids)?
        .into_iter()
        .filter(|name| bids.join(name).is_dir())
        .filter_map(|name| name.strip_prefix("sub-").map(String::from))
        .collect();
    if there.is_empty() {
        return Err(refuse(bids, "no participant; a BIDS folder has folders sub-LABEL"));
    }
    let wanted: Vec<&str> =
        wanted.iter().map(|label| label.strip_prefix("sub-").unwrap_or(label)).collect();
    if let Some(missing) = wanted.iter().find(|label| !there.iter().any(|there| there == **label)) {
        let text = format!("--participant-label {missing}: there are: {}", there.join(", "));
        return Err(Failure::Usage(text));
    }
    let plain = |label: &&String| label.chars().all(|c| c.is_ascii_alphanumeric());
    if let Some(label) = there.iter().find(|label| !plain(label)) {
        let why = format!("{label:?} is no label; BIDS allows letters and digits");
        return Err(refuse(&bids.join(format!("sub-{label}")), why));
    }
    Ok(there.into_iter().filter(|l| wanted.is_empty() || wanted.contains(&l.as_str())).collect())
}

/// The images of a participant, over all sessions.
///
/// # Errors
/// When there is no image, or two of the same pose.
pub fn participant(bids: &Path, label: &str) -> Result<Participant, Failure> {
    let folder = bids.join(format!("sub-{label}"));
    let mut places = vec![folder.join("anat")];
    for name in names(&folder)?.iter().filter(|name| name.starts_with("ses-")) {
        places.push(folder.join(name).join("anat"));
    }
    let mut poses: BTreeMap<String, PathBuf> = BTreeMap::new();
    for place in places.iter().filter(|place| place.is_dir()) {
        for name in names(place)? {
            let Some(stem) = name.strip_suffix(".nii.gz").or(name.strip_suffix(".nii")) else {
                continue;
            };
            let mut parts = stem.split('_');
            let weighted = ["T1w", "T2w"].contains(&parts.next_back().unwrap_or_default());
            let pose = parts.find_map(|part| part.strip_prefix("acq-"));
            let (true, Some(pose)) = (weighted, pose) else { continue };
            let path = place.join(&name);
            if let Some(other) = poses.insert(pose.to_owned(), path.clone()) {
                let why = format!("the pose {pose} has another image, {}", other.display());
                return Err(refuse(&path, why));
            }
        }
    }
    if poses.is_empty() {
        let why = "no image of a pose; name it sub-LABEL_acq-POSE_T1w.nii.gz in anat/";
        return Err(refuse(&folder, why));
    }
    Ok(Participant { label: label.to_owned(), poses, bids: bids.into() })
}

/// `sub-01_acq-prone_T1w` -> `sub-01_acq-prone_landmarks.csv` beside it, when it is there.
fn landmark_file(image: &Path) -> Option<PathBuf> {
    let stem = beside(image, "");
    let name = stem.file_name()?.to_string_lossy().into_owned();
    let (stem, _) = name.rsplit_once('_')?;
    let path = image.with_file_name(format!("{stem}_landmarks.csv"));
    path.exists().then_some(path)
}

/// Writes the study of a participant into `folder`, from a template.
///
/// # Errors
/// A template with a subject or poses of its own, a pose without a direction of gravity, or landmarks
/// that cannot be meant.
pub fn write_study(
    participant: &Participant,
    template: (&Path, &str),
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let (template_path, text) = template;
    let mut study: Table =
        text.parse().map_err(|cause: toml::de::Error| refuse(template_path, cause.message()))?;
    if let Some(key) = ["subject", "poses"].into_iter().find(|key| study.contains_key(*key)) {
        let why = format!("[{key}] comes from the BIDS folder; take it out of the template");
        return Err(refuse(template_path, why));
    }
    let held_out = held_out(study.remove("bids"), template_path)?;
    fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
    let mut poses = Table::new();
    for name in participant.poses.keys() {
        poses.insert(name.clone(), Value::Table(pose(participant, name, &held_out, folder)?));
    }
    study.entry("schema").or_insert(Value::Integer(1));
    let subject: Table =
        [("id".into(), format!("sub-{}", participant.label).into())].into_iter().collect();
    study.insert("subject".into(), Value::Table(subject));
    study.insert("poses".into(), Value::Table(poses));
    let path = folder.join("study.toml");
    fs::write(&path, study.to_string()).map_err(|cause| Failure::io(&path, cause))?;
    Ok(path)
}

/// Poses that the template keeps for the validation.
fn held_out(bids: Option<Value>, template: &Path) -> Result<Vec<String>, Failure> {
    let Some(bids) = bids else { return Ok(Vec::new()) };
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Plan {
        validate: Vec<String>,
    }
    let plan = bids.try_into::<Plan>();
    plan.map(|plan| plan.validate)
        .map_err(|cause| refuse(template, format!("[bids]: {}", cause.message())))
}

fn pose(
    participant: &Participant,
    name: &str,
    held_out: &[String],
    folder: &Path,
) -> Result<Table, Failure> {
    let image = &participant.poses[name];
    let told = sidecar::read(&participant.bids, image)?;
    let absolute = |path: &Path| {
        let path = fs::canonicalize(path).map_err(|cause| Failure::io(path, cause))?;
        let text = path.to_str().ok_or_else(|| refuse(&path, "its name is not UTF-8"))?;
        Ok::<Value, Failure>(Value::String(text.into()))
    };
    let mut pose = Table::new();
    pose.insert("image".into(), absolute(image)?);
    match told.gravity {
        Some(gravity) => {
            let gravity = gravity.map(Value::Float).to_vec();
            pose.insert("gravity_in_image".into(), Value::Array(gravity));
        }
        None if POSTURES.contains(&name) => {
            pose.insert("posture".into(), name.into());
        }
        None => {
            let why = format!(
                "the direction of gravity in the pose {name} is not known; write GravityInImage \
                 (RAS) into {}",
                beside(image, ".json").display()
            );
            return Err(refuse(image, why));
        }
    }
    let mut marks = landmark_file(image);
    if marks.is_none() && !told.landmarks.is_empty() {
        let path = folder.join(format!("{name}_landmarks.csv"));
        landmarks::write_csv(&path, &in_mm(image, &told.landmarks)?)?;
        marks = Some(path);
    }
    if let Some(marks) = marks {
        pose.insert("landmarks".into(), absolute(&marks)?);
    }
    if held_out.iter().any(|held| held == name) {
        pose.insert("use".into(), "validate".into());
    }
    Ok(pose)
}

/// Landmarks of a sidecar, which are voxels of its image.
fn in_mm(image: &Path, voxels: &BTreeMap<String, [f64; 3]>) -> Result<Landmarks, Failure> {
    let grid = nifti::read(image)?.grid;
    let mm = |(name, voxel): (&String, &[f64; 3])| (name.clone(), grid.world(&Vec3::from(*voxel)));
    Ok(Landmarks(voxels.iter().map(mm).collect()))
}
