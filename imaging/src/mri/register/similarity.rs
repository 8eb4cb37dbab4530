//! Local normalised cross-correlation, with its derivative by a rigid motion.
//!
//! In block b, with reference values a and moving values m at the moved points, let â and m̂ be
//! what is left of them after a linear trend over the block, scaled to unit length. Then
//! NCC_b = â·m̂ = 1 - ½‖â - m̂‖², and the similarity is Σ_b w_b NCC_b. Of logarithms of images
//! the trend takes away a shading that varies slowly over the image. The last form makes it a
//! least-squares problem, whose Gauss-Newton matrix is Σ_b w_b (∂m̂)ᵀ(∂m̂).

use super::samples::Block;
use mammotwin_data::{Vec3, rigid::RigidTransform, volume::Volume};
use nalgebra::{Matrix6, SMatrix, SVector, Vector4, Vector6};
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
}

/// Similarity of `blocks` with `moving` at the points that `motion` (reference to moving) gives.
pub(super) fn evaluate(
    blocks: &[Block],
    moving: &Volume<f32>,
    motion: &RigidTransform,
    pivot: &Vec3,
) -> Evaluation {
    // One result a block, added in order: the same bits for any number of threads.
    let about = About { motion, pivot };
    let parts: Vec<Option<Part<6>>> =
        blocks.par_iter().map(|block| Part::of(block, moving, &about)).collect();
    let mut sum = Evaluation {
        similarity: 0.0,
        gradient: Vector6::zeros(),
        curvature: Matrix6::zeros(),
        spread: Matrix6::zeros(),
    };
    for (block, part) in blocks.iter().zip(&parts) {
        let Some(part) = part else { continue };
        let gradient = block.weight * part.gradient;
        sum.similarity += block.weight * part.correlation;
        sum.gradient += gradient;
        sum.curvature += block.weight * part.curvature;
        sum.spread += gradient * gradient.transpose();
    }
    sum
}

/// A map from the reference to the moving image that N numbers change.
pub(super) trait Placement<const N: usize> {
    /// Where a point of the reference goes (mm).
    fn point(&self, p: &Vec3) -> Vec3;

    /// Derivative, by the N numbers, of an image with `slope` (1/mm) at the moved point.
    fn derivative(&self, p: &Vec3, moved: &Vec3, slope: &Vec3) -> SVector<f64, N>;
}

/// A rigid motion, turned and shifted about a pivot in the moving image.
struct About<'a> {
    motion: &'a RigidTransform,
    pivot: &'a Vec3,
}

impl Placement<6> for About<'_> {
    fn point(&self, p: &Vec3) -> Vec3 {
        self.motion.point(p)
    }

    fn derivative(&self, _: &Vec3, moved: &Vec3, slope: &Vec3) -> Vector6<f64> {
        let turn = (moved - self.pivot).cross(slope);
        Vector6::new(turn.x, turn.y, turn.z, slope.x, slope.y, slope.z)
    }
}

/// Contribution of a block.
pub(super) struct Part<const N: usize> {
    pub correlation: f64,
    pub gradient: SVector<f64, N>,
    pub curvature: SMatrix<f64, N, N>,
}

impl<const N: usize> Part<N> {
    /// `None` when the moving image is flat there.
    pub fn of(block: &Block, moving: &Volume<f32>, map: &impl Placement<N>) -> Option<Self> {
        let to_voxel = moving.grid.to_voxel();
        // m: moving values, d: their derivatives, a: unit reference values, q: unit trends.
        let (mut mm, mut am, mut qm) = (0.0, 0.0, Vector4::zeros());
        let (mut ad, mut md) = (SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros());
        let mut qd = SMatrix::<f64, 4, N>::zeros();
        let mut dd = SMatrix::<f64, N, N>::zeros();
        for (point, (a, q)) in block.points.iter().zip(block.unit.iter().zip(&block.trends)) {
            let moved = map.point(point);
            let (m, slope) = value_and_slope(moving, &to_voxel.apply(&moved));
            let slope = to_voxel.linear().tr_mul(&slope);
            let d = map.derivative(point, &moved, &slope);
            mm += m * m;
            am += a * m;
            qm.axpy(m, q, 1.0);
            ad.axpy(*a, &d, 1.0);
            md.axpy(m, &d, 1.0);
            qd.ger(1.0, q, &d, 1.0);
            dd.ger(1.0, &d, &d, 1.0);
        }
        let all = mm;
        let mm = all - qm.norm_squared();
        // Rounding of the sums is not contrast.
        if !(mm > 1e-9 * all) {
            return None;
        }
        let md = md - qd.tr_mul(&qm);
        let dd = dd - qd.tr_mul(&qd);
        let correlation = am / mm.sqrt();
        Some(Self {
            correlation,
            gradient: ad / mm.sqrt() - md * (correlation / mm),
            curvature: (dd - md * md.transpose() / mm) / mm,
        })
    }
}

/// Trilinear value and its derivative by voxel coordinates. Beyond the outer voxels the image
/// goes on with their values, so the similarity stays continuous.
fn value_and_slope(image: &Volume<f32>, voxel: &Vec3) -> (f64, Vec3) {
    let shape = image.grid.shape;
    let mut low = [0usize; 3];
    let mut t = [0.0f64; 3];
    let mut inside = Vec3::zeros();
    for axis in 0..3 {
        let last = (shape[axis] - 1) as f64;
        let v = voxel[axis].clamp(0.0, last);
        inside[axis] = if v == voxel[axis] { 1.0 } else { 0.0 };
        low[axis] = (v as usize).min(shape[axis] - 2);
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
    (c0 + t[2] * (c1 - c0), slope.component_mul(&inside))
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
    use mammotwin_data::{Mat3, volume::Grid};

    fn wave(p: &Vec3, a: f64) -> f64 {
        (0.11 * p.x + a).sin() * (0.13 * p.y).cos() + 0.02 * p.z
    }

    fn moving() -> Volume<f32> {
        let turn = *nalgebra::Rotation3::new(Vec3::new(0.2, -0.1, 0.3)).matrix();
        let axes = turn * Mat3::from_diagonal(&Vec3::new(2.0, 2.5, 3.0));
        let grid = Grid { shape: [30, 25, 20], axes, origin: Vec3::new(-30., -30., -35.) };
        let image = |n: usize| (100.0 * wave(&grid.center(grid.voxel(n)), 0.4) + 300.0) as f32;
        let values = (0..grid.len()).map(image).collect();
        Volume { grid, values }
    }

    fn blocks(value: impl Fn(&Vec3, f64) -> f64) -> Vec<Block> {
        let block = |b: usize| {
            let b = b as f64;
            let spot = |n: usize| {
                let n = n as f64;
                Vec3::new(7.1 * n.sin(), 6.3 * (1.7 * n).cos(), 8.9 * (0.37 * n).sin() + b)
            };
            let points: Vec<Vec3> = (0..60).map(spot).collect();
            let values = points.iter().map(|p| value(p, 0.1 * b)).collect();
            Block::new(points, values, 0.25).unwrap()
        };
        (0..4).map(block).collect()
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let (blocks, moving) = (blocks(wave), moving());
        let pivot = Vec3::new(1.0, 2.0, -3.0);
        let motion =
            RigidTransform::about(&pivot, &Vec3::new(0.1, 0.05, -0.2), &Vec3::new(1., -2., 1.5));
        let here = evaluate(&blocks, &moving, &motion, &pivot);
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
    fn contrast_and_trend_of_a_block_do_not_count() {
        let shaded = |p: &Vec3, b: f64| {
            let shade = Vec3::new(0.3, -0.5, 0.8) * (b - 0.1);
            (2.0 + b) * wave(p, b) - 7.0 + shade.dot(p)
        };
        let (motion, pivot) = (RigidTransform::identity(), Vec3::zeros());
        let here = evaluate(&blocks(wave), &moving(), &motion, &pivot);
        let other = evaluate(&blocks(shaded), &moving(), &motion, &pivot);
        assert!((here.similarity - other.similarity).abs() < 1e-12);
        assert!((here.gradient - other.gradient).amax() < 1e-12);
    }
}
