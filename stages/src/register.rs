//! The rigid motion of a pose to the reference pose, from the images behind the breasts, whose
//! chest wall may change its shape.

use crate::{
    align::Start,
    artifact::{load_json, save_json},
    surface::PoseSurfaces,
    wall_distance::WallDistances,
};
use mammotwin_data::{
    Failure, Vec3,
    labels::LabelMap,
    progress::Progress,
    rigid::RigidTransform,
    store::{Artifact, Stage},
    volume::Volume,
};
use mammotwin_imaging::mri::register::{self, RegisterError, Search};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// So far in front of the muscle (mm) its edge to the fat is compared too ...
pub(crate) const AHEAD_MM: f64 = 3.0;
/// ... and so far behind it the ribs.
pub(crate) const BEHIND_MM: f64 = 20.0;
/// A mean correlation above this is taken for that of images that lie on each other: T1 and T2 images of one person reach
/// 0.65, digital volunteers 0.95. Below it they may or may not.
const SURE: f64 = 0.6;

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
    /// The motion that the landmarks alone gave, or the images where there were none.
    pub start: Start,
    /// What the image registration says of itself; `None` for the reference pose.
    pub image: Option<register::Registration>,
    /// How far the front of the muscle is from the reference's; `None` for the reference pose, and
    /// where the labels show no breast.
    pub wall: Option<WallDistances>,
}

impl Registered {
    /// The reference pose itself.
    pub fn reference(gravity: Vec3) -> Self {
        let transform = RigidTransform::identity();
        let start = Start { transform, landmark_rms_mm: None, landmarks: 0 };
        Self { transform, gravity, start, image: None, wall: None }
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

/// What is known of a pose: its image, labels and surfaces.
pub type Pose = (Volume<f32>, LabelMap, PoseSurfaces);

impl Stage for Register {
    const NAME: &'static str = "register";
    const VERSION: u32 = 9;
    const METHODS: &'static str = "Poses were registered to the reference pose by maximising the normalised \
         cross-correlation of the images over the pectoral muscle and the ribs behind it, from coarse \
         to fine: first rigidly, then with a smooth change of the chest wall's shape (cubic B-splines; \
         Rueckert, IEEE Trans. Med. Imaging 18 (1999) 712) of which the rigid part over the front of \
         the muscle was kept.";
    /// The reference pose, the other, and where that lies about.
    type Input = (Pose, Pose, Start);
    type Output = Registered;

    fn run(
        &self,
        (reference, pose, start): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Registered, Failure> {
        let (_, own_labels, surfaces) = pose;
        let found = find(reference, pose, &start.transform, progress)
            .map_err(|cause| Failure::Numerics(format!("registration: {cause}")))?;
        let gravity = found.transform.direction(&self.gravity_in_image).normalize();
        let wall = WallDistances::of(surfaces, own_labels, &reference.2, &found.transform)
            .map_err(|cause| Failure::BadInput(format!("chest wall: {cause}")))?;
        let transform = found.transform;
        Ok(Registered { transform, gravity, start: *start, image: Some(found), wall })
    }
}

/// Registers from a start; where that may have led to a wrong place, from the centres of the chest walls
/// with a wide search too, and keeps what fits better.
fn find(
    (image, labels, _): &Pose,
    (moving, own_labels, _): &Pose,
    start: &RigidTransform,
    progress: &dyn Progress,
) -> Result<register::Registration, RegisterError> {
    let [mask, own] =
        [labels, own_labels].map(|l| register::chest_wall_mask(l, BEHIND_MM, AHEAD_MM));
    let front = register::chest_wall_front(labels);
    let from = |start: &RigidTransform, search: Search| {
        let options = register::Options { search, ..register::Options::default() };
        register::register_changed(image, &mask, &front, moving, start, &options, progress)
    };
    let near = from(start, Search::Near);
    if near.as_ref().is_ok_and(|found| found.similarity_after > SURE) {
        return near;
    }
    let Some(centers) = register::align_centers(&mask, &own) else { return near };
    let similarity = |found: &register::Registration| found.similarity_after;
    match (near, from(&centers, Search::Wide)) {
        (Ok(near), Ok(wide)) if similarity(&wide) > similarity(&near) => Ok(wide),
        (Err(_), wide) => wide,
        (near, _) => near,
    }
}
