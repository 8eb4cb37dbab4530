//! The pipeline: one function whose calls are the graph.

use mammotwin_data::{
    Failure,
    labels::LabelMap,
    landmarks::Landmarks,
    store::{Entry, Run, Stored},
    study::{CompressPlan, MammogramPlan, Pose, Study, Use},
    volume::Volume,
};
use mammotwin_stages::{
    align::{Align, Start},
    calibrate::{Calibrate, Calibration},
    comfort::Comfort,
    compress::{Compress, Compression},
    deliver::{Deliver, RawPicture, Report, ShownPicture},
    discover::{Discover, Discovery},
    mammogram::{Mammogram, Mammograms},
    mesh::{BreastMesh, Mesh},
    monte_carlo::MonteCarlo,
    phantom::{CompressedPhantom, Phantom},
    pictures::{Pictures, PosePictures},
    quality::{Metrics, Quality},
    register::{Register, Registered},
    results::{Provenance, StageRecord},
    segment::Segment,
    surface::{PoseSurfaces, Surface},
    validate::{Validate, Validation},
};
use std::collections::BTreeMap;

/// Seed of everything random in a run: shapes of microcalcifications and quantum noise.
const SEED: u64 = 1;
/// Pixel size (mm) of the cuts in the report.
const CUT_MM: f64 = 1.0;
/// What the thesis calls a limit of its own: said in every report.
const NO_DEVICE: &str = "A research result, not a medical device; nothing here is a diagnosis.";

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
    /// Cuts for the report.
    pub pictures: Stored<PosePictures>,
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
    deliver(study, run, &outcome)?;
    Ok(outcome)
}

/// Calls the stages of a study, and looks for an effect that its model lacks.
pub fn discover(
    study: &Study,
    held_out: &str,
    run: &Run<'_>,
) -> Result<Stored<Discovery>, Failure> {
    let Outcome { reference, poses, mesh, calibration, .. } = self::run(study, run)?;
    let (mut names, mut motions, mut surfaces) = (Vec::new(), Vec::new(), Vec::new());
    for (name, pose) in &poses {
        if let Some(registered) = &pose.registered {
            names.push(name.clone());
            motions.push(registered.clone());
            surfaces.push(pose.surfaces.clone());
        }
    }
    let discover = Discover {
        model: study.model.clone(),
        calibrate: study.calibrate.clone(),
        size_mm: study.mesh.size_mm,
        gravity: gravity(&reference, &study.poses[&reference])?,
        poses: names,
        held_out: held_out.into(),
        reference: reference.clone(),
    };
    let first = &poses[&reference];
    let inputs = (&first.labels, &first.surfaces, &mesh, &calibration, &motions[..], &surfaces[..]);
    let found = run.stage("", &discover, inputs)?;
    run.export("discovery.h5", &found)?;
    Ok(found)
}

/// The files that people open.
fn deliver(study: &Study, run: &Run<'_>, outcome: &Outcome) -> Result<(), Failure> {
    let provenance = provenance(run);
    let validations: Vec<_> = outcome.validations.values().cloned().collect();
    let Outcome { mesh, calibration, compression, phantom, mammograms, metrics, .. } = outcome;

    let moving = outcome.poses.iter().filter_map(|(name, pose)| {
        pose.registered.clone().map(|registered| (name.clone(), registered))
    });
    let (moving, moved): (Vec<String>, Vec<_>) = moving.unzip();
    let deliver = Deliver { study: study.without_files(), moving, provenance: provenance.clone() };
    let (squeezed, taken) = (compression.as_ref(), mammograms.as_ref());
    let inputs = (mesh, calibration, &validations[..], &moved[..], squeezed, taken, &metrics[..]);
    let results = run.stage("", &deliver, inputs)?;
    run.export("results.h5", &results)?;

    // The reference pose first.
    let mut names: Vec<&String> = outcome.poses.keys().collect();
    names.sort_by_key(|name| **name != outcome.reference);
    let of = |name: &&String| &outcome.poses[*name];
    let pictures: Vec<_> = names.iter().map(|n| of(n).pictures.clone()).collect();
    let surfaces: Vec<_> = names.iter().map(|n| of(n).surfaces.clone()).collect();
    let motions: Vec<_> = names.iter().filter_map(|n| of(n).registered.clone()).collect();
    let mut warnings = vec![NO_DEVICE.to_owned()];
    for name in &names {
        let text = study.poses[*name].warning.as_ref();
        warnings.extend(text.map(|text| format!("{name}: {text}")));
    }
    if study.poses.len() == 1 {
        warnings.push(
            "One pose only: the moduli are literature values, nothing was fitted, and \
                       no held-out pose shows the error."
                .into(),
        );
    }
    let report = Report {
        subject: study.subject.id.clone(),
        poses: names.into_iter().cloned().collect(),
        warnings,
        provenance,
    };
    let images = (&pictures[..], &surfaces[..], &motions[..]);
    let mechanics = (mesh, calibration, &validations[..]);
    let squeezed = (squeezed, phantom.as_ref(), taken, &metrics[..]);
    let report = run.stage("", &report, (images, mechanics, squeezed))?;
    run.export("report.html", &report)?;

    if let (Some(taken), Some(plan), Some(picture)) = (taken, &study.compress, &study.mammogram) {
        for (number, diameter_mm) in picture.calcifications.diameter_mm.iter().enumerate() {
            let um = (1000.0 * diameter_mm).round();
            let name = format!("calcifications_{um}um");
            let raw = run.stage(&name, &RawPicture { number }, taken)?;
            run.export(&format!("images/{name}.tiff"), &raw)?;
            let shown = run.stage(&name, &ShownPicture { number, side: plan.side }, taken)?;
            run.export(&format!("images/{name}.png"), &shown)?;
        }
    }
    Ok(())
}

/// Version, keys and contents of all results so far.
fn provenance(run: &Run<'_>) -> Provenance {
    let record = |entry: Entry| StageRecord {
        stage: entry.stage,
        of: entry.label,
        key: entry.key.map(|key| key.digest).unwrap_or_default(),
        content: entry.record.map(|record| record.content).unwrap_or_default(),
    };
    Provenance {
        program_version: env!("CARGO_PKG_VERSION").into(),
        stages: run.calls().into_iter().map(record).collect(),
    }
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
        let pictures = Pictures { mm_per_pixel: CUT_MM };
        let fixed = registered.as_ref().and(poses.get(reference)).map(|fixed| &fixed.scan);
        let pictures = run.stage(name, &pictures, (&scan, &labels, fixed, registered.as_ref()))?;
        poses.insert(name.clone(), PoseOutcome { scan, labels, surfaces, registered, pictures });
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
    if let Some(MammogramPlan { energy_kev, exposure, pixel_mm, monte_carlo, .. }) = study.mammogram
    {
        let phantom = Phantom { plan: study.mammogram.clone().unwrap_or_default(), seed: SEED };
        let phantom = run.stage("", &phantom, &compression)?;
        let mammogram = Mammogram { energy_kev, pixel_mm, exposure, seed: SEED };
        let mammograms = run.stage("", &mammogram, &phantom)?;
        let quality = Quality { energy_kev, pixel_mm };
        outcome.metrics.push(run.stage("", &quality, (&phantom, &mammograms))?);
        if let Some(plan) = monte_carlo {
            let transport = MonteCarlo { plan, energy_kev, pixel_mm, seed: SEED };
            outcome.metrics.push(run.stage("", &transport, (&phantom, &mammograms))?);
        }
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
