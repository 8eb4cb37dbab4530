//! The pipeline: one function whose calls are the graph.

use mammotwin_data::{
    Failure,
    labels::LabelMap,
    landmarks::Landmarks,
    store::{Run, Stored},
    study::{CompressPlan, MammogramPlan, Pose, Study, Use},
    volume::Volume,
};
use mammotwin_stages::{
    align::{Align, Start},
    calibrate::{Calibrate, Calibration},
    comfort::Comfort,
    compress::{Compress, Compression},
    mammogram::{Mammogram, Mammograms},
    mesh::{BreastMesh, Mesh},
    phantom::{CompressedPhantom, Phantom},
    quality::{Metrics, Quality},
    register::{Register, Registered},
    segment::Segment,
    surface::{PoseSurfaces, Surface},
    validate::{Validate, Validation},
};
use std::collections::BTreeMap;

/// Seed of everything random in a run: shapes of microcalcifications and quantum noise.
const SEED: u64 = 1;

/// Handles on what a run made.
#[derive(Debug)]
pub struct Outcome {
    /// Name of the reference pose.
    pub reference: String,
    /// By pose name.
    pub poses: BTreeMap<String, PoseOutcome>,
    /// Tetrahedra of the reference pose.
    pub mesh: Stored<BreastMesh>,
    /// Stress-free shape and moduli.
    pub calibration: Stored<Calibration>,
    /// By pose name.
    pub validations: BTreeMap<String, Stored<Validation>>,
    /// The compression, if the study asks for one.
    pub compression: Option<Stored<Compression>>,
    /// The phantom, if the study asks for a picture.
    pub phantom: Option<Stored<CompressedPhantom>>,
    /// The pictures.
    pub mammograms: Option<Stored<Mammograms>>,
    /// Comfort, image quality and dose.
    pub metrics: Vec<Stored<Metrics>>,
}

/// Handles on what was made of one image.
#[derive(Debug)]
pub struct PoseOutcome {
    /// The image itself.
    pub scan: Stored<Volume<f32>>,
    /// Its labels.
    pub labels: Stored<LabelMap>,
    /// Its surfaces.
    pub surfaces: Stored<PoseSurfaces>,
    /// How it lies to the reference pose; `None` for the reference pose.
    pub registered: Option<Stored<Registered>>,
}

/// Calls the stages of a study.
pub fn run(study: &Study, run: &Run<'_>) -> Result<Outcome, Failure> {
    let reference = study.reference_pose().to_owned();
    let poses = images(study, &reference, run)?;
    let gravity = gravity(&reference, &study.poses[&reference])?;

    let mesh = Mesh { size_mm: study.mesh.size_mm };
    let mesh = run.stage("", &mesh, &poses[&reference].labels)?;

    let mut fitted = Vec::new();
    let (mut motions, mut surfaces) = (Vec::new(), Vec::new());
    for (name, pose) in &poses {
        if let (Some(registered), Use::Fit) = (&pose.registered, study.poses[name].usage) {
            fitted.push(name.clone());
            motions.push(registered.clone());
            surfaces.push(pose.surfaces.clone());
        }
    }
    let calibrate = Calibrate {
        model: study.model.clone(),
        plan: study.calibrate.clone(),
        gravity,
        reference: reference.clone(),
        poses: fitted,
    };
    let inputs = (&mesh, &poses[&reference].surfaces, &motions[..], &surfaces[..]);
    let calibration = run.stage("", &calibrate, inputs)?;

    let mut validations = BTreeMap::new();
    for (name, pose) in &poses {
        if let (Some(registered), Use::Validate) = (&pose.registered, study.poses[name].usage) {
            let validate = Validate { model: study.model.clone(), pose: name.clone() };
            let inputs = (&mesh, &calibration, registered, &pose.surfaces);
            validations.insert(name.clone(), run.stage(name, &validate, inputs)?);
        }
    }

    let mut outcome = Outcome {
        reference,
        poses,
        mesh,
        calibration,
        validations,
        compression: None,
        phantom: None,
        mammograms: None,
        metrics: Vec::new(),
    };
    if let Some(plan) = &study.compress {
        squeeze(study, plan, run, &mut outcome)?;
    }
    Ok(outcome)
}

/// Labels, surfaces and rigid motions of all images.
fn images(
    study: &Study,
    reference: &str,
    run: &Run<'_>,
) -> Result<BTreeMap<String, PoseOutcome>, Failure> {
    let landmarks = |name: &str| -> Result<Option<Stored<Landmarks>>, Failure> {
        let key = format!("poses.{name}.landmarks");
        study.poses[name].landmarks.as_ref().map(|path| run.external(&key, path)).transpose()
    };
    let reference_landmarks = landmarks(reference)?;
    let mut scans = BTreeMap::new();
    for (name, pose) in &study.poses {
        let scan: Stored<Volume<f32>> =
            run.external(&format!("poses.{name}.image"), &pose.image)?;
        scans.insert(name.clone(), scan);
    }
    // The reference pose first: the others are registered to it.
    let mut order: Vec<&String> = study.poses.keys().collect();
    order.sort_by_key(|name| *name != reference);
    let mut poses: BTreeMap<String, PoseOutcome> = BTreeMap::new();
    for name in order {
        let (pose, scan) = (&study.poses[name], scans[name].clone());
        let gravity_in_image = gravity(name, pose)?;
        let start: Option<Stored<Start>> = if name == reference {
            None
        } else {
            let own = landmarks(name)?;
            Some(run.stage(name, &Align, (reference_landmarks.as_ref(), own.as_ref()))?)
        };
        let labels = match &pose.labels {
            Some(path) => run.external(&format!("poses.{name}.labels"), path)?,
            None => {
                let visible = format!("labels/{name}");
                run.editable(&visible, name, &Segment, (&scan, start.as_ref()))?
            }
        };
        let surfaces = run.stage(name, &Surface::default(), &labels)?;
        let registered = match (&start, poses.get(reference)) {
            (Some(start), Some(fixed)) => {
                let register = Register { gravity_in_image };
                Some(run.stage(name, &register, (&fixed.scan, &fixed.labels, &scan, start))?)
            }
            _ => None,
        };
        poses.insert(name.clone(), PoseOutcome { scan, labels, surfaces, registered });
    }
    Ok(poses)
}

/// Compression, picture and metrics.
fn squeeze(
    study: &Study,
    plan: &CompressPlan,
    run: &Run<'_>,
    outcome: &mut Outcome,
) -> Result<(), Failure> {
    let compress = Compress { model: study.model.clone(), plan: plan.clone() };
    let compression = run.stage("", &compress, (&outcome.mesh, &outcome.calibration))?;
    outcome.metrics.push(run.stage("", &Comfort, &compression)?);
    if let Some(MammogramPlan { energy_kev, exposure, pixel_mm, .. }) = study.mammogram {
        let phantom = Phantom { plan: study.mammogram.clone().unwrap_or_default(), seed: SEED };
        let phantom = run.stage("", &phantom, &compression)?;
        let mammogram = Mammogram { energy_kev, pixel_mm, exposure, seed: SEED };
        let mammograms = run.stage("", &mammogram, &phantom)?;
        let quality = Quality { energy_kev, pixel_mm };
        outcome.metrics.push(run.stage("", &quality, (&phantom, &mammograms))?);
        outcome.phantom = Some(phantom);
        outcome.mammograms = Some(mammograms);
    }
    outcome.compression = Some(compression);
    Ok(())
}

fn gravity(name: &str, pose: &Pose) -> Result<mammotwin_data::Vec3, Failure> {
    pose.gravity().ok_or_else(|| {
        Failure::BadInput(format!(
            "poses.{name}: no direction of gravity; give posture or gravity_in_image"
        ))
    })
}
