//! How far the skin moves, and how well the poses are met, over the moduli of the tissues.
//!
//! Two questions of Mîra (2018), § 3.5: which moduli matter (figs 3.15 and 3.16: gravity from behind
//! on the reference pose, taken for stress-free), and how the error of the model depends on them
//! (fig. 3.17: stress-free shape and all fitted poses, for each set of moduli).

use crate::{
    artifact::{load_json, save_json},
    calibrate::{Experiment, Fit, Measured},
    mesh::BreastMesh,
    model::{Body, Moduli},
    pose::{PoseFit, PoseTarget},
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    labels::Side,
    mesh::Patch,
    progress::{Progress, Silent},
    store::{Artifact, Stage},
    study::{CalibratePlan, ModelPlan, Posture},
};
use mammotwin_solver::{Options, solve};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Parameter {
    /// Poisson's ratio of the breast.
    Poisson,
    /// Young's modulus of both breasts.
    Breast,
    /// Young's modulus of the skin.
    Skin,
    /// Young's modulus of the fascia.
    Fascia,
}

impl Parameter {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Poisson, Self::Breast, Self::Skin, Self::Fascia];

    /// Word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Poisson => "poisson",
            Self::Breast => "breast",
            Self::Skin => "skin",
            Self::Fascia => "fascia",
        }
    }

    /// What it is, with its unit.
    pub fn label(self) -> &'static str {
        match self {
            Self::Poisson => "Poisson's ratio of the breast",
            Self::Breast => "Young's modulus of the breast (kPa)",
            Self::Skin => "Young's modulus of the skin (kPa)",
            Self::Fascia => "Young's modulus of the fascia (kPa)",
        }
    }

    /// The interval of the thesis (§ 3.5.1, table 3.2) in steps of a tenth.
    pub fn thesis_values(self) -> Vec<f64> {
        let [from, to] = match self {
            Self::Poisson => [0.45, 0.495],
            Self::Breast => [0.3, 6.0],
            Self::Skin => [7.4, 58.4],
            Self::Fascia => [100.0, 5000.0],
        };
        let value = |n: i32| from + 0.1 * f64::from(n) * (to - from);
        // Written out they are short.
        (0..=10).map(|n| (1e6 * value(n)).round() / 1e6).collect()
    }

    /// A plan with this value.
    fn set(self, plan: &ModelPlan, value: f64) -> ModelPlan {
        let mut plan = plan.clone();
        match self {
            Self::Poisson => plan.breast.poisson = value,
            Self::Breast => {
                (plan.breast.young_right_kpa, plan.breast.young_left_kpa) = (value, value);
            }
            Self::Skin => plan.skin.young_kpa = value,
            Self::Fascia => plan.fascia.young_kpa = value,
        }
        plan
    }
}

/// Gravity from behind on the reference pose, over one parameter.
#[derive(Debug, Clone, Serialize)]
pub struct Sweep {
    /// Tissues and supports; all else stays as here.
    pub model: ModelPlan,
    /// What is varied.
    pub parameter: Parameter,
    /// Its values, rising.
    pub values: Vec<f64>,
}

/// What a sweep found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Swept {
    /// What was varied.
    pub parameter: Parameter,
    /// Value after value.
    pub steps: Vec<Step>,
}

/// Displacement of the skin at one value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// The value.
    pub value: f64,
    /// What the skin does; `None` without an equilibrium.
    pub moved: Option<Moved>,
    /// Why there is no equilibrium.
    pub failed: Option<String>,
}

/// Displacement of the skin's nodes (mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moved {
    /// Mean.
    pub mean_mm: f64,
    /// Largest.
    pub max_mm: f64,
    /// Largest change of a node's displacement against the value before, if there is one.
    pub change_mm: Option<f64>,
    /// The same against the value at which the skin moves least.
    pub total_change_mm: f64,
}

impl Artifact for Swept {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

impl Stage for Sweep {
    const NAME: &'static str = "sweep";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "Gravity from behind was put on the reference pose, taken for stress-free, over one \
         parameter of the tissues (Mîra 2018, § 3.5.1).";
    type Input = BreastMesh;
    type Output = Swept;

    fn run(&self, mesh: &BreastMesh, progress: &dyn Progress) -> Result<Swept, Failure> {
        let skin = mesh.mesh.patch_nodes(Patch::Skin);
        let points = &mesh.mesh.points;
        let gravity = Posture::Prone.gravity();
        let told = Told::new(progress, self.values.len());
        let moved = |value: &f64| {
            let plan = self.parameter.set(&self.model, *value);
            let body = Body::new(mesh, &plan);
            let model = body.model(points, Moduli::of(&plan), gravity, None);
            let found = model.map_err(|cause| cause.to_string()).and_then(|model| {
                let found = solve(&model, points, &Options::default(), &Silent);
                found.map_err(|cause| cause.to_string())
            });
            told.one_more();
            let there = body.spread(found?).points;
            let moved = |n: &u32| there[*n as usize] - points[*n as usize];
            Ok(skin.iter().map(moved).collect::<Vec<Vec3>>())
        };
        let all: Vec<Result<Vec<Vec3>, String>> = self.values.par_iter().map(moved).collect();
        let largest = |v: &[Vec3]| v.iter().map(|u| u.norm()).fold(0.0, f64::max);
        let least = all.iter().flatten().min_by(|a, b| largest(a).total_cmp(&largest(b)));
        let apart = |a: &[Vec3], b: &[Vec3]| {
            a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        let mut before: Option<&[Vec3]> = None;
        let mut steps = Vec::new();
        for (&value, found) in self.values.iter().zip(&all) {
            let moved = found.as_ref().ok().map(|moved| {
                let sum: f64 = moved.iter().map(|u| u.norm()).sum();
                Moved {
                    mean_mm: sum / moved.len().max(1) as f64,
                    max_mm: largest(moved),
                    change_mm: before.replace(moved).map(|before| apart(moved, before)),
                    total_change_mm: least.map_or(0.0, |least| apart(moved, least)),
                }
            });
            steps.push(Step { value, moved, failed: found.as_ref().err().cloned() });
        }
        Ok(Swept { parameter: self.parameter, steps })
    }
}

/// The error of the model for several moduli of the breasts, with one skin and one fascia.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorRow {
    /// Tissues and supports, with this skin and this fascia.
    pub model: ModelPlan,
    /// How the stress-free shape is found.
    pub plan: CalibratePlan,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Name of the reference pose.
    pub reference: String,
    /// Names of the other poses to be fitted, in the order of the inputs.
    pub poses: Vec<String>,
    /// Young's moduli (kPa) of both breasts, one after the other.
    pub breast_kpa: Vec<f64>,
}

/// What a row found, modulus after modulus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Errors(pub Vec<ErrorPoint>);

/// The error of the model with one set of moduli.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorPoint {
    /// Young's modulus of both breasts (kPa).
    pub breast_kpa: f64,
    /// Root mean square distance (mm) of the nodes when the stress-free shape is loaded again.
    pub round_trip_mm: Option<f64>,
    /// The reference pose, then the fitted ones; none where the model does not stand.
    pub poses: Vec<PoseError>,
    /// Why the model does not stand.
    pub failed: Option<String>,
}

/// Distances (mm) between simulated and measured skin of one pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseError {
    /// Name of the pose.
    pub pose: String,
    /// Modified Hausdorff distance (eq. A.7).
    pub modified_hausdorff_mm: f64,
    /// Largest distance of a compared node.
    pub max_mm: f64,
    /// Mean distance of the compared nodes of the right and the left breast, of which there are some.
    pub mean_mm: [Option<f64>; 2],
}

impl PoseError {
    fn of(target: &PoseTarget, fit: &PoseFit) -> Self {
        let mean = |side: Side| {
            let own = target.sides().iter().zip(&fit.signed_mm).filter(|(on, _)| **on == side);
            let (count, sum) =
                own.fold((0, 0.0), |(count, sum), (_, mm)| (count + 1, sum + mm.abs()));
            (count > 0).then(|| sum / f64::from(count))
        };
        Self {
            pose: fit.pose.clone(),
            modified_hausdorff_mm: fit.distances.modified_hausdorff,
            max_mm: fit.distances.max,
            mean_mm: [mean(Side::Right), mean(Side::Left)],
        }
    }
}

impl Artifact for Errors {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

/// Mesh, surfaces of the reference pose, and for each other pose its motion and its surfaces.
type Input = (BreastMesh, PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>);

impl Stage for ErrorRow {
    const NAME: &'static str = "error_row";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "The stress-free shape was found and loaded into the fitted poses for each set of moduli, \
         and compared with the measured skin (Mîra 2018, § 3.5.2).";
    type Input = Input;
    type Output = Errors;

    fn run(&self, input: &Input, progress: &dyn Progress) -> Result<Errors, Failure> {
        let (mesh, reference, registered, surfaces) = input;
        let first = (self.reference.as_str(), self.gravity, reference);
        let measured = Measured::new(first, &self.poses, registered, surfaces);
        let experiment = Experiment::new(mesh, &self.model, &self.plan, &measured)?;
        let told = Told::new(progress, self.breast_kpa.len());
        let one = |&kpa: &f64| {
            let moduli = Moduli::new(kpa, kpa);
            let found = experiment.evaluate(moduli, None, &Silent, "");
            told.one_more();
            match found {
                Ok(Fit { round_trip, poses, .. }) => Ok(ErrorPoint {
                    breast_kpa: kpa,
                    round_trip_mm: Some(round_trip.rms_mm),
                    poses: experiment
                        .targets
                        .iter()
                        .zip(&poses)
                        .map(|(target, fit)| PoseError::of(target, fit))
                        .collect(),
                    failed: None,
                }),
                Err(Failure::Numerics(why)) => Ok(ErrorPoint {
                    breast_kpa: kpa,
                    round_trip_mm: None,
                    poses: Vec::new(),
                    failed: Some(why),
                }),
                Err(other) => Err(other),
            }
        };
        Ok(Errors(self.breast_kpa.par_iter().map(one).collect::<Result<_, _>>()?))
    }
}

/// Tells how many of several are done.
struct Told<'a> {
    progress: &'a dyn Progress,
    done: AtomicUsize,
    all: usize,
}

impl<'a> Told<'a> {
    fn new(progress: &'a dyn Progress, all: usize) -> Self {
        Self { progress, done: AtomicUsize::new(0), all }
    }

    fn one_more(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.report(done as f64 / self.all as f64, &format!("{done} of {}", self.all));
    }
}
