//! The pipeline: one function whose calls are the graph.

mod discover;
mod fiducials;
mod labels;
mod measured;
mod uncertain;

pub use discover::{Found, discover};
pub(crate) use measured::{Fitted, fitted, measured};
pub use measured::{Measured, PoseOutcome, ScanOutcome, Target};
use uncertain::{deviate, raised};
pub(crate) use uncertain::{stiffer, varied};

use mammotwin_data::{
    Failure,
    io::dicom::Intent,
    labels::LabelMap,
    store::{Entry, Run, Stage, State, Stored},
    study::{CompressPlan, Gland as Where, MeshPlan, Pose, Study, Use},
    surface::TriMesh,
};
use mammotwin_stages::{
    calibrate::{Calibrate, Calibration},
    clamp::Clamp,
    comfort::Comfort,
    compress::{Compress, Compression},
    deliver::{
        Deliver, DicomPicture, PhantomLegend, PhantomMeta, PhantomNifti, RawPicture, Report,
        ShownPicture, SixteenBits,
    },
    fiducials::Fiducials,
    gland::Gland,
    mammogram::{Mammogram, Mammograms},
    mesh::{BreastMesh, Mesh},
    monte_carlo::MonteCarlo,
    muscle::PectoralMuscle,
    phantom::{CompressedPhantom, Phantom},
    quality::{Metrics, Quality},
    results::{Provenance, StageRecord},
    segment::{Segment, Segmented},
    validate::{Validate, Validation},
};
use std::collections::BTreeMap;

/// Seed of everything random in a run: shapes of microcalcifications and quantum noise.
const SEED: u64 = 1;
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
    /// What was measured.
    pub measured: Measured,
    /// Tetrahedra of the reference pose.
    pub mesh: Stored<BreastMesh>,
    /// Stress-free shape and moduli.
    pub calibration: Stored<Calibration>,
    /// By pose name.
    pub validations: BTreeMap<String, Stored<Validation>>,
    /// Markers on the breasts, by pose name.
    pub fiducials: BTreeMap<String, Stored<Fiducials>>,
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

/// Calls the stages of a study.
pub fn run(study: &Study, run: &Run<'_>) -> Result<Outcome, Failure> {
    let mut outcome = body(study, run)?;
    if let Some(plan) = &study.compress {
        let mut squeezed = squeeze(study, plan, "", run, &outcome)?;
        if study.comfort.uncertainty {
            let raised = raised(study, [plan].into_iter(), &outcome, run)?;
            deviate(study, plan, "", run, (&outcome, raised.as_ref()), &mut squeezed)?;
        }
        outcome.squeezed = Some(squeezed);
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
    let raised = raised(study, ways.iter().map(|(_, plan)| plan), &outcome, run)?;
    let one = |(label, plan): &(String, CompressPlan)| {
        let mut squeezed = match squeeze(study, plan, label, run, &outcome) {
            Err(Failure::Numerics(why) | Failure::BadInput(why)) => return Ok(Err(why)),
            found => found?,
        };
        if study.comfort.uncertainty {
            deviate(study, plan, label, run, (&outcome, raised.as_ref()), &mut squeezed)?;
        }
        Ok(Ok(squeezed))
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
    let measured = measured(study, &reference, run)?;
    let one = |(label, meshing): &(String, MeshPlan)| {
        let (mesh, calibration) = calibrated(study, *meshing, &measured, label, run)?;
        let squeezed = Outcome {
            reference: reference.clone(),
            measured: measured.clone(),
            mesh,
            calibration,
            validations: BTreeMap::new(),
            fiducials: BTreeMap::new(),
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

/// From images to stress-free shape and moduli.
pub(crate) fn body(study: &Study, run: &Run<'_>) -> Result<Outcome, Failure> {
    let reference = study.reference_pose().to_owned();
    let measured = measured(study, &reference, run)?;
    let (mesh, calibration) = calibrated(study, study.mesh, &measured, "", run)?;

    let mut validations = BTreeMap::new();
    for target in measured.targets(study) {
        let Target { name, usage, registered, surfaces } = target;
        if usage == Use::Validate {
            let validate = Validate { model: study.model.clone(), pose: name.clone() };
            let inputs = (&mesh, &calibration, registered, surfaces);
            validations.insert(name.clone(), run.stage(name, &validate, inputs)?);
        }
    }
    let fitted = (&mesh, &calibration);
    let fiducials = fiducials::fiducials(study, &measured.images, fitted, &validations, run)?;
    Ok(Outcome { reference, measured, mesh, calibration, validations, fiducials, squeezed: None })
}

/// The mesh of a pose with these labels, with its muscle where that is deformable.
pub(crate) fn meshed(
    study: &Study,
    meshing: MeshPlan,
    label: &str,
    labels: &Stored<LabelMap>,
    run: &Run<'_>,
) -> Result<Stored<BreastMesh>, Failure> {
    let mesh = run.stage(label, &Mesh(meshing), labels)?;
    match study.model.muscle.rigid {
        true => Ok(mesh),
        false => run.stage(label, &PectoralMuscle, (&mesh, labels)),
    }
}

/// The mesh of the reference pose, stress-free shape and moduli, with elements of one's own choice.
fn calibrated(
    study: &Study,
    meshing: MeshPlan,
    measured: &Measured,
    label: &str,
    run: &Run<'_>,
) -> Result<(Stored<BreastMesh>, Stored<Calibration>), Failure> {
    let reference = study.reference_pose();
    let first = &measured.images[reference];
    let mesh = meshed(study, meshing, label, &first.labels, run)?;
    let Fitted { names, motions, surfaces } = fitted(study, measured);
    let calibrate = Calibrate {
        model: study.model.clone(),
        plan: study.calibrate.clone(),
        gravity: gravity(reference, &study.poses[reference])?,
        reference: reference.into(),
        poses: names,
    };
    let inputs = (&mesh, &first.surfaces, &motions[..], &surfaces[..]);
    let calibration = run.stage(label, &calibrate, inputs)?;
    Ok((mesh, calibration))
}

/// The files that people open.
fn deliver(study: &Study, run: &Run<'_>, outcome: &Outcome) -> Result<(), Failure> {
    let provenance = provenance(run);
    let validations: Vec<_> = outcome.validations.values().cloned().collect();
    let fiducials: Vec<_> = outcome.fiducials.values().cloned().collect();
    let Outcome { mesh, calibration, squeezed, .. } = outcome;
    let part = squeezed.as_ref();
    let metrics = part.map_or(&[][..], |part| &part.metrics);
    let phantom = part.and_then(|part| part.phantom.as_ref());

    let Fitted { names: moving, motions: moved, .. } =
        Fitted::of(outcome.measured.targets(study).into_iter());
    let images = &outcome.measured.images;
    let measured = images.keys().cloned().collect();
    let measures: Vec<_> = images.values().map(|pose| pose.measures.clone()).collect();
    let segmented = segmented(run);
    let deliver = Deliver {
        study: study.without_files(),
        moving,
        measured,
        segmented: segmented.clone(),
        provenance: provenance.clone(),
    };
    let squeezed = part.map(|part| &part.compression);
    let taken = part.and_then(|part| part.mammograms.as_ref());
    let tested = (&validations[..], &fiducials[..]);
    let inputs = (mesh, calibration, tested, &moved[..], squeezed, taken, metrics, &measures[..]);
    let results = run.stage("", &deliver, inputs)?;
    run.export("results.h5", &results)?;

    // The reference pose first.
    let mut names: Vec<&String> = images.keys().collect();
    names.sort_by_key(|name| **name != outcome.reference);
    let of = |name: &&String| &images[*name];
    let pictures: Vec<_> = names.iter().map(|n| of(n).pictures.clone()).collect();
    let surfaces: Vec<_> = names.iter().map(|n| of(n).surfaces.clone()).collect();
    let measures: Vec<_> = names.iter().map(|n| of(n).measures.clone()).collect();
    let motions: Vec<_> = names.iter().filter_map(|n| of(n).registered.clone()).collect();
    let mut warnings = vec![NO_DEVICE.to_owned()];
    let said = study.poses.iter().map(|(name, pose)| (name, &pose.warning));
    let scanned = study.scans.iter().map(|(name, scan)| (name, &scan.warning));
    let said = said.chain(scanned).filter_map(|(name, text)| Some((name, text.as_ref()?)));
    warnings.extend(said.map(|(name, text)| format!("{name}: {text}")));
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
        segmented,
        model: study.model.clone(),
        parameters: study.calibrate.parameters.clone(),
        provenance,
    };
    let images = (&pictures[..], &surfaces[..], &measures[..], &motions[..]);
    let mechanics = (mesh, calibration, &validations[..], &fiducials[..]);
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

/// What the segmentation says of the labels that are used; nothing of those that a person gave or changed.
fn segmented(run: &Run<'_>) -> Segmented {
    let own = |entry: Entry| {
        let fresh = entry.stage == Segment::NAME && entry.state == State::Fresh;
        entry.record.filter(|_| fresh).map(|record| (entry.label, record.notes))
    };
    run.calls().into_iter().filter_map(own).collect()
}

/// The compression alone.
fn press(
    study: &Study,
    plan: &CompressPlan,
    label: &str,
    run: &Run<'_>,
    (mesh, calibration): (&Stored<BreastMesh>, &Stored<Calibration>),
) -> Result<Stored<Compression>, Failure> {
    let cad: Option<Stored<TriMesh>> = match &plan.cad {
        Some(cad) => Some(run.external("compress.cad.file", &cad.file)?),
        None => None,
    };
    let elastic = plan.clone().without_files().without_clamp();
    let compress = Compress { model: study.model.clone(), plan: elastic };
    run.stage(label, &compress, (mesh, calibration, cad.as_ref()))
}

/// Compression, picture and metrics.
fn squeeze(
    study: &Study,
    plan: &CompressPlan,
    label: &str,
    run: &Run<'_>,
    Outcome { reference, measured, mesh, calibration, .. }: &Outcome,
) -> Result<Squeezed, Failure> {
    let compression = press(study, plan, label, run, (mesh, calibration))?;
    let comfort = Comfort { plan: study.comfort.without_uncertainty() };
    let mut metrics = vec![run.stage(label, &comfort, &compression)?];
    if let Some(clamp) = &plan.clamp {
        metrics.push(run.stage(label, &Clamp { plan: clamp.clone() }, &compression)?);
    }
    let (mut phantom, mut mammograms) = (None, None);
    if let Some(plan) = &study.mammogram {
        let gland = match plan.gland {
            Where::Segmented => {
                let inputs = (&measured.images[reference].labels, mesh, &compression);
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
