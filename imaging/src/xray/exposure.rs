//! From path lengths to a picture: photons, quanta, noise.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    calibration::{Calibration, Unit},
    phantom::Phantom,
    project::{Projection, project_from},
    raster::RasterError,
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
    /// A surface cannot be projected.
    #[error(transparent)]
    Raster(#[from] RasterError),
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
    /// Photons per mm² below the focal spot, without object and paddle.
    pub photons_per_mm2: f64,
    /// Incident air kerma (mGy) at the upper surface of the breast.
    pub kerma_mgy: f64,
    /// What either control would give: automatic, if it sees a breast, and fixed.
    pub kerma_of_controls_mgy: [Option<f64>; 2],
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
    let mut quanta = of_spot(phantom, projection, unit)?;
    let pixel_mm2 = quanta.pitch_mm * quanta.pitch_mm;
    let per_photon = pixel_mm2 * calibration.efficiency;
    let thickness_mm = phantom.thickness_mm;
    let automatic = mean_behind(projection, &quanta, thickness_mm)
        .map(|behind| calibration.quanta_per_pixel / (behind * per_photon));
    let fixed = calibration.photons_per_mm2;
    let photons_per_mm2 = match control {
        study::Exposure::Fixed => fixed,
        study::Exposure::Automatic => {
            automatic.ok_or(ExposureError::NothingBehind { thickness_mm })?
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
        kerma_mgy: unit.kerma_mgy(photons_per_mm2, thickness_mm)?,
        kerma_of_controls_mgy: [
            automatic.map(|photons| unit.kerma_mgy(photons, thickness_mm)).transpose()?,
            Some(unit.kerma_mgy(fixed, thickness_mm)?),
        ],
    })
}

/// Photons on each pixel over those below the focal spot without object and plates: the mean over the
/// focal spot.
fn of_spot(
    phantom: &Phantom,
    middle: &Projection,
    unit: &Unit,
) -> Result<Radiograph, ExposureError> {
    let geometry = &middle.geometry;
    if let [_] = unit.focal_spot.points[..] {
        return Ok(transmission(phantom, middle, unit)?);
    }
    let mut sum = vec![0f64; geometry.rows * geometry.columns];
    for &(place, share) in &unit.focal_spot.points {
        let seen = if place == middle.spot_mm {
            transmission(phantom, middle, unit)?
        } else {
            transmission(phantom, &project_from(phantom, geometry, place)?, unit)?
        };
        sum.par_iter_mut().zip(&seen.pixels).for_each(|(s, &p)| *s += share * f64::from(p));
    }
    let pixels = sum.into_iter().map(|pixel| pixel as f32).collect();
    Ok(geometry.picture(pixels, "photons over those without object"))
}

/// The same from one point.
///
/// Primary photons only: exp(-Σ µ l) of each line, weakened by distance and slant, plates along the
/// slant, and the heel effect. Calcifications replace what is around them; they are averaged over the
/// pixel after the exponential, as a pixel does.
pub fn transmission(
    phantom: &Phantom,
    projection: &Projection,
    unit: &Unit,
) -> Result<Radiograph, AttenuationError> {
    let geometry = &projection.geometry;
    let [sx, sy] = projection.spot_mm;
    let mut sum = vec![0f64; geometry.rows * geometry.columns];
    for line in &unit.spectrum.lines {
        let of = |material: &Material| material.attenuation_per_mm(line.energy_kev);
        let tissue = of(&phantom.tissue)?;
        let calcium = of(&phantom.calcium)?;
        let plates = unit.plates(line.energy_kev)?;
        let slanted = |n: usize| {
            let [x, y] = geometry.pixel_mm(n / geometry.columns, n % geometry.columns);
            plates * geometry.ray_mm([x - sx, y - sy]) / geometry.source_height_mm
        };
        let mut passed: Vec<f64> = projection
            .breast
            .pixels
            .par_iter()
            .enumerate()
            .map(|(n, &path)| {
                let before = if plates > 0.0 { slanted(n) } else { 0.0 };
                line.share * (-tissue * f64::from(path) - before).exp()
            })
            .collect();
        for (region, inclusion) in projection.regions.iter().zip(&phantom.inclusions) {
            let more = of(&inclusion.material)? - tissue;
            for (row, column, path) in region.pixels().filter(|(_, _, path)| *path > 0.0) {
                passed[row * geometry.columns + column] *= (-more * path).exp();
            }
        }
        for (insert, grain) in projection.inserts.iter().zip(&phantom.calcifications) {
            let more = calcium - grain.around.as_ref().map_or(Ok(tissue), of)?;
            for (row, column, weakened) in insert.pixels(|path| (-more * path).exp()) {
                passed[row * geometry.columns + column] *= weakened;
            }
        }
        sum.par_iter_mut().zip(&passed).for_each(|(sum, passed)| *sum += passed);
    }
    let pixels = sum.par_iter().enumerate().map(|(n, &passed)| {
        let [x, y] = geometry.pixel_mm(n / geometry.columns, n % geometry.columns);
        let heel = (1.0 - unit.heel_per_100mm * y / 100.0).max(0.0);
        (passed * heel * geometry.relative_fluence([x - sx, y - sy])) as f32
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xray::{
        attenuation::Material,
        calcification::sphere,
        calibration::{Anchor, calibrate},
        detector::Detector,
        geometry::Geometry,
        phantom::Calcification,
        placement::Site,
        project::project,
        shapes::cuboid,
        spectrum::Spectrum,
    };
    use mammotwin_data::{Vec3, surface::TriMesh};

    fn unit() -> Unit {
        let geometry = Geometry { source_height_mm: 660.0, columns: 240, rows: 160, pitch_mm: 0.5 };
        Unit { geometry, ..Unit::pristina(0.5, 24.0) }
    }

    fn slab(thickness_mm: f64, calcifications: Vec<Calcification>) -> Phantom {
        Phantom {
            surface: cuboid([-90.0, -50.0, 0.0], [90.0, 120.0, thickness_mm]),
            thickness_mm,
            tissue: Material::breast(0.2).unwrap(),
            inclusions: vec![],
            calcium: Material::calcification().unwrap(),
            calcifications,
        }
    }

    #[test]
    fn a_slab_transmits_as_beer_and_lambert_say() {
        let (unit, phantom) = (unit(), slab(46.0, vec![]));
        let projection = project(&phantom, &unit.geometry).unwrap();
        let got = transmission(&phantom, &projection, &unit).unwrap();
        let mu = Material::breast(0.2).unwrap().attenuation_per_mm(24.0).unwrap();
        for (row, column) in [(0, 120), (0, 0), (159, 239), (80, 60)] {
            let [x, y] = unit.geometry.pixel_mm(row, column);
            let secant = (1.0 + (x * x + y * y) / (660.0 * 660.0)).sqrt();
            let exact = (-mu * 46.0 * secant).exp() / secant.powi(3);
            let error = f64::from(got.at(row, column)) / exact - 1.0;
            assert!(error.abs() < 5e-6, "{row} {column}: {error}");
        }
    }

    #[test]
    fn two_energies_add_their_photons() {
        let (mut unit, phantom) = (unit(), slab(46.0, vec![]));
        let projection = project(&phantom, &unit.geometry).unwrap();
        let of = |unit: &Unit| transmission(&phantom, &projection, unit).unwrap().at(3, 99);
        let lines = [17.0, 30.0].map(|energy_kev| {
            unit.spectrum = Spectrum::mono(energy_kev);
            of(&unit)
        });
        unit.spectrum = Spectrum::mono(17.0);
        unit.spectrum.lines.extend(Spectrum::mono(30.0).lines);
        unit.spectrum.lines.iter_mut().zip([0.25, 0.75]).for_each(|(l, share)| l.share = share);
        assert!((of(&unit) / (0.25 * lines[0] + 0.75 * lines[1]) - 1.0).abs() < 1e-6);
    }

    /// Photons that a grain of volume V takes away: T Δµ V M² / slant, while Δµ d is small.
    #[test]
    fn a_calcification_takes_away_what_its_volume_does() {
        let (radius, center) = (0.15, Vec3::new(11.0, 40.0, 23.0));
        let points = sphere(4).points.iter().map(|p| center + radius * p).collect();
        let surface = TriMesh { points, triangles: sphere(4).triangles };
        let site = Site { row: 0, column: 0, center };
        let grain = Calcification { site, diameter_mm: 2.0 * radius, surface, around: None };
        let geometry = Geometry { columns: 400, rows: 500, pitch_mm: 0.1, ..unit().geometry };
        let unit = Unit { geometry, ..unit() };
        let pictures = [vec![], vec![grain]].map(|grains| {
            let phantom = slab(46.0, grains);
            let projection = project(&phantom, &unit.geometry).unwrap();
            transmission(&phantom, &projection, &unit).unwrap()
        });
        let of = |n: usize| -> f64 { pictures[n].pixels.iter().map(|&p| f64::from(p)).sum() };
        let lost = (of(0) - of(1)) * 0.01;
        let more = Material::calcification().unwrap().attenuation_per_mm(24.0).unwrap()
            - Material::breast(0.2).unwrap().attenuation_per_mm(24.0).unwrap();
        let shadow = unit.geometry.shadow_mm(&center);
        let [column, row] = [shadow[0] - unit.geometry.left_mm(), shadow[1]].map(|s| s / 0.1);
        let through = f64::from(pictures[0].at(row as usize, column.round() as usize));
        let magnification: f64 = 660.0 / 637.0;
        let slant = 660.0 / unit.geometry.ray_mm(shadow);
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        // ∫ 1 - exp(-Δµ l) over the chords of a sphere: 1 - 3/8 Δµ d + ... of the linear value.
        let d = 2.0 * radius;
        let saturation = 1.0 - 0.375 * more * d + 0.1 * (more * d).powi(2);
        let exact = through * more * volume * magnification.powi(2) / slant * saturation;
        assert!((lost / exact - 1.0).abs() < 5e-3, "{lost} {exact}");
    }

    #[test]
    fn automatic_exposure_holds_the_signal_and_fixed_the_photons() {
        let unit =
            Unit { detector: Detector { scintillator: None, ..Detector::essential() }, ..unit() };
        let calibration = calibrate(&Anchor::default(), &unit).unwrap();
        for thickness in [30.0, 46.0, 60.0] {
            let phantom = slab(thickness, vec![]);
            let projection = project(&phantom, &unit.geometry).unwrap();
            let shot =
                |control| expose(&phantom, &projection, &unit, &calibration, control, 1).unwrap();
            let automatic = shot(study::Exposure::Automatic);
            let count = automatic.signal.pixels.len() as f64;
            let mean = automatic.signal.pixels.iter().map(|&p| f64::from(p)).sum::<f64>() / count;
            assert!(
                (mean / calibration.quanta_per_pixel - 1.0).abs() < 1e-4,
                "{thickness}: {mean}"
            );
            let fixed = shot(study::Exposure::Fixed);
            assert_eq!(fixed.kerma_of_controls_mgy, automatic.kerma_of_controls_mgy);
            let both = [automatic.kerma_mgy, fixed.kerma_mgy].map(Some);
            assert_eq!(fixed.kerma_of_controls_mgy, both);
            assert_eq!(fixed.photons_per_mm2, calibration.photons_per_mm2);
            let kerma = calibration.kerma_mgy * ((660.0 - 46.0f64) / (660.0 - thickness)).powi(2);
            assert!((fixed.kerma_mgy / kerma - 1.0).abs() < 1e-12);
            assert_eq!(automatic.photons_per_mm2 > fixed.photons_per_mm2, thickness > 45.0);
        }
    }

    #[test]
    fn automatic_exposure_needs_a_breast() {
        let unit = unit();
        let calibration = calibrate(&Anchor::default(), &unit).unwrap();
        let mut phantom = slab(46.0, vec![]);
        phantom.surface = cuboid([-90.0, -50.0, 0.0], [90.0, -1.0, 46.0]);
        let projection = project(&phantom, &unit.geometry).unwrap();
        let got = expose(&phantom, &projection, &unit, &calibration, study::Exposure::Automatic, 1);
        assert_eq!(got, Err(ExposureError::NothingBehind { thickness_mm: 46.0 }));
    }
}
