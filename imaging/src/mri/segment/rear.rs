//! The rear of the pectoral muscle.

use super::body;
use super::polar::Polar;
use super::scribble::Bounds;
use super::search::{Columns, optimal_surface, smooth_map};
use super::shading::Shaded;
use super::wall::MARKED;
use mammotwin_data::Vec3;
use rayon::prelude::*;

/// Thickness (mm) of the belly of the muscle where its rear is not seen; half-way between the
/// sternum and the side.
pub const NOMINAL_MUSCLE_MM: f64 = 10.0;
/// Thickness (mm) of the muscle at the sternum and at the side where its rear is not seen.
const NOMINAL_THIN_MM: f64 = 4.0;

/// x of the middle of the wall, its half width, and its depth in front of the axis (mm): medians over
/// the rows.
fn half_axes(polar: &Polar, front: &[f32]) -> [f64; 3] {
    let [n_u, n_v] = polar.shape;
    let mut all = [(); 3].map(|()| Vec::with_capacity(n_v));
    for row in 0..n_v {
        let (mut low, mut high) = (Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN));
        for column in row * n_u..(row + 1) * n_u {
            let p = polar.point(column, f64::from(front[column]));
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        let of_row = [0.5 * (low.x + high.x), 0.5 * (high.x - low.x), high.y - polar.axis[1]];
        all.iter_mut().zip(of_row).for_each(|(all, value)| all.push(value));
    }
    let [mut middle, mut wide, mut deep] = all;
    let half = |values: &mut Vec<f64>| body::median(values).unwrap_or(1.0);
    [half(&mut middle), half(&mut wide).max(1.0), half(&mut deep).max(1.0)]
}

/// Rear of the muscle: a smooth surface behind the front where it gets brighter again (fat between
/// the ribs, marrow), at about its nominal thickness; which it has where nothing is seen. Returns
/// radii and the fraction of columns that show it.
pub(super) fn search(
    polar: &Polar,
    fine: &Shaded,
    front: &[f32],
    contrast: &[f32],
    bounds: &Bounds,
) -> (Vec<f32>, f64) {
    const PER_MM: f32 = 0.08;
    let (thinnest, n_offset) = (3usize, 13usize);
    let thickness = |n: usize| (thinnest + n) as f32;
    let axes = half_axes(polar, front);
    let nominal = |column: usize| {
        let p = polar.point(column, f64::from(front[column]));
        let [u, v] = [(p.x - axes[0]) / axes[1], (p.y - polar.axis[1]).max(0.0) / axes[2]];
        let belly = (2.0 * u * v / (u * u + v * v).max(1e-9)).powi(2);
        (NOMINAL_THIN_MM + (NOMINAL_MUSCLE_MM - NOMINAL_THIN_MM) * belly) as f32
    };
    let penalty = |column: usize, n: usize| PER_MM * (thickness(n) - nominal(column)).abs();
    let mut cost = vec![0.0f32; polar.len() * n_offset];
    cost.par_chunks_mut(n_offset).enumerate().for_each(|(column, cost)| {
        let depth = |mm: f64| {
            let radius = (f64::from(front[column]) - mm).max(0.0);
            fine.at(&polar.point(column, radius)).unwrap_or(0.0).min(1.0)
        };
        let profile: Vec<f32> =
            (0..2 * (thinnest + n_offset + 4)).map(|n| depth(0.5 * n as f64)).collect();
        let mean = |range: std::ops::Range<usize>| {
            profile[range.clone()].iter().sum::<f32>() / range.len() as f32
        };
        for (n, cost) in cost.iter_mut().enumerate() {
            let at = 2 * (thinnest + n);
            *cost = penalty(column, n) - (mean(at..at + 5) - mean(at - 5..at));
        }
    });
    let [n_u, n_v] = polar.shape;
    let columns = Columns { n_u, n_v, n_offset, cost };
    let offsets = optimal_surface(&columns, 0.15);
    let mut data: Vec<f32> = (0..polar.len()).map(nominal).collect();
    let mut weight = vec![0.02f32; polar.len()];
    let mut n_seen = 0;
    for column in 0..polar.len() {
        let n = offsets[column];
        let edge = penalty(column, n) - columns.cost[column * n_offset + n];
        if contrast[column] > 0.3 && edge > 0.15 {
            data[column] = thickness(n);
            weight[column] = 1.0;
            n_seen += 1;
        }
    }
    let mut smooth = smooth_map(&data, &weight, polar.shape, [20.0, 20.0]);
    let rear = |smooth: &[f32], c: usize| front[c] - smooth[c].clamp(2.0, 20.0);
    let wrong = |smooth: &[f32], c: usize| {
        let radius = rear(smooth, c);
        let held = bounds.rear(c, radius);
        (held != radius).then_some(front[c] - held)
    };
    let mut moved = false;
    for column in 0..polar.len() {
        if let Some(thickness) = wrong(&smooth, column) {
            (data[column], weight[column]) = (thickness, MARKED);
            moved = true;
        }
    }
    if moved {
        smooth = smooth_map(&data, &weight, polar.shape, [20.0, 20.0]);
    }
    let rear = (0..polar.len()).map(|c| bounds.rear(c, rear(&smooth, c)).min(front[c])).collect();
    (rear, f64::from(n_seen) / polar.len() as f64)
}
