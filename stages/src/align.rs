//! First guess of the rigid motion of a pose: from its chest-wall landmarks, else from its image.

use crate::{
    artifact::{load_json, save_json},
    register::{AHEAD_MM, BEHIND_MM},
};
use mammotwin_data::{
    Failure,
    labels::LabelMap,
    landmarks::Landmarks,
    progress::Progress,
    rigid::RigidTransform,
    store::{Artifact, Stage},
    volume::Volume,
};
use mammotwin_imaging::mri::register::{self, Search, landmarks};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Landmarks whose names start so lie on the chest wall.
pub const CHEST_WALL: &str = "chest_";
/// Distances of the points (mm) that a start from the images is found on: the registration goes on.
const LEVELS_MM: [f64; 2] = [6.0, 3.0];

/// Fits the chest-wall landmarks of a pose to those of the reference pose. With fewer than three in
/// common the images are searched: a pose must be known before it can be segmented.
#[derive(Debug, Clone, Serialize)]
pub struct Align;

/// Where a pose lies, before its image is looked at closely.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// From the pose's image to the reference pose.
    pub transform: RigidTransform,
    /// Root mean square distance (mm) of the landmarks after the fit; `None` when the images gave
    /// the motion.
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

impl Start {
    /// From the landmarks that both poses have; `None` with fewer than three on the chest wall.
    ///
    /// # Errors
    /// [`Failure::BadInput`] when they lie on a line.
    pub fn of_landmarks(
        reference: &Landmarks,
        moving: &Landmarks,
    ) -> Result<Option<Self>, Failure> {
        let pairs: Vec<_> =
            moving.pairs(reference, CHEST_WALL).iter().map(|(_, from, to)| (*from, *to)).collect();
        if pairs.len() < 3 {
            return Ok(None);
        }
        let fit = landmarks::fit(&pairs)
            .map_err(|cause| Failure::BadInput(format!("chest-wall landmarks: {cause}")))?;
        let landmarks = pairs.len();
        Ok(Some(Self { transform: fit.transform, landmark_rms_mm: Some(fit.rms_mm), landmarks }))
    }

    /// From the images alone: the centres of the bodies together, then the best of many turns and
    /// shifts over the chest wall of the reference.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the images have too little in common.
    pub fn of_images(
        (reference, labels): (&Volume<f32>, &LabelMap),
        moving: &Volume<f32>,
        progress: &dyn Progress,
    ) -> Result<Self, Failure> {
        let mask = register::chest_wall_mask(labels, BEHIND_MM, AHEAD_MM);
        let centers =
            register::align_centers(&register::bright(reference), &register::bright(moving));
        let from = centers.unwrap_or_else(RigidTransform::identity);
        let options = register::Options {
            search: Search::Wide,
            levels_mm: LEVELS_MM.into(),
            ..register::Options::default()
        };
        let found = register::register(reference, &mask, moving, &from, &options, progress)
            .map_err(|cause| Failure::Numerics(format!("start of the registration: {cause}")))?;
        Ok(Self { transform: found.transform, landmark_rms_mm: None, landmarks: 0 })
    }
}

/// Image and labels of the reference pose, image of the other.
pub type Images = (Volume<f32>, LabelMap, Volume<f32>);

impl Stage for Align {
    const NAME: &'static str = "align";
    const VERSION: u32 = 3;
    const METHODS: &'static str = "A first rigid motion of each pose was found from the chest-wall landmarks by least \
         squares (Kabsch, Acta Cryst. A 32 (1976) 922), where there were fewer than three by a search \
         over turns and shifts for the highest correlation of the images.";
    type Input = (Option<Landmarks>, Option<Landmarks>, Images);
    type Output = Start;

    fn run(
        &self,
        (reference, moving, (image, labels, other)): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Start, Failure> {
        let marked = match (reference, moving) {
            (Some(reference), Some(moving)) => Start::of_landmarks(reference, moving)?,
            _ => None,
        };
        match marked {
            Some(start) => Ok(start),
            None => Start::of_images((image, labels), other, progress),
        }
    }
}
