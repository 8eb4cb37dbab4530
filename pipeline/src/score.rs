//! How near a run came to the truth of a digital volunteer.

use mammotwin_data::{
    Failure,
    io::nifti,
    labels::{LabelMap, Tissue},
    landmarks::Landmarks,
    rigid::RigidTransform,
    units::DEGREE,
};
use mammotwin_stages::volunteer::Truth;
use serde_json::{Map, Value, json};
use std::{collections::BTreeMap, path::Path};

/// What a run says of a volunteer.
#[derive(Debug, Clone, Default)]
pub struct Estimates {
    /// Name of the reference pose.
    pub reference: String,
    /// Labels by pose name.
    pub labels: BTreeMap<String, LabelMap>,
    /// Distances (mm) of the border of the labels from the surfaces made of them, by pose name.
    pub surface: BTreeMap<String, Value>,
    /// From the image of a pose to that of the reference pose, by pose name.
    pub to_reference: BTreeMap<String, RigidTransform>,
    /// Young's moduli (kPa) by study key.
    pub moduli: BTreeMap<String, f64>,
    /// Distances of skins by pose name, as calibration and validation measured them.
    pub distance: BTreeMap<String, Value>,
    /// Misses of the markers on the breasts by pose name.
    pub fiducials: BTreeMap<String, Value>,
    /// What the fit leaves, and how it ended.
    pub fit: Value,
}

/// Compares estimates with `truth/truth.json` and `truth/POSE_labels.nii.gz`.
pub fn score(estimates: &Estimates, folder: &Path) -> Result<Value, Failure> {
    let truth = Truth::load(&folder.join("truth.json"))?;
    let mut segmentation = Map::new();
    for (name, labels) in &estimates.labels {
        let path = folder.join(format!("{name}_labels.nii.gz"));
        let known = nifti::read_labels(&path)?;
        if known.grid.shape != labels.grid.shape {
            let text = format!("{}: not the truth of poses.{name}.image", path.display());
            return Err(Failure::BadInput(text));
        }
        let of = |part: Part| dice(&labels.map(part).values, &known.map(part).values);
        let breast = truth.breast(name, &known);
        let scores = json!({
            "dice_breast": dice(&labels.map(Tissue::is_breast).values, &breast),
            "dice_breast_material_limits": of(Tissue::is_breast),
            "dice_gland": of(Tissue::is_gland),
            "dice_muscle": of(|tissue| tissue == Tissue::PectoralMuscle),
            "dice_chest_wall": of(Tissue::is_chest_wall),
        });
        segmentation.insert(name.clone(), scores);
    }
    let mut registration = Map::new();
    for (name, estimate) in &estimates.to_reference {
        let known = (truth.poses.get(name), truth.poses.get(&estimates.reference));
        let (Some(pose), Some(reference)) = known else {
            let text = format!("{}: knows no pose {name}", folder.join("truth.json").display());
            return Err(Failure::BadInput(text));
        };
        let exact = pose.to_common.then(&reference.to_common.inverse());
        let [mm, deg] = apart(estimate, &exact, &pose.landmarks);
        registration.insert(name.clone(), json!({ "translation_mm": mm, "rotation_deg": deg }));
    }
    let mut moduli = Map::new();
    for (key, exact) in &truth.moduli {
        if let Some(estimate) = estimates.moduli.get(key) {
            moduli.insert(key.clone(), json!({ "truth": exact, "estimate": estimate }));
        }
    }
    Ok(json!({
        "segmentation": segmentation,
        "surface": estimates.surface,
        "registration": registration,
        "moduli": moduli,
        "distance": estimates.distance,
        "fiducials": estimates.fiducials,
        "fit": estimates.fit,
    }))
}

/// A part of the body by its tissues.
pub type Part = fn(Tissue) -> bool;

/// Twice the common voxels over the voxels of both (Dice 1945); `None` when neither has any.
pub fn dice(a: &[bool], b: &[bool]) -> Option<f64> {
    let (mut common, mut both) = (0u64, 0u64);
    for (&a, &b) in a.iter().zip(b) {
        common += u64::from(a && b);
        both += u64::from(a) + u64::from(b);
    }
    (both > 0).then(|| 2.0 * common as f64 / both as f64)
}

/// Root mean square distance (mm) of the landmarks under two motions, and the angle (deg)
/// between the motions.
fn apart(a: &RigidTransform, b: &RigidTransform, landmarks: &Landmarks) -> [f64; 2] {
    let squares = landmarks.0.values().map(|p| (a.point(p) - b.point(p)).norm_squared());
    let mm = (squares.sum::<f64>() / landmarks.0.len().max(1) as f64).sqrt();
    [mm, a.then(&b.inverse()).angle() / DEGREE]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::{
        Vec3,
        volume::{Grid, Volume},
    };

    #[test]
    fn two_boxes_that_share_a_third_of_their_union_have_a_dice_of_one_half() {
        let grid = Grid::aligned([4, 1, 1], [1.0; 3], Vec3::zeros());
        let of = |values: [Tissue; 4]| Volume { grid: grid.clone(), values: values.to_vec() };
        use Tissue::{AdiposeLeft, Background, PectoralMuscle, Skin};
        let a = of([AdiposeLeft, Skin, Background, Background]);
        let b = of([Background, AdiposeLeft, AdiposeLeft, Background]);
        let of = |part: Part| dice(&a.map(part).values, &b.map(part).values);
        assert_eq!(of(Tissue::is_breast), Some(0.5));
        assert_eq!(of(|tissue| tissue == PectoralMuscle), None);
    }

    #[test]
    fn a_shift_and_a_turn_are_measured_apart() {
        let marks = [("a", Vec3::new(1.0, 0.0, 0.0)), ("b", Vec3::new(-1.0, 0.0, 0.0))];
        let marks = Landmarks(marks.map(|(name, p)| (name.to_string(), p)).into());
        let still = RigidTransform::identity();
        let shift = Vec3::new(0.0, 3.0, 4.0);
        let moved = RigidTransform::about(&Vec3::zeros(), &Vec3::zeros(), &shift);
        let [mm, deg] = apart(&moved, &still, &marks);
        assert!((mm - 5.0).abs() < 1e-12 && deg.abs() < 1e-9);
        let turn = Vec3::new(0.0, 0.0, 60.0 * DEGREE);
        let turned = RigidTransform::about(&Vec3::zeros(), &turn, &Vec3::zeros());
        let [mm, deg] = apart(&turned, &still, &marks);
        assert!((mm - 1.0).abs() < 1e-12 && (deg - 60.0).abs() < 1e-9);
    }
}
