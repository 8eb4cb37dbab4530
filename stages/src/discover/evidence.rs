//! What a verdict rests on: the residuals of the calibrated model, what moduli and effects would
//! change about them, and the size of the errors.

use super::{
    budget::{Budget, Nodes, Whitener, mean},
    observe::{carried, edges, residual, skin, weighed},
    reference::growth,
    refit::with_effect,
    signature::{Projector, Signature},
};
use crate::{
    calibrate::{Calibration, Experiment, Fit, Measured},
    effects::{Amplitude, EFFECTS, Effect},
    mesh::{BreastMesh, Mesh},
    model::{Body, Moduli},
    register::Registered,
    shape::Shape,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::LabelMap,
    progress::{Progress, Silent},
    store::{Artifact, Stage},
    study::{CalibratePlan, MeshPlan, ModelPlan},
};
use mammotwin_solver::mesh::lattice::Placement;
use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// The other meshes: edge length over the model's own, and how their lattice lies (degrees of
/// freedom: turn about three axes in radians, shift in edge lengths).
const MESHINGS: [(f64, Placement); 5] = [
    (0.8, Placement { rotation: [0.0; 3], offset: [0.2, 0.4, 0.6] }),
    (0.9, Placement { rotation: [0.4, -0.3, 0.2], offset: [0.5, 0.1, 0.3] }),
    (1.0, Placement { rotation: [-0.2, 0.6, 0.5], offset: [0.3, 0.8, 0.1] }),
    (1.0, Placement { rotation: [0.7, 0.2, -0.6], offset: [0.9, 0.6, 0.4] }),
    (1.15, Placement { rotation: [0.1, -0.7, 0.3], offset: [0.6, 0.2, 0.7] }),
];
/// With fewer other meshes their scatter is no measure.
const FEWEST_MESHINGS: usize = 3;
/// With fewer nodes there is nothing to weigh.
const FEWEST_NODES: usize = 30;
/// A large amplitude would change residuals by so many standard deviations, if it did so in proportion.
const LARGE: f64 = 20.0;
/// The amplitude beyond the large one up to which changes with moduli that stay are known, over it.
const FARTHER: f64 = 3.0;
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

/// Residuals (mm) and their derivatives have the nodes of pose after pose, in one column.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Names of the poses but the reference pose.
    pub poses: Vec<String>,
    /// The reference pose.
    pub reference: Shape,
    /// Places of the weighed nodes among those that a fit compares.
    pub weighed: Vec<u32>,
    /// Pairs of weighed nodes that are neighbours.
    pub edges: Vec<[u32; 2]>,
    /// The simulated poses.
    pub shapes: Vec<Shape>,
    /// Calibrated moduli.
    pub moduli: Moduli,
    /// Signed distances (mm) of simulated to measured skin with these, less the mean difference to the
    /// other meshes: what is known of the mesh's error.
    pub residual: DVector<f64>,
    /// Derivatives (mm) by the logarithms of the moduli, right and left.
    pub by_moduli: [DVector<f64>; 2],
    /// Halves of their second derivatives (mm).
    pub bends: [DVector<f64>; 2],
    /// What each effect changes.
    pub signatures: Vec<Signature>,
    /// Effects without a signature: the model has no equilibrium with them.
    pub failed: Vec<String>,
    /// Differences (mm) to the same model on other meshes.
    pub meshings: Vec<DVector<f64>>,
    /// By how much errors of the reference pose grow on their way into the residuals.
    pub growth: DVector<f64>,
    /// Sizes of the errors.
    pub budget: Budget,
}

impl Evidence {
    /// Residuals (mm) of a fit, less what is known of the mesh's error.
    pub(super) fn residual_of(&self, fit: &Fit) -> DVector<f64> {
        residual(fit, &self.weighed) - mean(&self.meshings)
    }

    /// The weighed nodes of all poses.
    pub fn places(&self) -> Nodes<'_> {
        let Self { edges, reference, shapes, growth, .. } = self;
        Nodes { edges, reference, shapes, growth }
    }

    /// Number of weighed nodes.
    pub fn nodes(&self) -> usize {
        self.reference.points.len()
    }
}

impl Artifact for Evidence {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_texts("poses", &self.poses, "poses but the reference pose")?;
        self.reference.put(&mut file, "reference")?;
        file.put("weighed", &self.weighed, "1", "weighed among the compared nodes")?;
        file.put("edges", &self.edges, "1", "neighbours among the weighed nodes")?;
        for (pose, shape) in self.poses.iter().zip(&self.shapes) {
            shape.put(&mut file, &format!("shapes/{pose}"))?;
        }
        file.put_texts("failed", &self.failed, "effects without a signature")?;
        file.put_json("moduli", &self.moduli, "calibrated moduli (kPa)")?;
        file.put_json("budget", &self.budget, "sizes of the errors (mm)")?;
        file.put("growth", self.growth.as_slice(), "1", "of errors of the reference pose")?;
        let mut put = |name: &str, column: &DVector<f64>, meaning: &str| {
            file.put(name, column.as_slice(), "mm", meaning)
        };
        put("residual", &self.residual, "signed distance, pose after pose")?;
        for (side, column) in ["right", "left"].iter().zip(&self.by_moduli) {
            put(&format!("by_modulus/{side}"), column, "derivative by the logarithm")?;
        }
        for (side, column) in ["right", "left"].iter().zip(&self.bends) {
            put(&format!("bend/{side}"), column, "half of the second derivative")?;
        }
        for (n, column) in self.meshings.iter().enumerate() {
            put(&format!("meshings/{n}"), column, "difference to another mesh")?;
        }
        for signature in &self.signatures {
            signature.put(&mut file)?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let column = |name: &str| Ok::<_, Failure>(DVector::from_vec(file.get::<f64>(name)?));
        let poses = file.texts("poses")?;
        let shapes = poses.iter().map(|pose| Shape::get(&file, &format!("shapes/{pose}")));
        let mut signatures = Vec::new();
        for effect in EFFECTS {
            signatures.extend(Signature::get(&file, effect)?);
        }
        let mut meshings = Vec::new();
        while file.has(&format!("meshings/{}", meshings.len())) {
            meshings.push(column(&format!("meshings/{}", meshings.len()))?);
        }
        Ok(Self {
            reference: Shape::get(&file, "reference")?,
            weighed: file.get("weighed")?,
            edges: file.get("edges")?,
            shapes: shapes.collect::<Result<_, _>>()?,
            moduli: file.json("moduli")?,
            residual: column("residual")?,
            by_moduli: [column("by_modulus/right")?, column("by_modulus/left")?],
            bends: [column("bend/right")?, column("bend/left")?],
            signatures,
            failed: file.texts("failed")?,
            meshings,
            growth: column("growth")?,
            budget: file.json("budget")?,
            poses,
        })
    }
}

/// Gathers the evidence: one evaluation a modulus, an effect and a mesh.
#[derive(Debug, Clone, Serialize)]
pub struct Gather {
    /// Tissues, supports and the effects that are on already.
    pub model: ModelPlan,
    /// How the stress-free shape is found.
    pub calibrate: CalibratePlan,
    /// The model's mesh.
    pub mesh: MeshPlan,
    /// Name of the reference pose.
    pub reference: String,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Names of the other poses, in the order of the inputs.
    pub poses: Vec<String>,
    /// Names of the effects that are tried.
    pub library: Vec<&'static str>,
}

/// Labels and surfaces of the reference pose, its mesh, the calibration, and for each other pose
/// its motion and its surfaces.
pub type Input =
    (LabelMap, PoseSurfaces, BreastMesh, Calibration, Vec<Registered>, Vec<PoseSurfaces>);

impl Gather {
    /// What was measured in all poses.
    pub(super) fn measured<'a>(&'a self, input: &'a Input) -> Measured<'a> {
        let (_, reference, _, _, registered, surfaces) = input;
        let first = (self.reference.as_str(), self.gravity, reference);
        Measured::new(first, &self.poses, registered, surfaces)
    }
}

impl Stage for Gather {
    const NAME: &'static str = "evidence";
    const VERSION: u32 = 11;
    const METHODS: &'static str = "Signed distances of the simulated to the measured skin were taken at the nodes of the \
         calibrated model, with their derivatives by the moduli and by the amplitude of each effect of \
         a library, and their differences to the same model on five other meshes.";
    type Input = Input;
    type Output = Evidence;

    fn run(&self, input: &Input, progress: &dyn Progress) -> Result<Evidence, Failure> {
        let (labels, _, mesh, calibration, ..) = input;
        let measured = self.measured(input);
        let experiment = Experiment::new(mesh, &self.model, &self.calibrate, &measured)?;
        progress.report(0.0, "calibrated model");
        let moduli = calibration.after.moduli;
        let base = experiment.evaluate(moduli, Some(&calibration.after), &Silent, "")?;
        let active = match base.poses.first() {
            Some(pose) if !pose.active.is_empty() => &pose.active,
            _ => return Err(Failure::BadInput("discover: no skin is compared".into())),
        };
        let weighed = weighed(mesh, active);
        let nodes: Vec<u32> = weighed.iter().map(|&place| active[place as usize]).collect();
        if nodes.len() < FEWEST_NODES {
            return Err(Failure::BadInput(format!(
                "discover: only {} nodes of the skin lie beside the nipples; take a smaller \
                 mesh.size_mm",
                nodes.len()
            )));
        }
        let shape = |points: &[Vec3]| Shape::of(&skin(mesh, points), &nodes);
        let shapes: Vec<Shape> =
            base.poses[1..].iter().map(|pose| shape(&pose.solution.points)).collect();

        let reference = shape(&mesh.mesh.points);
        let here = residual(&base, &weighed);
        progress.report(0.1, "the same model on other meshes");
        let other = |(part, placement): (f64, Placement)| {
            let meshing = Mesh(MeshPlan { size_mm: part * self.mesh.size_mm, ..self.mesh });
            let other = meshing.lying(labels, placement, &Silent)?;
            let experiment = Experiment::new(&other, &self.model, &self.calibrate, &measured)?;
            // A mesh on which the model fails tells nothing.
            let Ok(fit) = experiment.evaluate(moduli, None, &Silent, "") else { return Ok(None) };
            Ok(Some(&here - carried(&reference, &other, &fit)?))
        };
        let meshings: Vec<Option<DVector<f64>>> =
            MESHINGS.into_par_iter().map(other).collect::<Result<_, Failure>>()?;
        let meshings: Vec<DVector<f64>> = meshings.into_iter().flatten().collect();
        if meshings.len() < FEWEST_MESHINGS {
            return Err(Failure::Numerics(format!(
                "discover: the model stands on {} of {} other meshes only; the error of the mesh is \
                 not known",
                meshings.len(),
                MESHINGS.len()
            )));
        }

        progress.report(0.4, "errors of the reference pose");
        let growth = growth(mesh, &base, &experiment, (&weighed, &reference))?;

        progress.report(0.55, "signatures of the effects");
        let off = mean(&meshings);
        let by_modulus = |[right, left]: [f64; 2]| {
            let mut moduli = moduli;
            moduli.right_kpa *= f64::exp(right);
            moduli.left_kpa *= f64::exp(left);
            let fit = experiment.evaluate(moduli, Some(&base), &Silent, "")?;
            Ok::<_, Failure>(residual(&fit, &weighed) - &here)
        };
        let derivatives = |side: usize| {
            let of = |part: f64| by_modulus([0, 1].map(|s| if s == side { part } else { 0.0 }));
            let (small, large) = (of(SMALL_MODULUS)?, of(LARGE_MODULUS)?);
            let slope = small / SMALL_MODULUS;
            let bend = (large / LARGE_MODULUS - &slope) / (LARGE_MODULUS - SMALL_MODULUS);
            Ok::<_, Failure>((slope - SMALL_MODULUS * &bend, bend))
        };
        let ((right, right_bend), (left, left_bend)) = (derivatives(0)?, derivatives(1)?);
        let (by_moduli, bends) = ([right, left], [right_bend, left_bend]);
        let change = |effect: &Effect, amplitude: f64, [right, left]: [f64; 2]| {
            let plan = with_effect(&self.model, effect, amplitude);
            let body = Body { plan: &plan, ..experiment.body.clone() };
            let mut moduli = moduli;
            moduli.right_kpa *= right.exp();
            moduli.left_kpa *= left.exp();
            let fit = experiment.evaluate_as(&body, moduli, Some(&base), &Silent, "");
            Some(residual(&fit.ok()?, &weighed) - &here)
        };
        let edges = edges(mesh, &nodes);
        let places =
            Nodes { edges: &edges, reference: &reference, shapes: &shapes, growth: &growth };
        let budget = Budget::of(&places, &(&here - &off), labels.grid.mean_edge_mm());
        let whitener = Whitener::all(&budget.covariance(&places, &meshings))
            .ok_or_else(|| Failure::Numerics("discover: errors without a covariance".into()))?;
        let projector = Projector::new(&whitener, &by_moduli);
        // A calibration takes its part of a large change, and not in proportion.
        let settled = |effect: &Effect, amplitude: f64, kept: &DVector<f64>| {
            let mut at = [0.0; 2];
            let mut found = kept.clone();
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
                let Some(there) = change(effect, amplitude, next) else { break };
                (at, found, last) = (next, there, Some(step));
            }
            tracing::debug!(effect.name, amplitude, ?at, "moduli with the effect");
            found
        };
        let signatures: Vec<Signature> = EFFECTS
            .into_par_iter()
            .filter_map(|effect| {
                let Amplitude { small, range: [least, greatest], .. } = effect.amplitude;
                let little = change(effect, small, [0.0; 2])?;
                let slope = &little / small;
                let size = projector.surviving(&slope).0.norm();
                let reach = (LARGE / size).clamp(small, f64::max(-least, greatest));
                // Where the effect hardly shows, or the model does not stand with much of it, a small
                // change is all there is.
                let shows = size * reach > LARGE.sqrt();
                let large = [1.0, 0.5, 0.25].map(|part| part * reach).into_iter();
                let first = large
                    .filter(|amplitude| shows && *amplitude > 2.0 * small)
                    .find_map(|amplitude| Some((amplitude, change(effect, amplitude, [0.0; 2])?)));
                let large = first
                    .as_ref()
                    .map(|(amplitude, much)| (*amplitude, settled(effect, *amplitude, much)));
                let large = large.as_ref().map(|(amplitude, much)| (*amplitude, much));
                let farther = first.as_ref().and_then(|(reach, _)| {
                    let farther = (FARTHER * reach).min(f64::max(-least, greatest));
                    let beyond = farther > *reach;
                    beyond.then(|| Some((farther, change(effect, farther, [0.0; 2])?)))?
                });
                let kept = first.clone().into_iter().chain(farther);
                Some(Signature::new(effect, (small, &little), large, kept))
            })
            .collect();
        let found = |effect: &&Effect| signatures.iter().any(|s| s.effect.name == effect.name);
        let failed = EFFECTS.into_iter().filter(|e| !found(e)).map(|e| e.name.into()).collect();
        Ok(Evidence {
            poses: self.poses.clone(),
            budget,
            reference,
            weighed,
            edges,
            shapes,
            moduli,
            residual: here - off,
            by_moduli,
            bends,
            signatures,
            failed,
            meshings,
            growth,
        })
    }
}
