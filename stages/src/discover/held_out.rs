//! The pose that decides: does what an effect foretells show in it?
//!
//! Errors of the reference pose and of the mesh reach all poses. What the seen poses tell of them is taken from
//! the held-out one first, and what they leave open of the moduli is an error of it.

use super::{
    budget::Whitener,
    observe::{part, rows},
};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// The held-out pose must have so many standard errors of the change that is foretold, and be met better with it;
/// where the misfit rises by as many, the effect is refuted.
pub(crate) const HELD_OUT: f64 = 2.0;
/// Standard deviation of the logarithm of a modulus that poses tell nothing of.
const UNKNOWN_MODULUS: f64 = 1.0;

/// What an effect does to a pose that the search did not see.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square distance (mm) without rigid motion: moduli alone fitted.
    pub before_mm: f64,
    /// The same with the effect.
    pub after_mm: f64,
    /// What the errors alone leave.
    pub floor_mm: f64,
    /// How much of the change that the effect foretells is there, in standard errors: without it 0 ± 1.
    pub z: f64,
    /// Fall of the misfit (squared standard deviations): positive when the pose is met better with the effect.
    pub fall: f64,
    /// Standard error of the fall.
    pub fall_error: f64,
}

impl HeldOut {
    /// Whether it bears the effect out.
    pub fn confirms(&self) -> bool {
        self.z >= HELD_OUT && self.fall > 0.0
    }

    /// Whether it is met so much worse with the effect that this cannot be.
    pub fn refutes(&self) -> bool {
        self.fall < -HELD_OUT * self.fall_error
    }
}

/// Weighs the residuals of the held-out pose.
pub(super) struct Weights {
    seen: Vec<usize>,
    pose: usize,
    nodes: usize,
    /// What seen residuals foretell of it.
    known: DMatrix<f64>,
    whitener: Whitener,
    /// Covariance (mm²) of its errors and of what the moduli leave open, nothing known of the seen ones' errors.
    pub errors: DMatrix<f64>,
}

impl Weights {
    /// Of the covariance (mm²) of all poses' errors and the derivatives (mm) by the logarithms of the moduli.
    /// `None` when there is no such covariance.
    pub fn new(
        covariance: &DMatrix<f64>,
        whitener: &Whitener,
        slopes: [&DVector<f64>; 2],
        (seen, pose, nodes): (&[usize], usize, usize),
    ) -> Option<Self> {
        let (own, theirs) = (rows(&[pose], nodes), rows(seen, nodes));
        let block = |a: &[usize], b: &[usize]| covariance.select_rows(a).select_columns(b);
        let between = block(&own, &theirs);
        let known = whitener.solve(&between.transpose()).transpose();
        let columns =
            |rows: &[usize]| DMatrix::from_columns(&slopes.map(|slope| slope.select_rows(rows)));
        let (here, there) = (columns(&own), columns(&theirs));
        let prior = DMatrix::identity(2, 2) / UNKNOWN_MODULUS.powi(2);
        let open = (there.transpose() * whitener.solve(&there) + prior).try_inverse()?;
        let alone = block(&own, &own);
        let by = &here - &known * there;
        let left = &alone - &known * between.transpose() + &by * &open * by.transpose();
        let errors = alone + &here * open * here.transpose();
        let whitener = Whitener::all(&left)?;
        Some(Self { seen: seen.to_vec(), pose, nodes, known, whitener, errors })
    }

    /// Residuals (mm) of all poses to independent ones of variance 1 of this.
    fn whiten(&self, all: &DVector<f64>) -> DVector<f64> {
        let own = part(all, &[self.pose], self.nodes);
        self.whitener.whiten(&(own - &self.known * part(all, &self.seen, self.nodes)))
    }

    /// Compares residuals (mm, all poses) without and with an effect; root mean squares (mm): before, after, floor.
    pub fn judge(
        &self,
        without: &DVector<f64>,
        with: &DVector<f64>,
        [before_mm, after_mm, floor_mm]: [f64; 3],
    ) -> HeldOut {
        let (old, new) = (self.whiten(without), self.whiten(with));
        let foretold = &old - &new;
        let size = foretold.norm().max(f64::MIN_POSITIVE);
        HeldOut {
            before_mm,
            after_mm,
            floor_mm,
            z: foretold.dot(&old) / size,
            fall: old.norm_squared() - new.norm_squared(),
            fall_error: 2.0 * size,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Three poses of four nodes with errors that they share in part; the last one is held out.
    fn poses() -> (DMatrix<f64>, Vec<DVector<f64>>) {
        let mut random = ChaCha8Rng::seed_from_u64(8);
        let mut normal = |_: usize, _: usize| -> f64 { StandardNormal.sample(&mut random) };
        let shared = DMatrix::from_fn(12, 5, &mut normal);
        let covariance = &shared * shared.transpose() + DMatrix::identity(12, 12);
        // What moduli change is far larger than the errors.
        let columns = (0..3).map(|_| 10.0 * DVector::from_fn(12, &mut normal)).collect();
        (covariance, columns)
    }

    #[test]
    fn without_an_effect_z_is_a_normal_number_and_with_it_the_change_is_found() {
        let (covariance, columns) = poses();
        let slopes = [&columns[0], &columns[1]];
        let seen = [0, 1];
        let whitener = Whitener::new(&covariance, &seen, 4).unwrap();
        let weights = Weights::new(&covariance, &whitener, slopes, (&seen, 2, 4)).unwrap();
        let factor = covariance.clone().cholesky().unwrap().unpack();
        let change = 0.3 * &columns[2];
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let by_moduli = DMatrix::from_columns(&slopes.map(|s| whitener.whiten(&part(s, &seen, 4))));
        // Both moduli are fitted to the seen poses, with and without the effect.
        let fitted = |all: &DVector<f64>| {
            let rest = whitener.whiten(&part(all, &seen, 4));
            let at = by_moduli.clone().svd(true, true).solve(&rest, 1e-12).unwrap();
            all - at[0] * slopes[0] - at[1] * slopes[1]
        };
        let known = fitted(&change);
        let [mut none, mut some] = [(0.0, 0.0); 2];
        let draws = 4000;
        for _ in 0..draws {
            let white = DVector::from_fn(12, |_, _| StandardNormal.sample(&mut random));
            let errors = &factor * white;
            for (sums, real) in [(&mut none, 0.0), (&mut some, 1.0)] {
                let without = fitted(&(&errors + real * &change));
                let z = weights.judge(&without, &(&without - &known), [0.0; 3]).z;
                sums.0 += z / f64::from(draws);
                sums.1 += z * z / f64::from(draws);
            }
        }
        assert!(none.0.abs() < 0.06 && (none.1 - 1.0).abs() < 0.1, "{none:?}");
        let size = weights.whiten(&known).norm();
        assert!((some.0 / size - 1.0).abs() < 0.06, "{some:?}, {size}");
    }

    #[test]
    fn a_change_that_is_there_confirms_and_its_opposite_refutes() {
        let held_out = |z: f64, fall: f64, fall_error: f64| HeldOut {
            before_mm: 1.0,
            after_mm: 1.0,
            floor_mm: 1.0,
            z,
            fall,
            fall_error,
        };
        assert!(held_out(3.0, 9.0, 6.0).confirms());
        // Half of it is there: as far from all as from nothing.
        assert!(!held_out(3.0, 0.0, 12.0).confirms());
        assert!(!held_out(1.9, 3.0, 2.0).confirms());
        assert!(held_out(-2.0, -21.0, 6.0).refutes() && !held_out(0.0, -9.0, 6.0).refutes());
    }
}
