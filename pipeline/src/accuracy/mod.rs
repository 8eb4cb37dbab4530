//! How near the calibration comes to digital volunteers: fitted and held-out poses, moduli.

mod markers;
mod page;

pub use page::{chart, markdown, table};

use crate::graph::Outcome;
use mammotwin_data::{Failure, Vec3, io::hdf5, labels::Side, surface::TriMesh};
use mammotwin_solver::distance::SurfaceIndex;
use mammotwin_stages::{fiducials::Summary, pose::PoseFit, volunteer::Truth};
use std::path::Path;

/// What the fit knows of skin and fascia.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Layers {
    /// The person's own moduli
    Known,
    /// Those of the literature (skin 10, fascia 160 kPa)
    Literature,
}

/// What tissue is made of, and what the model takes it for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hypothesis {
    /// Neo-Hookean tissue, neo-Hookean model.
    Right,
    /// Tissue that stiffens, neo-Hookean model: the thesis' case.
    Simple,
    /// Tissue that stiffens, a model that stiffens as much.
    Stiffening,
}

impl Hypothesis {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Right, Self::Simple, Self::Stiffening];

    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "neo-Hookean by neo-Hookean",
            Self::Simple => "Gent by neo-Hookean",
            Self::Stiffening => "Gent by Gent",
        }
    }

    /// Whether the volunteer's tissue stiffens.
    pub fn tissue_stiffens(self) -> bool {
        self != Self::Right
    }
}

/// What the fit took a pose for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Its shape is given; what is left is the round trip through mesh and stress-free shape.
    Reference,
    /// Fitted.
    Fitted,
    /// Never seen.
    HeldOut,
}

impl Role {
    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Fitted => "fitted",
            Self::HeldOut => "held out",
        }
    }
}

/// Misses of the markers of a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerError {
    /// Mean way (mm) from the reference pose.
    pub moved_mm: f64,
    /// With the moduli that the study begins with.
    pub before: Summary,
    /// With the fitted moduli.
    pub after: Summary,
    /// With the true skin on an unchanged chest wall in place of the simulated one.
    pub floor: Summary,
}

/// One pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    /// Its name.
    pub pose: String,
    /// What the fit took it for.
    pub role: Role,
    /// Modified Hausdorff distance (mm) with the moduli that the study begins with.
    pub before_mm: f64,
    /// The same with the fitted moduli.
    pub after_mm: f64,
    /// Mean distance (mm) of the true skin on an unchanged chest wall from the measured one, where they are compared: what
    /// segmentation, surfaces, registration and the change of the chest wall leave to a perfect model.
    pub floor_mm: f64,
    /// Markers on the breasts; none in the reference pose.
    pub markers: Option<MarkerError>,
}

/// One volunteer, fitted once.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Which person.
    pub seed: u64,
    /// Tissue and model.
    pub hypothesis: Hypothesis,
    /// All poses, the reference pose first.
    pub poses: Vec<PoseError>,
    /// Fitted over true modulus, right and left.
    pub moduli: [f64; 2],
    /// Logarithm of that over its stated standard deviation; `None` where none was stated.
    pub scores: [Option<f64>; 2],
    /// Evaluations of the model.
    pub evaluations: usize,
}

/// Compares a finished run with the truth of its volunteer.
///
/// # Errors
/// Truth or results that cannot be read, [`Failure::BadInput`] when they are not of each other.
pub fn measure(
    outcome: &Outcome,
    truth_folder: &Path,
    seed: u64,
    hypothesis: Hypothesis,
) -> Result<Fitted, Failure> {
    let truth = Truth::load(&truth_folder.join("truth.json"))?;
    let bodies = hdf5::Reader::open(truth_folder.join("bodies.h5"))?;
    let calibration = outcome.calibration.load()?;
    let mut poses = Vec::new();
    let mut add = |before: &PoseFit, after: &PoseFit, role: Role| {
        let role = if after.pose == outcome.reference { Role::Reference } else { role };
        let floor_mm = floor(outcome, &truth, &bodies, after)?;
        let found = outcome.fiducials.get(&after.pose).map(|found| found.load()).transpose()?;
        let markers = match found {
            Some(found) => markers::measure(&outcome.reference, &truth, &bodies, &found)?,
            None => None,
        };
        poses.push(PoseError {
            pose: after.pose.clone(),
            role,
            before_mm: before.distances.modified_hausdorff,
            after_mm: after.distances.modified_hausdorff,
            floor_mm,
            markers,
        });
        Ok::<_, Failure>(())
    };
    for (before, after) in calibration.before.poses.iter().zip(&calibration.after.poses) {
        add(before, after, Role::Fitted)?;
    }
    for validation in outcome.validations.values() {
        let validation = validation.load()?;
        add(&validation.before, &validation.after, Role::HeldOut)?;
    }
    let moduli = [Side::Right, Side::Left].map(|side| {
        let known = truth.moduli.get(&format!("breast.young_{}_kpa", side.name()));
        calibration.after.moduli.of_side(side) / known.copied().unwrap_or(f64::NAN)
    });
    let deviation = [Side::Right, Side::Left].map(|side| calibration.precision.of_side(side));
    let score = |n: usize| deviation[n].map(|deviation| moduli[n].ln() / deviation);
    Ok(Fitted {
        seed,
        hypothesis,
        poses,
        moduli,
        scores: [score(0), score(1)],
        evaluations: calibration.trials.len(),
    })
}

/// Faces of the true skin, in every pose.
const TRUE_SKIN: &str = "stress_free/patches/skin";

/// Nodes (mm) of the true body in a pose, on an unchanged chest wall, in the frame of the reference pose.
fn true_points(
    truth: &Truth,
    bodies: &hdf5::Reader,
    reference: &str,
    pose: &str,
) -> Result<Vec<Vec3>, Failure> {
    let of = |pose: &str| {
        let none = || Failure::BadInput(format!("truth of {pose}: there is none"));
        truth.poses.get(pose).ok_or_else(none)
    };
    of(pose)?;
    let to_reference = of(reference)?.to_common.inverse();
    let points: Vec<Vec3> = bodies.get(&format!("{pose}/points"))?;
    Ok(points.iter().map(|p| to_reference.point(p)).collect())
}

/// Mean distance (mm) from the true skin of a pose to the measured one, at the points of the true skin next to the compared
/// nodes of a fit.
fn floor(
    outcome: &Outcome,
    truth: &Truth,
    bodies: &hdf5::Reader,
    fit: &PoseFit,
) -> Result<f64, Failure> {
    let name = &fit.pose;
    let refuse =
        |what: &dyn std::fmt::Display| Failure::BadInput(format!("truth of {name}: {what}"));
    let points = true_points(truth, bodies, &outcome.reference, name)?;
    let skin = TriMesh { points, triangles: bodies.get(TRUE_SKIN)? };
    let pose =
        outcome.measured.images.get(name).ok_or_else(|| refuse(&"the study has no such pose"))?;
    let mut measured = pose.surfaces.load()?.skin;
    if let Some(registered) = &pose.registered {
        let motion = registered.load()?.transform;
        measured.points.iter_mut().for_each(|p| *p = motion.point(p));
    }
    let nodes: Vec<_> = fit.active.iter().map(|&n| fit.solution.points[n as usize]).collect();
    let nearest = |surface: &TriMesh, points: &[_]| {
        SurfaceIndex::new(surface).and_then(|index| index.closest_of(points))
    };
    let on_truth = nearest(&skin, &nodes).map_err(|cause| refuse(&cause))?;
    let on_truth: Vec<_> = on_truth.iter().map(|found| found.point).collect();
    let found = nearest(&measured, &on_truth).map_err(|cause| refuse(&cause))?;
    let sum: f64 = found.iter().zip(&on_truth).map(|(found, p)| (found.point - p).norm()).sum();
    Ok(sum / on_truth.len().max(1) as f64)
}
