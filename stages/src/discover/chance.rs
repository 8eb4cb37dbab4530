//! The score that chance and a systematic error exceed once in a hundred times.

use super::signature::farthest;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Chance of naming anything where there is nothing.
const ALPHA: f64 = 0.01;
/// Draws of the largest score under nothing.
const DRAWS: usize = 20_000;
const SEED: u64 = 0x5c0e;

/// Amplitudes are tried where changes differ in size by so much; beyond the second size none is. A score that lies
/// between two is met to a hundredth.
const APART: f64 = 0.5;
const LARGEST: f64 = 15.0;
/// Steps in which these amplitudes are sought.
const STEPS: usize = 1000;
/// Less than this part of a curve beside its slope is rounding.
const STRAIGHT: f64 = 1e-9;

/// What an effect changes about whitened residuals beside what is fitted anyway: with an amplitude x, in units of the one up to
/// which it bends, `x slope + |x| min(|x|, 1) curve`.
pub(super) struct Curve {
    pub slope: DVector<f64>,
    pub curve: DVector<f64>,
    /// Of x.
    pub range: [f64; 2],
}

/// Factor of the curve.
fn bent(x: f64) -> f64 {
    x.abs() * x.abs().min(1.0)
}

/// Amplitudes of an effect that are tried, and what a drawn score may be at most.
struct Tries {
    /// Factors of slope and curve, and the squared size of the change.
    at: Vec<[f64; 3]>,
    /// Product of slope and curve over the square of the slope, squares of the slope and of what the curve has beside it.
    plane: [f64; 3],
}

impl Tries {
    fn new([least, greatest]: [f64; 2], [slope, mixed, curve]: [f64; 3]) -> Self {
        let mut at = Vec::new();
        for end in [least, greatest] {
            let mut last = 0.0_f64;
            for n in 1..=STEPS {
                let a = end * n as f64 / STEPS as f64;
                let b = bent(a);
                let square = (a * a * slope + 2.0 * a * b * mixed + b * b * curve).max(0.0);
                let size = square.sqrt();
                if (size - last).abs() >= APART || n == STEPS {
                    at.push([a, b, square]);
                    last = size;
                }
                if size > LARGEST {
                    break;
                }
            }
        }
        let part = if slope > 0.0 { mixed / slope } else { 0.0 };
        Self { at, plane: [part, slope, curve - part * mixed] }
    }

    /// Square of the score of residuals with these products with slope and curve; zero where it is not over `most`.
    fn square(&self, [slope, curve]: [f64; 2], most: f64) -> f64 {
        let [part, along, beside] = self.plane;
        let mut bound = if along > 0.0 { slope * slope / along } else { 0.0 };
        if beside > STRAIGHT * along {
            bound += (curve - part * slope).powi(2) / beside;
        }
        if bound <= most {
            return 0.0;
        }
        let gain = |[a, b, square]: &[f64; 3]| -2.0 * (a * slope + b * curve) - square;
        self.at.iter().map(gain).fold(0.0, f64::max)
    }
}

/// The largest of all scores that errors exceed with probability [`ALPHA`] where nothing is hidden. Beside chance there is a
/// change of size `systematic` that no budget knows, now along one effect, now along another: a score that it raises is normal
/// about it, not about zero.
///
/// Effects are drawn as they are searched, each with the plausible amplitude that explains most. That a change bends matters
/// little: 0.02 for one that turns by 45 degrees.
pub(super) fn limit(curves: &[&Curve], systematic: f64) -> f64 {
    let n = curves.len();
    if n == 0 {
        return systematic;
    }
    let slopes = curves.iter().map(|c| c.slope.clone());
    let columns: Vec<DVector<f64>> = slopes.chain(curves.iter().map(|c| c.curve.clone())).collect();
    let columns = DMatrix::from_columns(&columns);
    let products = columns.transpose() * columns;
    let tries: Vec<Tries> = (0..n)
        .map(|k| {
            let own = [products[(k, k)], products[(k, n + k)], products[(n + k, n + k)]];
            Tries::new(curves[k].range, own)
        })
        .collect();
    // What the change by a large amplitude has with all the others.
    let biases: Vec<DVector<f64>> = (0..n)
        .map(|k| {
            let sign = farthest(curves[k].range).signum();
            let along = sign * products.column(k) + products.column(n + k);
            let square = sign * along[k] + along[n + k];
            if square > 0.0 { along * (-systematic / square.sqrt()) } else { DVector::zeros(2 * n) }
        })
        .collect();
    let eigen = products.symmetric_eigen();
    let spread = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
    let factor = eigen.eigenvectors * spread;
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut drawn = DVector::zeros(2 * n);
    let mut largest: Vec<f64> = (0..DRAWS)
        .map(|draw| {
            let normal = DVector::from_fn(2 * n, |_, _| StandardNormal.sample(&mut random));
            drawn.copy_from(&biases[draw % n]);
            drawn.gemv(1.0, &factor, &normal, 1.0);
            let square = |most: f64, (k, tries): (usize, &Tries)| {
                most.max(tries.square([drawn[k], drawn[n + k]], most))
            };
            tries.iter().enumerate().fold(0.0, square).sqrt()
        })
        .collect();
    quantile(&mut largest)
}

fn quantile(largest: &mut [f64]) -> f64 {
    largest.sort_unstable_by(f64::total_cmp);
    let place = (1.0 - ALPHA) * largest.len() as f64;
    largest.get(place as usize).copied().unwrap_or(f64::INFINITY)
}

/// A score with a sign that an amplitude of this range cannot have counts as none.
fn allowed([least, greatest]: [f64; 2], z: f64) -> f64 {
    if (z < 0.0 && least == 0.0) || (z > 0.0 && greatest == 0.0) { 0.0 } else { z }
}

/// The largest of all scores that chance exceeds with probability [`ALPHA`]. Scores are of unit
/// signatures with these cosines; effects have amplitudes in `ranges`.
pub(crate) fn by_chance(cosines: &DMatrix<f64>, ranges: &[[f64; 2]]) -> f64 {
    let n = ranges.len();
    // A ridge keeps the factor real where signatures are alike.
    let correlation = cosines + DMatrix::from_diagonal_element(n, n, 1e-9);
    let Some(factor) = correlation.cholesky().map(|factor| factor.l()) else {
        return f64::INFINITY;
    };
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut largest: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let normal = |_, _| StandardNormal.sample(&mut random);
            let z: DVector<f64> = &factor * DVector::from_fn(n, normal);
            let scores = ranges.iter().zip(z.iter());
            scores.map(|(range, z)| allowed(*range, *z).abs()).fold(0.0, f64::max)
        })
        .collect();
    quantile(&mut largest)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::{
        super::{
            budget::Whitener,
            course::Change,
            signature::{Projector, Signature},
        },
        *,
    };
    use crate::effects::Effect;

    fn along(rows: usize, row: usize, size: f64) -> DVector<f64> {
        DVector::from_fn(rows, |n, _| if n == row { size } else { 0.0 })
    }

    fn straight(range: [f64; 2]) -> Curve {
        Curve { slope: along(2, 0, 20.0), curve: DVector::zeros(2), range }
    }

    #[test]
    fn a_systematic_error_shifts_the_quantile() {
        // One in a hundred on one side; on both sides 0.995 without and 0.99 with a shift.
        for (range, systematic, quantile) in [
            ([0.0, 1.0], 0.0, 2.326),
            ([0.0, 1.0], 1.0, 3.326),
            ([0.0, 1.0], 4.0, 6.326),
            ([-1.0, 1.0], 0.0, 2.576),
            ([-1.0, 1.0], 3.0, 5.326),
        ] {
            let found = limit(&[&straight(range)], systematic);
            assert!((found - quantile).abs() < 0.06, "{range:?} {systematic}: {found}");
        }
        assert_eq!(limit(&[], 1.0), 1.0);
        // Of two that nothing joins each has the error every other time: P(N > x - 1) + P(N > x) = 1 %.
        let other = Curve { slope: along(2, 1, 20.0), ..straight([0.0, 1.0]) };
        let found = limit(&[&straight([0.0, 1.0]), &other], 1.0);
        assert!((found - 3.345).abs() < 0.06, "{found}");
    }

    #[test]
    fn chance_explains_itself_as_the_search_does_with_changes_that_bend() {
        let effect = Effect::named("limit_chain").unwrap();
        let of = |a: f64| {
            let mean = along(2, 0, 10.0 * a) + along(2, 1, 10.0 * a * a);
            Change { off: DVector::zeros(2), mean }
        };
        let (small, large) = (of(0.05), of(0.8));
        let signature = Signature::new(effect, [0.0, 1.2], (0.05, &small), Some((0.8, &large)));
        let whitener = Whitener::new(&DMatrix::identity(2, 2), &[0], 2).unwrap();
        let projector = Projector::new(&whitener, &[]);
        let found = limit(&[&projector.curve(&signature)], 0.0);
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let draws = 20_000;
        let over = (0..draws)
            .filter(|_| {
                let rest = DVector::from_fn(2, |_, _| StandardNormal.sample(&mut random));
                projector.explain(&signature, &rest).best().1.sqrt() > found
            })
            .count();
        // 200 and four standard deviations of a count and of the limit's own draws.
        assert!((140..=260).contains(&over), "{over} of {draws} over {found}");
        // By 45 degrees: hardly more than along one direction (2.326).
        assert!((found - 2.35).abs() < 0.07, "{found}");
    }
}
