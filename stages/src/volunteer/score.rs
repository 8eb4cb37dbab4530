//! A run against the truth of its digital volunteer.

use super::Truth;
use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Tissue},
    rigid::RigidTransform,
};
use mammotwin_solver::distance::Distances;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a run found; whatever it did not look for is left empty.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// Labels by pose.
    pub labels: BTreeMap<String, LabelMap>,
    /// From the image frame of each pose to the common frame.
    pub transforms: BTreeMap<String, RigidTransform>,
    /// Distances of simulated from measured skin, by pose.
    pub distances: BTreeMap<String, Distances>,
    /// Young's moduli (kPa) by study key.
    pub moduli: BTreeMap<String, f64>,
    /// Compression force (N) by side.
    pub force_n: BTreeMap<String, f64>,
}

/// How near the truth a run came.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Overlaps by pose.
    pub segmentation: BTreeMap<String, SegmentationScore>,
    /// Errors of the rigid registration by pose.
    pub registration: BTreeMap<String, RegistrationScore>,
    /// Simulated against measured skin by pose.
    pub distance: BTreeMap<String, DistanceScore>,
    /// Moduli by study key.
    pub moduli: BTreeMap<String, ModulusScore>,
    /// Compression forces by side.
    pub force: BTreeMap<String, ForceScore>,
}

/// Dice overlaps; none where neither map has the tissue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SegmentationScore {
    /// Breasts with skin and nipples, where neither map sees tissue beyond the breast limits.
    pub dice_breast: Option<f64>,
    /// Pectoral muscle between the breast limits.
    pub dice_muscle: Option<f64>,
    /// Fibroglandular tissue.
    pub dice_gland: Option<f64>,
}

/// Error of a rigid transform.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RegistrationScore {
    /// At the centroid of the chest-wall landmarks (mm).
    pub translation_mm: f64,
    /// Angle between the rotations (deg).
    pub rotation_deg: f64,
}

/// Distances of simulated from measured skin (mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceScore {
    /// Modified Hausdorff distance (mm).
    pub modified_hausdorff_mm: f64,
    /// Largest distance (mm).
    pub max_mm: f64,
}

/// A modulus beside the truth (kPa).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModulusScore {
    /// True.
    pub truth: f64,
    /// Found.
    pub estimate: f64,
}

/// A force beside the truth (N).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ForceScore {
    /// True, when the truth was compressed.
    pub truth_n: Option<f64>,
    /// Found.
    pub estimate_n: f64,
}

/// Compares what a run found with the truth; `labels` are the true labels by pose. Poses and
/// keys that one of them lacks are left out.
pub fn score(found: &Found, truth: &Truth, labels: &BTreeMap<String, LabelMap>) -> Score {
    let mut score = Score::default();
    for (pose, ours) in &found.labels {
        if let (Some(known), Some(true_pose)) = (labels.get(pose), truth.poses.get(pose)) {
            let to_common = true_pose.to_common;
            let within = |p: &Vec3| truth.limits.contain(&to_common.point(p));
            score.segmentation.insert(pose.clone(), segmentation(ours, known, &within));
        }
    }
    for (pose, ours) in &found.transforms {
        if let Some(known) = truth.poses.get(pose) {
            let chest: Vec<Vec3> = known
                .landmarks
                .0
                .iter()
                .filter(|(name, _)| name.starts_with("chest_"))
                .map(|(_, p)| *p)
                .collect();
            let center = chest.iter().sum::<Vec3>() / chest.len().max(1) as f64;
            let error = registration(ours, &known.to_common, &center);
            score.registration.insert(pose.clone(), error);
        }
    }
    for (pose, distances) in &found.distances {
        let measured = DistanceScore {
            modified_hausdorff_mm: distances.modified_hausdorff,
            max_mm: distances.max,
        };
        score.distance.insert(pose.clone(), measured);
    }
    for (key, &estimate) in &found.moduli {
        if let Some(&truth) = truth.moduli.get(key) {
            score.moduli.insert(key.clone(), ModulusScore { truth, estimate });
        }
    }
    for (side, &estimate_n) in &found.force_n {
        score.force.insert(side.clone(), ForceScore { truth_n: None, estimate_n });
    }
    score
}

/// Error of a transform at `center`, a place of the image.
pub fn registration(
    found: &RigidTransform,
    truth: &RigidTransform,
    center: &Vec3,
) -> RegistrationScore {
    RegistrationScore {
        translation_mm: (found.point(center) - truth.point(center)).norm(),
        rotation_deg: truth.inverse().then(found).angle().to_degrees(),
    }
}

/// Overlaps of two label maps; voxels of `found` are looked up in `truth` by their place.
fn segmentation(
    found: &LabelMap,
    truth: &LabelMap,
    within: &impl Fn(&Vec3) -> bool,
) -> SegmentationScore {
    use Tissue::{FibroglandularLeft, FibroglandularRight, Other, PectoralMuscle};
    let mut breast = Overlap::default();
    let mut muscle = Overlap::default();
    let mut gland = Overlap::default();
    let to_voxel = truth.grid.to_voxel();
    for (index, &ours) in found.values.iter().enumerate() {
        let place = found.grid.center(found.grid.voxel(index));
        let known = truth.nearest(&to_voxel.apply(&place)).unwrap_or(Tissue::Background);
        if ours == Tissue::Background && known == Tissue::Background {
            continue;
        }
        if ours != Other && known != Other {
            breast.count(ours.is_breast(), known.is_breast());
        }
        let [is, was] = [ours, known].map(|t| t == PectoralMuscle);
        if (is || was) && within(&place) {
            muscle.count(is, was);
        }
        let [is, was] =
            [ours, known].map(|t| matches!(t, FibroglandularRight | FibroglandularLeft));
        gland.count(is, was);
    }
    SegmentationScore {
        dice_breast: breast.dice(),
        dice_muscle: muscle.dice(),
        dice_gland: gland.dice(),
    }
}

/// Counts of two sets and what they share.
#[derive(Debug, Clone, Copy, Default)]
struct Overlap {
    both: u64,
    sum: u64,
}

impl Overlap {
    fn count(&mut self, is: bool, was: bool) {
        self.both += u64::from(is && was);
        self.sum += u64::from(is) + u64::from(was);
    }

    fn dice(self) -> Option<f64> {
        (self.sum > 0).then(|| 2.0 * self.both as f64 / self.sum as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::{Grid, Volume};

    #[test]
    fn a_known_error_of_a_transform_is_measured() {
        let truth = RigidTransform::about(
            &Vec3::new(1.0, 2.0, 3.0),
            &Vec3::new(0.0, 0.1, 0.2),
            &Vec3::new(5.0, 0.0, -3.0),
        );
        let center = Vec3::new(10.0, 90.0, -20.0);
        let turn = Vec3::new(0.0, 0.0, 2f64.to_radians());
        let error = RigidTransform::about(&truth.point(&center), &turn, &Vec3::new(0.3, 0.4, 0.0));
        let score = registration(&truth.then(&error), &truth, &center);
        assert!((score.translation_mm - 0.5).abs() < 1e-12);
        assert!((score.rotation_deg - 2.0).abs() < 1e-9);
    }

    #[test]
    fn dice_counts_overlap_and_forgives_what_lies_beyond_either_limit() {
        let grid = Grid::aligned([8, 1, 1], [1.0; 3], Vec3::zeros());
        let of = |values: [Tissue; 8]| Volume { grid: grid.clone(), values: values.to_vec() };
        use Tissue::{AdiposeRight as A, Background as B, Other as O, PectoralMuscle as P};
        let found = of([B, A, A, A, O, P, P, B]);
        let truth = of([B, B, A, A, A, P, P, P]);
        let score = segmentation(&found, &truth, &|_: &Vec3| true);
        assert_eq!(score.dice_breast, Some(0.8));
        assert_eq!(score.dice_muscle, Some(0.8));
        assert_eq!(score.dice_gland, None);
    }
}
