//! Where simulation and measurement disagree, and which missing effect explains it.
//!
//! Residuals of the simulated poses are weighed with an [error budget](Budget). Each effect of the
//! [library](crate::effects) has a signature, the change of the residuals by a small amplitude;
//! a score test asks whether what survives of it, after the moduli took what they can, is in the
//! data. The best are fitted together with the moduli. A pose that the search never saw decides.

mod budget;
mod observe;
mod refit;
mod screen;
mod verdict;

pub use budget::Budget;
pub use screen::{Score, Screening};
pub use verdict::{Candidate, HeldOut, Verdict, VerdictName};

use crate::{
    calibrate::{Calibration, Experiment, Fit, Measured},
    effects::{EFFECTS, Effect},
    mesh::{BreastMesh, Mesh},
    model::Body,
    register::Registered,
    surface::PoseSurfaces,
};
use budget::Whitener;
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::LabelMap,
    mesh::Patch,
    progress::{Progress, Silent},
    store::{Artifact, Stage},
    study::{CalibratePlan, ModelPlan},
    surface::TriMesh,
};
use nalgebra::DVector;
use observe::Frame;
use rayon::prelude::*;
use refit::{Refit, with_effect};
use serde::Serialize;
use std::path::Path;

/// Edge lengths of the other meshes, over the model's own.
const MESHINGS: [f64; 3] = [0.8, 0.9, 1.15];
/// Change of the logarithm of a modulus, for differences.
const SMALL_MODULUS: f64 = 0.05;
/// Effects that are fitted after the screening.
const FITTED: usize = 3;

/// Looks for a missing effect.
#[derive(Debug, Clone, Serialize)]
pub struct Discover {
    /// Tissues, supports and the effects that are on already.
    pub model: ModelPlan,
    /// How the stress-free shape is found.
    pub calibrate: CalibratePlan,
    /// Edge length (mm) of the model's mesh.
    pub size_mm: f64,
    /// Name of the reference pose.
    pub reference: String,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Names of the other poses, in the order of the inputs.
    pub poses: Vec<String>,
    /// The pose that decides, and that the search does not see.
    pub held_out: String,
}

/// A pose before and after the effect is added.
#[derive(Debug, Clone)]
pub struct PoseGap {
    /// Its name.
    pub pose: String,
    /// Compared nodes of the measured pose's simulation without the effect (mm).
    pub skin: TriMesh,
    /// The compared nodes among those of the mesh.
    pub active: Vec<u32>,
    /// Signed distances (mm) with refitted moduli.
    pub before_mm: Vec<f64>,
    /// The same with the effect that explains most.
    pub after_mm: Vec<f64>,
    /// Root mean squares (mm) after the best rigid motion: before, after, and of the errors.
    pub rms_mm: [f64; 3],
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Discovery {
    /// The answer.
    pub verdict: Verdict,
    /// All tests.
    pub screening: Screening,
    /// The error budget.
    pub budget: Budget,
    /// Before and after, in the order of the poses.
    pub gaps: Vec<PoseGap>,
}

impl Artifact for Discovery {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_json("verdict", &self.verdict, "the answer")?;
        file.put_json("screening", &self.screening, "score of each effect")?;
        file.put_json("budget", &self.budget, "error budget (mm)")?;
        let names: Vec<String> = self.gaps.iter().map(|gap| gap.pose.clone()).collect();
        file.put_texts("poses", &names, "poses that were compared")?;
        for gap in &self.gaps {
            let group = format!("gaps/{}", gap.pose);
            file.put_surface(&format!("{group}/skin"), &gap.skin)?;
            file.put(&format!("{group}/active"), &gap.active, "1", "compared nodes")?;
            let name = format!("{group}/before");
            file.put(&name, &gap.before_mm, "mm", "signed distance without the effect")?;
            let name = format!("{group}/after");
            file.put(&name, &gap.after_mm, "mm", "signed distance with the effect")?;
            let name = format!("{group}/rms");
            file.put(&name, &gap.rms_mm, "mm", "before, after, floor; without rigid motion")?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let mut gaps = Vec::new();
        for pose in file.texts("poses")? {
            let group = format!("gaps/{pose}");
            let rms: Vec<f64> = file.get(&format!("{group}/rms"))?;
            gaps.push(PoseGap {
                skin: file.surface(&format!("{group}/skin"))?,
                active: file.get(&format!("{group}/active"))?,
                before_mm: file.get(&format!("{group}/before"))?,
                after_mm: file.get(&format!("{group}/after"))?,
                rms_mm: std::array::from_fn(|n| rms.get(n).copied().unwrap_or(f64::NAN)),
                pose,
            });
        }
        Ok(Self {
            verdict: file.json("verdict")?,
            screening: file.json("screening")?,
            budget: file.json("budget")?,
            gaps,
        })
    }
}

/// Labels and surfaces of the reference pose, its mesh, the calibration, and for each other pose
/// its motion and its surfaces.
type Input = (LabelMap, PoseSurfaces, BreastMesh, Calibration, Vec<Registered>, Vec<PoseSurfaces>);

impl Stage for Discover {
    const NAME: &'static str = "discover";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Signed distances of the simulated to the measured skin were weighed with the covariance \
         of the errors of segmentation, registration, chest wall and mesh. A score test asked for \
         each effect of a library whether what the moduli do not absorb of its signature is in \
         the distances; the threshold is the 99 % quantile of the largest score. The best effects \
         were fitted together with the moduli, and judged on a pose that the search did not see.";
    type Input = Input;
    type Output = Discovery;

    fn run(&self, input: &Input, progress: &dyn Progress) -> Result<Discovery, Failure> {
        let (labels, reference, mesh, calibration, registered, surfaces) = input;
        let names = self.poses.iter().map(String::as_str);
        let measured = Measured {
            reference: &self.reference,
            gravity: self.gravity,
            surfaces: reference,
            others: names.zip(registered).zip(surfaces).map(|((n, m), s)| (n, m, s)).collect(),
        };
        let experiment = Experiment::new(mesh, &self.model, &self.calibrate, &measured)?;
        let held_out = self.poses.iter().position(|pose| *pose == self.held_out);
        let seen: Vec<usize> = (0..self.poses.len()).filter(|p| Some(*p) != held_out).collect();
        let (Some(held_out), false) = (held_out, seen.is_empty()) else {
            return Err(Failure::BadInput(format!(
                "discover: needs the held-out pose {} and at least one more beside the reference \
                 pose",
                self.held_out
            )));
        };

        progress.report(0.0, "calibrated model");
        let base =
            experiment.evaluate(calibration.after.moduli, Some(&calibration.after), &Silent, "")?;
        let frame = Frame::new(mesh, &base)?;
        let observed = frame.observe(&base);

        let mut meshings = Vec::new();
        for (n, part) in MESHINGS.into_iter().enumerate() {
            progress.report(0.05 + 0.1 * n as f64, "the same model on other meshes");
            let other = Mesh { size_mm: part * self.size_mm }.run(labels, &Silent)?;
            let faces = other.mesh.patch(Patch::Skin).to_vec();
            let experiment = Experiment::new(&other, &self.model, &self.calibrate, &measured)?;
            // A mesh on which the model fails tells nothing.
            if let Ok(fit) = experiment.evaluate(base.moduli, None, &Silent, "") {
                meshings.push(observed.differences(&fit.poses[1..], &faces)?);
            }
        }
        let budget = Budget::of(&frame, &observed);
        let covariance = budget.covariance(&frame, &observed, &meshings);
        let nodes = frame.reference.len();
        let whiten = |poses: &[usize]| {
            Whitener::new(&covariance, poses, nodes)
                .ok_or_else(|| Failure::Numerics("discover: errors without a covariance".into()))
        };
        let whitener = whiten(&seen)?;

        progress.report(0.35, "signatures of the effects");
        let residual = observed.residual(&seen);
        let by_moduli = self.by_moduli(&experiment, &frame, &base, &seen, &residual)?;
        let signatures: Vec<(&'static Effect, DVector<f64>)> = EFFECTS
            .into_par_iter()
            .filter_map(|effect| {
                let small = effect.amplitude.small;
                let plan = with_effect(&self.model, effect, small);
                let body = Body { plan: &plan, ..experiment.body.clone() };
                let fit = experiment.evaluate_as(&body, base.moduli, Some(&base), &Silent, "");
                let moved = frame.observe(&fit.ok()?).residual(&seen);
                Some((effect, (moved - &residual) / small))
            })
            .collect();
        let screening = Screening::new(&whitener, &residual, &by_moduli, &signatures);

        progress.report(0.7, "fits with the likeliest effects");
        let refit = Refit {
            experiment: &experiment,
            frame: &frame,
            whitener: &whitener,
            seen: &seen,
            plan: &self.model,
            start: &base,
            by_moduli: &by_moduli,
        };
        let without = refit.run(None)?;
        let ranked = screening.ranked();
        let likely: Vec<&Score> = ranked.into_iter().filter(|s| s.z > 0.0).take(FITTED).collect();
        let with: Vec<_> = likely
            .into_par_iter()
            .filter_map(|score| {
                let (effect, signature) =
                    signatures.iter().find(|(effect, _)| effect.name == score.effect)?;
                let found = refit.run(Some((effect, score.amplitude, signature))).ok()?;
                Some((*effect, found))
            })
            .collect();

        let judge = verdict::Judge {
            frame: &frame,
            covariance: &covariance,
            screening: &screening,
            seen: &seen,
            held_out,
            held_out_whitener: &whiten(&[held_out])?,
        };
        let (verdict, after) = judge.judge(&without, &with);
        let after = after.unwrap_or(&without.fit);
        Ok(Discovery {
            gaps: self.gaps(&frame, &covariance, &without.fit, after),
            verdict,
            screening,
            budget,
        })
    }
}

impl Discover {
    /// Derivatives (mm) of the seen residuals by the logarithms of the moduli.
    fn by_moduli(
        &self,
        experiment: &Experiment,
        frame: &Frame,
        base: &Fit,
        seen: &[usize],
        residual: &DVector<f64>,
    ) -> Result<Vec<DVector<f64>>, Failure> {
        [[SMALL_MODULUS, 0.0], [0.0, SMALL_MODULUS]]
            .into_par_iter()
            .map(|[right, left]| {
                let mut moduli = base.moduli;
                moduli.right_kpa *= f64::exp(right);
                moduli.left_kpa *= f64::exp(left);
                let fit = experiment.evaluate(moduli, Some(base), &Silent, "")?;
                Ok((frame.observe(&fit).residual(seen) - residual) / SMALL_MODULUS)
            })
            .collect()
    }

    fn gaps(
        &self,
        frame: &Frame,
        covariance: &nalgebra::DMatrix<f64>,
        before: &Fit,
        after: &Fit,
    ) -> Vec<PoseGap> {
        let (before_at, after_at) = (frame.observe(before), frame.observe(after));
        let nodes = frame.reference.len();
        let one = |(p, pose): (usize, &String)| {
            let [b, a] = [&before_at, &after_at].map(|o| (&o.poses[p], o.residual(&[p])));
            let own = covariance.view((p * nodes, p * nodes), (nodes, nodes)).into_owned();
            PoseGap {
                pose: pose.clone(),
                skin: b.0.surface().clone(),
                active: before.poses[p + 1].active.clone(),
                before_mm: b.1.as_slice().to_vec(),
                after_mm: a.1.as_slice().to_vec(),
                rms_mm: [
                    b.0.without_rigid_mm(&b.1),
                    a.0.without_rigid_mm(&a.1),
                    b.0.floor_mm(&own),
                ],
            }
        };
        self.poses.iter().enumerate().map(one).collect()
    }
}
