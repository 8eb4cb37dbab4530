//! The pipeline: one function whose calls are the graph.

use mammotwin_data::{
    Failure,
    io::dicom::Intent,
    labels::LabelMap,
    landmarks::Landmarks,
    store::{Entry, Run, Stored},
    study::{CompressPlan, Elements, Gland as Where, MeshPlan, Pose, Study, Use},
    surface::TriMesh,
    volume::Volume,
};
use mammotwin_stages::{
    align::{Align, Start},
    calibrate::{Calibrate, Calibration},
    clamp::Clamp,
    comfort::Comfort,
    compress::{Compress, Compression},
    deliver::{
        Deliver, DicomPicture, PhantomLegend, PhantomMeta, PhantomNifti, RawPicture, Report,
        ShownPicture, SixteenBits,
    },
    discover::{Discover, Discovery, Evidence, Gather},
    effects::Effect,
    gland::Gland,
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
/// Voxel size (mm) of the phantom's labels.
const LABEL_MM: f64 = 0.5;
/// What the thesis calls a limit of its own: said in every report.
const NO_DEVICE: &str = "A research result, not a medical device; nothing here is a diagnosis.";

/// Said where moduli are those of the study.
const NOT_FITTED: &str = "No modulus was fitted: they are those that the study gives.";
/// Said where nothing tests the model.
const NOT_VALIDATED: &str = "No pose was held out: nothing here shows the error of the model.";
/// Said of every compression; the measure is in `docs/credibility.md`.
const FORCES: &str = "Forces and pressures come out far below measured ones, by ten to a hundred times on the \
    volunteers that were compared: compare compressions with each other, and quote no absolute value.";

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
    /// The compressed breast, if the study asks for one.
    pub squeezed: Option<Squeezed>,
}

/// Handles on what was made of one compression.
#[derive(Debug)]
pub struct Squeezed {
    /// Both breasts before any compression.
    pub mesh: Stored<BreastMesh>,
    /// Stress-free shape and moduli of what was compressed.
    pub calibration: Stored<Calibration>,
    /// The compression.
    pub compression: Stored<Compression>,
    /// The phantom, if the study asks for a picture.
    pub phantom: Option<Stored<CompressedPhantom>>,
    /// The pictures.
    pub mammograms: Option<Stored<Mammograms>>,
    /// Comfort, image quality and dose.
    pub metrics: Vec<Stored<Metrics>>,
}

/// Handles on what was made of one image.
#[derive(Debug, Clone)]
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
    let mut outcome = body(study, run)?;
    if let Some(plan) = &study.compress {
        outcome.squeezed = Some(squeeze(study, plan, "", run, &outcome)?);
    }
    deliver(study, run, &outcome)?;
    Ok(outcome)
}

/// Compresses the breast of a study in several ways, told apart by their labels. A way that cannot
/// be gone is named with the reason; the others are gone.
pub fn squeezes(
    study: &Study,
    ways: &[(String, CompressPlan)],
    run: &Run<'_>,
) -> Result<Vec<Result<Squeezed, String>>, Failure> {
    let outcome = body(study, run)?;
    let one =
        |(label, plan): &(String, CompressPlan)| match squeeze(study, plan, label, run, &outcome) {
            Err(Failure::Numerics(why) | Failure::BadInput(why)) => Ok(Err(why)),
            found => found.map(Ok),
        };
    ways.iter().map(one).collect()
}

/// Presses the breast of a study on other meshes, told apart by their labels; moduli are fitted on each
/// unless the study fits none. A mesh on which there is no equilibrium is named with the reason.
pub fn remeshed(
    study: &Study,
    plan: &CompressPlan,
    meshings: &[(String, MeshPlan)],
    run: &Run<'_>,
) -> Result<Vec<Result<Stored<Compression>, String>>, Failure> {
    let reference = study.reference_pose().to_owned();
    let poses = images(study, &reference, run)?;
    let one = |(label, meshing): &(String, MeshPlan)| {
        let (mesh, calibration) = calibrated(study, *meshing, &poses, label, run)?;
        let squeezed = Outcome {
            reference: reference.clone(),
            poses: poses.clone(),
            mesh,
            calibration,
            validations: BTreeMap::new(),
            squeezed: None,
        };
        Ok(squeeze(study, plan, label, run, &squeezed)?.compression)
    };
    let named = |meshing| match one(meshing) {
        Err(Failure::Numerics(why) | Failure::BadInput(why)) => Ok(Err(why)),
        found => found.map(Ok),
    };
    meshings.iter().map(named).collect()
}

/// The poses that a fit reads, but the reference pose.
pub(crate) struct Fitted {
    pub names: Vec<String>,
    pub motions: Vec<Stored<Registered>>,
    pub surfaces: Vec<Stored<PoseSurfaces>>,
}

pub(crate) fn fitted(study: &Study, poses: &BTreeMap<String, PoseOutcome>) -> Fitted {
    let mut found = Fitted { names: Vec::new(), motions: Vec::new(), surfaces: Vec::new() };
    for (name, pose) in poses {
        if let (Some(registered), Use::Fit) = (&pose.registered, study.poses[name].usage) {
            found.names.push(name.clone());
            found.motions.push(registered.clone());
            found.surfaces.push(pose.surfaces.clone());
        }
    }
    found
}

/// From images to stress-free shape and moduli.
fn body(study: &Study, run: &Run<'_>) -> Result<Outcome, Failure> {
    let reference = study.reference_pose().to_owned();
    let poses = images(study, &reference, run)?;
    let (mesh, calibration) = calibrated(study, study.mesh, &poses, "", run)?;

    let mut validations = BTreeMap::new();
    for (name, pose) in &poses {
        if let (Some(registered), Use::Validate) = (&pose.registered, study.poses[name].usage) {
            let validate = Validate { model: study.model.clone(), pose: name.clone() };
            let inputs = (&mesh, &calibration, registered, &pose.surfaces);
            validations.insert(name.clone(), run.stage(name, &validate, inputs)?);
        }
    }

    Ok(Outcome { reference, poses, mesh, calibration, validations, squeezed: None })
}

/// The mesh of the reference pose, stress-free shape and moduli, with elements of one's own choice.
fn calibrated(
    study: &Study,
    meshing: MeshPlan,
    poses: &BTreeMap<String, PoseOutcome>,
    label: &str,
    run: &Run<'_>,
) -> Result<(Stored<BreastMesh>, Stored<Calibration>), Failure> {
    let reference = study.reference_pose();
    let mesh = run.stage(label, &Mesh(meshing), &poses[reference].labels)?;
    let Fitted { names, motions, surfaces } = fitted(study, poses);
    let calibrate = Calibrate {
        model: study.model.clone(),
        plan: study.calibrate.clone(),
        gravity: gravity(reference, &study.poses[reference])?,
        reference: reference.into(),
        poses: names,
    };
    let inputs = (&mesh, &poses[reference].surfaces, &motions[..], &surfaces[..]);
    let calibration = run.stage(label, &calibrate, inputs)?;
    Ok((mesh, calibration))
}

/// What [`discover`] makes.
#[derive(Debug)]
pub struct Found {
    /// Residuals, their derivatives and errors.
    pub evidence: Stored<Evidence>,
    /// The answer.
    pub discovery: Stored<Discovery>,
}

/// Edges of the quadratic elements with which effects are looked for, over those of a study's linear
/// ones: what linear elements are off is larger than most effects.
const QUADRATIC_EDGE: f64 = 1.25;

/// Calls the stages of a study, and looks for an effect that its model lacks.
pub fn discover(
    study: &Study,
    held_out: &str,
    effects: &[&'static Effect],
    run: &Run<'_>,
) -> Result<Found, Failure> {
    let Outcome { reference, poses, mesh, calibration, .. } = self::run(study, run)?;
    let (meshing, mesh, calibration) = match study.mesh.elements {
        Elements::Quadratic => (study.mesh, mesh, calibration),
        Elements::Linear => {
            let size_mm = QUADRATIC_EDGE * study.mesh.size_mm;
            let meshing = MeshPlan { size_mm, elements: Elements::Quadratic };
            let (mesh, calibration) = calibrated(study, meshing, &poses, "quadratic", run)?;
            (meshing, mesh, calibration)
        }
    };
    let (mut names, mut motions, mut surfaces) = (Vec::new(), Vec::new(), Vec::new());
    for (name, pose) in &poses {
        if let Some(registered) = &pose.registered {
            names.push(name.clone());
            motions.push(registered.clone());
            surfaces.push(pose.surfaces.clone());
        }
    }
    let gather = Gather {
        model: study.model.clone(),
        calibrate: study.calibrate.clone(),
        mesh: meshing,
        gravity: gravity(&reference, &study.poses[&reference])?,
        poses: names,
        reference: reference.clone(),
        effects: effects.iter().map(|effect| effect.name).collect(),
    };
    let first = &poses[&reference];
    let inputs = (&first.labels, &first.surfaces, &mesh, &calibration, &motions[..], &surfaces[..]);
    let evidence = run.stage("", &gather, inputs)?;
    let discover = Discover { gather, held_out: held_out.into() };
    let discovery = run.stage("", &discover, (&evidence, inputs))?;
    run.export("discovery.h5", &discovery)?;
    Ok(Found { evidence, discovery })
}

/// The files that people open.
fn deliver(study: &Study, run: &Run<'_>, outcome: &Outcome) -> Result<(), Failure> {
    let provenance = provenance(run);
    let validations: Vec<_> = outcome.validations.values().cloned().collect();
    let Outcome { mesh, calibration, squeezed, .. } = outcome;
    let part = squeezed.as_ref();
    let metrics = part.map_or(&[][..], |part| &part.metrics);
    let phantom = part.and_then(|part| part.phantom.as_ref());

    let moving = outcome.poses.iter().filter_map(|(name, pose)| {
        pose.registered.clone().map(|registered| (name.clone(), registered))
    });
    let (moving, moved): (Vec<String>, Vec<_>) = moving.unzip();
    let deliver = Deliver { study: study.without_files(), moving, provenance: provenance.clone() };
    let squeezed = part.map(|part| &part.compression);
    let taken = part.and_then(|part| part.mammograms.as_ref());
    let inputs = (mesh, calibration, &validations[..], &moved[..], squeezed, taken, metrics);
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
    let limits = [
        (study.calibrate.parameters.is_empty(), NOT_FITTED),
        (validations.is_empty(), NOT_VALIDATED),
        (part.is_some(), FORCES),
    ];
    warnings.extend(limits.iter().filter(|(holds, _)| *holds).map(|(_, text)| (*text).to_owned()));
    let report = Report {
        subject: study.subject.id.clone(),
        poses: names.into_iter().cloned().collect(),
        warnings,
        provenance,
    };
    let images = (&pictures[..], &surfaces[..], &motions[..]);
    let mechanics = (mesh, calibration, &validations[..]);
    let squeezed = (squeezed, phantom, taken, metrics);
    let report = run.stage("", &report, (images, mechanics, squeezed))?;
    run.export("report.html", &report)?;

    share(study, run, phantom.zip(taken))
}

/// Pictures and phantom as files of other programs.
fn share(
    study: &Study,
    run: &Run<'_>,
    made: Option<(&Stored<CompressedPhantom>, &Stored<Mammograms>)>,
) -> Result<(), Failure> {
    if let (Some((phantom, taken)), Some(plan), Some(picture)) =
        (made, &study.compress, &study.mammogram)
    {
        let voxel_mm = LABEL_MM;
        let labels = run.stage("", &PhantomNifti { voxel_mm }, phantom)?;
        run.export("images/phantom.nii.gz", &labels)?;
        let labels = run.stage("", &PhantomMeta { voxel_mm }, phantom)?;
        run.export("images/phantom.mha", &labels)?;
        let legend = run.stage("", &PhantomLegend, phantom)?;
        run.export("images/phantom.json", &legend)?;
        for (number, diameter_mm) in picture.calcifications.diameter_mm.iter().enumerate() {
            let um = (1000.0 * diameter_mm).round();
            let name = format!("calcifications_{um}um");
            let raw = run.stage(&name, &RawPicture { number }, taken)?;
            run.export(&format!("images/{name}.tiff"), &raw)?;
            let counts = run.stage(&name, &SixteenBits { number }, taken)?;
            run.export(&format!("images/{name}_16bit.tiff"), &counts)?;
            let shown = run.stage(&name, &ShownPicture { number, side: plan.side }, taken)?;
            run.export(&format!("images/{name}.png"), &shown)?;
            for (intent, word) in
                [(Intent::Processing, "for_processing"), (Intent::Presentation, "for_presentation")]
            {
                let dicom = DicomPicture {
                    number,
                    side: plan.side,
                    view: plan.view,
                    intent,
                    subject: study.subject.id.clone(),
                };
                let file = run.stage(&format!("{name}_{word}"), &dicom, (phantom, taken))?;
                run.export(&format!("images/{name}_{word}.dcm"), &file)?;
            }
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
pub(crate) fn images(
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
    label: &str,
    run: &Run<'_>,
    Outcome { reference, poses, mesh, calibration, .. }: &Outcome,
) -> Result<Squeezed, Failure> {
    let cad: Option<Stored<TriMesh>> = match &plan.cad {
        Some(cad) => Some(run.external("compress.cad.file", &cad.file)?),
        None => None,
    };
    let elastic = plan.clone().without_files().without_clamp();
    let compress = Compress { model: study.model.clone(), plan: elastic };
    let compression = run.stage(label, &compress, (mesh, calibration, cad.as_ref()))?;
    let comfort = Comfort { plan: study.comfort };
    let mut metrics = vec![run.stage(label, &comfort, &compression)?];
    if let Some(clamp) = &plan.clamp {
        metrics.push(run.stage(label, &Clamp { plan: clamp.clone() }, &compression)?);
    }
    let (mut phantom, mut mammograms) = (None, None);
    if let Some(plan) = &study.mammogram {
        let gland = match plan.gland {
            Where::Segmented => {
                let inputs = (&poses[reference].labels, mesh, &compression);
                Some(run.stage(label, &Gland::default(), inputs)?)
            }
            Where::Uniform => None,
        };
        let filled = Phantom { plan: plan.clone(), seed: SEED };
        let filled = run.stage(label, &filled, (&compression, gland.as_ref()))?;
        let taken = run.stage(label, &Mammogram { seed: SEED }, &filled)?;
        metrics.push(run.stage(label, &Quality, (&filled, &taken))?);
        if let Some(plan) = plan.monte_carlo {
            let transport = MonteCarlo { plan, seed: SEED };
            metrics.push(run.stage(label, &transport, (&filled, &taken))?);
        }
        (phantom, mammograms) = (Some(filled), Some(taken));
    }
    let (mesh, calibration) = (mesh.clone(), calibration.clone());
    Ok(Squeezed { mesh, calibration, compression, phantom, mammograms, metrics })
}

pub(crate) fn gravity(name: &str, pose: &Pose) -> Result<mammotwin_data::Vec3, Failure> {
    pose.gravity().ok_or_else(|| {
        Failure::BadInput(format!(
            "poses.{name}: no direction of gravity; give posture or gravity_in_image"
        ))
    })
}
