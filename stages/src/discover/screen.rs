//! Score test: does any effect explain the residuals beyond what the moduli can?

use super::{
    chance::{self, Curve},
    signature::{Explained, Projector, Signature},
};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

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
    /// A score beyond this is not explained by chance (1 % of data without any effect) about what models
    /// and volunteers differ by anyway.
    pub limit: f64,
    /// Cosines between what survives of the signatures, row after row.
    pub cosines: Vec<Vec<f64>>,
}

impl Screening {
    /// Tests signatures (rows as the residuals) against residuals (mm). `systematic` is the size of a change that stands for
    /// nothing: chance is about it.
    pub(super) fn new(
        projector: &Projector,
        residual: &DVector<f64>,
        signatures: &[Signature],
        systematic: f64,
    ) -> Self {
        let (rest, _) = projector.surviving(residual);
        let (unit, parts): (Vec<DVector<f64>>, Vec<f64>) = signatures
            .iter()
            .map(|signature| projector.surviving(&signature.change(signature.far())))
            .map(|(left, part)| (&left / left.norm().max(f64::MIN_POSITIVE), part))
            .unzip();
        let cosines: Vec<Vec<f64>> =
            unit.iter().map(|a| unit.iter().map(|b| a.dot(b)).collect()).collect();
        let curves: Vec<Curve> = signatures.iter().map(|s| projector.curve(s)).collect();
        let explained: Vec<Explained> =
            signatures.iter().map(|s| projector.explain(s, &rest)).collect();
        let limit = |tested: &[usize]| {
            let curves: Vec<&Curve> = tested.iter().map(|&k| &curves[k]).collect();
            chance::limit(&curves, systematic)
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

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;
    use crate::{discover::budget::Whitener, effects::Effect};
    use nalgebra::DMatrix;

    /// An effect that changes one of three independent residuals, by so much at an amplitude of 1.
    fn along(name: &str, row: usize, by: f64) -> Signature {
        let mut change = DVector::zeros(3);
        change[row] = 0.01 * by;
        let effect = Effect::named(name).unwrap();
        Signature::small(effect, effect.amplitude.range, 0.01, change)
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
        assert!(
            (coarse.limit - alone.limit - 1.0).abs() < 0.05,
            "{} {}",
            coarse.limit,
            alone.limit
        );
    }
}
