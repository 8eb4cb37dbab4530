//! Score test: does any effect explain the residuals beyond what the moduli can?

use super::signature::{Explained, Projector, Signature};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Chance of naming anything where there is nothing.
const ALPHA: f64 = 0.01;
/// Draws of the largest score under nothing.
const DRAWS: usize = 20_000;
const SEED: u64 = 0x5c0e;

/// Changes with a larger cosine are one to the data.
pub(crate) const ALIKE_COSINE: f64 = 0.95;

/// One effect, tested.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Word of the effect.
    pub effect: String,
    /// Score in standard deviations; positive: with this sign the effect explains residuals.
    pub z: f64,
    /// Amplitude that explains most, moduli linearly fitted; `None` for an effect that these data could
    /// not show.
    pub amplitude: Option<f64>,
    /// Part of the effect's signature that the moduli do not absorb.
    pub surviving: f64,
    /// Score that the largest plausible amplitude would have.
    pub detectable_z: f64,
    /// Whether the data could show the effect at all.
    pub testable: bool,
}

/// All effects, tested.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Screening {
    /// In the order of the library; effects whose signature could not be computed are missing.
    pub scores: Vec<Score>,
    /// A score beyond this is not explained by chance (1 % of data without any effect) and by what models
    /// and volunteers differ by anyway.
    pub limit: f64,
    /// Cosines between what survives of the signatures, row after row.
    pub cosines: Vec<Vec<f64>>,
}

impl Screening {
    /// Tests signatures (rows as the residuals) against residuals (mm). `systematic` is the score that stands for nothing
    /// beside chance.
    pub(super) fn new(
        projector: &Projector,
        residual: &DVector<f64>,
        signatures: &[Signature],
        systematic: f64,
    ) -> Self {
        let (rest, _) = projector.surviving(residual);
        let (unit, parts): (Vec<DVector<f64>>, Vec<f64>) = signatures
            .iter()
            .map(|signature| projector.surviving(&signature.change(signature.reach)))
            .map(|(left, part)| (&left / left.norm().max(f64::MIN_POSITIVE), part))
            .unzip();
        let cosines: Vec<Vec<f64>> =
            unit.iter().map(|a| unit.iter().map(|b| a.dot(b)).collect()).collect();
        let ranges: Vec<[f64; 2]> = signatures.iter().map(|s| s.effect.amplitude.range).collect();
        let explained: Vec<Explained> =
            signatures.iter().map(|s| projector.explain(s, &rest)).collect();
        let limit = |tested: &[usize]| {
            let cosines =
                DMatrix::from_fn(tested.len(), tested.len(), |i, j| cosines[tested[i]][tested[j]]);
            let ranges: Vec<[f64; 2]> = tested.iter().map(|&k| ranges[k]).collect();
            by_chance(&cosines, &ranges).hypot(systematic)
        };
        let all: Vec<usize> = (0..signatures.len()).collect();
        let strictest = limit(&all);
        // What the data could not show at all is no trial, and raises no threshold.
        let testable: Vec<usize> =
            all.iter().copied().filter(|&k| explained[k].largest() > strictest).collect();
        let limit = if testable.is_empty() { strictest } else { limit(&testable) };
        let score = |k: usize| {
            let (explained, effect) = (&explained[k], signatures[k].effect);
            let (amplitude, gain) = explained.best();
            let testable = testable.contains(&k);
            Score {
                effect: effect.name.into(),
                z: gain.sqrt(),
                amplitude: testable.then_some(amplitude),
                surviving: parts[k],
                detectable_z: explained.largest(),
                testable,
            }
        };
        Self { scores: all.iter().map(|&k| score(k)).collect(), limit, cosines }
    }

    /// Effects that show and whose change these data do not tell from that of an effect.
    pub fn alike(&self, effect: &str) -> Vec<String> {
        let Some(place) = self.scores.iter().position(|score| score.effect == effect) else {
            return Vec::new();
        };
        let row = self.scores.iter().zip(&self.cosines[place]);
        row.filter(|(score, _)| score.effect != effect && score.testable && score.z > 0.0)
            .filter(|(_, cosine)| cosine.abs() > ALIKE_COSINE)
            .map(|(score, _)| score.effect.clone())
            .collect()
    }

    /// Scores, the largest first.
    pub fn ranked(&self) -> Vec<&Score> {
        let mut ranked: Vec<&Score> = self.scores.iter().collect();
        ranked.sort_by(|a, b| b.z.total_cmp(&a.z));
        ranked
    }
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
            ranges
                .iter()
                .zip(z.iter())
                .map(|(range, z)| allowed(*range, *z).abs())
                .fold(0.0, f64::max)
        })
        .collect();
    largest.sort_unstable_by(f64::total_cmp);
    largest.get(((1.0 - ALPHA) * DRAWS as f64) as usize).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;
    use crate::{discover::budget::Whitener, effects::Effect};

    /// An effect that changes one of three independent residuals, by so much at an amplitude of 1.
    fn along(name: &str, row: usize, by: f64) -> Signature {
        let mut change = DVector::zeros(3);
        change[row] = 0.01 * by;
        Signature::small(Effect::named(name).unwrap(), 0.01, change)
    }

    #[test]
    fn what_the_data_cannot_show_raises_no_threshold_and_systematic_errors_do() {
        let whitener = Whitener::new(&DMatrix::identity(3, 3), &[0], 3).unwrap();
        let projector = Projector::new(&whitener, &[]);
        let residual = DVector::from_row_slice(&[-8.0, -8.0, 0.0]);
        let shown = along("limit_chain", 0, 20.0);
        let hidden = along("skin_region", 1, 1e-3);
        let screen = |signatures: &[Signature], systematic: f64| {
            Screening::new(&projector, &residual, signatures, systematic)
        };
        let alone = screen(std::slice::from_ref(&shown), 1.0);
        let both = screen(&[shown.clone(), hidden], 1.0);
        assert_eq!(both.limit, alone.limit);
        assert!(both.scores[0].testable && both.scores[0].z > both.limit);
        assert!(!both.scores[1].testable && both.scores[1].amplitude.is_none());
        let two = screen(&[shown.clone(), along("skin_region", 1, 20.0)], 1.0);
        assert!(two.limit > alone.limit);
        let coarse = screen(&[shown], 2.0);
        assert!((coarse.limit.powi(2) - alone.limit.powi(2) - 3.0).abs() < 1e-9);
    }
}
