//! A folder of the Brain Imaging Data Structure as input, derivatives of the same as output.
//!
//! One image for each pose: `sub-01/anat/sub-01_acq-prone_T1w.nii.gz`. What BIDS has no word for is
//! told in `docs/bids.md`.

pub mod dataset;
pub mod derivatives;
pub mod group;
mod sidecar;

use mammotwin_data::Failure;
use std::{fs, path::Path};

/// Study of a participant when no template is given.
pub const DEFAULT_TEMPLATE: &str = include_str!("template.toml");

fn refuse(path: &Path, why: impl std::fmt::Display) -> Failure {
    Failure::BadInput(format!("{}: {why}", path.display()))
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Result<Vec<String>, Failure> {
    let entries = fs::read_dir(folder).map_err(|cause| match cause.kind() {
        std::io::ErrorKind::NotFound => refuse(folder, "no such folder"),
        _ => Failure::io(folder, cause),
    })?;
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(|cause| Failure::io(folder, cause))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}
