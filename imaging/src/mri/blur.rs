//! Gaussian blur of volumes.

use mammotwin_data::volume::Volume;
use rayon::prelude::*;

/// Blurs with a Gaussian whose standard deviations along i, j, k are in voxels. Beyond the border
/// the image goes on as at the border.
pub fn gaussian(mut image: Volume<f32>, sigmas: [f64; 3]) -> Volume<f32> {
    let [ni, nj, nk] = image.grid.shape;
    let mut result = vec![0f32; image.values.len()];
    if image.values.is_empty() {
        return image;
    }
    let kernels = sigmas.map(kernel);

    let reach = kernels[0].len() - 1;
    result.par_chunks_mut(ni).zip(image.values.par_chunks(ni)).for_each(|(to, from)| {
        to.fill(0.0);
        for (d, w) in kernels[0].iter().enumerate() {
            let mut add = |i: usize, low: usize, high: usize| to[i] += w * (from[low] + from[high]);
            let inner = reach.min(ni)..ni.saturating_sub(reach).max(reach.min(ni));
            (0..inner.start)
                .chain(inner.end..ni)
                .for_each(|i| add(i, i.saturating_sub(d), (i + d).min(ni - 1)));
            // Away from the ends nothing is clamped: whole rows are added.
            let [low, high] = [inner.start - d.min(inner.start), inner.start + d];
            let count = inner.len();
            if count > 0 {
                let (low, high) = (&from[low..][..count], &from[high..][..count]);
                let sums = low.iter().zip(high);
                to[inner].iter_mut().zip(sums).for_each(|(to, (a, b))| *to += w * (a + b));
            }
        }
    });
    // Along j and k whole rows are added: the memory is read in order.
    let add_rows =
        |to: &mut [f32], from: &[f32], plane: usize, at: usize, last: usize, w: &[f32]| {
            to.fill(0.0);
            for (d, w) in w.iter().enumerate() {
                for other in [at.saturating_sub(d), (at + d).min(last)] {
                    let row = &from[other * plane..][..to.len()];
                    to.iter_mut().zip(row).for_each(|(to, from)| *to += w * from);
                }
            }
        };
    let slice = ni * nj;
    image.values.par_chunks_mut(slice).zip(result.par_chunks(slice)).for_each(|(to, from)| {
        for (j, row) in to.chunks_mut(ni).enumerate() {
            add_rows(row, from, ni, j, nj - 1, &kernels[1]);
        }
    });
    result.par_chunks_mut(slice).enumerate().for_each(|(k, to)| {
        add_rows(to, &image.values, slice, k, nk - 1, &kernels[2]);
    });
    image.values = result;
    image
}

/// Half of a normalised kernel: the first weight counts twice, once for each side.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as usize;
    let weight = |d: usize| (-0.5 * (d as f64 / sigma.max(1e-9)).powi(2)).exp();
    let total = 1.0 + 2.0 * (1..=reach).map(weight).sum::<f64>();
    (0..=reach).map(|d| if d == 0 { 0.5 / total } else { weight(d) / total } as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::{Vec3, volume::Grid};

    #[test]
    fn a_point_becomes_a_gaussian_of_the_given_widths() {
        let grid = Grid::aligned([21, 23, 25], [1.0; 3], Vec3::zeros());
        let mut image = Volume::filled(grid, 0.0);
        let middle = image.grid.index([10, 11, 12]);
        image.values[middle] = 1.0;
        let sigmas = [1.0, 1.5, 2.0];
        let blurred = gaussian(image, sigmas);
        let total: f32 = blurred.values.iter().sum();
        assert!((total - 1.0).abs() < 1e-4);
        for axis in 0..3 {
            let square = |n: usize| {
                let d = blurred.grid.voxel(n)[axis] as f64 - [10.0, 11.0, 12.0][axis];
                f64::from(blurred.values[n]) * d * d
            };
            let variance: f64 = (0..blurred.values.len()).map(square).sum();
            assert!((variance.sqrt() - sigmas[axis]).abs() < 0.01 * sigmas[axis]);
        }
    }

    #[test]
    fn a_constant_stays_up_to_the_border() {
        let grid = Grid::aligned([4, 1, 3], [1.0; 3], Vec3::zeros());
        let blurred = gaussian(Volume::filled(grid, 2.0), [3.0, 1.0, 0.0]);
        assert!(blurred.values.iter().all(|v| (v - 2.0).abs() < 1e-5));
    }
}
