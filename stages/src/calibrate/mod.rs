//! Stress-free shape and numbers of the tissues from the reference pose and the poses to be fitted.

mod correction;
mod experiment;
mod parameter;
mod precision;
mod search;

pub use experiment::{Experiment, Measured};
pub use parameter::Parameter;
pub use precision::Precision;

use crate::{
    mesh::BreastMesh, model::Moduli, pose::PoseFit, register::Registered, surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    progress::{Part, Progress},
    store::{Artifact, Stage},
    study::{CalibratePlan, ModelPlan},
};
use search::Search;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Finds the stress-free shape and, where poses are given, the numbers of the tissues that are to be fitted.
#[derive(Debug, Clone, Serialize)]
pub struct Calibrate {
    /// Tissues and supports; its numbers are where the search begins.
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
    /// Root mean square distance (mm) of the skin in the fitted poses, after their best rigid motions:
    /// what the search makes least.
    pub misfit_mm: f64,
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

/// Root mean square distance (mm) that is left where the model is right: chest walls that change between poses, and the
/// skin of the labels.
const EXPLAINED_MM: f64 = 1.2;
/// Times that, from which the fitted poses contradict the model or each other: between the worst of 18 fits of digital
/// volunteers, six with a wrong law (1.0), and prone breasts of another person of the same kind (1.9).
const CONTRADICTION: f64 = 1.5;

/// A second search, begun far from the first one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SecondStart {
    /// Where it began.
    pub from: Moduli,
    /// Where it ended; `None` when it found no equilibrium.
    pub end: Option<Moduli>,
    /// Evaluations.
    pub evaluations: usize,
}

/// Moduli of the second start over those of the first.
const SECOND_START: f64 = 3.0;
/// Moduli that differ by less than this part are alike: each search may end a twentieth from its minimum.
const ALIKE: f64 = 0.1;

impl SecondStart {
    /// Whether it ended where the first search did.
    pub fn agrees(&self, with: &Moduli) -> bool {
        let near = |end: &Moduli, parameter: Parameter| {
            let both = parameter.given(end).zip(parameter.given(with));
            both.is_none_or(|(a, b)| (a / b).ln().abs() < ALIKE)
        };
        self.end.is_some_and(|end| Parameter::ALL.iter().all(|&one| near(&end, one)))
    }
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
    /// Whether the search came to its end; otherwise the moduli are the best of those that were tried.
    pub converged: bool,
    /// How well the moduli are known.
    pub precision: Precision,
    /// A second search from elsewhere, where the study asks for it.
    pub second: Option<SecondStart>,
}

impl Calibration {
    /// Whether anything was fitted.
    pub fn fitted(&self) -> bool {
        self.trials.len() > 1
    }

    /// Root mean square distance (mm) that the fit leaves in the fitted poses after their best rigid motions; `None`
    /// without such a pose.
    pub fn misfit_mm(&self) -> Option<f64> {
        let least = self.trials.iter().map(|trial| trial.misfit_mm).fold(f64::INFINITY, f64::min);
        (self.after.poses.len() > 1 && least.is_finite()).then_some(least)
    }

    /// That over what chest walls and labels explain.
    pub fn lack_of_fit(&self) -> Option<f64> {
        Some(self.misfit_mm()? / EXPLAINED_MM)
    }

    /// What to say when the fit leaves far more than can be explained.
    pub fn contradiction(&self) -> Option<String> {
        let (misfit_mm, lack) = self.misfit_mm().zip(self.lack_of_fit())?;
        (self.fitted() && lack > CONTRADICTION).then(|| {
            format!(
                "The fitted poses contradict the model or each other: {misfit_mm:.1} mm (rms) are left, {lack:.1} times what \
                 labels and chest wall explain. A pose may be of another person or posture, or badly registered or \
                 segmented; else the model lacks something large. Do not trust the moduli"
            )
        })
    }
}

impl Artifact for Calibration {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Ras)?;
        file.put_json("trials", &self.trials, "evaluations of the search")?;
        file.put_json("converged", &self.converged, "whether the search came to its end")?;
        file.put_json("precision", &self.precision, "covariance of the logarithms")?;
        if let Some(second) = &self.second {
            file.put_json("second", second, "a second search from elsewhere")?;
        }
        for (group, fit) in [("before", &self.before), ("after", &self.after)] {
            file.put_json(
                &format!("{group}/moduli"),
                &fit.moduli,
                "numbers of the tissues (kPa; Jₘ: 1)",
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
        Ok(Self {
            before: fit("before")?,
            after: fit("after")?,
            trials: file.json("trials")?,
            converged: file.json("converged")?,
            precision: file.json("precision")?,
            second: file.has("second").then(|| file.json("second")).transpose()?,
        })
    }
}

/// Mesh, surfaces of the reference pose, and for each other pose its motion and its surfaces.
type Input = (BreastMesh, PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>);

impl Stage for Calibrate {
    const NAME: &'static str = "calibrate";
    const VERSION: u32 = 11;
    const METHODS: &'static str = "The stress-free shape is the shape that gravity deforms into the reference pose; it \
         was found as the inverse motion (Govindjee & Mihalic, Comput. Methods Appl. Mech. Eng. 136 \
         (1996) 47), or by an accelerated fixed point (Sellier, Comput. Mech. 48 (2011) 503) or by prediction and \
         correction towards another pose (Mîra, thesis, Université Grenoble Alpes 2018) where the study asks for it. The numbers of the tissues that the study fits (Young's moduli of the breasts and others) were \
         found by a Gauss-Newton search on the signed distances of the skin to the fitted poses, whose rigid motions were \
         left open.";
    type Input = Input;
    type Output = Calibration;

    fn run(&self, input: &Input, progress: &dyn Progress) -> Result<Calibration, Failure> {
        let (mesh, reference, registered, surfaces) = input;
        let first = (self.reference.as_str(), self.gravity, reference);
        let measured = Measured::new(first, &self.poses, registered, surfaces);
        let fitted = Parameter::named(&self.plan.parameters);
        let experiment = Experiment::new(mesh, &self.model, &self.plan, &measured)?;
        let search = Search { experiment, fitted };
        let start = Moduli::of(&self.model);
        if !(self.plan.second_start && search.searches()) {
            return search.run(start, progress);
        }
        let mut found = search.run(start, &Part { whole: progress, from: 0.0, to: 0.5 })?;
        found.second = Some(again(&search, start, &Part { whole: progress, from: 0.5, to: 1.0 })?);
        Ok(found)
    }
}

/// A second search, from stiffer moduli: softer ones may not stand.
fn again(search: &Search, start: Moduli, progress: &dyn Progress) -> Result<SecondStart, Failure> {
    let mut from = start;
    for &parameter in &search.fitted {
        if let Some(value) = parameter.value(&start, search.experiment.body.plan) {
            parameter.set(&mut from, SECOND_START * value);
        }
    }
    match search.run(from, progress) {
        Ok(found) => {
            let (end, evaluations) = (Some(found.after.moduli), found.trials.len());
            Ok(SecondStart { from, end, evaluations })
        }
        Err(Failure::Numerics(_)) => Ok(SecondStart { from, end: None, evaluations: 0 }),
        Err(other) => Err(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_starts_agree_when_both_moduli_are_alike() {
        let moduli = Moduli::new;
        let second = |end| SecondStart { from: moduli(1.5, 1.5), end, evaluations: 6 };
        let first = moduli(0.3, 0.2);
        assert!(second(Some(moduli(0.308, 0.195))).agrees(&first));
        assert!(!second(Some(moduli(0.3, 0.225))).agrees(&first));
        assert!(!second(None).agrees(&first), "no equilibrium is no agreement");
        let with_skin = |kpa: f64| {
            let mut moduli = first;
            moduli.shared.skin_kpa = Some(kpa);
            moduli
        };
        assert!(second(Some(with_skin(4.1))).agrees(&with_skin(4.0)));
        assert!(!second(Some(with_skin(6.0))).agrees(&with_skin(4.0)));
    }
}
