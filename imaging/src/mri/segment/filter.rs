//! Separable filters on regular grids: box blur, maximum, minimum.

use crate::mri::nearest_seed::transpose;
use rayon::prelude::*;

/// Applies `line` to every grid line along `axis`; `line` sees the values in order and writes back.
fn for_each_line(
    values: &mut [f32],
    [ni, nj, nk]: [usize; 3],
    axis: usize,
    line: impl Fn(&[f32], &mut [f32]) + Sync,
) {
    let apply = |values: &mut [f32]| {
        let from = values.to_vec();
        line(&from, values);
    };
    match axis {
        0 => values.par_chunks_mut(ni).for_each(apply),
        // Turned, so that the lines are contiguous.
        1 => values.par_chunks_mut(ni * nj).for_each(|slice| {
            let mut turned = transpose(slice, ni, nj);
            turned.chunks_mut(nj).for_each(apply);
            slice.copy_from_slice(&transpose(&turned, nj, ni));
        }),
        _ => {
            let mut turned = transpose(values, ni * nj, nk);
            turned.par_chunks_mut(nk).for_each(apply);
            values.copy_from_slice(&transpose(&turned, nk, ni * nj));
        }
    }
}

/// Mean over a window of `2 radius + 1` voxels along each axis; zero outside of the grid.
pub(super) fn box_blur(values: &mut [f32], shape: [usize; 3], radius: [usize; 3]) {
    for axis in 0..3 {
        let r = radius[axis];
        if r == 0 {
            continue;
        }
        let width = (2 * r + 1) as f64;
        for_each_line(values, shape, axis, |from, to| {
            let n = from.len();
            let mut sum: f64 = from.iter().take(r).map(|&v| f64::from(v)).sum();
            for i in 0..n {
                sum += from.get(i + r).map_or(0.0, |&v| f64::from(v));
                to[i] = (sum / width) as f32;
                sum -= if i >= r { f64::from(from[i - r]) } else { 0.0 };
            }
        });
    }
}

/// Close to a Gaussian of standard deviation `sigma` voxels (three box blurs).
pub(super) fn gaussian_blur(values: &mut [f32], shape: [usize; 3], sigma: f64) {
    // Three boxes of width w have the variance 3 (w^2 - 1) / 12.
    let radius = (((4.0 * sigma * sigma + 1.0).sqrt() - 1.0) / 2.0).round() as usize;
    for _ in 0..3 {
        box_blur(values, shape, [radius; 3]);
    }
}

/// Largest value in a cube of `2 radius + 1` voxels.
pub(super) fn maximum(values: &mut [f32], shape: [usize; 3], radius: usize) {
    for axis in 0..3 {
        for_each_line(values, shape, axis, |from, to| {
            for i in 0..from.len() {
                let window = &from[i.saturating_sub(radius)..(i + radius + 1).min(from.len())];
                to[i] = window.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            }
        });
    }
}

/// Threshold that parts a histogram in two classes of least variance (Otsu 1979,
/// <https://doi.org/10.1109/TSMC.1979.4310076>). `None` without two distinct values.
pub(super) fn otsu(values: impl Iterator<Item = f32> + Clone) -> Option<f32> {
    const BINS: usize = 256;
    let low = values.clone().fold(f32::INFINITY, f32::min);
    let high = values.clone().fold(f32::NEG_INFINITY, f32::max);
    if !(high > low && low.is_finite() && high.is_finite()) {
        return None;
    }
    let scale = (BINS - 1) as f32 / (high - low);
    let mut histogram = [0u64; BINS];
    for v in values {
        histogram[((v - low) * scale) as usize] += 1;
    }
    let count: u64 = histogram.iter().sum();
    let moment: f64 = histogram.iter().enumerate().map(|(b, &n)| b as f64 * n as f64).sum();
    let (mut below, mut moment_below) = (0u64, 0.0);
    let mut best = (f64::NEG_INFINITY, 0, 0);
    for (bin, &n) in histogram.iter().enumerate() {
        below += n;
        moment_below += bin as f64 * n as f64;
        let above = count - below;
        if below == 0 || above == 0 {
            continue;
        }
        let gap = moment_below / below as f64 - (moment - moment_below) / above as f64;
        let between = below as f64 * above as f64 * gap * gap;
        if between > best.0 {
            best = (between, bin, bin);
        } else if between == best.0 {
            best.2 = bin;
        }
    }
    // In the middle, where empty bins leave the choice.
    Some(low + (0.5 * (best.1 + best.2) as f32 + 0.5) / scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blur_keeps_the_sum_and_has_the_stated_width() {
        let shape = [51, 53, 55];
        let mut values = vec![0.0; 51 * 53 * 55];
        values[(27 * 53 + 26) * 51 + 25] = 1.0;
        gaussian_blur(&mut values, shape, 6.0);
        let sum: f32 = values.iter().sum();
        let along_k = |n: usize| (n / (51 * 53)) as f32 - 27.0;
        let variance: f32 = values.iter().enumerate().map(|(n, v)| v * along_k(n).powi(2)).sum();
        assert!((sum - 1.0).abs() < 1e-3);
        assert!((variance.sqrt() - 6.0).abs() < 0.6, "{}", variance.sqrt());
    }

    #[test]
    fn otsu_lies_between_two_clusters() {
        let values = (0..200).map(|n| if n < 150 { 1.0 } else { 5.0 } + 0.001 * n as f32);
        let threshold = otsu(values).unwrap();
        assert!(threshold > 1.2 && threshold < 5.1);
        assert!(otsu([2.0f32; 4].into_iter()).is_none());
    }
}
