//! First guess of the rigid motion of a pose: from its chest-wall landmarks.

use crate::artifact::{load_json, save_json};
use mammotwin_data::{
    Failure,
    landmarks::Landmarks,
    progress::Progress,
    rigid::RigidTransform,
    store::{Artifact, Stage},
};
use mammotwin_imaging::mri::register::landmarks;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Landmarks whose names start so lie on the chest wall.
pub const CHEST_WALL: &str = "chest_";

/// Fits the chest-wall landmarks of a pose to those of the reference pose.
#[derive(Debug, Clone, Serialize)]
pub struct Align;

/// Where a pose lies, before its image is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// From the pose's image to the reference pose.
    pub transform: RigidTransform,
    /// Root mean square distance (mm) of the landmarks after the fit; `None` without landmarks.
    pub landmark_rms_mm: Option<f64>,
    /// How many landmarks both poses have.
    pub landmarks: usize,
}

impl Artifact for Start {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

impl Stage for Align {
    const NAME: &'static str = "align";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "A first rigid motion of each pose was found from the chest-wall landmarks by least \
         squares (Kabsch, Acta Cryst. A 32 (1976) 922).";
    type Input = (Option<Landmarks>, Option<Landmarks>);
    type Output = Start;

    fn run(&self, (reference, moving): &Self::Input, _: &dyn Progress) -> Result<Start, Failure> {
        let pairs = match (reference, moving) {
            (Some(reference), Some(moving)) => moving.pairs(reference, CHEST_WALL),
            _ => Vec::new(),
        };
        if pairs.len() < 3 {
            let transform = RigidTransform::identity();
            return Ok(Start { transform, landmark_rms_mm: None, landmarks: pairs.len() });
        }
        let pairs: Vec<_> = pairs.iter().map(|(_, from, to)| (*from, *to)).collect();
        let fit = landmarks::fit(&pairs)
            .map_err(|cause| Failure::BadInput(format!("chest-wall landmarks: {cause}")))?;
        Ok(Start {
            transform: fit.transform,
            landmark_rms_mm: Some(fit.rms_mm),
            landmarks: pairs.len(),
        })
    }
}
