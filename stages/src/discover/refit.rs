//! Fit of the moduli, with or without one effect: linear, or Gauss-Newton with Broyden's updates.

use super::{
    budget::Whitener,
    evidence::Evidence,
    observe,
    signature::{Projector, beyond},
    variation::SMALL_MODULUS,
};
use crate::{
    calibrate::{Experiment, Fit},
    effects::{Amplitude, Effect},
    model::{Body, Moduli},
};
use mammotwin_data::{Failure, progress::Silent, study::ModelPlan};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Evaluations of one fit at most, but those of derivatives.
const MOST: usize = 10;
/// A fit ends when the misfit falls by less than this (it counts squared standard deviations).
const ENOUGH: f64 = 0.2;
/// Largest change of the logarithm of a modulus in one step.
const STRIDE: f64 = 0.5;

/// Smallest part of a step that is tried.
const LEAST_DAMPING: f64 = 0.05;

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
    let mut moduli = evidence.moduli;
    if let Some(at) =
        least_squares(&DMatrix::from_columns(&columns), &whitener.whiten(&seen_part(&rest)))
    {
        rest += at[0] * slopes[0] + at[1] * slopes[1];
        moduli.right_kpa *= at[0].exp();
        moduli.left_kpa *= at[1].exp();
    }
    Fitted {
        misfit: whitener.whiten(&seen_part(&rest)).norm_squared(),
        residual: rest,
        moduli,
        amplitude,
        amplitude_sd,
        beyond,
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

/// Where a fit stands.
struct At {
    /// Logarithms of both moduli over the start, and the amplitude.
    unknowns: DVector<f64>,
    fit: Fit,
    /// Residuals (mm) of all poses.
    all: DVector<f64>,
    /// Those of the seen poses, whitened.
    seen: DVector<f64>,
}

impl Refit<'_> {
    /// Fits the moduli, and the amplitude of an effect, from where signatures put them.
    ///
    /// Gauss-Newton with Broyden's updates, in standard deviations of the unknowns; where it stalls, derivatives are taken
    /// anew, once.
    pub fn run(&self, effect: Option<Start>) -> (Fitted, Fit) {
        let Evidence { signatures, moduli, .. } = self.evidence;
        let place = effect.map(|(k, _)| k);
        let unknowns = 2 + usize::from(effect.is_some());
        let base = self.at(DVector::zeros(unknowns), self.start.clone(), place);
        let screened = linear(self.evidence, self.whitener, self.seen, &base.all, place);
        let mut columns: Vec<DVector<f64>> =
            self.evidence.slopes().into_iter().map(|v| self.whitened(v)).collect();
        let far = [
            (screened.moduli.right_kpa / moduli.right_kpa).ln(),
            (screened.moduli.left_kpa / moduli.left_kpa).ln(),
        ];
        let mut first: Vec<f64> = far.map(|log| log.clamp(-STRIDE, STRIDE)).into();
        if let Some((k, amplitude)) = effect {
            columns.push(self.whitened(&signatures[k].rate(amplitude)));
            first.push(amplitude);
        }
        let mut jacobian = DMatrix::from_columns(&columns);
        let mut at = base;
        let mut next = DVector::from_vec(first);
        let (mut damping, mut fresh) = (1.0, false);
        for _ in 0..MOST {
            let step = &next - &at.unknowns;
            let trial =
                self.evaluate(&next, place, &at.fit).map(|fit| self.at(next.clone(), fit, place));
            let mut stalled = step.norm() == 0.0;
            match trial {
                Ok(trial) if !stalled => {
                    let change = &trial.seen - &at.seen - &jacobian * &step;
                    broyden(&mut jacobian, &change, &step);
                    let gain = at.misfit() - trial.misfit();
                    if gain > 0.0 {
                        (at, damping) = (trial, 1.0);
                    } else {
                        damping *= 0.4;
                    }
                    stalled = gain.abs() < ENOUGH || damping < LEAST_DAMPING;
                }
                _ => damping *= 0.4,
            }
            if stalled {
                if fresh {
                    break;
                }
                let Some(derivatives) = self.derivatives(&at, place) else { break };
                (jacobian, fresh, damping) = (derivatives, true, 1.0);
            }
            let Some(step) = least_squares(&jacobian, &at.seen) else { break };
            let mut step: DVector<f64> = damping * step;
            let limit = step.rows(0, 2).amax() / STRIDE;
            if limit > 1.0 {
                step.rows_mut(0, 2).scale_mut(1.0 / limit);
            }
            next = &at.unknowns + step;
            if let Some(k) = place {
                let [least, greatest] = signatures[k].effect.amplitude.range;
                next[2] = next[2].clamp(least, greatest);
            }
        }
        let out = place.and_then(|k| {
            let step = least_squares(&jacobian, &at.seen)?[2] / deviation(&jacobian);
            Some(beyond(signatures[k].effect.amplitude.range, at.unknowns[2], step))
        });
        let best = Fitted {
            beyond: out.unwrap_or(0.0),
            misfit: at.misfit(),
            moduli: at.fit.moduli,
            amplitude: if effect.is_some() { at.unknowns[2] } else { 0.0 },
            amplitude_sd: if effect.is_some() { deviation(&jacobian) } else { f64::NAN },
            residual: at.all,
        };
        (best, at.fit)
    }

    /// Where a fit stands with these unknowns; `place` is that of the effect's signature.
    fn at(&self, unknowns: DVector<f64>, fit: Fit, place: Option<usize>) -> At {
        let all = self.evidence.residual_of(&fit, place.map(|k| (k, unknowns[2])));
        At { unknowns, fit, seen: self.whitened(&all), all }
    }

    /// Derivatives of the whitened residuals by differences; `None` where the model does not stand.
    fn derivatives(&self, at: &At, place: Option<usize>) -> Option<DMatrix<f64>> {
        let column = |n: usize| {
            let amplitude = place.filter(|_| n == 2).map(|k| self.effect(k).amplitude);
            let step = match amplitude {
                None => SMALL_MODULUS,
                Some(Amplitude { small, range: [_, greatest], .. }) => {
                    if at.unknowns[2] + small > greatest { -small } else { small }
                }
            };
            let mut there = at.unknowns.clone();
            there[n] += step;
            let fit = self.evaluate(&there, place, &at.fit).ok()?;
            Some((self.at(there, fit, place).seen - &at.seen) / step)
        };
        let columns: Option<Vec<DVector<f64>>> =
            (0..at.unknowns.len()).into_par_iter().map(column).collect();
        columns.map(|columns| DMatrix::from_columns(&columns))
    }

    fn effect(&self, place: usize) -> &'static Effect {
        self.evidence.signatures[place].effect
    }

    fn whitened(&self, all: &DVector<f64>) -> DVector<f64> {
        self.whitener.whiten(&observe::part(all, self.seen, self.evidence.nodes()))
    }

    fn evaluate(
        &self,
        at: &DVector<f64>,
        place: Option<usize>,
        near: &Fit,
    ) -> Result<Fit, Failure> {
        let moduli = Moduli {
            right_kpa: self.start.moduli.right_kpa * at[0].exp(),
            left_kpa: self.start.moduli.left_kpa * at[1].exp(),
        };
        let plan = match place {
            Some(k) => with_effect(self.plan, self.effect(k), at[2]),
            None => self.plan.clone(),
        };
        let body = Body { plan: &plan, ..self.experiment.body.clone() };
        self.experiment.evaluate_as(&body, moduli, Some(near), &Silent, "")
    }
}

impl At {
    fn misfit(&self) -> f64 {
        self.seen.norm_squared()
    }
}

/// Broyden's update in units in which each unknown changes the residuals alike: what a step changed beyond
/// what `jacobian` told.
fn broyden(jacobian: &mut DMatrix<f64>, change: &DVector<f64>, step: &DVector<f64>) {
    let weights = DVector::from_iterator(
        jacobian.ncols(),
        jacobian.column_iter().map(|column| column.norm_squared()),
    );
    let along = step.component_mul(&weights);
    let length = step.dot(&along);
    if length > 0.0 {
        jacobian.ger(1.0 / length, change, &along, 1.0);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_update_does_not_depend_on_units() {
        let columns = [[1.0, 0.2, 0.0], [0.3, 2.0, 0.1]];
        let [first, second] = columns.map(|c| DVector::from_row_slice(&c));
        let mut plain = DMatrix::from_columns(&[first.clone(), second.clone()]);
        // The second unknown in thousandths.
        let mut scaled = DMatrix::from_columns(&[first, &second / 1000.0]);
        let change = DVector::from_row_slice(&[0.1, -0.3, 0.5]);
        let step = DVector::from_row_slice(&[0.4, 0.7]);
        let before = &plain * &step;
        broyden(&mut plain, &change, &step);
        broyden(&mut scaled, &change, &DVector::from_row_slice(&[0.4, 700.0]));
        assert!((&plain * &step - before - &change).norm() < 1e-12);
        assert!((scaled.column(1) * 1000.0 - plain.column(1)).norm() < 1e-9);
        assert!((scaled.column(0) - plain.column(0)).norm() < 1e-12);
    }
}
