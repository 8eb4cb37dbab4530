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

/// Where the breasts rest on the chest wall: centres (mm) of the voxels of muscle beside soft
/// tissue, in the axial slices that show a breast; beside it in the slice, not above or below.
/// Beside any tissue of the chest wall where no muscle is labelled. Slices are across the axis of
/// storage that runs most along the body, so the order of storage changes the order alone.
pub fn chest_wall_front(labels: &LabelMap) -> Vec<Vec3> {
    let Volume { grid, values } = labels;
    let is_muscle = |tissue: Tissue| tissue == Tissue::PectoralMuscle;
    let no_muscle = !values.iter().any(|t| is_muscle(*t));
    let is_wall = |tissue: Tissue| is_muscle(tissue) || (no_muscle && tissue.is_chest_wall());
    let soft = |tissue: Tissue| tissue != Tissue::Background && !tissue.is_chest_wall();
    // Skin shows through a breast's limit; what is under it does not.
    let breast = |tissue: Tissue| tissue.is_breast() && tissue != Tissue::Skin;
    let across = grid.axis_along(2);
    let mut shows_breast = vec![false; grid.shape[across]];
    for n in (0..values.len()).filter(|n| breast(values[*n])) {
        shows_breast[grid.voxel(n)[across]] = true;
    }
    let [ni, nj, _] = grid.shape;
    let steps = [1, ni, ni * nj];
    let beside_soft = |n: usize, voxel: [usize; 3]| {
        (0..3).filter(|axis| *axis != across).any(|axis| {
            let (at, step) = (voxel[axis], steps[axis]);
            (at > 0 && soft(values[n - step]))
                || (at + 1 < grid.shape[axis] && soft(values[n + step]))
        })
    };
    let place = |n: usize| {
        let voxel = grid.voxel(n);
        (shows_breast[voxel[across]] && beside_soft(n, voxel)).then(|| grid.center(voxel))
    };
    (0..values.len()).filter(|n| is_wall(values[*n])).filter_map(place).collect()
}

/// Box (mm, along the world axes) of the voxels of a mask; `None` when it has none.
pub(super) fn bounds(mask: &Volume<bool>) -> Option<[Vec3; 2]> {
    let inside = mask.values.iter().enumerate().filter(|(_, inside)| **inside);
    inside.map(|(n, _)| mask.grid.center(mask.grid.voxel(n))).fold(None, |found, p| {
        let [low, high] = found.unwrap_or([p, p]);
        Some([low.inf(&p), high.sup(&p)])
    })
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

/// A start without landmarks: the shift that brings the centres of two masks together.
///
/// Poses share the right-anterior-superior frame of the person, up to a tilt that
/// [`super::Search::Wide`] finds. `None` when a mask is empty.
pub fn align_centers(reference: &Volume<bool>, moving: &Volume<bool>) -> Option<RigidTransform> {
    let translation = center(reference)? - center(moving)?;
    Some(RigidTransform { translation, ..RigidTransform::identity() })
}

/// The body before anything is known of an image: what is brighter than half of its mean.
pub fn bright(image: &Volume<f32>) -> Volume<bool> {
    let least = 0.5 * mean(image);
    image.map(|v| v > least)
}

/// Mean of the positive values.
pub(super) fn mean(image: &Volume<f32>) -> f32 {
    let sum: f64 = image.values.iter().map(|&v| f64::from(v.max(0.0))).sum();
    (sum / image.values.len() as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::{Mat3, volume::Grid};

    /// The same labels in posterior-inferior-right order.
    fn as_pir(labels: &LabelMap) -> LabelMap {
        let [ni, nj, nk] = labels.grid.shape;
        let [x, y, z] = [0, 1, 2].map(|axis| labels.grid.axes.column(axis).into_owned());
        let grid = Grid {
            shape: [nj, nk, ni],
            axes: Mat3::from_columns(&[-y, -z, x]),
            origin: labels.grid.center([0, nj - 1, nk - 1]),
        };
        let to_voxel = labels.grid.to_voxel();
        let value = |n| labels.nearest(&to_voxel.apply(&grid.center(grid.voxel(n)))).unwrap();
        Volume { values: (0..grid.len()).map(value).collect(), grid }
    }

    #[test]
    fn the_front_is_the_muscle_beside_soft_tissue_where_there_is_breast() {
        use Tissue::{
            AdiposeLeft as A, Background as B, Other as O, PectoralMuscle as M, Thorax as T,
        };
        let grid = Grid::aligned([3, 4, 2], [1.0, 2.0, 3.0], Vec3::zeros());
        let values = [
            [[T, T, T], [M, M, T], [A, M, T], [A, A, B]],
            [[T, T, T], [M, M, T], [O, M, T], [O, O, B]],
        ];
        let mut labels = Volume { grid, values: values.concat().concat() };
        let found = |labels: &LabelMap| chest_wall_front(labels);
        let muscle = vec![Vec3::new(0.0, 2.0, 0.0), Vec3::new(1.0, 4.0, 0.0)];
        assert_eq!(found(&labels), muscle);
        let mut stored = found(&as_pir(&labels));
        stored.sort_by(|a, b| a.x.total_cmp(&b.x));
        assert_eq!(stored, muscle, "another order of storage");
        labels.values.iter_mut().filter(|t| **t == M).for_each(|t| *t = T);
        assert_eq!(found(&labels), muscle, "no muscle: the whole chest wall");
    }

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
