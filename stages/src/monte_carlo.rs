//! Dose and scatter in the true shape of the compressed breast, by Monte Carlo.

use crate::{mammogram::Mammograms, phantom::CompressedPhantom, quality::Metrics};
use mammotwin_data::{
    Failure, metric::Metric, progress::Progress, store::Stage, study::MonteCarloPlan,
};
use mammotwin_imaging::xray::{
    attenuation::Material,
    calibration::Unit,
    dose::average_glandular_dose,
    spectrum::Spectrum,
    transport::{
        exam::{Exam, Setup, examine},
        photon::Histories,
        tally::Estimate,
    },
};
use serde::Serialize;

/// Radius (mm) around the middle of the microcalcifications in which scatter is averaged.
const DISC_MM: f64 = 20.0;

/// Follows photons of the picture's tube, or of the dose tables' beam (34 kV Rh/Ag) for a picture of one
/// energy, behind the paddle, through the breast.
#[derive(Debug, Clone, Serialize)]
pub struct MonteCarlo {
    /// How many photons.
    pub plan: MonteCarloPlan,
    /// Seed of the photons.
    pub seed: u64,
}

impl MonteCarlo {
    fn examine(&self, phantom: &CompressedPhantom, unit: &Unit) -> Result<Exam, Failure> {
        let refuse =
            |cause: &dyn std::fmt::Display| Failure::BadInput(format!("monte_carlo: {cause}"));
        let thickness = phantom.thickness_mm;
        let (body, inclusions) = phantom.body().map_err(|c| refuse(&c))?;
        let paddle = Material::named("pmma").map_err(|c| refuse(&c))?;
        let (name, kv) = match &phantom.plan.beam {
            Some(beam) => (beam.target_filter.as_str(), beam.kv),
            None => ("Rh/Ag", 34),
        };
        let tube = Spectrum::of_tube(name, kv).map_err(|c| refuse(&c))?;
        let beam = tube.behind(&paddle, 2.5).map_err(|c| refuse(&c))?.of_all();
        let usual = Setup::usual(phantom.glandularity).map_err(|c| refuse(&c))?;
        let tissue = phantom.tissue().map_err(|c| refuse(&c))?;
        let setup =
            Setup { paddle_mm: 0.0, kerma_height_mm: Some(thickness), tissue, inclusions, ..usual };
        let histories = Histories { photons: self.plan.photons, seed: self.seed };
        examine(body, &setup, &unit.geometry, &beam, histories).map_err(|c| refuse(&c))
    }
}

impl Stage for MonteCarlo {
    const NAME: &'static str = "monte_carlo";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "Dose and scatter in the compressed breast itself were computed by Monte Carlo photon \
         transport (photoelectric effect, Compton scatter with incoherent scattering functions, Rayleigh \
         scatter with form factors; checked against case 3 of AAPM TG-195), with 34 kV Rh/Ag unless the study names another beam.";
    type Input = (CompressedPhantom, Mammograms);
    type Output = Metrics;

    fn run(
        &self,
        (phantom, mammograms): &Self::Input,
        _: &dyn Progress,
    ) -> Result<Metrics, Failure> {
        let refuse =
            |cause: &dyn std::fmt::Display| Failure::BadInput(format!("monte_carlo: {cause}"));
        let unit = Unit::of(&phantom.plan).map_err(|c| refuse(&c))?;
        let exam = self.examine(phantom, &unit)?;
        let mut metrics = Vec::new();
        let mut add = |name: &str, long: &str, unit: &str, value: f64| {
            metrics.push(Metric::new(name, long, unit, value, "Monte Carlo photon transport"));
        };
        if let Some(technique) = mammograms.techniques.first() {
            let (thickness, gland) = (phantom.thickness_mm, phantom.glandularity);
            let dance = average_glandular_dose(1.0, thickness, gland, &unit.dose_beam)
                .map_err(|c| refuse(&c))?;
            let dose = exam.dose_per_kerma.times(technique.kerma_mgy);
            add("mc_agd_mgy", "average glandular dose, Monte Carlo", "mGy", dose.mean);
            add("mc_agd_error_mgy", "its standard error", "mGy", dose.error);
            let over = exam.dose_per_kerma.mean / dance.agd_mgy;
            add("mc_over_dance", "dose by Monte Carlo over K g c s", "", over);
        }
        let sites = match mammograms.techniques.first() {
            Some(technique) => {
                phantom.with_diameter(technique.diameter_mm).map_err(|c| refuse(&c))?.calcifications
            }
            None => Vec::new(),
        };
        let count = sites.len() as f64;
        let shadow = |axis: usize| {
            let sum: f64 =
                sites.iter().map(|c| unit.geometry.shadow_mm(&c.site.center)[axis]).sum();
            sum / count
        };
        let [x0, y0] = [shadow(0), shadow(1)];
        let disc = |x: f64, y: f64| (x - x0).hypot(y - y0) < DISC_MM;
        let mut ratio = |name: &str, long: &str, found: Option<Estimate>| {
            if let Some(found) = found {
                add(name, long, "", found.mean);
                add(&format!("{name}_error"), "its standard error", "", found.error);
            }
        };
        let around = "scatter over primary energy around the microcalcifications";
        ratio("scatter_to_primary", &format!("{around}, no grid"), exam.scatter_to_primary(disc));
        ratio(
            "scatter_to_primary_grid",
            &format!("{around}, behind a grid"),
            exam.behind_grid(disc),
        );
        Ok(Metrics { metrics, ..Metrics::default() })
    }
}
