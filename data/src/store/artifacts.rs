//! Central types as artifacts: images and labels as NIfTI, landmarks as CSV, surfaces as STL.

use super::Artifact;
use crate::{
    Failure,
    io::{
        landmarks,
        nifti::{self, Version, VoxelType},
        ply, stl,
    },
    labels::{LabelMap, RawLabels, Scribbles},
    landmarks::Landmarks,
    surface::TriMesh,
    volume::Volume,
};
use std::path::Path;

impl Artifact for Volume<f32> {
    const EXTENSION: &'static str = "nii.gz";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        Ok(nifti::write(path, self, VoxelType::F32, Version::Two)?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        Ok(nifti::read(path)?)
    }
}

impl Artifact for LabelMap {
    const EXTENSION: &'static str = "nii.gz";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        Ok(nifti::write_labels(path, self, Version::One)?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        Ok(nifti::read_labels(path)?)
    }
}

impl Artifact for Scribbles {
    const EXTENSION: &'static str = "nii.gz";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let values = self.0.map(|mark| u16::from(Self::label(mark)));
        Ok(nifti::write_raw_labels(path, &values, Version::One)?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        Ok(nifti::read_scribbles(path)?)
    }
}

impl Artifact for RawLabels {
    const EXTENSION: &'static str = "nii.gz";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        Ok(nifti::write_raw_labels(path, &self.0, Version::One)?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        Ok(nifti::read_raw_labels(path)?)
    }
}

impl Artifact for TriMesh {
    const EXTENSION: &'static str = "stl";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        stl::write(path, self)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("ply") => ply::read(path),
            _ => stl::read(path),
        }
    }
}

impl Artifact for Landmarks {
    const EXTENSION: &'static str = "csv";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        Ok(landmarks::write_csv(path, self)?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        Ok(landmarks::read(path)?)
    }
}
