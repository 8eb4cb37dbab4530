//! How much the tube gives and how much of it the detector counts: one anchor at 46 mm.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    detector::{Detector, Noise},
    dose::{DoseBeam, DoseError, average_glandular_dose},
    focal_spot::FocalSpot,
    geometry::Geometry,
    spectrum::{Spectrum, UnknownBeam},
};
use mammotwin_data::study::{AbsorberPlan, MammogramPlan, QuantumNoise};

/// A mammography unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// Focal spot and pixels.
    pub geometry: Geometry,
    /// Photons by energy.
    pub spectrum: Spectrum,
    /// Detector.
    pub detector: Detector,
    /// The same beam as the dose tables know it.
    pub dose_beam: DoseBeam,
    /// The paddle in the beam, if it counts.
    pub paddle: Option<Absorber>,
    /// What lies between breast and detector, if it counts.
    pub receptor: Option<Absorber>,
    /// Where photons leave the target.
    pub focal_spot: FocalSpot,
    /// Share of the photons that is missing for each 100 mm away from the chest wall.
    pub heel_per_100mm: f64,
}

/// A flat absorber across the whole beam.
#[derive(Debug, Clone, PartialEq)]
pub struct Absorber {
    /// What it is made of.
    pub material: Material,
    /// Thickness (mm).
    pub thickness_mm: f64,
}

impl Absorber {
    fn of(plan: &AbsorberPlan) -> Result<Self, AttenuationError> {
        let material = Material::named(&plan.material)?;
        Ok(Self { material, thickness_mm: plan.thickness_mm })
    }
}

/// Why there is no unit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnitError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// No such spectrum.
    #[error(transparent)]
    Beam(#[from] UnknownBeam),
}

/// Air (mm) between focal spot and breast that hardens the beam of a tube.
const AIR_MM: f64 = 560.0;
/// The paddle (mm of PMMA) of a tube's beam for which none is stated: that of the dose tables.
const PADDLE_MM: f64 = 2.5;

impl Unit {
    /// Senographe Pristina as the thesis simulates it (Mîra 2018, § 5.2.1), with the published
    /// light spread of the Essential's scintillator.
    pub fn pristina(pixel_mm: f64, energy_kev: f64) -> Self {
        Self {
            geometry: Geometry::pristina(pixel_mm),
            spectrum: Spectrum::mono(energy_kev),
            detector: Detector::essential(),
            dose_beam: DoseBeam::rhodium_silver_34_kvp(),
            paddle: None,
            receptor: None,
            focal_spot: FocalSpot::point(),
            heel_per_100mm: 0.0,
        }
    }

    /// The unit of a study. The spectrum of a tube is that behind air, its paddle is 2.5 mm of PMMA unless
    /// the study states one, its doses are those of its own half-value layer, and light spreads its noise:
    /// white noise of the anchor's SNR would ask for more quanta than photons.
    pub fn of(plan: &MammogramPlan) -> Result<Self, UnitError> {
        let around = &plan.unit;
        let absorber = |plan: &Option<AbsorberPlan>| plan.as_ref().map(Absorber::of).transpose();
        let mut unit = Self {
            geometry: Geometry::covering(around.source_height_mm, around.field_mm, plan.pixel_mm),
            paddle: absorber(&around.paddle)?,
            receptor: absorber(&around.receptor)?,
            focal_spot: around.focal_spot.as_ref().map_or_else(FocalSpot::point, FocalSpot::of),
            heel_per_100mm: around.heel_per_100mm,
            ..Self::pristina(plan.pixel_mm, plan.energy_kev)
        };
        unit.detector.electronic_noise = around.electronic_noise_quanta;
        unit.detector.lag = around.lag;
        unit.detector.noise = match (around.noise, &plan.beam) {
            (Some(QuantumNoise::BeforeLight), _) | (None, Some(_)) => Noise::BeforeLight,
            (Some(QuantumNoise::AfterLight), _) | (None, None) => Noise::AfterLight,
        };
        if let Some(beam) = &plan.beam {
            let tube = Spectrum::of_tube(&beam.target_filter, beam.kv)?;
            unit.spectrum = tube.behind(&Material::named("air")?, AIR_MM)?.of_all();
            let pmma = Absorber { material: Material::named("pmma")?, thickness_mm: PADDLE_MM };
            let paddle = unit.paddle.get_or_insert(pmma);
            let behind = unit.spectrum.behind(&paddle.material, paddle.thickness_mm)?;
            unit.dose_beam = DoseBeam {
                target_filter: beam.target_filter.clone(),
                hvl_mm_al: behind.hvl_mm_al()?,
            };
        }
        Ok(unit)
    }

    /// Attenuation (no unit) of paddle and receptor along the shortest way, at an energy (keV).
    pub fn plates(&self, energy_kev: f64) -> Result<f64, AttenuationError> {
        let mut sum = 0.0;
        for plate in self.paddle.iter().chain(&self.receptor) {
            sum += plate.material.attenuation_per_mm(energy_kev)? * plate.thickness_mm;
        }
        Ok(sum)
    }

    /// Share of the photons that pass tissue, paddle and receptor along the shortest way.
    fn transmission(&self, tissue: &Material, path_mm: f64) -> Result<f64, AttenuationError> {
        let mut sum = 0.0;
        for line in &self.spectrum.lines {
            let depth = tissue.attenuation_per_mm(line.energy_kev)? * path_mm;
            sum += line.share * (-depth - self.plates(line.energy_kev)?).exp();
        }
        Ok(sum)
    }
}

/// A phantom whose picture and dose are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Mass fraction of gland.
    pub glandularity: f64,
    /// Mean over SD of pixels of 0.1 mm in a flat area.
    pub snr: f64,
    /// Average glandular dose (mGy).
    pub agd_mgy: f64,
}

impl Default for Anchor {
    /// 46 mm of 20 % gland. The thesis measured signal and SNR of this phantom but prints
    /// neither them nor the kerma. Taken instead from its table 5.10: SNR 132, the mean of
    /// volunteer 2 (126.9 at 48 mm and 137.2 at 46 mm; volunteer 1's 83 ± 43 holds the slope of
    /// the breast's rim), and the AGD of volunteer 1 at 46 mm, 1.15 mGy.
    fn default() -> Self {
        Self { thickness_mm: 46.0, glandularity: 0.2, snr: 132.0, agd_mgy: 1.15 }
    }
}

/// Pixel pitch (mm) that the SNR of an [`Anchor`] belongs to.
const ANCHOR_PITCH_MM: f64 = 0.1;

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// The anchor has no dose.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// More quanta counted than photons there.
    #[error(
        "the anchor wants {efficiency:.2} counted quanta for each photon that reaches the \
         detector: its SNR is too high for its dose; quantum noise before the spread of light needs fewer \
         (mammogram.unit.noise = \"before_light\")"
    )]
    Efficiency {
        /// Counted quanta per photon.
        efficiency: f64,
    },
}

/// What the anchor implies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Quanta per pixel of the unit that the anchor's SNR needs: the signal that automatic
    /// exposure holds.
    pub quanta_per_pixel: f64,
    /// Photons per mm² below the focal spot, without object and paddle.
    pub photons_per_mm2: f64,
    /// Incident air kerma (mGy) at the upper surface of the anchor.
    pub kerma_mgy: f64,
    /// Counted quanta per photon that reaches the detector (grid, cover, absorption), that is what passes
    /// plates that are in the beam.
    pub efficiency: f64,
}

/// Solves the anchor: its SNR sets the counted quanta, its dose the kerma and so the photons,
/// and both together the efficiency of the detector.
pub fn calibrate(anchor: &Anchor, unit: &Unit) -> Result<Calibration, CalibrationError> {
    let tissue = Material::breast(anchor.glandularity)?;
    let per_dose =
        average_glandular_dose(1.0, anchor.thickness_mm, anchor.glandularity, &unit.dose_beam)?;
    let kerma_mgy = anchor.agd_mgy / per_dose.agd_mgy;
    let photons_per_mm2 = kerma_mgy / unit.kerma_mgy(1.0, anchor.thickness_mm)?;

    let pitch_mm = unit.geometry.pitch_mm;
    let quanta_per_mm2 = anchor.snr.powi(2) * unit.detector.noise_power(ANCHOR_PITCH_MM)
        / (ANCHOR_PITCH_MM * ANCHOR_PITCH_MM);
    let transmission = unit.transmission(&tissue, anchor.thickness_mm)?;
    let efficiency = quanta_per_mm2 / (photons_per_mm2 * transmission);
    if efficiency > 1.0 {
        return Err(CalibrationError::Efficiency { efficiency });
    }
    let quanta_per_pixel = quanta_per_mm2 * pitch_mm * pitch_mm;
    Ok(Calibration { quanta_per_pixel, photons_per_mm2, kerma_mgy, efficiency })
}

impl Unit {
    /// Incident air kerma (mGy) behind the paddle at a height above the detector, of photons per mm² on
    /// the detector without either.
    pub fn kerma_mgy(&self, photons_per_mm2: f64, height_mm: f64) -> Result<f64, AttenuationError> {
        let air = Material::named("air")?;
        let of_one = match &self.paddle {
            Some(plate) => self.spectrum.kerma_mgy_mm2(&plate.material, plate.thickness_mm)?,
            None => self.spectrum.kerma_mgy_mm2(&air, 0.0)?,
        };
        Ok(photons_per_mm2 * self.geometry.closer(height_mm) * of_one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_anchor_gets_its_quanta_and_its_dose_at_any_pixel_size() {
        for pixel_mm in [0.1, 0.2] {
            let unit = Unit::pristina(pixel_mm, 24.0);
            let got = calibrate(&Anchor::default(), &unit).unwrap();
            assert!(
                (got.quanta_per_pixel / (132.0 * 132.0 * (10.0 * pixel_mm).powi(2)) - 1.0).abs()
                    < 1e-12
            );
            let dose = average_glandular_dose(got.kerma_mgy, 46.0, 0.2, &unit.dose_beam).unwrap();
            assert!((dose.agd_mgy / 1.15 - 1.0).abs() < 1e-12);
            // Half of the photons behind the breast are counted: a grid and a CsI layer do that.
            assert!((got.efficiency - 0.478).abs() < 0.002, "{got:?}");
            assert!((got.kerma_mgy - 3.194).abs() < 0.002, "{got:?}");
        }
    }

    #[test]
    fn more_quanta_than_photons_are_refused() {
        let anchor = Anchor { snr: 200.0, ..Anchor::default() };
        let refused = calibrate(&anchor, &Unit::pristina(0.1, 24.0));
        assert!(matches!(refused, Err(CalibrationError::Efficiency { .. })));
    }
}
