//! Fit of the moduli, with or without one effect: linear, or Gauss-Newton with Broyden's updates.

use super::{budget::Whitener, evidence::Evidence, observe, signature::Projector};
use crate::{
    calibrate::{Experiment, Fit},
    effects::Effect,
    model::{Body, Moduli},
};
use mammotwin_data::{Failure, progress::Silent, study::ModelPlan};
use nalgebra::{DMatrix, DVector};

/// Evaluations of one fit at most.
const MOST: usize = 6;
/// A fit ends when the misfit falls by less than this (it counts squared standard deviations).
const ENOUGH: f64 = 0.2;
/// Largest change of the logarithm of a modulus in one step.
const STRIDE: f64 = 0.5;

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
    /// Squared norm of the whitened residuals of the seen poses.
    pub misfit: f64,
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
    let by_moduli: Vec<DVector<f64>> = evidence.by_moduli.iter().map(seen_part).collect();
    let mut rest = residual.clone();
    let (mut amplitude, mut amplitude_sd) = (0.0, f64::NAN);
    if let Some(signature) = effect.map(|k| &evidence.signatures[k]) {
        let projector = Projector::new(whitener, &by_moduli);
        let (left, _) = projector.surviving(&seen_part(residual));
        let explained = projector.explain(&signature.of(seen_part), &left);
        (amplitude, _) = explained.best();
        amplitude_sd = 1.0 / explained.rate(amplitude).max(f64::MIN_POSITIVE);
        rest += signature.change(amplitude);
    }
    let columns: Vec<DVector<f64>> = by_moduli.iter().map(|v| whitener.whiten(v)).collect();
    let mut moduli = evidence.moduli;
    if let Some(at) =
        least_squares(&DMatrix::from_columns(&columns), &whitener.whiten(&seen_part(&rest)))
    {
        rest += at[0] * &evidence.by_moduli[0] + at[1] * &evidence.by_moduli[1];
        moduli.right_kpa *= at[0].exp();
        moduli.left_kpa *= at[1].exp();
    }
    Fitted {
        misfit: whitener.whiten(&seen_part(&rest)).norm_squared(),
        residual: rest,
        moduli,
        amplitude,
        amplitude_sd,
    }
}

/// A plan with an effect on top.
pub(super) fn with_effect(plan: &ModelPlan, effect: &Effect, amplitude: f64) -> ModelPlan {
    let mut plan = plan.clone();
    let [least, greatest] = effect.amplitude.range;
    let sum = plan.effects.get(effect.name).copied().unwrap_or(0.0) + amplitude;
    plan.effects.insert(effect.name.into(), sum.clamp(least, greatest));
    plan
}

impl Refit<'_> {
    /// Fits the moduli, and the amplitude of an effect.
    pub fn run(&self, effect: Option<Start>) -> (Fitted, Fit) {
        let Evidence { by_moduli, signatures, .. } = self.evidence;
        let mut columns: Vec<DVector<f64>> = by_moduli.iter().map(|v| self.whitened(v)).collect();
        columns.extend(effect.map(|(k, _)| self.whitened(&signatures[k].slope)));
        let (effect, mut first) = effect.map(|(k, first)| (signatures[k].effect, first)).unzip();
        let mut jacobian = DMatrix::from_columns(&columns);
        // Unknowns: logarithms of both moduli over the start, amplitude.
        let mut at = DVector::zeros(columns.len());
        let mut fit = self.start.clone();
        let all = self.evidence.residual_of(&fit);
        let mut residual = self.whitened(&all);
        let mut best = Fitted {
            residual: all,
            moduli: fit.moduli,
            amplitude: 0.0,
            amplitude_sd: f64::NAN,
            misfit: residual.norm_squared(),
        };
        let mut damping = 1.0;
        for _ in 0..MOST {
            let Some(step) = least_squares(&jacobian, &residual) else { break };
            let mut step: DVector<f64> = damping * step;
            if let Some(amplitude) = first.take() {
                // The score's amplitude is better than a linear one far outside of the range.
                step[2] = step[2].clamp(-2.0 * amplitude.abs(), 2.0 * amplitude.abs());
            }
            let limit = step.rows(0, 2).amax() / STRIDE;
            if limit > 1.0 {
                step.rows_mut(0, 2).scale_mut(1.0 / limit);
            }
            let mut next = &at + &step;
            if let Some(effect) = effect {
                let [least, greatest] = effect.amplitude.range;
                next[2] = next[2].clamp(least, greatest);
            }
            let step = &next - &at;
            if step.norm() == 0.0 {
                break;
            }
            let Ok(trial) = self.evaluate(&next, effect, &fit) else {
                damping *= 0.4;
                continue;
            };
            let all = self.evidence.residual_of(&trial);
            let there = self.whitened(&all);
            let change = &there - &residual - &jacobian * &step;
            jacobian.ger(1.0 / step.norm_squared(), &change, &step, 1.0);
            let misfit = there.norm_squared();
            let gain = best.misfit - misfit;
            if gain > 0.0 {
                let amplitude = if effect.is_some() { next[2] } else { 0.0 };
                let moduli = trial.moduli;
                best = Fitted { residual: all, moduli, amplitude, misfit, amplitude_sd: f64::NAN };
                (fit, at, residual, damping) = (trial, next, there, 1.0);
                if gain < ENOUGH {
                    break;
                }
            } else {
                damping *= 0.4;
                if damping < 0.05 {
                    break;
                }
            }
        }
        if effect.is_some() {
            best.amplitude_sd = deviation(&jacobian);
        }
        (best, fit)
    }

    fn whitened(&self, all: &DVector<f64>) -> DVector<f64> {
        self.whitener.whiten(&observe::part(all, self.seen, self.evidence.nodes()))
    }

    fn evaluate(
        &self,
        at: &DVector<f64>,
        effect: Option<&Effect>,
        near: &Fit,
    ) -> Result<Fit, Failure> {
        let moduli = Moduli {
            right_kpa: self.start.moduli.right_kpa * at[0].exp(),
            left_kpa: self.start.moduli.left_kpa * at[1].exp(),
        };
        let plan = match effect {
            Some(effect) => with_effect(self.plan, effect, at[2]),
            None => self.plan.clone(),
        };
        let body = Body { plan: &plan, ..self.experiment.body.clone() };
        self.experiment.evaluate_as(&body, moduli, Some(near), &Silent, "")
    }
}

/// Standard deviation of the third unknown of whitened residuals.
fn deviation(jacobian: &DMatrix<f64>) -> f64 {
    let covariance = (jacobian.transpose() * jacobian).try_inverse();
    covariance.map_or(f64::NAN, |c| c[(2, 2)].max(0.0).sqrt())
}

fn least_squares(jacobian: &DMatrix<f64>, residual: &DVector<f64>) -> Option<DVector<f64>> {
    let normal = jacobian.transpose() * jacobian;
    normal.cholesky().map(|factor| factor.solve(&(-(jacobian.transpose() * residual))))
}
