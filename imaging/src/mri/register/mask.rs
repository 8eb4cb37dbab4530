//! Which voxels count, and a first guess from them.

use mammotwin_data::{Vec3, labels::LabelMap, rigid::RigidTransform, volume::Volume};

/// Voxels behind the breasts (muscle and thorax), grown by `margin_mm` so that the edge of the
/// muscle to the fat in front of it counts too.
pub fn chest_wall_mask(labels: &LabelMap, margin_mm: f64) -> Volume<bool> {
    let inside = labels.map(|tissue| tissue.is_chest_wall());
    let ball = ball(&inside, margin_mm);
    let shape = inside.grid.shape.map(|n| n as isize);
    let mut grown = inside.clone();
    for index in 0..inside.values.len() {
        if !inside.values[index] || !at_edge(&inside, index) {
            continue;
        }
        let center = inside.grid.voxel(index).map(|n| n as isize);
        for offset in &ball {
            let at: [isize; 3] = std::array::from_fn(|axis| center[axis] + offset[axis]);
            if (0..3).all(|axis| (0..shape[axis]).contains(&at[axis])) {
                let at = inside.grid.index(at.map(|n| n as usize));
                grown.values[at] = true;
            }
        }
    }
    grown
}

/// Voxel steps within a distance.
fn ball(mask: &Volume<bool>, radius_mm: f64) -> Vec<[isize; 3]> {
    let reach = mask.grid.spacing_mm().map(|spacing| (2.0 * radius_mm / spacing) as isize);
    let mut steps = Vec::new();
    for k in -reach[2]..=reach[2] {
        for j in -reach[1]..=reach[1] {
            for i in -reach[0]..=reach[0] {
                let step = mask.grid.axes * Vec3::new(i as f64, j as f64, k as f64);
                if step.norm() <= radius_mm {
                    steps.push([i, j, k]);
                }
            }
        }
    }
    steps
}

/// Whether a neighbour along an axis is outside of the mask.
fn at_edge(mask: &Volume<bool>, index: usize) -> bool {
    let voxel = mask.grid.voxel(index);
    let step = [1, mask.grid.shape[0], mask.grid.shape[0] * mask.grid.shape[1]];
    (0..3).any(|axis| {
        let below = voxel[axis] > 0 && !mask.values[index - step[axis]];
        let above = voxel[axis] + 1 < mask.grid.shape[axis] && !mask.values[index + step[axis]];
        below || above
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
    use mammotwin_data::{labels::Tissue, volume::Grid};

    #[test]
    fn the_mask_grows_by_millimetres_not_voxels() {
        let grid = Grid::aligned([41, 41, 21], [1.0, 1.0, 2.0], Vec3::new(-20.0, -20.0, -20.0));
        let inside = |p: &Vec3, radius: f64| p.norm() <= radius;
        let tissue = |p: &Vec3| if inside(p, 10.0) { Tissue::Thorax } else { Tissue::AdiposeLeft };
        let values = (0..grid.len()).map(|n| tissue(&grid.center(grid.voxel(n)))).collect();
        let labels = Volume { grid, values };
        let mask = chest_wall_mask(&labels, 4.0);
        for n in 0..mask.grid.len() {
            let p = mask.grid.center(mask.grid.voxel(n));
            if inside(&p, 12.0) {
                assert!(mask.values[n], "{p:?} is not in the grown mask");
            }
            if !inside(&p, 14.0) {
                assert!(!mask.values[n], "{p:?} is in the grown mask");
            }
        }
        assert!(center(&mask).unwrap().norm() < 1e-12);
    }
}
