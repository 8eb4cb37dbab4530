//! Mammograms as DICOM files.

use crate::{
    artifact::{bytes_artifact, bytes_of},
    mammogram::Mammograms,
    phantom::CompressedPhantom,
};
use mammotwin_data::{
    Failure,
    io::dicom::{Acquisition, Intent, write_mammogram},
    labels::Side,
    progress::Progress,
    store::Stage,
    study::View,
};
use mammotwin_imaging::xray::{calibration::Unit, dose::average_glandular_dose};
use serde::Serialize;
use std::path::Path;

bytes_artifact!("A mammogram as a DICOM file.", DicomFile, "dcm");

/// Tube voltage (kV) of the beam that doses are computed for where the picture has one energy.
const TUBE_KV: f64 = 34.0;

/// A picture with the attributes of a digital mammography image.
#[derive(Debug, Clone, Serialize)]
pub struct DicomPicture {
    /// Which of the pictures.
    pub number: usize,
    /// Which breast.
    pub side: Side,
    /// From where.
    pub view: View,
    /// What its pixels are for.
    pub intent: Intent,
    /// Pseudonym of the person.
    pub subject: String,
}

impl Stage for DicomPicture {
    const NAME: &'static str = "dicom";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    type Input = (CompressedPhantom, Mammograms);
    type Output = DicomFile;

    fn run(
        &self,
        (phantom, mammograms): &Self::Input,
        _: &dyn Progress,
    ) -> Result<DicomFile, Failure> {
        let taken =
            mammograms.techniques.get(self.number).zip(mammograms.pictures.get(self.number));
        let (technique, signal) = taken.ok_or_else(|| {
            let count = mammograms.pictures.len();
            Failure::BadInput(format!("picture {}: only {count} were taken", self.number))
        })?;
        let refuse = |cause: &dyn std::fmt::Display| Failure::BadInput(format!("dicom: {cause}"));
        let unit = Unit::of(&phantom.plan).map_err(|cause| refuse(&cause))?;
        let (thickness_mm, gland) = (phantom.thickness_mm, phantom.glandularity);
        let dose =
            average_glandular_dose(technique.kerma_mgy, thickness_mm, gland, &unit.dose_beam)
                .map_err(|cause| refuse(&cause))?;
        let acquisition = Acquisition {
            subject: self.subject.clone(),
            description: format!("microcalcifications of {} mm", technique.diameter_mm),
            number: self.number as u32 + 1,
            side: self.side,
            view: self.view,
            thickness_mm,
            source_height_mm: unit.geometry.source_height_mm,
            tube_kv: phantom.plan.beam.as_ref().map_or(TUBE_KV, |beam| f64::from(beam.kv)),
            hvl_mm_al: unit.dose_beam.hvl_mm_al,
            kerma_mgy: technique.kerma_mgy,
            agd_mgy: dose.agd_mgy,
        };
        let write = |path: &Path| {
            write_mammogram(path, signal, &acquisition, self.intent)
                .map_err(|cause| Failure::io(path, cause))
        };
        bytes_of("picture.dcm", write).map(DicomFile)
    }
}
