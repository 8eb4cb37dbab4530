//! Points of the reference that are compared, in blocks.

use super::RegisterError;
use mammotwin_data::{Vec3, rigid::RigidTransform, volume::Volume};
use nalgebra::Vector4;
use std::collections::BTreeMap;

/// Fewer points than this make no block.
const FEWEST: usize = 24;

/// Neighbouring points of the reference, with their values.
#[derive(Debug, Clone, Default)]
pub(super) struct Sample {
    points: Vec<Vec3>,
    values: Vec<f64>,
    weight: f64,
}

/// Points that are compared with the moving image as long as a level lasts.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Positions (mm, reference).
    pub points: Vec<Vec3>,
    /// Values of the reference without their linear trend, of unit length.
    pub unit: Vec<f64>,
    /// Orthonormal trends 1, x, y, z over the block, by point.
    pub trends: Vec<Vector4<f64>>,
    /// Share of the block in the similarity.
    pub weight: f64,
}

/// Mask points of an averaged reference, at most about `most`; the weights sum to one.
///
/// Blocks with little contrast count less: their values are mostly noise.
pub(super) fn samples(
    reference: &Volume<f32>,
    mask: &Volume<bool>,
    block_mm: f64,
    most: usize,
) -> Result<Vec<Sample>, RegisterError> {
    let to_mask = mask.grid.to_voxel();
    let inside = |n: usize| {
        let point = reference.grid.center(reference.grid.voxel(n));
        mask.nearest(&to_mask.apply(&point)).unwrap_or(false).then_some(point)
    };
    let marked = mask.values.iter().filter(|inside| **inside).count() as f64;
    let total = marked * mask.grid.voxel_mm3() / reference.grid.voxel_mm3();
    let keep = most as f64 / total.max(1.0);
    let mut samples: BTreeMap<[i64; 3], Sample> = BTreeMap::new();
    for n in (0..reference.grid.len()).filter(|&n| uniform(n) < keep) {
        let Some(point) = inside(n) else { continue };
        let place = [0, 1, 2].map(|axis| (point[axis] / block_mm).floor() as i64);
        let sample = samples.entry(place).or_default();
        sample.points.push(point);
        sample.values.push(f64::from(reference.values[n]));
    }
    let mut samples: Vec<Sample> =
        samples.into_values().filter(|sample| sample.points.len() >= FEWEST).collect();
    weigh(&mut samples)?;
    Ok(samples)
}

/// Share by number of points and by contrast against a tenth of the mean contrast.
fn weigh(samples: &mut [Sample]) -> Result<(), RegisterError> {
    let variances: Vec<f64> = samples.iter().map(|sample| variance(&sample.values)).collect();
    let usual = variances.iter().sum::<f64>() / samples.len().max(1) as f64;
    if !(usual > 0.0 && usual.is_finite()) {
        return Err(RegisterError::NoStructure);
    }
    for (sample, v) in samples.iter_mut().zip(&variances) {
        sample.weight = sample.points.len() as f64 * v / (v + 0.1 * usual);
    }
    let sum: f64 = samples.iter().map(|sample| sample.weight).sum();
    samples.iter_mut().for_each(|sample| sample.weight /= sum);
    Ok(())
}

/// The blocks of those points that `motion` puts inside of the moving image; a block loses
/// weight with its points, so the weights sum to the covered part.
pub(super) fn covered(
    samples: &[Sample],
    moving: &Volume<f32>,
    motion: &RigidTransform,
) -> Vec<Block> {
    let to_voxel = moving.grid.to_voxel();
    let inside = |point: &Vec3| {
        let voxel = to_voxel.apply(&motion.point(point));
        (0..3).all(|axis| (0.0..=(moving.grid.shape[axis] - 1) as f64).contains(&voxel[axis]))
    };
    let block = |sample: &Sample| {
        let both = sample.points.iter().zip(&sample.values);
        let (points, values): (Vec<Vec3>, Vec<f64>) = both.filter(|(p, _)| inside(p)).unzip();
        let weight = sample.weight * points.len() as f64 / sample.points.len() as f64;
        Block::new(points, values, weight)
    };
    samples.iter().filter_map(block).collect()
}

impl Block {
    /// `None` when the points are few or in a plane, or the values have no contrast.
    pub fn new(points: Vec<Vec3>, mut values: Vec<f64>, weight: f64) -> Option<Self> {
        if points.len() < FEWEST {
            return None;
        }
        let mean = points.iter().sum::<Vec3>() / points.len() as f64;
        let mut columns: [Vec<f64>; 4] = std::array::from_fn(|c| {
            points.iter().map(|p| if c == 0 { 1.0 } else { p[c - 1] - mean[c - 1] }).collect()
        });
        // Gram-Schmidt.
        for c in 0..4 {
            let before = norm(&columns[c]);
            let (done, rest) = columns.split_at_mut(c);
            done.iter().for_each(|column| remove(column, &mut rest[0]));
            scale(&mut rest[0], 1e-6 * before)?;
        }
        let contrast = norm(&values);
        columns.iter().for_each(|column| remove(column, &mut values));
        scale(&mut values, 1e-6 * contrast)?;
        let trends = (0..points.len()).map(|n| Vector4::from_fn(|c, _| columns[c][n])).collect();
        Some(Self { points, unit: values, trends, weight })
    }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Takes a unit vector out of another.
fn remove(unit: &[f64], from: &mut [f64]) {
    let along: f64 = unit.iter().zip(&*from).map(|(a, b)| a * b).sum();
    from.iter_mut().zip(unit).for_each(|(v, u)| *v -= along * u);
}

/// To unit length; `None` when it is shorter than `least`.
fn scale(values: &mut [f64], least: f64) -> Option<()> {
    let length = norm(values);
    values.iter_mut().for_each(|v| *v /= length);
    (length > least).then_some(())
}

fn variance(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64
}

/// A number in 0..1 that looks random but belongs to the index (splitmix64, Steele 2014).
fn uniform(index: usize) -> f64 {
    let mut z = (index as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
