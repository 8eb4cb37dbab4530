//! Which voxels count, and a first guess from them.

use crate::mri::segment::distance_to_outside;
use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Tissue},
    rigid::RigidTransform,
    volume::Volume,
};

/// Voxels of the chest wall within `behind_mm` of the pectoral muscle, and what is in front of it up
/// to `ahead_mm`: so the edge of the muscle to the fat counts too. The whole chest wall where no
/// muscle is labelled.
///
/// The breasts rest on the front of the chest wall; heart, liver and back move by themselves.
pub fn chest_wall_mask(labels: &LabelMap, behind_mm: f64, ahead_mm: f64) -> Volume<bool> {
    let is_muscle = |tissue: &Tissue| *tissue == Tissue::PectoralMuscle;
    let no_muscle = !labels.values.iter().any(is_muscle);
    let off: Vec<bool> = labels
        .values
        .iter()
        .map(|tissue| !(is_muscle(tissue) || (no_muscle && tissue.is_chest_wall())))
        .collect();
    let farthest = 2.0 * behind_mm.max(ahead_mm);
    let distance = distance_to_outside(&off, &labels.grid, farthest);
    let near = |(tissue, distance): (&Tissue, f32)| {
        let reach = if tissue.is_chest_wall() { behind_mm } else { ahead_mm };
        f64::from(distance) <= reach
    };
    let values = labels.values.iter().zip(distance).map(near).collect();
    Volume { grid: labels.grid.clone(), values }
}

/// Centre of the voxels of a mask (mm); `None` when it has none.
pub(super) fn center(mask: &Volume<bool>) -> Option<Vec3> {
    let mut sum = [0.0f64; 3];
    let mut count = 0u64;
    for (index, _) in mask.values.iter().enumerate().filter(|(_, inside)| **inside) {
        let voxel = mask.grid.voxel(index);
        (0..3).for_each(|axis| sum[axis] += voxel[axis] as f64);
        count += 1;
    }
    (count > 0).then(|| mask.grid.world(&(Vec3::from(sum) / count as f64)))
}

/// A start without landmarks: the shift that brings the centres of two chest walls together.
///
/// Poses share the right-anterior-superior frame of the person, up to a tilt that
/// [`super::Search::Wide`] finds. `None` when a mask is empty.
pub fn align_centers(reference: &Volume<bool>, moving: &Volume<bool>) -> Option<RigidTransform> {
    let translation = center(reference)? - center(moving)?;
    Some(RigidTransform { translation, ..RigidTransform::identity() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::Grid;

    #[test]
    fn the_mask_is_a_shell_about_the_muscle_in_millimetres() {
        let grid = Grid::aligned([41, 41, 21], [1.0, 1.0, 2.0], Vec3::new(-20.0, -20.0, -20.0));
        let tissue = |radius: f64| match radius {
            r if r < 10.0 => Tissue::Thorax,
            r if r < 13.0 => Tissue::PectoralMuscle,
            _ => Tissue::AdiposeLeft,
        };
        let values = (0..grid.len()).map(|n| tissue(grid.center(grid.voxel(n)).norm())).collect();
        let mut labels = Volume { grid, values };
        let mask = chest_wall_mask(&labels, 5.0, 3.0);
        for n in 0..mask.grid.len() {
            let radius = mask.grid.center(mask.grid.voxel(n)).norm();
            if (7.0..14.0).contains(&radius) {
                assert!(mask.values[n], "{radius} mm is not in the shell");
            }
            if !(4.9..17.0).contains(&radius) {
                assert!(!mask.values[n], "{radius} mm is in the shell");
            }
        }
        assert!(center(&mask).unwrap().norm() < 1e-12);
        let muscle = |tissue: &mut Tissue| {
            if *tissue == Tissue::PectoralMuscle {
                *tissue = Tissue::Thorax;
            }
        };
        labels.values.iter_mut().for_each(muscle);
        let whole = chest_wall_mask(&labels, 5.0, 3.0);
        assert!(whole.values[whole.grid.index([20, 20, 10])], "no muscle: the whole chest wall");
    }
}
