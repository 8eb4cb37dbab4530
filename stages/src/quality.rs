//! Image quality and dose of the pictures.

use crate::{
    artifact::{load_json, save_json},
    clamp::ClampCourse,
    mammogram::Mammograms,
    phantom::CompressedPhantom,
};
use mammotwin_data::{
    Failure,
    metric::Metric,
    progress::Progress,
    store::{Artifact, Stage},
};
use mammotwin_imaging::xray::{
    calibration::Unit,
    dose::average_glandular_dose,
    quality::{RoiQuality, detectability, quality, summary},
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Measures signal, contrast and noise around each microcalcification, and the dose.
#[derive(Debug, Clone, Serialize)]
pub struct Quality;

/// Numbers of the report.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// In the order of the report.
    pub metrics: Vec<Metric>,
    /// Regions of interest of each picture, where the numbers come from such.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<PictureRegions>,
    /// What standard deviations of the numbers rest on, or why there are none, where the study asks for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deviations: Option<String>,
    /// A compression in time, where the numbers come from one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub course: Option<ClampCourse>,
}

/// Regions of interest of one picture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureRegions {
    /// Diameter of the microcalcifications (mm).
    pub diameter_mm: f64,
    /// Around each microcalcification.
    pub regions: Vec<RoiQuality>,
}

impl Artifact for Metrics {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

/// Means of the thesis' rigid paddle, volunteer 1 and 2 (fig. 5.10): orders of magnitude.
const THESIS_SNR: f64 = 126.89;
const THESIS_SDNR: [(f64, f64); 2] = [(0.2, 1.14), (0.3, 2.96)];
const THESIS_AGD_MGY: f64 = 1.20;

impl Stage for Quality {
    const NAME: &'static str = "quality";
    const VERSION: u32 = 4;
    const METHODS: &'static str = "Signal-to-noise and signal-difference-to-noise ratios are those of Mîra (2018, \
         eqs. 5.1-5.5) in squares of 1 cm, as printed and with the plane of the background removed. \
         Average glandular dose is K g c s (Dance, Phys. Med. Biol. 45 (2000) 3225).";
    type Input = (CompressedPhantom, Mammograms);
    type Output = Metrics;

    fn run(
        &self,
        (phantom, mammograms): &Self::Input,
        _: &dyn Progress,
    ) -> Result<Metrics, Failure> {
        let refuse = |cause: &dyn std::fmt::Display| Failure::BadInput(format!("quality: {cause}"));
        let unit = Unit::of(&phantom.plan).map_err(|c| refuse(&c))?;
        let (mut metrics, mut measured) = (Vec::new(), Vec::new());
        for (technique, picture) in mammograms.techniques.iter().zip(&mammograms.pictures) {
            let one = phantom.with_diameter(technique.diameter_mm).map_err(|c| refuse(&c))?;
            let regions = quality(picture, &one, &unit.geometry).map_err(|c| refuse(&c))?;
            let um = (1000.0 * technique.diameter_mm).round();
            let thesis = THESIS_SDNR.iter().find(|(d, _)| *d == technique.diameter_mm);
            let mut add = |name: &str, long: &str, of: &dyn Fn(&RoiQuality) -> f64, thesis| {
                let Some(found) = summary(&regions, of) else { return };
                let long = format!("{long}, {um} µm, {} regions", regions.len());
                let source = "Mîra 2018, eqs. 5.1-5.5";
                let mean = format!("{name}_{um}um_mean");
                let metric = Metric::new(&mean, &format!("{long}: mean"), "", found.mean, source);
                metrics.push(Metric { thesis, ..metric });
                let sd = format!("{name}_{um}um_sd");
                metrics.push(Metric::new(&sd, &format!("{long}: SD"), "", found.sd, source));
            };
            add("snr", "SNR as printed", &|r| r.printed.snr, Some(THESIS_SNR));
            add("snr_detrended", "SNR, plane removed", &|r| r.detrended.snr, None);
            add("sdnr", "SDNR as printed", &|r| r.printed.sdnr, thesis.map(|t| t.1));
            add("sdnr_detrended", "SDNR, plane removed", &|r| r.detrended.sdnr, None);
            measured.push(PictureRegions {
                diameter_mm: technique.diameter_mm,
                regions: regions.clone(),
            });
            if let Some(index) = detectability(&regions) {
                let long = format!("detectability index d', {um} µm, {} regions", regions.len());
                let source = "observer who knows signal and white noise (Barrett and Myers 2004)";
                let name = format!("detectability_{um}um");
                metrics.push(Metric::new(&name, &long, "", index, source));
            }
        }
        if let Some(technique) = mammograms.techniques.first() {
            let kerma = technique.kerma_mgy;
            let (thickness, gland) = (phantom.thickness_mm, phantom.glandularity);
            let dose = average_glandular_dose(kerma, thickness, gland, &unit.dose_beam)
                .map_err(|c| refuse(&c))?;
            let mut add = |name: &str, long: &str, unit: &str, value: f64, source: &str| {
                metrics.push(Metric::new(name, long, unit, value, source));
            };
            let agd = "average glandular dose K g c s";
            add("agd_mgy", agd, "mGy", dose.agd_mgy, "Dance 2000; anchor: 1.15 mGy at 46 mm");
            add("kerma_mgy", "incident air kerma K", "mGy", dose.kerma_mgy, "flux of the picture");
            add("dance_g", "Dance factor g", "mGy/mGy", dose.g, "Dance 1990, 2000");
            add("dance_c", "Dance factor c", "", dose.c, "Monte Carlo of Dance's model");
            add("dance_s", "Dance factor s", "", dose.s, "Monte Carlo of Dance's model");
            let controls = [
                ("agd_automatic_mgy", "dose under automatic exposure"),
                ("agd_fixed_mgy", "dose with the photons of the 46 mm phantom"),
            ];
            for ((name, long), kerma) in controls.into_iter().zip(technique.kerma_of_controls_mgy) {
                if let Some(kerma) = kerma {
                    let of_control = dose.agd_mgy / dose.kerma_mgy * kerma;
                    add(name, long, "mGy", of_control, "Dance 2000; anchor: 1.15 mGy at 46 mm");
                }
            }
            let shares = "gland in front of the detector's edge, without skin";
            let counted = match phantom.gland {
                Some(_) => "labels, carried by the tissue",
                None => "study",
            };
            add("glandularity", &format!("{shares}, by mass"), "", gland, counted);
            let by_volume = phantom.gland_volume_share;
            add("gland_volume_share", &format!("{shares}, by volume"), "", by_volume, counted);
            for metric in metrics.iter_mut().filter(|m| m.name == "agd_mgy") {
                metric.thesis = Some(THESIS_AGD_MGY);
            }
        }
        Ok(Metrics { metrics, regions: measured, ..Metrics::default() })
    }
}
