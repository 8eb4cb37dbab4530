//! Averaged copies of an image, for coarse and fine registration.

use mammotwin_data::{
    Vec3,
    volume::{Grid, Volume},
};
use rayon::prelude::*;

/// log(image + floor), averaged over whole voxels up to a spacing, then by (1, 2, 1)/4 along
/// each axis. The averages are of the image, the logarithm is taken of them.
///
/// Each output voxel is computed alone: the result does not depend on the number of threads.
pub(super) fn level(image: &Volume<f32>, spacing_mm: f64, floor: f32) -> Volume<f32> {
    let smoothed = (0..3).fold(average(image, spacing_mm), smooth);
    smoothed.map(|v| (v.max(0.0) + floor.max(f32::MIN_POSITIVE)).ln())
}

/// Means over blocks of voxels that are no longer than `spacing_mm`.
fn average(image: &Volume<f32>, spacing_mm: f64) -> Volume<f32> {
    let (shape, spacing) = (image.grid.shape, image.grid.spacing_mm());
    let factor: [usize; 3] = std::array::from_fn(|axis| {
        ((spacing_mm / spacing[axis] + 1e-6) as usize).clamp(1, shape[axis])
    });
    if factor == [1; 3] {
        return image.clone();
    }
    let new: [usize; 3] = std::array::from_fn(|axis| shape[axis] / factor[axis]);
    let grid = Grid {
        shape: new,
        axes: image.grid.axes
            * mammotwin_data::Mat3::from_diagonal(&factor.map(|f| f as f64).into()),
        origin: image.grid.world(&Vec3::from(factor.map(|f| 0.5 * (f as f64 - 1.0)))),
    };
    let scale = 1.0 / factor.iter().product::<usize>() as f32;
    let mut values = vec![0.0f32; grid.len()];
    values.par_chunks_mut(new[0] * new[1]).enumerate().for_each(|(k, slice)| {
        for fine_k in k * factor[2]..(k + 1) * factor[2] {
            for fine_j in 0..new[1] * factor[1] {
                let from = image.grid.index([0, fine_j, fine_k]);
                let fine = &image.values[from..from + new[0] * factor[0]];
                let row = &mut slice[fine_j / factor[1] * new[0]..][..new[0]];
                for (sum, part) in row.iter_mut().zip(fine.chunks_exact(factor[0])) {
                    *sum += part.iter().sum::<f32>();
                }
            }
        }
        slice.iter_mut().for_each(|sum| *sum *= scale);
    });
    Volume { grid, values }
}

/// Weights (1, 2, 1)/4 along an axis; the end voxels stay.
fn smooth(image: Volume<f32>, axis: usize) -> Volume<f32> {
    let [ni, nj, _] = image.grid.shape;
    let step = [1, ni, ni * nj][axis];
    let count = image.grid.shape[axis];
    let old = &image.values;
    let mut values = vec![0.0f32; old.len()];
    values.par_chunks_mut(ni).enumerate().for_each(|(row, out)| {
        let start = row * ni;
        let place = [0, row % nj, row / nj][axis];
        if axis == 0 {
            out.copy_from_slice(&old[start..start + ni]);
            for i in 1..ni.saturating_sub(1) {
                let n = start + i;
                out[i] = 0.25 * (old[n - 1] + 2.0 * old[n] + old[n + 1]);
            }
        } else if place == 0 || place + 1 == count {
            out.copy_from_slice(&old[start..start + ni]);
        } else {
            for (i, out) in out.iter_mut().enumerate() {
                let n = start + i;
                *out = 0.25 * (old[n - step] + 2.0 * old[n] + old[n + step]);
            }
        }
    });
    Volume { grid: image.grid, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_image_stays_where_it_is() {
        let grid = Grid::aligned([23, 17, 12], [0.9, 1.1, 2.5], Vec3::new(-7.0, 3.0, 11.0));
        let plane = |p: &Vec3| (3.0 * p.x - 2.0 * p.y + 0.5 * p.z) as f32;
        let values = (0..grid.len()).map(|n| plane(&grid.center(grid.voxel(n)))).collect();
        let coarse = (0..3).fold(average(&Volume { grid, values }, 3.0), smooth);
        assert_eq!(coarse.grid.shape, [7, 8, 12]);
        let worst = (0..coarse.grid.len())
            .map(|n| (coarse.values[n] - plane(&coarse.grid.center(coarse.grid.voxel(n)))).abs())
            .fold(0.0, f32::max);
        assert!(worst < 1e-4, "{worst}");
    }
}
