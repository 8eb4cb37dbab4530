//! Score test: does any effect explain the residuals beyond what the moduli can?

use super::signature::{Projector, Signature};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Chance of naming anything where there is nothing.
const ALPHA: f64 = 0.01;
/// Scores that volunteers without any effect have by what no budget knows (standard deviations): their
/// truth lies on another mesh under measured surfaces of another kind. Without noise the largest were
/// 2.5 and 1.7 (`tiny`, seeds 3 and 7); a score must stand out from that as well.
const SYSTEMATIC: f64 = 2.0;
/// Draws of the largest score under nothing.
const DRAWS: usize = 20_000;
const SEED: u64 = 0x5c0e;

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
    /// Tests signatures (rows as the residuals) against residuals (mm).
    pub(super) fn new(
        projector: &Projector,
        residual: &DVector<f64>,
        signatures: &[Signature],
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
        let of = |i: usize, j: usize| cosines[i][j];
        let limit =
            by_chance(&DMatrix::from_fn(unit.len(), unit.len(), of), &ranges).hypot(SYSTEMATIC);
        let score = |(signature, surviving): (&Signature, f64)| {
            let explained = projector.explain(signature, &rest);
            let (amplitude, gain) = explained.best();
            let detectable_z = explained.largest();
            let testable = detectable_z > limit;
            Score {
                effect: signature.effect.name.into(),
                z: gain.sqrt(),
                amplitude: testable.then_some(amplitude),
                surviving,
                detectable_z,
                testable,
            }
        };
        Self { scores: signatures.iter().zip(parts).map(score).collect(), limit, cosines }
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
