//! The projection against closed forms, and signal and contrast against theory, on the full detector.

use mammotwin_data::{
    Vec3,
    study::{Exposure, MammogramPlan},
};
use mammotwin_imaging::xray::{
    attenuation::Material,
    calibration::{Anchor, Unit, calibrate},
    detector::Detector,
    exposure::expose,
    geometry::Geometry,
    known::{Known, measure},
    phantom::{Calcification, Phantom, PhantomError},
    placement::Site,
    project::project,
    quality::{QualityError, RoiQuality, quality, summary},
    shapes::{cuboid, prism},
};
use std::f64::consts::TAU;

/// 6.8 million pixels, edges included.
#[test]
fn bodies_are_projected_as_their_closed_forms() {
    for body in Known::ALL {
        let (picture, [rms, largest]) = measure(body, &Geometry::pristina(0.1)).unwrap();
        println!("{}: rms {rms:.2e}, largest {largest:.2e}", body.name());
        assert!(rms <= 1e-3, "{}: {rms}", body.name());
        assert!(picture.pixels.iter().any(|&path| path > 45.0), "{}", body.name());
    }
}

/// Discs of aluminium in a slab, 60 µm thin, much wider than a pixel: N quanta in the background,
/// N exp(-Δµ t) in the disc, noise √N. Rims that share pixels change SNR by 0.3 %.
fn discs(thickness: f64) -> (Phantom, Unit) {
    let outline: Vec<[f64; 2]> = (0..64)
        .map(|n| {
            let angle = TAU * f64::from(n) / 64.0;
            [angle.cos(), angle.sin()]
        })
        .collect();
    let disc = |n: u32| {
        let center =
            Vec3::new(-33.0 + 11.0 * f64::from(n % 7), 8.0 + 11.0 * f64::from(n / 7), 23.0);
        let around: Vec<[f64; 2]> =
            outline.iter().map(|o| [center.x + 3.0 * o[0], center.y + 3.0 * o[1]]).collect();
        let surface = prism(&around, |_| center.z - 0.03, |_| center.z + 0.03);
        let site = Site { row: n as usize / 7, column: n as usize % 7, center };
        // Its shadow is a little wider than it is.
        Calcification { site, diameter_mm: 6.0 * 660.0 / (660.0 - 23.0), surface, around: None }
    };
    let phantom = Phantom {
        surface: cuboid([-90.0, -50.0, 0.0], [90.0, 120.0, thickness]),
        thickness_mm: thickness,
        tissue: Material::breast(0.2).unwrap(),
        inclusions: vec![],
        calcium: Material::calcification().unwrap(),
        calcifications: (0..49).map(disc).collect(),
    };
    let unit = Unit::pristina(0.1, 24.0);
    (phantom, Unit { detector: Detector { scintillator: None, ..unit.detector.clone() }, ..unit })
}

#[test]
fn signal_and_contrast_over_noise_are_those_of_theory() {
    let (phantom, unit) = discs(46.0);
    let calibration = calibrate(&Anchor::default(), &unit).unwrap();
    let projection = project(&phantom, &unit.geometry).unwrap();
    let taken = expose(&phantom, &projection, &unit, &calibration, Exposure::Fixed, 3).unwrap();
    let regions = quality(&taken.noisy, &phantom, &unit.geometry).unwrap();
    let of = |material: &Material| material.attenuation_per_mm(24.0).unwrap();
    let more = of(&phantom.calcium) - of(&phantom.tissue);
    // Each place has its own quanta and slant; the theory is taken there.
    let quanta = |r: &RoiQuality| {
        let slant = unit.geometry.ray_mm(r.center_mm) / unit.geometry.source_height_mm;
        let passed = (-of(&phantom.tissue) * 46.0 * slant).exp();
        let fluence = unit.geometry.relative_fluence(r.center_mm);
        calibration.photons_per_mm2 * calibration.efficiency * 0.01 * passed * fluence
    };
    let contrast = |r: &RoiQuality| {
        let slant = unit.geometry.ray_mm(r.center_mm) / unit.geometry.source_height_mm;
        1.0 - (-more * 0.06 * slant).exp()
    };
    let snr = summary(&regions, |r| r.detrended.snr / quanta(r).sqrt()).unwrap();
    let sdnr = summary(&regions, |r| r.detrended.sdnr / (quanta(r).sqrt() * contrast(r))).unwrap();
    println!("SNR over theory {snr:?}, SDNR over theory {sdnr:?}");
    assert!((snr.mean - 1.0).abs() <= 0.02 && (sdnr.mean - 1.0).abs() <= 0.02);
}

/// What lies beside the detector is said, not measured.
#[test]
fn a_detector_smaller_than_the_breast_is_told() {
    let (phantom, unit) = discs(46.0);
    let geometry = Geometry { columns: 300, rows: 200, ..unit.geometry.clone() };
    let unit = Unit { geometry, ..unit };
    let calibration = calibrate(&Anchor::default(), &unit).unwrap();
    let projection = project(&phantom, &unit.geometry).unwrap();
    let taken = expose(&phantom, &projection, &unit, &calibration, Exposure::Fixed, 3).unwrap();
    let told = quality(&taken.noisy, &phantom, &unit.geometry).unwrap_err();
    assert!(matches!(told, QualityError::TooFew { .. }), "{told}");
    assert!(told.to_string().contains("detector"), "{told}");
}

/// Of a matrix that finds no tissue nothing is drawn, and why is said.
#[test]
fn grains_beside_the_breast_are_refused() {
    let behind = cuboid([-60.0, -90.0, 0.0], [60.0, -5.0, 46.0]);
    let told = Phantom::new(behind, None, 46.0, &MammogramPlan::default(), 0.3, 1).unwrap_err();
    assert!(matches!(told, PhantomError::Misplaced { .. }));
    assert!(told.to_string().contains("no microcalcification lies in tissue"), "{told}");
}
