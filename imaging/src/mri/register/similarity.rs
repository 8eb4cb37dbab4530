//! Local normalised cross-correlation, with its derivative by a rigid motion.
//!
//! In block b, with reference values a and moving values m at the moved points,
//! NCC_b = Σ(a-ā)(m-m̄) / √(Σ(a-ā)² Σ(m-m̄)²) = 1 - ½‖â - m̂‖², where â and m̂ are centred and of
//! unit length. The similarity is Σ_b w_b NCC_b: a brightness and a contrast that vary slowly
//! over the image cancel. The last form makes it a least-squares problem, whose Gauss-Newton
//! matrix is Σ_b w_b (∂m̂)ᵀ(∂m̂).

use super::samples::Block;
use mammotwin_data::{Vec3, rigid::RigidTransform, volume::Volume};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

/// Similarity at a position; derivatives are by (rotation vector in rad, translation in mm) of
/// the moved points about the pivot, in the frame of the moving image.
#[derive(Debug, Clone)]
pub(super) struct Evaluation {
    /// Weighted mean of the blocks' correlations.
    pub similarity: f64,
    /// Its derivative.
    pub gradient: Vector6<f64>,
    /// Gauss-Newton approximation of minus its second derivative.
    pub curvature: Matrix6<f64>,
    /// Σ_b g_b g_bᵀ of the blocks' gradients.
    pub spread: Matrix6<f64>,
    /// Fraction of points in the moving image.
    pub overlap: f64,
}

/// Similarity of `blocks` with `moving` at the points that `motion` (reference to moving) gives.
pub(super) fn evaluate(
    blocks: &[Block],
    moving: &Volume<f32>,
    motion: &RigidTransform,
    pivot: &Vec3,
) -> Evaluation {
    // One result a block, added in order: the same bits for any number of threads.
    let parts: Vec<Part> =
        blocks.par_iter().map(|block| Part::of(block, moving, motion, pivot)).collect();
    let mut sum = Evaluation {
        similarity: 0.0,
        gradient: Vector6::zeros(),
        curvature: Matrix6::zeros(),
        spread: Matrix6::zeros(),
        overlap: 0.0,
    };
    let mut total = 0.0;
    for (block, part) in blocks.iter().zip(&parts) {
        let points = block.points.len() as f64;
        total += points;
        sum.overlap += part.count;
        // Points that left the moving image count as uncorrelated.
        let weight = block.weight * part.count / points;
        let gradient = weight * part.gradient;
        sum.similarity += weight * part.correlation;
        sum.gradient += gradient;
        sum.curvature += weight * part.curvature;
        sum.spread += gradient * gradient.transpose();
    }
    sum.overlap /= total.max(1.0);
    sum
}

/// Contribution of a block.
struct Part {
    count: f64,
    correlation: f64,
    gradient: Vector6<f64>,
    curvature: Matrix6<f64>,
}

impl Part {
    fn of(block: &Block, moving: &Volume<f32>, motion: &RigidTransform, pivot: &Vec3) -> Self {
        let to_voxel = moving.grid.to_voxel();
        let mut n = 0.0;
        let (mut a1, mut a2, mut m1, mut m2, mut am) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut d1, mut ad, mut md) = (Vector6::zeros(), Vector6::zeros(), Vector6::zeros());
        let mut dd = Matrix6::zeros();
        for (point, &a) in block.points.iter().zip(&block.values) {
            let moved = motion.point(point);
            let Some((m, slope)) = value_and_slope(moving, &to_voxel.apply(&moved)) else {
                continue;
            };
            let slope = to_voxel.linear().tr_mul(&slope);
            let turn = (moved - pivot).cross(&slope);
            let d = Vector6::new(turn.x, turn.y, turn.z, slope.x, slope.y, slope.z);
            n += 1.0;
            (a1, a2, m1, m2, am) = (a1 + a, a2 + a * a, m1 + m, m2 + m * m, am + a * m);
            d1 += d;
            ad += a * d;
            md += m * d;
            dd.ger(1.0, &d, &d, 1.0);
        }
        let empty = Self {
            count: n,
            correlation: 0.0,
            gradient: Vector6::zeros(),
            curvature: Matrix6::zeros(),
        };
        if n < 8.0 {
            return empty;
        }
        let (aa, mm, am) = (a2 - a1 * a1 / n, m2 - m1 * m1 / n, am - a1 * m1 / n);
        // A flat block has no correlation; rounding of the sums is not contrast.
        if !(aa > 1e-9 * a2 && mm > 1e-9 * m2) {
            return empty;
        }
        let (ad, md) = (ad - d1 * (a1 / n), md - d1 * (m1 / n));
        let dd = dd - d1 * d1.transpose() / n;
        let correlation = am / (aa * mm).sqrt();
        Self {
            count: n,
            correlation,
            gradient: ad / (aa * mm).sqrt() - md * (correlation / mm),
            curvature: (dd - md * md.transpose() / mm) / mm,
        }
    }
}

/// Trilinear value and its derivative by voxel coordinates; `None` outside.
fn value_and_slope(image: &Volume<f32>, voxel: &Vec3) -> Option<(f64, Vec3)> {
    let shape = image.grid.shape;
    let mut low = [0usize; 3];
    let mut t = [0.0f64; 3];
    for axis in 0..3 {
        let v = voxel[axis];
        if !(v >= 0.0 && v < (shape[axis] - 1) as f64) {
            return None;
        }
        low[axis] = v as usize;
        t[axis] = v - low[axis] as f64;
    }
    let (row, slice) = (shape[0], shape[0] * shape[1]);
    let first = image.grid.index(low);
    let at = |step: usize| f64::from(image.values[first + step]);
    let along_i = |step: usize| {
        let (a, b) = (at(step), at(step + 1));
        (a + t[0] * (b - a), b - a)
    };
    let (c00, s00) = along_i(0);
    let (c10, s10) = along_i(row);
    let (c01, s01) = along_i(slice);
    let (c11, s11) = along_i(slice + row);
    let (c0, c1) = (c00 + t[1] * (c10 - c00), c01 + t[1] * (c11 - c01));
    let (s0, s1) = (s00 + t[1] * (s10 - s00), s01 + t[1] * (s11 - s01));
    let (j0, j1) = (c10 - c00, c11 - c01);
    let slope = Vec3::new(s0 + t[2] * (s1 - s0), j0 + t[2] * (j1 - j0), c1 - c0);
    Some((c0 + t[2] * (c1 - c0), slope))
}

/// The motion turned and shifted by a step about its pivot; the derivatives of [`Evaluation`] are
/// by such a step.
pub(super) fn stepped(
    motion: &RigidTransform,
    pivot: &Vec3,
    step: &Vector6<f64>,
) -> RigidTransform {
    let turn = step.fixed_rows::<3>(0).into_owned();
    let shift = step.fixed_rows::<3>(3).into_owned();
    motion.then(&RigidTransform::about(pivot, &turn, &shift))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::Grid;

    fn scene() -> (Vec<Block>, Volume<f32>) {
        let turn = *nalgebra::Rotation3::new(Vec3::new(0.2, -0.1, 0.3)).matrix();
        let spacing = mammotwin_data::Mat3::from_diagonal(&Vec3::new(2.0, 2.5, 3.0));
        let grid =
            Grid { shape: [30, 25, 20], axes: turn * spacing, origin: Vec3::new(-30., -30., -35.) };
        let wave = |p: &Vec3, a: f64| (0.11 * p.x + a).sin() * (0.13 * p.y).cos() + 0.02 * p.z;
        let image = |n: usize| (100.0 * wave(&grid.center(grid.voxel(n)), 0.4) + 300.0) as f32;
        let values = (0..grid.len()).map(image).collect();
        let block = |b: usize| {
            let spot = |n: usize| {
                let n = n as f64;
                Vec3::new(7.1 * n.sin(), 6.3 * (1.7 * n).cos(), 8.9 * (0.37 * n).sin() + b as f64)
            };
            let points: Vec<Vec3> = (0..60).map(spot).collect();
            let values = points.iter().map(|p| 40.0 * wave(p, 0.1 * b as f64)).collect();
            Block { points, values, weight: 0.25 }
        };
        ((0..4).map(block).collect(), Volume { grid, values })
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let (blocks, moving) = scene();
        let pivot = Vec3::new(1.0, 2.0, -3.0);
        let motion =
            RigidTransform::about(&pivot, &Vec3::new(0.1, 0.05, -0.2), &Vec3::new(1., -2., 1.5));
        let here = evaluate(&blocks, &moving, &motion, &pivot);
        assert_eq!(here.overlap, 1.0);
        let h = 1e-6;
        for n in 0..6 {
            let mut step = Vector6::zeros();
            step[n] = h;
            let at = |step: Vector6<f64>| {
                evaluate(&blocks, &moving, &stepped(&motion, &pivot, &step), &pivot).similarity
            };
            let slope = (at(step) - at(-step)) / (2.0 * h);
            let scale = here.gradient.amax();
            assert!((slope - here.gradient[n]).abs() < 1e-6 * scale, "{n}: {slope} {here:?}");
        }
    }

    #[test]
    fn brightness_and_contrast_of_a_block_do_not_count() {
        let (mut blocks, moving) = scene();
        let here = evaluate(&blocks, &moving, &RigidTransform::identity(), &Vec3::zeros());
        for (b, block) in blocks.iter_mut().enumerate() {
            block.values.iter_mut().for_each(|v| *v = *v * (2.0 + b as f64) - 70.0);
        }
        let other = evaluate(&blocks, &moving, &RigidTransform::identity(), &Vec3::zeros());
        assert!((here.similarity - other.similarity).abs() < 1e-12);
        assert!((here.gradient - other.gradient).amax() < 1e-12);
    }
}
