//! The rigid motion of a pose to the reference pose, from the images behind the breasts, whose
//! chest wall may change its shape.

use crate::{
    align::Start,
    artifact::{load_json, save_json},
};
use mammotwin_data::{
    Failure, Vec3,
    labels::LabelMap,
    progress::Progress,
    rigid::RigidTransform,
    store::{Artifact, Stage},
    volume::Volume,
};
use mammotwin_imaging::mri::register::{self, Search};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// So far in front of the muscle (mm) its edge to the fat is compared too ...
const AHEAD_MM: f64 = 3.0;
/// ... and so far behind it the ribs.
const BEHIND_MM: f64 = 20.0;

/// Registers the image of a pose to the reference pose.
#[derive(Debug, Clone, Serialize)]
pub struct Register {
    /// Unit vector of gravity in the pose's image.
    pub gravity_in_image: Vec3,
}

/// How a pose lies in the reference pose's frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Registered {
    /// From the pose's image to the reference pose.
    pub transform: RigidTransform,
    /// Unit vector of gravity in the reference pose's frame.
    pub gravity: Vec3,
    /// The motion that the landmarks alone gave.
    pub start: Start,
    /// What the image registration says of itself; `None` for the reference pose.
    pub image: Option<register::Registration>,
}

impl Registered {
    /// The reference pose itself.
    pub fn reference(gravity: Vec3) -> Self {
        let transform = RigidTransform::identity();
        let start = Start { transform, landmark_rms_mm: None, landmarks: 0 };
        Self { transform, gravity, start, image: None }
    }
}

impl Artifact for Registered {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

impl Stage for Register {
    const NAME: &'static str = "register";
    const VERSION: u32 = 4;
    const METHODS: &'static str = "Poses were registered to the reference pose by maximising the normalised \
         cross-correlation of the images over the pectoral muscle and the ribs behind it, from coarse \
         to fine: first rigidly, then with a smooth change of the chest wall's shape (cubic B-splines; \
         Rueckert, IEEE Trans. Med. Imaging 18 (1999) 712) of which the rigid part over the front of \
         the muscle was kept.";
    type Input = (Volume<f32>, LabelMap, Volume<f32>, Start);
    type Output = Registered;

    fn run(
        &self,
        (reference, labels, moving, start): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Registered, Failure> {
        let mask = register::chest_wall_mask(labels, BEHIND_MM, AHEAD_MM);
        let search = if start.landmark_rms_mm.is_some() { Search::Near } else { Search::Wide };
        let options = register::Options { search, ..register::Options::default() };
        let front = register::chest_wall_front(labels);
        let start_at = &start.transform;
        let found = register::register_changed(
            reference, &mask, &front, moving, start_at, &options, progress,
        )
        .map_err(|cause| Failure::Numerics(format!("registration: {cause}")))?;
        let gravity = found.transform.direction(&self.gravity_in_image).normalize();
        Ok(Registered { transform: found.transform, gravity, start: *start, image: Some(found) })
    }
}
