//! What is true of a digital volunteer: `truth/truth.json`, which no stage reads.

use super::{Motion, PoseName, Torso, torso::Limits};
use mammotwin_data::{
    Failure, Vec3, labels::LabelMap, landmarks::Landmarks, rigid::RigidTransform,
};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// The truth. Lengths in mm, stiffness in kPa; the common frame is that of the supine image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Version of this format: 1.
    pub schema: u32,
    /// Kind of volunteer.
    pub preset: String,
    /// Which person.
    pub seed: u64,
    /// Every number of her shape and tissues.
    pub person: super::Preset,
    /// Where breasts end, in the common frame.
    pub limits: Limits,
    /// Young's moduli (kPa) by study key.
    pub moduli: BTreeMap<String, f64>,
    /// Poses by name.
    pub poses: BTreeMap<String, PoseTruth>,
}

/// The truth of a pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseTruth {
    /// From the image frame to the common frame.
    pub to_common: RigidTransform,
    /// Unit vector of gravity in the image frame.
    pub gravity_in_image: Vec3,
    /// Unit vector of gravity in the common frame.
    pub gravity_in_common: Vec3,
    /// Root mean square of the change of the chest wall (mm); it has no rigid part.
    pub chest_change_rms_mm: f64,
    /// Landmarks in the image frame, without an error of pointing.
    pub landmarks: Landmarks,
}

impl Truth {
    /// The truth of a torso, still without poses.
    pub fn of(torso: &Torso, preset: &str, seed: u64) -> Self {
        let stiffness = &torso.person.stiffness;
        let moduli = [
            ("breast.young_right_kpa", stiffness.breast_right_kpa),
            ("breast.young_left_kpa", stiffness.breast_left_kpa),
            ("skin.young_kpa", stiffness.skin_kpa),
            ("fascia.young_kpa", stiffness.fascia_kpa),
        ];
        Self {
            schema: 1,
            preset: preset.into(),
            seed,
            person: torso.person.clone(),
            limits: torso.limits,
            moduli: moduli.map(|(key, value)| (key.into(), value)).into(),
            poses: BTreeMap::new(),
        }
    }

    /// Whether a place (mm) of the image of a pose lies between the breast limits, `margin_mm` away
    /// from them. They are marks of bones (sternal and midaxillary line, clavicle, costal margin) and
    /// move with the chest, not with the tissue. A pose that is not known is taken for supine.
    pub fn inside_limits(&self, pose: &str, margin_mm: f64) -> impl Fn(&Vec3) -> bool + use<> {
        let motion = self.poses.get(pose).map_or(RigidTransform::identity(), |p| p.to_common);
        let inner = Limits {
            least_y_mm: self.limits.least_y_mm + margin_mm,
            least_z_mm: self.limits.least_z_mm + margin_mm,
            greatest_z_mm: self.limits.greatest_z_mm - margin_mm,
        };
        move |p| inner.contain(&motion.point(p))
    }

    /// The voxels of the breasts in a pose: soft tissue of the labels between the breast limits.
    pub fn breast(&self, pose: &str, labels: &LabelMap) -> Vec<bool> {
        let within = self.inside_limits(pose, 0.0);
        let place = |n: usize| labels.grid.center(labels.grid.voxel(n));
        let soft = labels.values.iter().enumerate();
        soft.map(|(n, tissue)| tissue.is_soft() && within(&place(n))).collect()
    }

    /// Writes the truth as JSON.
    ///
    /// # Errors
    /// [`Failure::Io`].
    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(self).map_err(|error| Failure::io(path, error))?;
        std::fs::write(path, text).map_err(|error| Failure::io(path, error))
    }

    /// Reads what [`Truth::save`] wrote.
    ///
    /// # Errors
    /// [`Failure::Io`], or [`Failure::BadInput`] when it is no such file.
    pub fn load(path: &Path) -> Result<Self, Failure> {
        let text = std::fs::read_to_string(path).map_err(|error| Failure::io(path, error))?;
        let refused = |error| Failure::BadInput(format!("{}: {error}", path.display()));
        serde_json::from_str(&text).map_err(refused)
    }
}

impl PoseTruth {
    /// The truth of a pose with these landmarks.
    pub fn of(pose: PoseName, motion: &Motion, landmarks: Landmarks) -> Self {
        let gravity_in_common = pose.gravity();
        Self {
            to_common: motion.to_common,
            gravity_in_image: motion.to_common.inverse().direction(&gravity_in_common),
            gravity_in_common,
            chest_change_rms_mm: motion.chest.rms_mm,
            landmarks,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volunteer::Preset;
    use mammotwin_data::{
        labels::Tissue,
        volume::{Grid, Volume},
    };

    #[test]
    fn breast_limits_move_with_the_chest_and_not_with_the_tissue() {
        let torso = Torso::new(Preset::named("tiny").unwrap(), 1);
        let mut truth = Truth::of(&torso, "tiny", 1);
        let motion = Motion::drawn(&torso, PoseName::Prone, 1);
        let prone = PoseTruth::of(PoseName::Prone, &motion, Landmarks::default());
        truth.poses.insert("prone".into(), prone);
        let upper = truth.limits.greatest_z_mm;
        let to_image = |z: f64| motion.to_common.inverse().point(&Vec3::new(60.0, 90.0, z));
        let inside = truth.inside_limits("prone", 2.0);
        assert!(inside(&to_image(upper - 2.1)) && !inside(&to_image(upper - 1.9)));
        // Three voxels at the limit: two in it, of which one is muscle.
        let (low, step) = (to_image(upper - 5.0), to_image(upper) - to_image(upper - 4.0));
        let mut grid = Grid::aligned([1, 1, 3], [1.0, 1.0, 4.0], low);
        grid.axes.set_column(2, &step);
        let values = vec![Tissue::PectoralMuscle, Tissue::Other, Tissue::AdiposeRight];
        assert_eq!(truth.breast("prone", &Volume { grid, values }), [false, true, false]);
    }
}
