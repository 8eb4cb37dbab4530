//! The rear of the pectoral muscle.

use super::body;
use super::polar::Polar;
use super::scribble::Bounds;
use super::search::{Columns, optimal_surface, smooth_map};
use super::shading::Shaded;
use super::wall::MARKED;
use mammotwin_data::Vec3;
use rayon::prelude::*;

/// Thickness (mm) of the belly of the muscle, half-way between the sternum and the side, before anything
/// of its rear is seen.
const NOMINAL_MUSCLE_MM: f64 = 10.0;
/// Its thickness (mm) at the sternum and at the side.
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

/// The rear of the muscle.
#[derive(Debug, Clone)]
pub(super) struct Rear {
    /// Radii (mm), one for each column.
    pub radii: Vec<f32>,
    /// Fraction of the columns that show it.
    pub seen: f64,
    /// Thickness (mm) of the belly that is assumed where it is not seen.
    pub belly_mm: f64,
}

/// Depths (mm) behind the front at which an edge is looked for: the first, and how many.
const THINNEST_MM: usize = 3;
const TRIED: usize = 18;
/// The muscle ends so far in front of where an edge is filed (mm): a quarter, since the means that are compared
/// meet there, and a quarter for the ribs' cortex, a millimetre thick and as dark as muscle; fat beside them has none.
const BEFORE_EDGE_MM: f32 = 0.5;
/// What a millimetre off the expected thickness costs, in units of fat.
const PER_MM: f32 = 0.08;
/// Times that what is seen tells how thick the muscle is beside it.
const PASSES: usize = 3;
/// A muscle is this much thinner or thicker than the nominal one at most, and on so few columns it is not told.
const SCALES: [f64; 2] = [0.5, 2.0];
const FEWEST_SEEN: f64 = 0.05;
/// Bending of the thickness against what is seen of it.
const BENDING: [f64; 2] = [20.0, 20.0];

/// Brightening (units of fat) at each depth behind the front, column after column: fat between the
/// ribs, marrow.
fn edges(polar: &Polar, fine: &Shaded, front: &[f32]) -> Vec<f32> {
    let mut edges = vec![0.0f32; polar.len() * TRIED];
    edges.par_chunks_mut(TRIED).enumerate().for_each(|(column, edges)| {
        let depth = |mm: f64| {
            let radius = (f64::from(front[column]) - mm).max(0.0);
            fine.at(&polar.point(column, radius)).unwrap_or(0.0).min(1.0)
        };
        let profile: Vec<f32> =
            (0..2 * (THINNEST_MM + TRIED + 4)).map(|n| depth(0.5 * n as f64)).collect();
        let mean = |range: std::ops::Range<usize>| {
            profile[range.clone()].iter().sum::<f32>() / range.len() as f32
        };
        for (n, edge) in edges.iter_mut().enumerate() {
            let at = 2 * (THINNEST_MM + n);
            *edge = mean(at..at + 5) - mean(at - 5..at);
        }
    });
    edges
}

/// How thick a muscle is over the nominal one, by the columns that show it: their thicknesses over the nominal
/// ones, and which part of all they are.
fn told(over: &mut [f64], seen: f64) -> f64 {
    match body::median(over) {
        Some(scale) if seen > FEWEST_SEEN => scale.clamp(SCALES[0], SCALES[1]),
        _ => 1.0,
    }
}

/// Rear of the muscle: a smooth surface behind the front where it gets brighter again, at about the
/// thickness that is expected. That is at first the nominal one, then what is seen of this muscle, which
/// also scales the nominal one where nothing is seen.
pub(super) fn search(
    polar: &Polar,
    fine: &Shaded,
    front: &[f32],
    contrast: &[f32],
    bounds: &Bounds,
) -> Rear {
    let axes = half_axes(polar, front);
    let nominal = |column: usize| {
        let p = polar.point(column, f64::from(front[column]));
        let [u, v] = [(p.x - axes[0]) / axes[1], (p.y - polar.axis[1]).max(0.0) / axes[2]];
        let belly = (2.0 * u * v / (u * u + v * v).max(1e-9)).powi(2);
        (NOMINAL_THIN_MM + (NOMINAL_MUSCLE_MM - NOMINAL_THIN_MM) * belly) as f32
    };
    let nominal: Vec<f32> = (0..polar.len()).map(nominal).collect();
    let thickness = |n: usize| (THINNEST_MM + n) as f32 - BEFORE_EDGE_MM;
    let edges = edges(polar, fine, front);
    let [n_u, n_v] = polar.shape;
    let (mut data, mut weight) = (nominal.clone(), vec![0.0f32; polar.len()]);
    let mut smooth = nominal.clone();
    let (mut seen_part, mut scale) = (0.0, 1.0);
    for _ in 0..PASSES {
        let cost = edges
            .iter()
            .enumerate()
            .map(|(at, edge)| PER_MM * (thickness(at % TRIED) - smooth[at / TRIED]).abs() - edge);
        let columns = Columns { n_u, n_v, n_offset: TRIED, cost: cost.collect() };
        let offsets = optimal_surface(&columns, 0.15);
        let seen = |c: usize| contrast[c] > 0.3 && edges[c * TRIED + offsets[c]] > 0.15;
        let mut over: Vec<f64> = (0..polar.len())
            .filter(|&c| seen(c))
            .map(|c| f64::from(thickness(offsets[c]) / nominal[c]))
            .collect();
        seen_part = over.len() as f64 / polar.len() as f64;
        scale = told(&mut over, seen_part);
        for c in 0..polar.len() {
            (data[c], weight[c]) = if seen(c) {
                (thickness(offsets[c]), 1.0)
            } else {
                (scale as f32 * nominal[c], 0.02)
            };
        }
        smooth = smooth_map(&data, &weight, polar.shape, BENDING);
    }
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
        smooth = smooth_map(&data, &weight, polar.shape, BENDING);
    }
    let radii = (0..polar.len()).map(|c| bounds.rear(c, rear(&smooth, c)).min(front[c])).collect();
    Rear { radii, seen: seen_part, belly_mm: scale * NOMINAL_MUSCLE_MM }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_of_a_muscle_is_the_median_of_what_is_seen() {
        assert_eq!(told(&mut [1.2, 1.3, 9.0], 0.3), 1.3);
        assert_eq!(told(&mut [1.2, 1.3, 9.0], 0.04), 1.0);
        assert_eq!(told(&mut [], 0.3), 1.0);
        assert_eq!(told(&mut [0.1], 0.3), SCALES[0]);
        assert_eq!(told(&mut [7.0], 0.3), SCALES[1]);
    }
}
