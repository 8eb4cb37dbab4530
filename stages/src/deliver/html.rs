//! `report.html` as a stage.

use super::{clamping, fits, scenes::scenes, sections};
use crate::{
    align,
    artifact::bytes_artifact,
    calibrate::{self, Calibration},
    clamp, comfort, compress,
    compress::Compression,
    fiducials::{Carry, Fiducials},
    mammogram,
    mammogram::Mammograms,
    measure,
    measure::PoseMeasures,
    mesh,
    mesh::BreastMesh,
    phantom,
    phantom::CompressedPhantom,
    pictures::PosePictures,
    quality,
    quality::Metrics,
    register,
    register::Registered,
    report::{self, ReportInput},
    results::Provenance,
    segment::{self, Segmented},
    stiffer::Deviations,
    surface,
    surface::PoseSurfaces,
    validate,
    validate::Validation,
};
use mammotwin_data::{
    Failure, Vec3, mesh::TetMesh, progress::Progress, store::Stage, study::ModelPlan,
};
use serde::Serialize;

/// Writes what was found into one page for people.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Pseudonym of the person.
    pub subject: String,
    /// Names of the poses, the reference first, in the order of the inputs.
    pub poses: Vec<String>,
    /// What a reader must know first.
    pub warnings: Vec<String>,
    /// What the segmentation says of its labels.
    pub segmented: Segmented,
    /// Tissues and supports.
    pub model: ModelPlan,
    /// Study keys of what was fitted.
    pub parameters: Vec<String>,
    /// Version and stages that made the results.
    pub provenance: Provenance,
}

bytes_artifact!("The text of `report.html`.", ReportFile, "html");

/// What was made of the images: cuts, surfaces and measures of all poses, motions of all but the first.
pub type Images = (Vec<PosePictures>, Vec<PoseSurfaces>, Vec<PoseMeasures>, Vec<Registered>);
/// What was made of the reference pose, of the poses that were held out, and of the markers.
pub type Mechanics = (BreastMesh, Calibration, Vec<Validation>, Vec<Fiducials>);
/// What was made of the compression.
pub type Squeezed =
    (Option<Compression>, Option<CompressedPhantom>, Option<Mammograms>, Vec<Metrics>);

impl Stage for Report {
    const NAME: &'static str = "report";
    const VERSION: u32 = 10;
    const METHODS: &'static str = "";
    type Input = (Images, Mechanics, Squeezed);
    type Output = ReportFile;

    fn run(
        &self,
        (images, mechanics, squeezed): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<ReportFile, Failure> {
        let (mesh, calibration, validations, fiducials) = mechanics;
        let (compression, phantom, mammograms, metrics) = squeezed;
        progress.report(0.1, "images");
        let told = self.segmented.iter();
        let told = told.flat_map(|(pose, notes)| notes.warnings.iter().map(move |w| (pose, w)));
        let told = told.map(|(pose, warning)| format!("{pose}: {warning}"));
        let mut input = ReportInput {
            subject: self.subject.clone(),
            warnings: self.warnings.iter().cloned().chain(told).collect(),
            poses: sections::poses(&self.poses, images, &self.segmented),
            mesh: Some(sections::mesh(mesh)),
            calibration: Some(sections::calibration(mesh, calibration)),
            validations: validations.iter().map(|v| sections::validation(mesh, v)).collect(),
            compression: compression.as_ref().map(sections::compression),
            scenes: scenes(mesh, calibration, validations, compression.as_ref()),
            metrics: sections::round_trip(calibration)
                .into_iter()
                .chain(fits::metrics(calibration, fiducials))
                .chain(sections::walls(self.poses.get(1..).unwrap_or_default(), &images.3))
                .chain(metrics.iter().flat_map(|m| m.metrics.clone()))
                .collect(),
            methods: methods(
                [!images.3.is_empty(), !validations.is_empty()],
                [compression.is_some(), mammograms.is_some()],
            ),
            provenance: self.provenance.clone(),
            ..ReportInput::default()
        };
        self.fit(&mut input, calibration, fiducials);
        if let (Some(compression), Some(phantom), Some(made)) = (compression, phantom, mammograms) {
            input.mammograms = sections::mammograms(compression, phantom, made);
        }
        if input.metrics.iter().any(|metric| metric.sd.is_some()) {
            input.methods.push(Deviations::METHODS.into());
        }
        for said in metrics.iter().filter_map(|part| part.deviations.as_ref()) {
            input.methods.push(format!("Standard deviations of comfort: {said}."));
        }
        if let (Some(part), Some(course)) = (&mut input.compression, clamping::of(metrics)) {
            part.curves.extend(clamping::charts(course));
            part.facts.push(clamping::fact(course));
            input.methods.push(clamp::Clamp::METHODS.into());
        }
        if !calibration.converged {
            input.warnings.push(
                "The search for the moduli did not come to its end: they are the best of what it tried"
                    .into(),
            );
        }
        let fitted = calibration.after.poses.iter();
        let poses = fitted.chain(validations.iter().map(|held_out| &held_out.after));
        let corners = mesh.corners();
        let told = |state: &str, points: &[Vec3], tets: &[[u32; 4]], mesh: &TetMesh| {
            let stretched = fits::stretched(state, points, tets);
            stretched.into_iter().chain(fits::passes_through_itself(state, mesh, points))
        };
        let poses = poses.flat_map(|fit| {
            let state = format!("Simulated pose {}", fit.pose);
            told(&state, &fit.solution.points, &corners.tets, &mesh.mesh)
        });
        input.warnings.extend(poses);
        let pressed = compression.iter();
        input
            .warnings
            .extend(pressed.flat_map(|c| {
                told("Compressed breast", &c.solution.points, &c.mesh.tets, &c.mesh)
            }));
        if let Some(why) = compression.as_ref().and_then(|c| c.stopped_early.as_ref()) {
            input.warnings.push(format!("The compression ended before its stop rule: {why}"));
        }
        let leaps = compression.as_ref().map(|c| c.curve.leaps()).unwrap_or_default();
        input.warnings.extend(leaps.iter().map(|leap| leap.to_string()));
        input.facts =
            sections::headlines(calibration, validations, compression.as_ref(), &input.metrics);
        input.summary =
            sections::summary(&self.poses, calibration, validations, compression.as_ref());
        progress.report(0.6, "page");
        Ok(ReportFile(report::render(&input)?.into_bytes()))
    }
}

impl Report {
    /// Markers and limits of the fit.
    fn fit(&self, input: &mut ReportInput, calibration: &Calibration, fiducials: &[Fiducials]) {
        for found in fiducials {
            let held_out = input.validations.iter_mut().find(|(pose, _)| *pose == found.pose);
            let part = held_out.map(|(_, part)| part).or(input.calibration.as_mut());
            part.into_iter().for_each(|part| part.facts.extend(fits::markers(found)));
        }
        if let Some(part) = &mut input.calibration {
            part.notes = fits::untold(&self.model, &self.parameters, calibration);
        }
        if fiducials.iter().any(|found| !found.markers.is_empty()) {
            input.methods.push(Carry::METHODS.into());
        }
        input.warnings.extend(calibration.contradiction());
        input.warnings.extend(fits::second_start_warning(calibration));
        input.warnings.extend(fits::marker_warnings(fiducials, self.poses.len() > 1));
    }
}

/// The sentences of the stages that took part, in their order.
fn methods([moved, validated]: [bool; 2], [compressed, pictured]: [bool; 2]) -> Vec<String> {
    let mut sentences = Vec::new();
    if moved {
        sentences.push(align::Align::METHODS);
    }
    sentences.extend([segment::Segment::METHODS, surface::Surface::METHODS]);
    if moved {
        sentences.push(register::Register::METHODS);
    }
    sentences.push(measure::Measure::METHODS);
    sentences.extend([mesh::Mesh::METHODS, calibrate::Calibrate::METHODS]);
    if validated {
        sentences.push(validate::Validate::METHODS);
    }
    if compressed {
        sentences.extend([compress::Compress::METHODS, comfort::Comfort::METHODS]);
    }
    if pictured {
        let of_picture =
            [phantom::Phantom::METHODS, mammogram::Mammogram::METHODS, quality::Quality::METHODS];
        sentences.extend(of_picture);
    }
    sentences.into_iter().map(String::from).collect()
}
