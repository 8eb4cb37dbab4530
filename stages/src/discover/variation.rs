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
    observe::{carried, part, residual},
    refit::{plausible, with_effect},
    signature::{Projector, Signature, farthest},
};
use crate::{
    calibrate::{Experiment, Fit},
    effects::{Amplitude, Effect},
    mesh::BreastMesh,
    model::{Body, Moduli},
    place::Finder,
    pose::PoseFit,
    shape::Shape,
};
use mammotwin_data::{Failure, Vec3, solution::Solution, study::ModelPlan};
use mammotwin_solver::mesh::locate::Location;
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
    /// The model of `near`, on the mesh `of`, on another mesh, or `None` where it fails on it: such a mesh tells nothing.
    pub fn new(
        mesh: &'a BreastMesh,
        experiment: Experiment<'a>,
        (of, near): (&BreastMesh, &Fit),
        reference: &Shape,
    ) -> Result<Option<Self>, Failure> {
        let guess = carried_over(of, near, mesh);
        let Ok(base) = experiment.evaluate_as(&experiment.body, near.moduli, guess.as_ref()) else {
            return Ok(None);
        };
        let residual = carried(reference, mesh, &base)?;
        Ok(Some(Self { mesh, experiment, base, residual }))
    }

    fn change(&self, plan: &ModelPlan, moduli: Moduli, reference: &Shape) -> Option<DVector<f64>> {
        let body = Body { plan, ..self.experiment.body.clone() };
        let fit = self.experiment.evaluate_as(&body, moduli, Some(&self.base)).ok()?;
        Some(carried(reference, self.mesh, &fit).ok()? - &self.residual)
    }
}

/// Where the nodes of another mesh are when they move as those of a fit do: from there its equilibria are two or three steps
/// of Newton's method away. `None` for a mesh that has no surface.
fn carried_over(mesh: &BreastMesh, fit: &Fit, to: &BreastMesh) -> Option<Fit> {
    let (here, there) = (&mesh.mesh, &to.mesh);
    let finder = Finder::new(here, &here.points);
    let find = |p: &Vec3| finder.find(p).map(|(location, _)| location);
    let places: Vec<Location> = there.points.par_iter().map(find).collect::<Option<_>>()?;
    let carried = |nodes: &[Vec3]| -> Vec<Vec3> {
        let moved = |(p, place): (&Vec3, &Location)| {
            let [from, to] =
                [&here.points, nodes].map(|nodes| place.interpolate(&here.tets, nodes));
            p + to - from
        };
        there.points.iter().zip(&places).map(moved).collect()
    };
    let pose = |pose: &PoseFit| PoseFit {
        solution: Solution { points: carried(&pose.solution.points), ..Solution::default() },
        active: Vec::new(),
        signed_mm: Vec::new(),
        ..pose.clone()
    };
    Some(Fit {
        rest: carried(&fit.rest),
        poses: fit.poses.iter().map(pose).collect(),
        ..fit.clone()
    })
}

/// One change (mm) on several meshes; `None` where the model does not stand.
struct Meshes {
    own: DVector<f64>,
    there: Vec<Option<DVector<f64>>>,
}

impl Meshes {
    /// This change and another one, both as means over the meshes on which the model stands with both, since the difference of
    /// two means over other meshes would be theirs; `None` where it stands with both on the own mesh alone.
    fn with(&self, other: &Self) -> Option<(Change, Change)> {
        let both: Vec<(&DVector<f64>, &DVector<f64>)> = self
            .there
            .iter()
            .zip(&other.there)
            .filter_map(|(a, b)| a.as_ref().zip(b.as_ref()))
            .collect();
        let change = |own: &DVector<f64>, there: Vec<&DVector<f64>>| {
            let all: Vec<DVector<f64>> = there.into_iter().chain([own]).cloned().collect();
            let mean = mean(&all);
            Change { off: own - &mean, mean }
        };
        let (ours, theirs) = both.into_iter().unzip::<_, _, Vec<_>, Vec<_>>();
        (!ours.is_empty()).then(|| (change(&self.own, ours), change(&other.own, theirs)))
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
    /// Places of the poses that the search sees: moduli settle by these.
    pub seen: &'a [usize],
    /// These nodes in the reference pose.
    pub reference: &'a Shape,
    /// Its residuals (mm).
    pub here: &'a DVector<f64>,
    /// On other meshes.
    pub others: &'a [Standing<'a>],
}

impl Variation<'_> {
    fn moduli(&self, [right, left]: [f64; 2]) -> Moduli {
        self.base.moduli.times(right.exp(), left.exp())
    }

    /// Change (mm) on the model's own mesh, the logarithms of its moduli changed by `logs`.
    fn own(&self, plan: &ModelPlan, logs: [f64; 2]) -> Result<DVector<f64>, Failure> {
        let body = Body { plan, ..self.experiment.body.clone() };
        let moduli = self.moduli(logs);
        let fit = self.experiment.evaluate_as(&body, moduli, Some(self.base))?;
        Ok(residual(&fit, self.weighed) - self.here)
    }

    /// Residuals of the seen poses among those of all.
    pub fn seen(&self, all: &DVector<f64>) -> DVector<f64> {
        part(all, self.seen, self.reference.points.len())
    }

    /// The change (mm) on the own mesh that is given, and those on others.
    fn everywhere(&self, own: DVector<f64>, plan: &ModelPlan, logs: [f64; 2]) -> Meshes {
        let moduli = self.moduli(logs);
        let compared = &self.others[..COMPARED.min(self.others.len())];
        let there =
            compared.par_iter().map(|other| other.change(plan, moduli, self.reference)).collect();
        Meshes { own, there }
    }

    /// What a modulus changes, by its logarithm: right (0), left (1).
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the model does not stand with moduli a little or half as high again.
    pub fn by_modulus(&self, side: usize) -> Result<Course, Failure> {
        let of = |part: f64| {
            let logs = [0, 1].map(|s| if s == side { part } else { 0.0 });
            Ok::<_, Failure>(self.everywhere(self.own(self.plan, logs)?, self.plan, logs))
        };
        let (small, large) = (of(SMALL_MODULUS)?, of(LARGE_MODULUS)?);
        let (small, large) = small.with(&large).ok_or_else(|| {
            Failure::Numerics("discover: other meshes fail with other moduli".into())
        })?;
        Ok(Course::through((SMALL_MODULUS, &small), Some((LARGE_MODULUS, &large))))
    }

    /// What an effect changes; `None` where the model does not stand with a little of it. `moduli` are what
    /// they change by their logarithms.
    pub fn signature(
        &self,
        effect: &'static Effect,
        projector: &Projector,
        moduli: &[Course; 2],
    ) -> Option<Signature> {
        let Amplitude { small, .. } = effect.amplitude;
        let [least, greatest] = plausible(self.plan, effect);
        // Less of it, where the study has nearly as much as is plausible.
        let end = farthest([least, greatest]);
        let (sign, farthest) = (end.signum(), end.abs());
        let small = sign * small;
        let plan = |amplitude: f64| with_effect(self.plan, effect, amplitude);
        let own = |amplitude: f64, logs| self.own(&plan(amplitude), logs).ok();
        let little = own(small, [0.0; 2])?;
        let size = projector.surviving(&self.seen(&little)).0.norm() / small.abs();
        // Where the effect hardly shows, a small change of the own mesh is all there is.
        let shows = size * farthest > LARGE.sqrt();
        let here_alone = |own| Signature::small(effect, [least, greatest], small, own);
        if !shows {
            return Some(here_alone(little));
        }
        let little = self.everywhere(little, &plan(small), [0.0; 2]);
        let reach = (LARGE / size).min(farthest);
        // Nor where the model does not stand with much of it.
        let first = [1.0, 0.5, 0.25]
            .into_iter()
            .map(|part| part * sign * reach)
            .filter(|amplitude| amplitude.abs() > 2.0 * small.abs())
            .find_map(|amplitude| Some((amplitude, own(amplitude, [0.0; 2])?)));
        let large = first.and_then(|(amplitude, much)| {
            let (at, found) = self.settled(effect, amplitude, much, projector);
            let much = self.everywhere(found, &plan(amplitude), at);
            let (little, much) = little.with(&much)?;
            Some((little, (amplitude, much.without(moduli, at))))
        });
        let range = [least, greatest];
        Some(match large {
            Some((little, (amplitude, much))) => {
                Signature::new(effect, range, (small, &little), Some((amplitude, &much)))
            }
            None => match little.with(&little) {
                Some((little, _)) => Signature::new(effect, range, (small, &little), None),
                None => here_alone(little.own),
            },
        })
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
            let step = projector.fitted(&self.seen(&found));
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

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    #[test]
    fn a_mesh_that_fails_once_is_in_neither_mean() {
        let of = |value: f64| DVector::from_element(1, value);
        let small = Meshes { own: of(1.0), there: vec![Some(of(3.0)), Some(of(20.0))] };
        let large = Meshes { own: of(10.0), there: vec![Some(of(30.0)), None] };
        let (a, b) = small.with(&large).unwrap();
        assert_eq!((a.mean[0], a.off[0], b.mean[0], b.off[0]), (2.0, -1.0, 20.0, -10.0));
        let nowhere = Meshes { own: of(1.0), there: vec![None, Some(of(4.0))] };
        assert!(large.with(&nowhere).is_none());
    }
}
