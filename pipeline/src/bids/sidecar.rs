//! What the sidecars of BIDS say of an image, those of the folders above it included.

use super::{names, refuse};
use mammotwin_data::Failure;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// What is read of the sidecars of an image.
#[derive(Debug, Default, PartialEq, Deserialize)]
pub struct Sidecar {
    /// Voxels, from 0, in the order of the file.
    #[serde(rename = "AnatomicalLandmarkCoordinates", default)]
    pub landmarks: BTreeMap<String, [f64; 3]>,
    /// Direction of gravity, RAS.
    #[serde(rename = "GravityInImage")]
    pub gravity: Option<[f64; 3]>,
}

/// A path with another ending than `.nii` or `.nii.gz`.
pub fn beside(image: &Path, ending: &str) -> PathBuf {
    let name = image.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".nii.gz").or(name.strip_suffix(".nii")).unwrap_or(&name);
    image.with_file_name(format!("{stem}{ending}"))
}

/// Reads what is known of an image of the folder `bids`.
///
/// The inheritance of BIDS: a file `acq-tilted_T1w.json` holds for the images `.._T1w` beside and
/// below it that have all of its entities; key by key the nearest one counts.
///
/// # Errors
/// Two files of one folder that both apply, which BIDS forbids; a file that is no JSON object; a
/// key of another kind.
pub fn read(bids: &Path, image: &Path) -> Result<Sidecar, Failure> {
    let stem = beside(image, "");
    let stem = stem.file_name().unwrap_or_default().to_string_lossy();
    let mut folders: Vec<&Path> =
        image.ancestors().skip(1).take_while(|folder| folder.starts_with(bids)).collect();
    // The nearest is read last, and overrides.
    folders.reverse();
    let mut told = Map::new();
    let mut last = beside(image, ".json");
    for folder in folders {
        let Some(path) = applying(folder, &stem)? else { continue };
        let text = fs::read_to_string(&path).map_err(|cause| Failure::io(&path, cause))?;
        let keys: Map<String, Value> =
            serde_json::from_str(&text).map_err(|cause| refuse(&path, cause))?;
        // Each file by itself, so that the error names the one that is wrong.
        Sidecar::deserialize(Value::Object(keys.clone())).map_err(|cause| refuse(&path, cause))?;
        told.extend(keys);
        last = path;
    }
    Sidecar::deserialize(Value::Object(told)).map_err(|cause| refuse(&last, cause))
}

/// The sidecar of a folder that applies to an image of this stem.
fn applying(folder: &Path, image: &str) -> Result<Option<PathBuf>, Failure> {
    let mut found: Option<PathBuf> = None;
    for name in names(folder)? {
        let applies = name.strip_suffix(".json").is_some_and(|stem| covers(stem, image));
        if !applies {
            continue;
        }
        let path = folder.join(name);
        if let Some(other) = &found {
            let other = other.display();
            let why = format!("applies to {image} as well as {other}; BIDS allows one in a folder");
            return Err(refuse(&path, why));
        }
        found = Some(path);
    }
    Ok(found)
}

/// Whether a sidecar's suffix is that of the image, and its entities are among the image's.
fn covers(sidecar: &str, image: &str) -> bool {
    let parts = |stem: &str| {
        let (entities, suffix) = stem.rsplit_once('_').unwrap_or(("", stem));
        let entities = entities.split('_').filter(|part| !part.is_empty());
        (entities.map(String::from).collect::<Vec<_>>(), suffix.to_owned())
    };
    let ((few, suffix), (all, of_image)) = (parts(sidecar), parts(image));
    suffix == of_image && few.iter().all(|entity| all.contains(entity))
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGE: &str = "sub-01/ses-a/anat/sub-01_ses-a_acq-tilted_T1w.nii.gz";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files.iter().chain([&(IMAGE, "")]) {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    fn gravity(files: &[(&str, &str)]) -> Option<[f64; 3]> {
        let folder = folder(files);
        read(folder.path(), &folder.path().join(IMAGE)).unwrap().gravity
    }

    fn towards(x: f64) -> String {
        format!("{{\"GravityInImage\": [{x}, 0, 0]}}")
    }

    #[test]
    fn what_is_higher_up_holds_below_and_the_nearest_counts() {
        let (one, two, three) = (towards(1.0), towards(2.0), towards(3.0));
        assert_eq!(gravity(&[]), None);
        let top = ("acq-tilted_T1w.json", one.as_str());
        assert_eq!(gravity(&[top]), Some([1.0, 0.0, 0.0]));
        let hers = ("sub-01/sub-01_acq-tilted_T1w.json", two.as_str());
        assert_eq!(gravity(&[hers, top]), Some([2.0, 0.0, 0.0]));
        let beside = ("sub-01/ses-a/anat/sub-01_ses-a_acq-tilted_T1w.json", three.as_str());
        assert_eq!(gravity(&[beside, hers, top]), Some([3.0, 0.0, 0.0]));
        // A nearer file without the key leaves it as it was.
        let silent = ("sub-01/ses-a/anat/sub-01_ses-a_acq-tilted_T1w.json", "{\"EchoTime\": 0.1}");
        assert_eq!(gravity(&[silent, top]), Some([1.0, 0.0, 0.0]));
    }

    #[test]
    fn sidecars_of_other_images_do_not_apply() {
        let text = towards(1.0);
        for name in [
            "acq-prone_T1w.json",
            "acq-tilted_T2w.json",
            "ses-b_acq-tilted_T1w.json",
            "acq-tilt_T1w.json",
            "sub-02/acq-tilted_T1w.json",
            "dataset_description.json",
        ] {
            assert_eq!(gravity(&[(name, &text)]), None, "{name}");
        }
        assert_eq!(gravity(&[("T1w.json", &text)]), Some([1.0, 0.0, 0.0]));
    }

    #[test]
    fn two_in_one_folder_and_what_is_no_sidecar_are_refused() {
        let text = towards(1.0);
        for (files, says) in [
            (vec![("T1w.json", text.as_str()), ("acq-tilted_T1w.json", &text)], "one in a folder"),
            (vec![("T1w.json", "[1]")], "T1w.json: invalid type: sequence, expected a map"),
            (vec![("T1w.json", "{\"GravityInImage\": 3}")], "T1w.json: invalid type"),
        ] {
            let folder = folder(&files);
            let refused = read(folder.path(), &folder.path().join(IMAGE)).unwrap_err().to_string();
            assert!(refused.contains(says), "{refused}");
        }
    }
}
