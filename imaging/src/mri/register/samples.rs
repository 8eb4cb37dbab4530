//! Points of the reference that are compared, in blocks.

use super::RegisterError;
use mammotwin_data::{Vec3, volume::Volume};
use std::collections::BTreeMap;

/// Fewer points than this make no block.
const FEWEST: usize = 24;

/// Neighbouring points whose values are correlated with those of the moving image.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Positions (mm, reference).
    pub points: Vec<Vec3>,
    /// Values of the reference.
    pub values: Vec<f64>,
    /// Share of the block in the similarity; all shares sum to one.
    pub weight: f64,
}

/// Blocks of mask points of an averaged reference, at most about `most` points.
///
/// Blocks with little contrast count less: their values are mostly noise.
pub(super) fn blocks(
    reference: &Volume<f32>,
    mask: &Volume<bool>,
    block_mm: f64,
    most: usize,
) -> Result<Vec<Block>, RegisterError> {
    let to_mask = mask.grid.to_voxel();
    let inside = |n: usize| {
        let point = reference.grid.center(reference.grid.voxel(n));
        mask.nearest(&to_mask.apply(&point)).unwrap_or(false).then_some(point)
    };
    let total = (0..reference.grid.len()).filter(|&n| inside(n).is_some()).count();
    let keep = (most as f64 / total.max(1) as f64).min(1.0);
    let mut blocks: BTreeMap<[i64; 3], Block> = BTreeMap::new();
    for n in (0..reference.grid.len()).filter(|&n| uniform(n) < keep) {
        let Some(point) = inside(n) else { continue };
        let place = [0, 1, 2].map(|axis| (point[axis] / block_mm).floor() as i64);
        let block = blocks.entry(place).or_insert_with(|| Block {
            points: Vec::new(),
            values: Vec::new(),
            weight: 0.0,
        });
        block.points.push(point);
        block.values.push(f64::from(reference.values[n]));
    }
    let mut blocks: Vec<Block> =
        blocks.into_values().filter(|block| block.points.len() >= FEWEST).collect();
    weigh(&mut blocks)?;
    Ok(blocks)
}

/// Share by number of points and by contrast against a tenth of the mean contrast.
fn weigh(blocks: &mut [Block]) -> Result<(), RegisterError> {
    let variances: Vec<f64> = blocks.iter().map(|block| variance(&block.values)).collect();
    let usual = variances.iter().sum::<f64>() / blocks.len().max(1) as f64;
    if !(usual > 0.0 && usual.is_finite()) {
        return Err(RegisterError::NoStructure);
    }
    for (block, v) in blocks.iter_mut().zip(&variances) {
        block.weight = block.points.len() as f64 * v / (v + 0.1 * usual);
    }
    let sum: f64 = blocks.iter().map(|block| block.weight).sum();
    blocks.iter_mut().for_each(|block| block.weight /= sum);
    Ok(())
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
