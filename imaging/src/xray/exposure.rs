//! From path lengths to a picture: photons, quanta, noise.

use crate::xray::{
    attenuation::AttenuationError,
    calibration::{Calibration, Unit},
    phantom::Phantom,
    project::Projection,
};
use mammotwin_data::{radiograph::Radiograph, study};
use rayon::prelude::*;

/// Automatic exposure looks where the path in tissue is the nominal thickness within this share.
const BEHIND: f64 = 0.05;

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExposureError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// Automatic exposure sees no breast.
    #[error(
        "no pixel lies behind about {thickness_mm} mm of breast, which automatic exposure needs; \
         check thickness and frame, or exposure = \"fixed\""
    )]
    NothingBehind {
        /// Nominal thickness (mm).
        thickness_mm: f64,
    },
}

/// A mammogram and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposure {
    /// Mean signal (counted quanta per pixel).
    pub signal: Radiograph,
    /// One draw of it, with quantum noise.
    pub noisy: Radiograph,
    /// Photons per mm² below the focal spot, without object.
    pub photons_per_mm2: f64,
    /// Incident air kerma (mGy) at the upper surface of the breast.
    pub kerma_mgy: f64,
}

/// Takes the picture. Automatic exposure brings the mean signal behind the flat part of the breast
/// to that of the anchor; fixed exposure gives what the anchor needed.
pub fn expose(
    phantom: &Phantom,
    projection: &Projection,
    unit: &Unit,
    calibration: &Calibration,
    control: study::Exposure,
    seed: u64,
) -> Result<Exposure, ExposureError> {
    let mut quanta = transmission(phantom, projection, unit)?;
    let pixel_mm2 = quanta.pitch_mm * quanta.pitch_mm;
    let per_photon = pixel_mm2 * calibration.efficiency;
    let photons_per_mm2 = match control {
        study::Exposure::Fixed => calibration.photons_per_mm2,
        study::Exposure::Automatic => {
            let behind = mean_behind(projection, &quanta, phantom.thickness_mm)
                .ok_or(ExposureError::NothingBehind { thickness_mm: phantom.thickness_mm })?;
            calibration.quanta_per_pixel / (behind * per_photon)
        }
    };
    let scale = (photons_per_mm2 * per_photon) as f32;
    quanta.pixels.par_iter_mut().for_each(|pixel| *pixel *= scale);
    quanta.quantity = "counted quanta per pixel".into();
    let [signal, noisy] = unit.detector.read(&quanta, seed);
    Ok(Exposure {
        signal,
        noisy,
        photons_per_mm2,
        kerma_mgy: unit.kerma_mgy(photons_per_mm2, phantom.thickness_mm)?,
    })
}

/// Photons on each pixel over those below the focal spot without object.
///
/// Primary photons only: exp(-Σ µ l) of each line, weakened by distance and slant. Calcifications
/// replace tissue; they are averaged over the pixel after the exponential, as a pixel does.
pub fn transmission(
    phantom: &Phantom,
    projection: &Projection,
    unit: &Unit,
) -> Result<Radiograph, AttenuationError> {
    let geometry = &projection.geometry;
    let mut sum = vec![0f64; geometry.rows * geometry.columns];
    for line in &unit.spectrum.lines {
        let tissue = phantom.tissue.attenuation_per_mm(line.energy_kev)?;
        let more = phantom.calcium.attenuation_per_mm(line.energy_kev)? - tissue;
        let mut passed: Vec<f64> = projection
            .breast
            .pixels
            .par_iter()
            .map(|&path| line.share * (-tissue * f64::from(path)).exp())
            .collect();
        for insert in &projection.inserts {
            for (row, column, weakened) in insert.pixels(|path| (-more * path).exp()) {
                passed[row * geometry.columns + column] *= weakened;
            }
        }
        sum.par_iter_mut().zip(&passed).for_each(|(sum, passed)| *sum += passed);
    }
    let pixels = sum.par_iter().enumerate().map(|(n, &passed)| {
        let at = geometry.pixel_mm(n / geometry.columns, n % geometry.columns);
        (passed * geometry.relative_fluence(at)) as f32
    });
    Ok(geometry.picture(pixels.collect(), "photons over those without object"))
}

/// Mean transmission where the path is about the nominal thickness; `None` when it is nowhere.
fn mean_behind(projection: &Projection, share: &Radiograph, thickness_mm: f64) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for (path, share) in projection.breast.pixels.iter().zip(&share.pixels) {
        if (f64::from(*path) / thickness_mm - 1.0).abs() <= BEHIND {
            sum += f64::from(*share);
            count += 1;
        }
    }
    (count > 0).then(|| sum / count as f64)
}
