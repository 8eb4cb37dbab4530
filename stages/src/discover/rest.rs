//! Whether something smooth is left that no effect explains.

use super::{budget::Whitener, evidence::Evidence};
use crate::span::{orthonormal, without};
use nalgebra::{DMatrix, DVector};

/// Smooth shapes in which something left over is looked for, per pose, and their length (mm).
const SMOOTH_SHAPES: usize = 12;
const SMOOTH_LENGTH_MM: f64 = 35.0;
/// A shape of which less than this part is no rigid motion, and less than that is not fitted anyway, tells nothing.
const LEAST_BENT: f64 = 0.05;
const LEAST_LEFT: f64 = 0.05;
/// Quantile 99.9 % of the normal distribution.
pub(crate) const RARE: f64 = 3.09;

/// The smoothest shapes (mm) that the residuals of the seen poses may have, pose by pose, and their rigid motions, as columns.
#[derive(Debug, Clone)]
pub(super) struct Rest {
    shapes: Vec<DVector<f64>>,
    rigid: Vec<DVector<f64>>,
}

impl Rest {
    pub fn new(evidence: &Evidence, seen: &[usize]) -> Self {
        let nodes = evidence.nodes();
        let (mut shapes, mut rigid) = (Vec::new(), Vec::new());
        for (block, &p) in seen.iter().enumerate() {
            let pose = &evidence.shapes[p];
            let whole = |part: &DVector<f64>| {
                let mut column = DVector::zeros(nodes * seen.len());
                column.rows_mut(block * nodes, nodes).copy_from(part);
                column
            };
            let modes = pose.rigid_modes();
            let motions = orthonormal(&DMatrix::from_columns(&modes));
            let kernel = DMatrix::from_fn(nodes, nodes, |i, j| {
                let far = (pose.points[i] - pose.points[j]).norm_squared();
                let facing = pose.normals[i].dot(&pose.normals[j]);
                (-0.5 * far / SMOOTH_LENGTH_MM.powi(2)).exp() * facing
            });
            let eigen = kernel.symmetric_eigen();
            let mut order: Vec<usize> = (0..nodes).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            for &k in order.iter().take(SMOOTH_SHAPES) {
                let bent = without(&motions, &eigen.eigenvectors.column(k).into_owned());
                if bent.norm() > LEAST_BENT {
                    shapes.push(whole(&bent));
                }
            }
            rigid.extend(modes.iter().map(whole));
        }
        Self { shapes, rigid }
    }

    /// Square of what seen residuals (mm) have in smooth shapes beyond rigid motions and `fitted` (mm), in standard
    /// deviations, and the value that errors exceed once in a thousand times, with a part of size `systematic` that
    /// is no error of the budget.
    pub fn of(
        &self,
        whitener: &Whitener,
        fitted: &[DVector<f64>],
        residual: &DVector<f64>,
        systematic: f64,
    ) -> [f64; 2] {
        let white = |columns: &[DVector<f64>]| -> Vec<DVector<f64>> {
            columns.iter().map(|column| whitener.whiten(column)).collect()
        };
        let mut known = white(&self.rigid);
        known.extend(white(fitted));
        let known = orthonormal(&DMatrix::from_columns(&known));
        let left = |shape: &DVector<f64>| {
            let rest = without(&known, shape);
            (rest.norm() > LEAST_LEFT * shape.norm()).then_some(rest)
        };
        let shapes: Vec<DVector<f64>> = white(&self.shapes).iter().filter_map(left).collect();
        if shapes.is_empty() {
            return [0.0, f64::INFINITY];
        }
        let basis = orthonormal(&DMatrix::from_columns(&shapes));
        let parts = basis.transpose() * without(&known, &whitener.whiten(residual));
        [parts.norm_squared(), rare(basis.ncols() as f64, systematic.powi(2))]
    }
}

/// The value that the sum of `count` squares of normal numbers, whose means have the squared sum `noncentral`, exceeds
/// once in a thousand times (Patnaik, *Biometrika* 36 (1949) 202; Wilson & Hilferty, *PNAS* 17 (1931) 684).
pub(super) fn rare(count: f64, noncentral: f64) -> f64 {
    let (mean, spread) = (count + noncentral, count + 2.0 * noncentral);
    let freedom = mean * mean / spread;
    let third = 2.0 / (9.0 * freedom);
    mean * (1.0 - third + RARE * third.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn one_sum_of_squares_in_a_thousand_is_rarer() {
        // Tables of chi-square.
        for (count, table) in [(3.0, 16.27), (9.0, 27.88), (24.0, 51.18)] {
            assert!((rare(count, 0.0) / table - 1.0).abs() < 0.02, "{count}");
        }
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let (count, mean) = (9, 2.0);
        let limit = rare(f64::from(count), mean * mean);
        let mut over = 0;
        for _ in 0..200_000 {
            let normal = |n: i32| -> f64 {
                let x: f64 = StandardNormal.sample(&mut random);
                if n == 0 { x + mean } else { x }
            };
            over += usize::from((0..count).map(normal).map(|x| x * x).sum::<f64>() > limit);
        }
        assert!((140..=270).contains(&over), "{over} of 200 000");
    }
}
