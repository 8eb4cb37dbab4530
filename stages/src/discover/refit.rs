//! Nonlinear fit of the moduli, with or without one effect: Gauss-Newton with Broyden's updates.

use super::{budget::Whitener, observe::Frame};
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
    pub frame: &'a Frame,
    pub whitener: &'a Whitener,
    /// Poses that the fit sees.
    pub seen: &'a [usize],
    pub plan: &'a ModelPlan,
    /// The fit to begin with, and derivatives (mm) of its seen residuals by the logarithms of both
    /// moduli.
    pub start: &'a Fit,
    pub by_moduli: &'a [DVector<f64>],
}

/// A fit that was found.
#[derive(Debug, Clone)]
pub(super) struct Refitted {
    pub fit: Fit,
    pub amplitude: f64,
    /// Squared norm of the whitened residuals of the seen poses.
    pub misfit: f64,
    pub evaluations: usize,
    /// Standard deviation of the amplitude, linearised.
    pub amplitude_sd: f64,
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
    /// Fits the moduli, and the amplitude of `effect` from `amplitude` on, whose signature (mm per
    /// unit of amplitude) is known.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the first evaluation has no equilibrium.
    pub fn run(&self, effect: Option<(&Effect, f64, &DVector<f64>)>) -> Result<Refitted, Failure> {
        let mut columns: Vec<DVector<f64>> =
            self.by_moduli.iter().map(|v| self.whitener.whiten(v)).collect();
        if let Some((_, _, signature)) = effect {
            columns.push(self.whitener.whiten(signature));
        }
        let mut jacobian = DMatrix::from_columns(&columns);
        // Unknowns: logarithms of both moduli over the start, amplitude.
        let mut at = DVector::zeros(columns.len());
        let mut best = Refitted {
            fit: self.start.clone(),
            amplitude: 0.0,
            misfit: 0.0,
            evaluations: 0,
            amplitude_sd: f64::NAN,
        };
        let mut residual = self.residual(&best.fit);
        best.misfit = residual.norm_squared();
        let mut damping = 1.0;
        let mut first = effect.map(|(_, amplitude, _)| amplitude);
        while best.evaluations < MOST {
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
            if let Some((effect, ..)) = effect {
                let [least, greatest] = effect.amplitude.range;
                next[2] = next[2].clamp(least, greatest);
            }
            let step = &next - &at;
            if step.norm() == 0.0 {
                break;
            }
            best.evaluations += 1;
            let amplitude = if effect.is_some() { next[2] } else { 0.0 };
            let Ok(fit) = self.evaluate(&next, effect.map(|(e, ..)| e), &best.fit) else {
                damping *= 0.4;
                continue;
            };
            let trial = self.residual(&fit);
            let change = &trial - &residual - &jacobian * &step;
            jacobian.ger(1.0 / step.norm_squared(), &change, &step, 1.0);
            let misfit = trial.norm_squared();
            let gain = best.misfit - misfit;
            if gain > 0.0 {
                let evaluations = best.evaluations;
                best = Refitted { fit, amplitude, misfit, evaluations, amplitude_sd: f64::NAN };
                (at, residual, damping) = (next, trial, 1.0);
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
            let covariance = (jacobian.transpose() * &jacobian).try_inverse();
            best.amplitude_sd = covariance.map_or(f64::NAN, |c| c[(2, 2)].max(0.0).sqrt());
        }
        Ok(best)
    }

    fn residual(&self, fit: &Fit) -> DVector<f64> {
        self.whitener.whiten(&self.frame.observe(fit).residual(self.seen))
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

fn least_squares(jacobian: &DMatrix<f64>, residual: &DVector<f64>) -> Option<DVector<f64>> {
    let normal = jacobian.transpose() * jacobian;
    normal.cholesky().map(|factor| factor.solve(&(-(jacobian.transpose() * residual))))
}
