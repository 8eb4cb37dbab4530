//! Stress-free shape and breast moduli from the reference pose and the poses to be fitted.

mod experiment;
mod secant;

pub use experiment::{Experiment, Measured};

use crate::{
    mesh::BreastMesh, model::Moduli, pose::PoseFit, register::Registered, surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::Side,
    progress::{Part, Progress},
    store::{Artifact, Stage},
    study::{CalibratePlan, ModelPlan},
};
use secant::Secant;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Study keys of the moduli that can be fitted.
pub const FITTED: [&str; 2] = ["breast.young_right_kpa", "breast.young_left_kpa"];
/// Moduli between which the search stays (kPa).
const BOUNDS_KPA: [f64; 2] = [0.05, 20.0];
/// The search ends when the weighted mean residual is smaller (mm) ...
const CLOSE_MM: f64 = 0.1;
/// ... or after so many trials.
const MAX_TRIALS: usize = 7;
/// A search that leaves more (mm) than this did not come to its end.
const FAR_MM: f64 = 10.0 * CLOSE_MM;

/// Finds the stress-free shape and, where poses are given, the moduli of both breasts.
#[derive(Debug, Clone, Serialize)]
pub struct Calibrate {
    /// Tissues and supports; its breast moduli are where the search begins.
    pub model: ModelPlan,
    /// What is fitted.
    pub plan: CalibratePlan,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Name of the reference pose.
    pub reference: String,
    /// Names of the other poses to be fitted, in the order of the inputs.
    pub poses: Vec<String>,
}

/// One evaluation of the search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Moduli of the trial.
    pub moduli: Moduli,
    /// Weighted mean signed distance of the right skin (mm); positive: sags too far.
    pub residual_right_mm: f64,
    /// The same on the left.
    pub residual_left_mm: f64,
    /// Largest modified Hausdorff distance (mm) over the fitted poses.
    pub modified_hausdorff_mm: f64,
}

/// How well the stress-free shape, loaded again, takes the reference pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RoundTrip {
    /// Root mean square distance (mm) of the nodes.
    pub rms_mm: f64,
    /// Largest distance (mm) of a node.
    pub max_mm: f64,
    /// How far (mm) sliding nodes of the mesh had to be moved onto the chest wall beforehand.
    pub off_wall_mm: f64,
}

/// A stress-free shape, and how well it reaches the fitted poses.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Moduli of the breasts.
    pub moduli: Moduli,
    /// How well it takes the reference pose.
    pub round_trip: RoundTrip,
    /// Stress-free node positions (mm), in the reference pose's frame.
    pub rest: Vec<Vec3>,
    /// The reference pose, loaded again from the stress-free shape, then the fitted poses.
    pub poses: Vec<PoseFit>,
}

/// What the calibration found.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// With the moduli of the study.
    pub before: Fit,
    /// With the fitted moduli.
    pub after: Fit,
    /// All evaluations, the study's moduli first.
    pub trials: Vec<Trial>,
}

impl Calibration {
    /// What the search left of the sag (mm) when it did not come to its end: the moduli are the best of
    /// those that were tried, but they are not fitted. `None` when it did, or nothing was searched.
    pub fn unmet_mm(&self) -> Option<f64> {
        let taken = self.trials.iter().find(|trial| trial.moduli == self.after.moduli)?;
        let left = taken.residual_right_mm.abs().max(taken.residual_left_mm.abs());
        (self.trials.len() > 1 && left > FAR_MM).then_some(left)
    }
}

impl Artifact for Calibration {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Ras)?;
        file.put_json("trials", &self.trials, "evaluations of the search")?;
        for (group, fit) in [("before", &self.before), ("after", &self.after)] {
            file.put_json(
                &format!("{group}/moduli"),
                &fit.moduli,
                "Young's moduli of the breasts",
            )?;
            file.put_json(
                &format!("{group}/round_trip"),
                &fit.round_trip,
                "reference pose, loaded again (mm)",
            )?;
            file.put(&format!("{group}/rest"), &fit.rest, "mm", "stress-free node positions")?;
            let names: Vec<String> = fit.poses.iter().map(|p| p.pose.clone()).collect();
            file.put_texts(&format!("{group}/poses"), &names, "poses, the reference first")?;
            for pose in &fit.poses {
                pose.put(&mut file, &format!("{group}/fits/{}", pose.pose))?;
            }
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let fit = |group: &str| -> Result<Fit, Failure> {
            let mut poses = Vec::new();
            for name in file.texts(&format!("{group}/poses"))? {
                poses.push(PoseFit::get(&file, &format!("{group}/fits/{name}"), &name)?);
            }
            let moduli = file.json(&format!("{group}/moduli"))?;
            let round_trip = file.json(&format!("{group}/round_trip"))?;
            Ok(Fit { moduli, round_trip, rest: file.get(&format!("{group}/rest"))?, poses })
        };
        Ok(Self { before: fit("before")?, after: fit("after")?, trials: file.json("trials")? })
    }
}

/// Mesh, surfaces of the reference pose, and for each other pose its motion and its surfaces.
type Input = (BreastMesh, PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>);

impl Stage for Calibrate {
    const NAME: &'static str = "calibrate";
    const VERSION: u32 = 5;
    const METHODS: &'static str = "The stress-free shape is the shape that gravity deforms into the reference pose; it \
         was found as the inverse motion (Govindjee & Mihalic, Comput. Methods Appl. Mech. Eng. 136 \
         (1996) 47), or by an accelerated fixed point (Sellier, Comput. Mech. 48 (2011) 503) where the \
         study asks for it. The Young's \
         modulus of each breast was found by a secant search on the gravity-weighted signed distance \
         of its skin to the fitted pose.";
    type Input = Input;
    type Output = Calibration;

    fn run(&self, input: &Input, progress: &dyn Progress) -> Result<Calibration, Failure> {
        let (mesh, reference, registered, surfaces) = input;
        let names = self.poses.iter().map(String::as_str);
        let measured = Measured {
            reference: &self.reference,
            gravity: self.gravity,
            surfaces: reference,
            others: names.zip(registered).zip(surfaces).map(|((n, m), s)| (n, m, s)).collect(),
        };
        let search = Search(Experiment::new(mesh, &self.model, &self.plan, &measured)?);
        let fitted: Vec<Side> = [Side::Right, Side::Left]
            .into_iter()
            .zip(FITTED)
            .filter(|(_, key)| self.plan.parameters.iter().any(|p| p == key))
            .map(|(side, _)| side)
            .collect();
        let rounds = if fitted.is_empty() || self.poses.is_empty() { 1 } else { MAX_TRIALS };
        search.run(Moduli::of(&self.model), &fitted, rounds, progress)
    }
}

/// The search for the moduli.
struct Search<'a>(Experiment<'a>);

impl Search<'_> {
    fn run(
        &self,
        start: Moduli,
        fitted: &[Side],
        rounds: usize,
        progress: &dyn Progress,
    ) -> Result<Calibration, Failure> {
        let mut trials: Vec<Trial> = Vec::new();
        let mut secants =
            [Side::Right, Side::Left].map(|_| Secant::within(BOUNDS_KPA[0], BOUNDS_KPA[1]));
        let mut moduli = start;
        let mut before: Option<Fit> = None;
        let mut best: Option<(f64, Fit)> = None;
        let mut failed: Option<(Moduli, String)> = None;
        for round in 0..rounds {
            let doing = format!(
                "trial {}: {:.3} / {:.3} kPa",
                round + 1,
                moduli.right_kpa,
                moduli.left_kpa
            );
            let from = round as f64 / rounds as f64;
            let part = Part { whole: progress, from, to: (round + 1) as f64 / rounds as f64 };
            part.report(0.0, &doing);
            let near = best.as_ref().map(|(_, fit)| fit);
            let fit = match self.0.evaluate(moduli, near, &part, &doing) {
                Ok(fit) => fit,
                // Too soft to stand: go half way back to the last moduli that stood.
                Err(Failure::Numerics(why)) if !trials.is_empty() => {
                    failed = Some((moduli, why));
                    let last = trials[trials.len() - 1].moduli;
                    let back = |now: f64, then: f64| (now * then).sqrt();
                    moduli = Moduli {
                        right_kpa: back(moduli.right_kpa, last.right_kpa),
                        left_kpa: back(moduli.left_kpa, last.left_kpa),
                    };
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let residual = |side: Side| self.residual(&fit, side);
            let trial = Trial {
                moduli,
                residual_right_mm: residual(Side::Right),
                residual_left_mm: residual(Side::Left),
                modified_hausdorff_mm: fit.poses[1..]
                    .iter()
                    .map(|p| p.distances.modified_hausdorff)
                    .fold(0.0, f64::max),
            };
            trials.push(trial);
            let mut worst = 0.0f64;
            for &side in fitted {
                let secant = &mut secants[side as usize];
                let (young, off) = match side {
                    Side::Right => (&mut moduli.right_kpa, trial.residual_right_mm),
                    Side::Left => (&mut moduli.left_kpa, trial.residual_left_mm),
                };
                secant.note(*young, off);
                worst = worst.max(off.abs());
                if off.abs() > CLOSE_MM {
                    *young = secant.next().unwrap_or(*young);
                }
            }
            if before.is_none() {
                before = Some(fit.clone());
            }
            if best.as_ref().is_none_or(|(least, _)| worst < *least) {
                best = Some((worst, fit));
            }
            if worst <= CLOSE_MM {
                break;
            }
        }
        // Moduli that no other could be compared with are not fitted.
        if let (1, Some((moduli, why))) = (trials.len(), failed) {
            return Err(Failure::Numerics(format!(
                "calibrate: nothing but the study's moduli stands; the last that was tried, {:.3} and \
                 {:.3} kPa, has no solution ({why}); begin with others, or keep the study's: \
                 calibrate.parameters = []",
                moduli.right_kpa, moduli.left_kpa
            )));
        }
        let (Some(before), Some((_, after))) = (before, best) else {
            return Err(Failure::Numerics("calibrate: no trial was evaluated".into()));
        };
        Ok(Calibration { before, after, trials })
    }

    /// Mean over the fitted poses of the residual of one side (mm).
    fn residual(&self, fit: &Fit, side: Side) -> f64 {
        let others = self.0.targets.iter().zip(&fit.poses).skip(1);
        let residuals: Vec<f64> = others.map(|(t, p)| t.sag_residual_mm(p, side)).collect();
        residuals.iter().sum::<f64>() / residuals.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_that_did_not_end_is_told_from_one_that_did() {
        let trial = |young: f64, residual_left_mm: f64| Trial {
            moduli: Moduli { right_kpa: 0.5, left_kpa: young },
            residual_right_mm: 0.05,
            residual_left_mm,
            modified_hausdorff_mm: 5.0,
        };
        let fit = |young: f64| Fit {
            moduli: Moduli { right_kpa: 0.5, left_kpa: young },
            round_trip: RoundTrip { rms_mm: 0.0, max_mm: 0.0, off_wall_mm: 0.0 },
            rest: Vec::new(),
            poses: Vec::new(),
        };
        let found = |trials: &[Trial], taken: f64| Calibration {
            before: fit(0.5),
            after: fit(taken),
            trials: trials.to_vec(),
        };
        assert_eq!(found(&[trial(0.5, 4.9), trial(0.2, 0.05)], 0.2).unmet_mm(), None);
        assert_eq!(found(&[trial(0.5, -4.9), trial(1.0, -5.5)], 0.5).unmet_mm(), Some(4.9));
        // Nothing was searched.
        assert_eq!(found(&[trial(0.5, 4.9)], 0.5).unmet_mm(), None);
    }
}
