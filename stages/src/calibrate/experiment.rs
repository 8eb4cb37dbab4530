//! The model and the poses that it must reach: one evaluation is a stress-free shape and an
//! equilibrium in each pose.

use super::{Fit, RoundTrip, correction::Scheme};
use crate::{
    mesh::BreastMesh,
    model::{Body, Moduli},
    pose::PoseTarget,
    posture,
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    progress::{Progress, Silent},
    study::{CalibratePlan, ModelPlan, StressFree},
};
use mammotwin_solver::{solve, unload};

/// What is evaluated.
pub struct Experiment<'a> {
    /// The body in its reference pose.
    pub body: Body<'a>,
    /// The reference pose, then the others.
    pub targets: Vec<PoseTarget>,
    /// How the stress-free shape is found.
    pub stress_free: StressFree,
}

/// The measured poses beside the model: names, motions to the reference pose, surfaces.
pub struct Measured<'a> {
    /// Name of the reference pose.
    pub reference: &'a str,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Surfaces of the reference pose.
    pub surfaces: &'a PoseSurfaces,
    /// The other poses.
    pub others: Vec<(&'a str, &'a Registered, &'a PoseSurfaces)>,
}

impl<'a> Measured<'a> {
    /// The reference pose (name, gravity, surfaces), and of each other pose its name, motion and surfaces.
    pub fn new(
        (reference, gravity, surfaces): (&'a str, Vec3, &'a PoseSurfaces),
        names: &'a [String],
        motions: &'a [Registered],
        others: &'a [PoseSurfaces],
    ) -> Self {
        let others = names.iter().zip(motions).zip(others).map(|((n, m), s)| (n.as_str(), m, s));
        Self { reference, gravity, surfaces, others: others.collect() }
    }
}

impl<'a> Experiment<'a> {
    /// The experiment of a mesh, a plan and what was measured.
    ///
    /// # Errors
    /// A measured surface that cannot be compared with, or that moved against what is stated of its gravity.
    pub fn new(
        mesh: &'a BreastMesh,
        model: &'a ModelPlan,
        plan: &CalibratePlan,
        measured: &Measured,
    ) -> Result<Self, Failure> {
        let reference = Registered::reference(measured.gravity);
        let first = PoseTarget::new(measured.reference, mesh, &reference, measured.surfaces)?;
        let mut targets = vec![first];
        for (name, motion, surfaces) in &measured.others {
            let target = PoseTarget::new(name, mesh, motion, surfaces)?;
            let shape = target.reference_shape(mesh);
            posture::refuse_wrong(&target, measured.reference, &shape, &measured.gravity)?;
            targets.push(target);
        }
        Ok(Self { body: Body::new(mesh, model), targets, stress_free: plan.stress_free })
    }

    /// The same poses and tissues on another mesh of the body.
    pub fn on<'b>(&self, mesh: &'b BreastMesh) -> Experiment<'b>
    where
        'a: 'b,
    {
        Experiment {
            body: Body::new(mesh, self.body.plan),
            targets: self.targets.iter().map(|target| target.on(mesh)).collect(),
            stress_free: self.stress_free,
        }
    }

    /// Unloads the reference pose with `moduli` and loads the stress-free shape into each pose.
    /// An earlier evaluation that is near makes it faster.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when there is no stress-free shape or no equilibrium.
    pub fn evaluate(
        &self,
        moduli: Moduli,
        near: Option<&Fit>,
        progress: &dyn Progress,
        doing: &str,
    ) -> Result<Fit, Failure> {
        let mut fit = self.loaded(&self.body, moduli, near, progress, doing)?;
        for (target, pose) in self.targets.iter().zip(&mut fit.poses) {
            target.compare(pose)?;
        }
        Ok(fit)
    }

    /// The same of a body with other tissues or nodes, without the distances of the measured skins to its own.
    ///
    /// # Errors
    /// As [`Experiment::evaluate`].
    pub fn evaluate_as(
        &self,
        body: &Body,
        moduli: Moduli,
        near: Option<&Fit>,
    ) -> Result<Fit, Failure> {
        self.loaded(body, moduli, near, &Silent, "")
    }

    fn loaded(
        &self,
        body: &Body,
        moduli: Moduli,
        near: Option<&Fit>,
        progress: &dyn Progress,
        doing: &str,
    ) -> Result<Fit, Failure> {
        let loaded = &body.mesh.points;
        let found = match self.stress_free {
            StressFree::Inverse => self.unloaded(unload::Method::Inverse, body, moduli, near),
            StressFree::FixedPoint => self.unloaded(unload::Method::FixedPoint, body, moduli, near),
            StressFree::PlainFixedPoint => self.unloaded(unload::Method::Plain, body, moduli, near),
            StressFree::PredictionCorrection => Scheme::PUBLISHED.run(self, body, moduli),
            StressFree::DampedPredictionCorrection => Scheme::DAMPED.run(self, body, moduli),
        }?;
        let mut poses = Vec::new();
        for (n, target) in self.targets.iter().enumerate() {
            progress.report(0.6 + 0.4 * n as f64 / self.targets.len() as f64, doing);
            let solution = if n == 0 {
                body.spread(found.loaded.clone())
            } else {
                let near = near.map_or(&[][..], |fit| &fit.poses);
                let same = near.iter().find(|pose| pose.pose == target.pose);
                let start = same.map_or(loaded, |pose| &pose.solution.points);
                // A tissue with a limit of stretch may not stand what another one is stretched to.
                let from = |start: &[Vec3], near: bool| {
                    target.load(body, &found.rest, moduli, start, near)
                };
                from(start, same.is_some())
                    .or_else(|cause| from(&found.rest, false).map_err(|_| cause))?
            };
            poses.push(target.facing(solution)?);
        }
        let round_trip = RoundTrip {
            rms_mm: found.miss.rms_mm,
            max_mm: found.miss.max_mm,
            off_wall_mm: found.off_surface_mm,
        };
        let mut rest = found.rest;
        body.join(&mut rest);
        Ok(Fit { moduli, round_trip, rest, poses })
    }

    /// The stress-free shape from the reference pose alone.
    fn unloaded(
        &self,
        method: unload::Method,
        body: &Body,
        moduli: Moduli,
        near: Option<&Fit>,
    ) -> Result<unload::StressFree, Failure> {
        let loaded = &body.mesh.points;
        let gravity = self.targets[0].gravity;
        let model = |rest: &[Vec3]| body.model(rest, moduli, gravity, None);
        let counted = body.muscle.map_or(usize::MAX, |muscle| muscle.first as usize);
        let options = &unload::Options { method, counted, ..unload::Options::default() };
        let guess = match (near, method) {
            (Some(fit), _) => fit.rest.clone(),
            (None, unload::Method::Inverse) => loaded.clone(),
            // Gravity turned round is the thesis' first guess.
            (None, unload::Method::FixedPoint | unload::Method::Plain) => {
                let lifted = body.model(loaded, moduli, -gravity, None)?;
                let solution = solve(&lifted, loaded, &options.solve, &Silent);
                solution.map_or_else(|_| loaded.clone(), |solution| solution.points)
            }
        };
        unload::stress_free(loaded, &guess, model, options, &Silent)
            .map_err(|cause| Failure::Numerics(format!("stress-free shape: {cause}")))
    }
}
