//! A second effect: what explains what the first one leaves?

use super::{
    evidence::Evidence,
    refit::Fitted,
    screen::Screening,
    signature::{Projector, Signature},
    verdict::Judge,
};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// An effect beside a fitted one, by its signature alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Second {
    /// Its word.
    pub effect: String,
    /// Its score (standard deviations), the first effect and the moduli projected out.
    pub z: f64,
    /// What chance exceeds once in a hundred times.
    pub limit: f64,
    /// Its amplitude, to first order in moduli and the first effect.
    pub amplitude: f64,
    /// Score of what is left in smooth shapes beyond both; beyond the second number something else is missing.
    pub left: [f64; 2],
}

impl Second {
    /// Whether nothing smooth is left beside both.
    pub fn completes(&self) -> bool {
        self.left[0] <= self.left[1]
    }
}

impl Judge<'_> {
    /// The effect that explains most of what the fit of another one leaves; `None` where chance explains it. `first` is
    /// the place of that one in the evidence, `alike` are effects that these data do not tell from it.
    pub(super) fn second(&self, first: usize, found: &Fitted, alike: &[String]) -> Option<Second> {
        let Evidence { signatures, budget, .. } = self.evidence;
        let seen = |all: &DVector<f64>| self.seen(all);
        let mut fitted: Vec<DVector<f64>> = self.evidence.slopes().into_iter().map(seen).collect();
        fitted.push(seen(&signatures[first].rate(found.amplitude)));
        let others: Vec<Signature> = (0..)
            .zip(signatures)
            .filter(|(k, s)| *k != first && !alike.iter().any(|name| name == s.effect.name))
            .map(|(_, signature)| signature.of(seen))
            .collect();
        let systematic = budget.systematic();
        let mut residual = seen(&found.residual);
        let projector = Projector::new(&self.whitener, &fitted);
        let screening = Screening::new(&projector, &residual, &others, systematic);
        let best = *screening.ranked().first()?;
        let amplitude = best.amplitude.filter(|_| best.z > screening.limit)?;
        let signature = others.iter().find(|s| s.effect.name == best.effect)?;
        residual += signature.change(amplitude);
        fitted.push(signature.rate(amplitude));
        Some(Second {
            effect: best.effect.clone(),
            z: best.z,
            limit: screening.limit,
            amplitude,
            left: self.rest.of(&self.whitener, &fitted, &residual, systematic),
        })
    }
}
