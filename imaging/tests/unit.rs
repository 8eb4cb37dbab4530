//! What is around the breast against closed forms: focal spot, paddle, receptor, heel, spectrum.

use mammotwin_data::study::{
    AbsorberPlan, BeamPlan, Exposure, FocalSpotPlan, MammogramPlan, QuantumNoise, SpotShape,
    UnitPlan,
};
use mammotwin_imaging::xray::{
    attenuation::Material,
    calibration::{Anchor, Unit, calibrate},
    dose::average_glandular_dose,
    exposure::{expose, transmission},
    focal_spot::FocalSpot,
    geometry::Geometry,
    phantom::Phantom,
    project::{fits, project},
    raster::RasterError,
    shapes::cuboid,
};

fn slab(thickness_mm: f64) -> Phantom {
    Phantom {
        surface: cuboid([-90.0, -50.0, 0.0], [90.0, 120.0, thickness_mm]),
        thickness_mm,
        tissue: Material::breast(0.2).unwrap(),
        inclusions: vec![],
        calcium: Material::calcification().unwrap(),
        calcifications: vec![],
    }
}

fn small(unit: Unit) -> Unit {
    let geometry = Geometry { columns: 240, rows: 160, pitch_mm: 0.5, ..unit.geometry.clone() };
    Unit { geometry, ..unit }
}

/// The edge of a plate at a height h is spread as wide as the spot times h / (H - h) (which is M - 1):
/// the second moment of the slope of its picture.
#[test]
fn a_focal_spot_spreads_an_edge_by_its_width_times_magnification_less_one() {
    let (height, thin) = (200.0, 0.02);
    let width_mm = 0.3;
    // Pixels much finer than the spread, 0.13 mm, across an edge at x = 0 and another at y = 20 mm.
    let geometry = Geometry { source_height_mm: 660.0, columns: 1200, rows: 4, pitch_mm: 0.001 };
    let mut plate = slab(46.0);
    plate.surface = cuboid([-30.0, -30.0, height], [0.0, 30.0, height + thin]);
    for (shape, to_sd) in [
        (SpotShape::Square, 1.0 / 12f64.sqrt()),
        (SpotShape::Gaussian, 1.0 / (8.0 * 2f64.ln()).sqrt()),
    ] {
        let focal_spot = FocalSpot::of(&FocalSpotPlan { width_mm, shape });
        let unit = Unit { geometry: geometry.clone(), focal_spot, ..Unit::pristina(0.001, 24.0) };
        let projection = project(&plate, &unit.geometry).unwrap();
        let calibration = calibrate(&Anchor::default(), &Unit::pristina(0.1, 24.0)).unwrap();
        let bare = mammotwin_imaging::xray::detector::Detector {
            scintillator: None,
            ..unit.detector.clone()
        };
        let unit = Unit { detector: bare, ..unit };
        let taken = expose(&plate, &projection, &unit, &calibration, Exposure::Fixed, 1).unwrap();
        let row: Vec<f64> = (0..1200).map(|c| f64::from(taken.signal.at(1, c))).collect();
        // Moments of the slope.
        let slope: Vec<[f64; 2]> = row
            .windows(2)
            .enumerate()
            .map(|(n, p)| [geometry.pixel_mm(1, n)[0] + 0.0005, p[1] - p[0]])
            .filter(|[_, rise]| rise.abs() > 1e-4 * (row[1199] - row[0]))
            .collect();
        let moment = |k: i32, about: f64| -> f64 {
            slope.iter().map(|[x, rise]| rise * (x - about).powi(k)).sum::<f64>()
        };
        let mean = moment(1, 0.0) / moment(0, 0.0);
        let spread = (moment(2, mean) / moment(0, 0.0)).sqrt();
        let wanted = width_mm * to_sd * height / (660.0 - height);
        println!("{shape:?}: {spread:.5} mm, closed form {wanted:.5} mm");
        assert!((spread / wanted - 1.0).abs() < 0.02, "{spread} {wanted}");
        assert!(mean.abs() < 0.002, "{mean}");
    }
}

/// exp(-Σ µ t / cos θ) of both plates, and no more.
#[test]
fn plates_absorb_along_the_slant() {
    let plate = |material: &str, thickness_mm| {
        Some(AbsorberPlan { material: material.into(), thickness_mm })
    };
    let around = UnitPlan {
        paddle: plate("pmma", 2.8),
        receptor: plate("polycarbonate", 1.2),
        ..UnitPlan::default()
    };
    let plan = MammogramPlan { unit: around, ..MammogramPlan::default() };
    let [with, without] = [&plan, &MammogramPlan::default()].map(|p| small(Unit::of(p).unwrap()));
    let phantom = slab(46.0);
    let projection = project(&phantom, &with.geometry).unwrap();
    let pictures = [&with, &without].map(|u| transmission(&phantom, &projection, u).unwrap());
    let of = |name: &str| Material::named(name).unwrap().attenuation_per_mm(24.0).unwrap();
    for (row, column) in [(0, 120), (159, 239), (70, 3)] {
        let slant = with.geometry.ray_mm(with.geometry.pixel_mm(row, column)) / 660.0;
        let exact = (-(2.8 * of("pmma") + 1.2 * of("polycarbonate")) * slant).exp();
        let got = f64::from(pictures[0].at(row, column) / pictures[1].at(row, column));
        assert!((got / exact - 1.0).abs() < 1e-5, "{got} {exact}");
    }
    // The anchor keeps its signal and its dose: the tube gives more.
    let [a, b] = [&with, &without].map(|u| calibrate(&Anchor::default(), u).unwrap());
    assert_eq!(a.quanta_per_pixel, b.quanta_per_pixel);
    assert!((a.kerma_mgy / b.kerma_mgy - 1.0).abs() < 1e-12);
    let through = (-2.8 * of("pmma")).exp();
    assert!((a.photons_per_mm2 * through / b.photons_per_mm2 - 1.0).abs() < 1e-9);
    let taken = expose(&phantom, &projection, &with, &a, Exposure::Automatic, 1).unwrap();
    let agd = average_glandular_dose(taken.kerma_mgy, 46.0, 0.2, &with.dose_beam).unwrap();
    assert!((agd.agd_mgy / 1.15 - 1.0).abs() < 0.03, "{agd:?}");
}

#[test]
fn heel_takes_its_share_away_from_the_chest_wall() {
    let around = UnitPlan { heel_per_100mm: 0.1, ..UnitPlan::default() };
    let plan = MammogramPlan { unit: around, ..MammogramPlan::default() };
    let [with, without] = [&plan, &MammogramPlan::default()].map(|p| small(Unit::of(p).unwrap()));
    let phantom = slab(46.0);
    let projection = project(&phantom, &with.geometry).unwrap();
    let pictures = [&with, &without].map(|u| transmission(&phantom, &projection, u).unwrap());
    for row in [0, 80, 159] {
        let y = with.geometry.pixel_mm(row, 7)[1];
        let got = f64::from(pictures[0].at(row, 7) / pictures[1].at(row, 7));
        assert!((got - (1.0 - 0.001 * y)).abs() < 1e-6, "{got}");
    }
}

/// A tube's picture is the sum over its lines, hardened by air, paddle and tissue; its dose is that of its
/// own half-value layer; the anchor holds.
#[test]
fn a_spectrum_is_the_sum_of_its_lines() {
    for (name, kv) in [("Rh/Ag", 34), ("W/Rh", 28), ("Mo/Mo", 28)] {
        let beam = Some(BeamPlan { target_filter: name.into(), kv });
        let plan = MammogramPlan { beam, ..MammogramPlan::default() };
        let unit = small(Unit::of(&plan).unwrap());
        let phantom = slab(46.0);
        let projection = project(&phantom, &unit.geometry).unwrap();
        let picture = transmission(&phantom, &projection, &unit).unwrap();
        let (row, column) = (159, 0);
        let [x, y] = unit.geometry.pixel_mm(row, column);
        let slant = unit.geometry.ray_mm([x, y]) / 660.0;
        let pmma = Material::named("pmma").unwrap();
        let exact: f64 = unit
            .spectrum
            .lines
            .iter()
            .map(|line| {
                let of = |m: &Material| m.attenuation_per_mm(line.energy_kev).unwrap();
                line.share * (-slant * (46.0 * of(&phantom.tissue) + 2.5 * of(&pmma))).exp()
            })
            .sum();
        let exact = exact * unit.geometry.relative_fluence([x, y]);
        assert!((f64::from(picture.at(row, column)) / exact - 1.0).abs() < 1e-5);
        let calibration = calibrate(&Anchor::default(), &unit).unwrap();
        println!(
            "{name}: half-value layer {:.4} mm, efficiency {:.3}, kerma {:.3} mGy",
            unit.dose_beam.hvl_mm_al, calibration.efficiency, calibration.kerma_mgy
        );
        assert!((0.3..0.6).contains(&unit.dose_beam.hvl_mm_al));
        assert!(calibration.efficiency < 1.0);
        // White noise of this SNR at this dose cannot be.
        let mut white = plan.clone();
        white.unit.noise = Some(QuantumNoise::AfterLight);
        let told = calibrate(&Anchor::default(), &Unit::of(&white).unwrap()).unwrap_err();
        assert!(told.to_string().contains("before_light"), "{told}");
    }
}

#[test]
fn a_detector_that_is_too_small_is_refused() {
    let breast = cuboid([-80.0, -50.0, 0.0], [80.0, 90.0, 46.0]);
    let with = |field_mm| Geometry::covering(660.0, field_mm, 0.1);
    assert_eq!(fits(&breast, &with([285.0, 239.4])), Ok(()));
    for field in [[160.0, 239.4], [285.0, 90.0]] {
        let told = fits(&breast, &with(field)).unwrap_err();
        assert!(matches!(told, RasterError::Beyond { .. }));
        assert!(told.to_string().contains("larger than the detector"), "{told}");
    }
}
