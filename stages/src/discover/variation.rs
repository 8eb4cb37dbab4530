//! The calibrated model with other moduli and effects, on its own mesh and on others.
//!
//! What a mesh does to the change by an effect is as large as small effects are, and as rough as the
//! errors of a segmentation: a signature of one mesh is up to half its own noise, and finds but a part of
//! an effect. On a mesh of 0.64 times the edges, signatures of one mesh found 0.73 - 1.07 of large effects
//! and 0.37 - 1.07 of small ones, the mean of three 0.85 - 1.05 and 0.79 - 1.04, of five finer ones 0.90 - 1.04
//! and 0.86 - 1.03 (`tiny`, seed 3, five effects).

use super::{
    budget::mean,
    course::{Change, Course},
    observe::{carried, residual},
    refit::with_effect,
    signature::{Projector, Signature},
};
use crate::{
    calibrate::{Experiment, Fit},
    effects::{Amplitude, Effect},
    mesh::BreastMesh,
    model::{Body, Moduli},
    shape::Shape,
};
use mammotwin_data::{Failure, progress::Silent, study::ModelPlan};
use nalgebra::DVector;
use rayon::prelude::*;

/// Other meshes on which changes are computed.
const COMPARED: usize = 2;
/// A large amplitude would change residuals by so many standard deviations, if it did so in proportion.
const LARGE: f64 = 20.0;
/// Most that the logarithm of a modulus may go with it, steps in which it is sought, and how near to
/// where a calibration puts it is near enough.
const FAR: f64 = 0.7;
const SETTLING_STEPS: usize = 3;
const SETTLED: f64 = 0.03;
/// Largest part of the last step that the next one may have.
const SLOWEST: f64 = 0.7;
/// Changes of the logarithm of a modulus, for its first and second derivative.
pub(super) const SMALL_MODULUS: f64 = 0.05;
const LARGE_MODULUS: f64 = 0.4;

/// The calibrated model on one mesh.
pub(super) struct Standing<'a> {
    mesh: &'a BreastMesh,
    experiment: Experiment<'a>,
    base: Fit,
    /// Residuals (mm) at the weighed nodes of the model's own mesh.
    pub residual: DVector<f64>,
}

impl<'a> Standing<'a> {
    /// The model on another mesh, or `None` where it fails on it: such a mesh tells nothing.
    pub fn new(
        mesh: &'a BreastMesh,
        experiment: Experiment<'a>,
        moduli: Moduli,
        reference: &Shape,
    ) -> Result<Option<Self>, Failure> {
        let Ok(base) = experiment.evaluate(moduli, None, &Silent, "") else { return Ok(None) };
        let residual = carried(reference, mesh, &base)?;
        Ok(Some(Self { mesh, experiment, base, residual }))
    }

    fn change(&self, plan: &ModelPlan, moduli: Moduli, reference: &Shape) -> Option<DVector<f64>> {
        let body = Body { plan, ..self.experiment.body.clone() };
        let fit = self.experiment.evaluate_as(&body, moduli, Some(&self.base), &Silent, "").ok()?;
        Some(carried(reference, self.mesh, &fit).ok()? - &self.residual)
    }
}

/// The calibrated model, to be varied.
pub(super) struct Variation<'a> {
    /// On its own mesh.
    pub experiment: &'a Experiment<'a>,
    /// Tissues, supports and the effects that are on already.
    pub plan: &'a ModelPlan,
    /// Its evaluation, with calibrated moduli.
    pub base: &'a Fit,
    /// Places of the weighed nodes among those that a fit compares.
    pub weighed: &'a [u32],
    /// These nodes in the reference pose.
    pub reference: &'a Shape,
    /// Its residuals (mm).
    pub here: &'a DVector<f64>,
    /// On other meshes.
    pub others: &'a [Standing<'a>],
}

impl Variation<'_> {
    fn moduli(&self, [right, left]: [f64; 2]) -> Moduli {
        let Moduli { right_kpa, left_kpa } = self.base.moduli;
        Moduli { right_kpa: right_kpa * right.exp(), left_kpa: left_kpa * left.exp() }
    }

    /// Change (mm) on the model's own mesh, the logarithms of its moduli changed by `logs`.
    fn own(&self, plan: &ModelPlan, logs: [f64; 2]) -> Result<DVector<f64>, Failure> {
        let body = Body { plan, ..self.experiment.body.clone() };
        let moduli = self.moduli(logs);
        let fit = self.experiment.evaluate_as(&body, moduli, Some(self.base), &Silent, "")?;
        Ok(residual(&fit, self.weighed) - self.here)
    }

    /// The mean over the own mesh (with the change `own`, mm) and others, and what the own one is off;
    /// `None` where the model stands on no other.
    fn compared(&self, own: &DVector<f64>, plan: &ModelPlan, logs: [f64; 2]) -> Option<Change> {
        let moduli = self.moduli(logs);
        let compared = &self.others[..COMPARED.min(self.others.len())];
        let there: Vec<Option<DVector<f64>>> =
            compared.par_iter().map(|other| other.change(plan, moduli, self.reference)).collect();
        let mut all: Vec<DVector<f64>> = there.into_iter().flatten().collect();
        if all.is_empty() {
            return None;
        }
        all.push(own.clone());
        let mean = mean(&all);
        Some(Change { off: own - &mean, mean })
    }

    /// What a modulus changes, by its logarithm: right (0), left (1).
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the model does not stand with moduli a little or half as high again.
    pub fn by_modulus(&self, side: usize) -> Result<Course, Failure> {
        let of = |part: f64| {
            let logs = [0, 1].map(|s| if s == side { part } else { 0.0 });
            let own = self.own(self.plan, logs)?;
            let change = self.compared(&own, self.plan, logs);
            change.map(|change| (part, change)).ok_or_else(|| {
                Failure::Numerics("discover: other meshes fail with other moduli".into())
            })
        };
        let (small, large) = (of(SMALL_MODULUS)?, of(LARGE_MODULUS)?);
        Ok(Course::through((small.0, &small.1), Some((large.0, &large.1))))
    }

    /// What an effect changes; `None` where the model does not stand with a little of it. `moduli` are what
    /// they change by their logarithms.
    pub fn signature(
        &self,
        effect: &'static Effect,
        projector: &Projector,
        moduli: &[Course; 2],
    ) -> Option<Signature> {
        let Amplitude { small, range: [least, greatest], .. } = effect.amplitude;
        let plan = |amplitude: f64| with_effect(self.plan, effect, amplitude);
        let own = |amplitude: f64, logs| self.own(&plan(amplitude), logs).ok();
        let little = own(small, [0.0; 2])?;
        let size = projector.surviving(&little).0.norm() / small;
        let farthest = f64::max(-least, greatest);
        // Where the effect hardly shows, a small change of the own mesh is all there is.
        let shows = size * farthest > LARGE.sqrt();
        let compared = shows.then(|| self.compared(&little, &plan(small), [0.0; 2])).flatten();
        let Some(small_change) = compared else {
            return Some(Signature::small(effect, small, little));
        };
        let reach = (LARGE / size).clamp(small, farthest);
        // Nor where the model does not stand with much of it.
        let first = [1.0, 0.5, 0.25]
            .into_iter()
            .map(|part| part * reach)
            .filter(|amplitude| *amplitude > 2.0 * small)
            .find_map(|amplitude| Some((amplitude, own(amplitude, [0.0; 2])?)));
        let large = first.and_then(|(amplitude, much)| {
            let (at, found) = self.settled(effect, amplitude, much, projector);
            let change = self.compared(&found, &plan(amplitude), at)?;
            Some((amplitude, change.without(moduli, at)))
        });
        let large = large.as_ref().map(|(amplitude, change)| (*amplitude, change));
        Some(Signature::new(effect, (small, &small_change), large))
    }

    /// Where a calibration puts the logarithms of the moduli, and the change (mm) on the own mesh: it takes
    /// its part of a large change, and not in proportion. `kept` is the change with moduli that stay.
    fn settled(
        &self,
        effect: &Effect,
        amplitude: f64,
        kept: DVector<f64>,
        projector: &Projector,
    ) -> ([f64; 2], DVector<f64>) {
        let plan = with_effect(self.plan, effect, amplitude);
        let mut at = [0.0; 2];
        let mut found = kept;
        let mut last: Option<[f64; 2]> = None;
        for _ in 0..SETTLING_STEPS {
            let step = projector.fitted(&found);
            if step.iter().all(|part| part.abs() < SETTLED) {
                break;
            }
            // With the effect a modulus does less than without: steps fall short alike.
            let product = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
            let ratio = last.map_or(0.0, |last| product(step, last) / product(last, last));
            let longer = 1.0 / (1.0 - ratio.clamp(0.0, SLOWEST));
            let next = [0, 1].map(|side| (at[side] + longer * step[side]).clamp(-FAR, FAR));
            if next == at {
                break;
            }
            let Ok(there) = self.own(&plan, next) else { break };
            (at, found, last) = (next, there, Some(step));
        }
        tracing::debug!(effect.name, amplitude, ?at, "moduli with the effect");
        (at, found)
    }
}
