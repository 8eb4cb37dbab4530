//! Fit of the moduli, with or without one effect: linear, or by whole solutions.

use super::{
    budget::Whitener,
    descent::{End, Limits, Model, State, descend},
    evidence::Evidence,
    observe,
    signature::{Projector, beyond},
    variation::SMALL_MODULUS,
};
use crate::{
    calibrate::{Experiment, Fit},
    effects::Effect,
    model::{Body, Moduli},
    span::least_squares,
};
use mammotwin_data::{Failure, study::ModelPlan};
use nalgebra::{DMatrix, DVector};

/// Farthest from the start (of the logarithm of a modulus) that the first solution is tried.
const FARTHEST: f64 = 0.5;

/// What a fit needs to know.
pub(super) struct Refit<'a> {
    pub experiment: &'a Experiment<'a>,
    pub evidence: &'a Evidence,
    /// Of the seen poses.
    pub whitener: &'a Whitener,
    /// Poses that the fit sees.
    pub seen: &'a [usize],
    pub plan: &'a ModelPlan,
    /// The fit to begin with.
    pub start: &'a Fit,
}

/// A fit that was found.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    /// Residuals (mm) of all poses.
    pub residual: DVector<f64>,
    pub moduli: Moduli,
    pub amplitude: f64,
    /// Standard deviation of the amplitude, linearised.
    pub amplitude_sd: f64,
    /// By how many of these the amplitude would go beyond its plausible range.
    pub beyond: f64,
    /// Squared norm of the whitened residuals of the seen poses.
    pub misfit: f64,
    /// Why this is no least misfit, if it is none: then it tells nothing.
    pub unsettled: Option<String>,
}

/// An effect to fit: place of its signature in the evidence, and the amplitude to begin with.
pub(super) type Start = (usize, f64);

/// The moduli and the amplitude of an effect that make residuals (mm) of all poses least, as far as
/// they are linear in the moduli and known from the effect's signature.
pub(super) fn linear(
    evidence: &Evidence,
    whitener: &Whitener,
    seen: &[usize],
    residual: &DVector<f64>,
    effect: Option<usize>,
) -> Fitted {
    let nodes = evidence.nodes();
    let seen_part = |v: &DVector<f64>| observe::part(v, seen, nodes);
    let slopes = evidence.slopes();
    let by_moduli: Vec<DVector<f64>> = slopes.into_iter().map(seen_part).collect();
    let mut rest = residual.clone();
    let (mut amplitude, mut amplitude_sd, mut beyond) = (0.0, f64::NAN, 0.0);
    if let Some(signature) = effect.map(|k| &evidence.signatures[k]) {
        let projector = Projector::new(whitener, &by_moduli);
        let (left, _) = projector.surviving(&seen_part(residual));
        let explained = projector.explain(&signature.of(seen_part), &left);
        (amplitude, _) = explained.best();
        amplitude_sd = 1.0 / explained.rate(amplitude).max(f64::MIN_POSITIVE);
        beyond = explained.beyond(amplitude);
        rest += signature.change(amplitude);
    }
    let columns: Vec<DVector<f64>> = by_moduli.iter().map(|v| whitener.whiten(v)).collect();
    let at = least_squares(&DMatrix::from_columns(&columns), &whitener.whiten(&seen_part(&rest)));
    rest += at[0] * slopes[0] + at[1] * slopes[1];
    let moduli = evidence.moduli.times(at[0].exp(), at[1].exp());
    Fitted {
        misfit: whitener.whiten(&seen_part(&rest)).norm_squared(),
        residual: rest,
        moduli,
        amplitude,
        amplitude_sd,
        beyond,
        unsettled: None,
    }
}

/// What a plan has of an effect.
fn held(plan: &ModelPlan, effect: &Effect) -> f64 {
    plan.effects.get(effect.name).copied().unwrap_or(0.0)
}

/// Amplitudes of an effect that are plausible on top of what a plan has of it.
pub(super) fn plausible(plan: &ModelPlan, effect: &Effect) -> [f64; 2] {
    effect.amplitude.range.map(|end| end - held(plan, effect))
}

/// A plan with a [`plausible`] amplitude of an effect on top.
pub(super) fn with_effect(plan: &ModelPlan, effect: &Effect, amplitude: f64) -> ModelPlan {
    let mut plan = plan.clone();
    let [least, greatest] = effect.amplitude.range;
    let sum = held(&plan, effect) + amplitude;
    // Against rounding alone.
    plan.effects.insert(effect.name.into(), sum.clamp(least, greatest));
    plan
}

impl Refit<'_> {
    /// Fits the moduli, and the amplitude of an effect, from where signatures put them, in standard deviations of the unknowns.
    pub fn run(&self, effect: Option<Start>) -> (Fitted, Fit) {
        let Evidence { signatures, moduli, .. } = self.evidence;
        let place = effect.map(|(k, _)| k);
        let model = Solutions { refit: self, place };
        let none = DVector::zeros(2 + usize::from(effect.is_some()));
        let all = model.all(&none, self.start);
        let screened = linear(self.evidence, self.whitener, self.seen, &all, place);
        let mut columns: Vec<DVector<f64>> =
            self.evidence.slopes().into_iter().map(|v| self.whitened(v)).collect();
        let far = [
            (screened.moduli.right_kpa / moduli.right_kpa).ln(),
            (screened.moduli.left_kpa / moduli.left_kpa).ln(),
        ];
        let mut first: Vec<f64> = far.map(|log| log.clamp(-FARTHEST, FARTHEST)).into();
        let mut limits = Limits { small: vec![SMALL_MODULUS; 2], range: None };
        if let Some((k, amplitude)) = effect {
            columns.push(self.whitened(&signatures[k].rate(amplitude)));
            first.push(amplitude);
            limits.small.push(self.effect(k).amplitude.small);
            limits.range = Some(signatures[k].range);
        }
        let start =
            State { residual: self.whitened(&all), unknowns: none, solution: self.start.clone() };
        let (first, jacobian) = (DVector::from_vec(first), DMatrix::from_columns(&columns));
        let End { at, jacobian, mut unsettled } = descend(&model, start, first, jacobian, &limits);
        let (mut amplitude, mut amplitude_sd, mut out) = (0.0, f64::NAN, 0.0);
        if let Some(range) = limits.range {
            amplitude = at.unknowns[2];
            match deviation(&jacobian) {
                Some(deviation) => {
                    let step = least_squares(&jacobian, &at.residual)[2] / deviation;
                    (amplitude_sd, out) = (deviation, beyond(range, amplitude, step));
                }
                None => {
                    amplitude_sd = range[1] - range[0];
                    unsettled.get_or_insert("its amplitude changes nothing there".into());
                }
            }
        }
        let best = Fitted {
            residual: model.all(&at.unknowns, &at.solution),
            moduli: at.solution.moduli,
            amplitude,
            amplitude_sd,
            beyond: out,
            misfit: at.misfit(),
            unsettled,
        };
        (best, at.solution)
    }

    fn effect(&self, place: usize) -> &'static Effect {
        self.evidence.signatures[place].effect
    }

    fn whitened(&self, all: &DVector<f64>) -> DVector<f64> {
        self.whitener.whiten(&observe::part(all, self.seen, self.evidence.nodes()))
    }
}

/// Solutions with other logarithms of both moduli, over the start's, and an amplitude.
struct Solutions<'a> {
    refit: &'a Refit<'a>,
    /// Of the effect's signature.
    place: Option<usize>,
}

impl Solutions<'_> {
    /// Residuals (mm) of all poses.
    fn all(&self, unknowns: &DVector<f64>, fit: &Fit) -> DVector<f64> {
        self.refit.evidence.residual_of(fit, self.place.map(|k| (k, unknowns[2])))
    }
}

impl Model for Solutions<'_> {
    type Solution = Fit;

    fn solve(&self, at: &DVector<f64>, near: &Fit) -> Result<(DVector<f64>, Fit), Failure> {
        let Refit { experiment, plan, start, .. } = self.refit;
        let moduli = start.moduli.times(at[0].exp(), at[1].exp());
        let plan = match self.place {
            Some(k) => with_effect(plan, self.refit.effect(k), at[2]),
            None => (*plan).clone(),
        };
        let body = Body { plan: &plan, ..experiment.body.clone() };
        let fit = experiment.evaluate_as(&body, moduli, Some(near))?;
        Ok((self.refit.whitened(&self.all(at, &fit)), fit))
    }
}

/// Standard deviation of the third unknown of whitened residuals; `None` where they do not tell it.
fn deviation(jacobian: &DMatrix<f64>) -> Option<f64> {
    let covariance = (jacobian.transpose() * jacobian).try_inverse()?;
    Some(covariance[(2, 2)].sqrt()).filter(|sd| sd.is_finite())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    #[test]
    fn what_a_study_has_of_an_effect_is_less_that_it_may_lack() {
        let study = "schema = 1\n[subject]\nid = \"v\"\n[poses.supine]\nimage = \"s.nii\"\nposture = \"supine\"\n[mesh]\nsize_mm = 9.0\n";
        let mut plan = mammotwin_data::study::parse(study).unwrap().model;
        let effect = Effect::named("limit_chain").unwrap();
        let [least, greatest] = effect.amplitude.range;
        assert_eq!(plausible(&plan, effect), [least, greatest]);
        plan.effects.insert("limit_chain".into(), 0.8);
        let left = plausible(&plan, effect);
        assert_eq!(left, [least - 0.8, greatest - 0.8]);
        // All of these make a difference, and none goes beyond what is plausible.
        for amplitude in [left[0], 0.5 * left[0], 0.5 * left[1], left[1]] {
            let sum = with_effect(&plan, effect, amplitude).effects["limit_chain"];
            assert!((sum - 0.8 - amplitude).abs() < 1e-12 && (least..=greatest).contains(&sum));
        }
    }
}
