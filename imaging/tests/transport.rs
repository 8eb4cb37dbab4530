//! Photon transport against the benchmark of the AAPM, published scatter and closed forms.

use mammotwin_data::{Vec3, surface::TriMesh, tables};
use mammotwin_imaging::xray::{
    attenuation::Material,
    dose::{factor_g, factor_s},
    geometry::Geometry,
    spectrum::Spectrum,
    transport::{
        bodies::{Closed, HalfCylinder},
        exam::{Exam, MEDIA, Setup, examine},
        media::Media,
        photon::{Histories, transport},
        scene::{Block, Bounds, Scene},
        source::Source,
        study::{Shield, StudyError, StudyPlan, study as compare},
        tally::{Image, Receptor, Scoring, Tally},
    },
};

/// AAPM TG-195, case 3, in the frame of the detector: x is the report's y, y its x.
fn tg195(spectrum: Spectrum, photons: u64) -> Tally {
    let named = |name: &str| Material::named(name).unwrap();
    // The report prints 0.952 g/cm³: mean of the densities, not of the volumes.
    let tissue = Material { density_g_per_cm3: 0.952, ..Material::breast(0.2).unwrap() };
    let materials =
        [named("air"), named("skin_hammerstein"), tissue, named("pmma"), named("water")];
    let body = HalfCylinder {
        radius: 100.0,
        bottom: 15.0,
        top: 65.0,
        slope: 0.0,
        skin: 2.0,
        media: MEDIA,
    };
    let wide = [-130.0, 130.0];
    let plate = |z| Block { bounds: Bounds::of(wide, [0.0, 140.0], z), medium: 3 };
    let torso = Bounds::of([-150.0, 150.0], [-170.0, 0.0], [-110.0, 190.0]);
    let blocks = [plate([65.0, 67.0]), plate([13.0, 15.0]), Block { bounds: torso, medium: 4 }];
    let world = Bounds::of([-400.0, 400.0], [-400.0, 400.0], [-200.0, 700.0]);
    let media = Media::new(materials.to_vec()).unwrap();
    let scene = Scene::new(media, 0, world, body, &blocks).unwrap();
    let position = Vec3::new(0.0, 0.0, 660.0);
    let source = Source { position, x: wide, y: [0.0, 140.0], z: 0.0, spectrum, window: None };
    let volume = |x: f64, y: f64, z: f64| {
        Bounds::of([x - 10.0, x + 10.0], [y - 10.0, y + 10.0], [z - 5.0, z + 5.0])
    };
    let boxes = vec![
        volume(-50.0, 50.0, 40.0),
        volume(0.0, 20.0, 40.0),
        volume(0.0, 50.0, 40.0),
        volume(0.0, 80.0, 40.0),
        volume(50.0, 50.0, 40.0),
        volume(0.0, 50.0, 25.0),
        volume(0.0, 50.0, 55.0),
    ];
    let scoring = Scoring { boxes, receptor: None, from_y_mm: 0.0 };
    transport(&scene, &source, &scoring, None, Histories { photons, seed: 1 }).unwrap()
}

/// Compares with the table. Boxes may be off by 3 % and this many standard errors.
fn compare_with_tg195(photons: u64, errors: f64) {
    let tube = Spectrum::of_tube("Mo/Mo (TG-195)", 30).unwrap();
    for (beam, spectrum) in [("16.8keV", Spectrum::mono(16.8)), ("30kVp_MoMo", tube)] {
        let tally = tg195(spectrum, photons);
        for row in tables::rows(tables::TG195_CASE_3).filter(|row| row[0] == beam) {
            let wanted: f64 = row[3].parse().unwrap();
            let total = row[2] == "breast_tissue";
            let number = row[2].trim_start_matches("VOI").parse::<usize>();
            let got = number.map_or(tally.body[MEDIA[2]], |n| tally.boxes[n - 1]).times(1000.0);
            let off = got.mean / wanted - 1.0;
            println!(
                "{beam} {:13} {:9.3} eV, report {wanted:9.3}: {:+.2} % ± {:.2} %",
                row[2],
                got.mean,
                100.0 * off,
                100.0 * got.relative_error()
            );
            if total {
                assert!(got.relative_error() <= 0.003, "{got:?}");
                assert!(off.abs() < 0.01, "{beam} {}: {off}", row[2]);
            } else {
                let sure = 0.03 + errors * got.relative_error();
                assert!(off.abs() < sure, "{beam} {}: {off}", row[2]);
            }
        }
        // Energy goes nowhere else.
        let body: f64 = tally.body.iter().map(|e| e.mean).sum();
        let all = body + tally.elsewhere.mean + tally.lost.mean;
        assert!((all / tally.emitted.mean - 1.0).abs() < 1e-9, "{all}");
    }
}

#[test]
fn tg195_case_3_short() {
    compare_with_tg195(2_000_000, 3.0);
}

/// Box 6 at 16.8 keV is 2.9 ± 0.6 % above the report; an independent program has 2.6 ± 0.9 %.
#[test]
#[ignore = "a minute of two cores"]
fn tg195_case_3_full() {
    compare_with_tg195(60_000_000, 0.0);
}

fn usual(glandularity: f64) -> Setup {
    Setup { grid: false, ..Setup::usual(glandularity).unwrap() }
}

fn cylinder(radius: f64, thickness: f64, slope: f64, skin: f64) -> HalfCylinder {
    HalfCylinder { radius, bottom: 0.0, top: thickness, slope, skin, media: MEDIA }
}

/// Boone and Cooper (2000): semicircular breast of 20 cm, no grid, 15 mm of air, ideal detector;
/// fitted to 1 % over many beams. An independent program has -4 to +4 % of it (24 keV, disc of
/// 20 mm 50 mm from the chest wall).
#[test]
fn scatter_is_that_of_boone_and_cooper() {
    let geometry = Geometry { source_height_mm: 645.0, ..Geometry::pristina(0.1) };
    for (thickness, published, other) in [(30.0, 0.3327, 0.3347), (60.0, 0.6626, 0.6440)] {
        let setup = Setup { paddle_mm: 0.0, ..usual(0.2) };
        let body = cylinder(100.0, thickness, 0.0, 2.0);
        let spectrum = Spectrum::mono(24.0);
        let histories = Histories { photons: 3_000_000, seed: 1 };
        let exam = examine(body, &setup, &geometry, &spectrum, histories).unwrap();
        let disc = |x: f64, y: f64| x.hypot(y - 50.0) < 20.0;
        let got = exam.scatter_to_primary(disc).unwrap();
        println!("{thickness} mm: S/P {got:?}, published {published}, other {other}");
        assert!((got.mean / other - 1.0).abs() < 0.02 + 3.0 * got.relative_error(), "{got:?}");
        assert!((got.mean / published - 1.0).abs() < 0.04 + 3.0 * got.relative_error());
    }
}

fn dance_breast(beam: &str, kv: u32, thickness: f64, photons: u64) -> Exam {
    // Dance (1990): half cylinder of 16 cm, 5 mm of fat around 50 % gland, focus 600 mm above
    // the support.
    let geometry = Geometry { source_height_mm: 600.0, ..Geometry::pristina(0.1) };
    let fat = Material::breast(0.0).unwrap();
    let setup = Setup { paddle_mm: 0.0, skin: fat, cells: None, ..usual(0.5) };
    let paddle = Material::named("pmma").unwrap();
    let tube = Spectrum::of_tube(beam, kv).unwrap().behind(&paddle, 2.5).unwrap().of_all();
    let histories = Histories { photons, seed: 2 };
    examine(cylinder(80.0, thickness, 0.0, 5.0), &setup, &geometry, &tube, histories).unwrap()
}

/// The published g (interpolated in half-value layer) times s, and the results of an independent
/// program for the same breast (`dance_check.csv`): 0.3 to 1.7 % off, 2.1 % for Rh/Ag, whose
/// spectrum there is not quite the same (half-value layer 0.535 mm, here 0.537 mm).
#[test]
fn dose_in_dances_breast_is_his() {
    let mut worst: [f64; 2] = [0.0; 2];
    for (beam, kv, photons) in
        [("Mo/Mo", 28, 300_000), ("W/Rh", 28, 200_000), ("Rh/Ag", 34, 200_000)]
    {
        let rows = tables::rows(tables::DANCE_CHECK)
            .filter(|row| row[0] == beam && row[1] == kv.to_string())
            .filter(|row| ["20", "45", "80", "110"].contains(&row[3]));
        for row in rows {
            let [hvl, thickness, other] = [2, 3, 4].map(|k| row[k].parse::<f64>().unwrap());
            let got = dance_breast(beam, kv, thickness, photons).dose_per_kerma;
            let published = factor_g(thickness, hvl).unwrap() * factor_s(thickness, beam).unwrap();
            let off = [published, other].map(|wanted| got.mean / wanted - 1.0);
            println!("{beam} {thickness} mm: {got:?}, off {off:.4?} (published, other program)");
            worst = [0, 1].map(|k| worst[k].max(off[k].abs()));
        }
    }
    assert!(worst[0] < 0.05 && worst[1] < 0.025, "{worst:?}");
}

/// A block of tissue, much wider than what one looks at, transmits exp(-µ l).
#[test]
fn primary_photons_obey_beer_and_lambert() {
    let named = |name: &str| Material::named(name).unwrap();
    let tissue = Material::breast(0.2).unwrap();
    let media = Media::new(vec![named("air"), tissue.clone(), tissue.clone()]).unwrap();
    let body = HalfCylinder { skin: 0.0, ..cylinder(200.0, 40.0, 0.0, 0.0) };
    let world = Bounds::of([-300.0, 300.0], [-300.0, 300.0], [-20.0, 700.0]);
    let scene = Scene::new(media, 0, world, body, &[]).unwrap();
    let source = Source {
        position: Vec3::new(0.0, 0.0, 660.0),
        x: [-5.0, 5.0],
        y: [45.0, 55.0],
        z: -15.0,
        spectrum: Spectrum::mono(21.3),
        window: None,
    };
    let receptor = Receptor { x: source.x, y: source.y, z: -15.0, cells: [1, 1] };
    let scoring = Scoring { boxes: vec![], receptor: Some(receptor), from_y_mm: 0.0 };
    let histories = Histories { photons: 1_000_000, seed: 3 };
    let tally = transport(&scene, &source, &scoring, None, histories).unwrap();
    let slant = (1.0 + (50.0f64 / 675.0).powi(2)).sqrt();
    let [mu, air] = [&tissue, &named("air")].map(|m| m.attenuation_per_mm(21.3).unwrap());
    let wanted = 21.3 * (-slant * (40.0 * mu + 635.0 * air)).exp();
    let got = Image::sum(&tally.bare.primary, |_| true);
    assert!((got.mean / wanted - 1.0).abs() < 4.0 * got.relative_error(), "{got:?} {wanted}");
    assert!(got.relative_error() < 0.005);
}

fn sides(radius: f64, thickness: f64, facets: usize) -> TriMesh {
    let angle = |k: usize| std::f64::consts::PI * k as f64 / facets as f64;
    let n = facets as u32 + 1;
    let mut points = Vec::new();
    for z in [0.0, thickness] {
        points.extend((0..n).map(|k| {
            Vec3::new(radius * angle(k as usize).cos(), radius * angle(k as usize).sin(), z)
        }));
    }
    let mut triangles = Vec::new();
    for k in 1..n - 1 {
        triangles.extend([[0, k + 1, k], [n, n + k, n + k + 1]]);
    }
    for k in 0..n {
        let next = (k + 1) % n;
        triangles.extend([[k, next, n + next], [k, n + next, n + k]]);
    }
    TriMesh { points, triangles }
}

/// The same breast as a formula and as a closed surface with distances on a grid.
#[test]
fn a_surface_gets_the_dose_and_the_scatter_of_its_formula() {
    let geometry = Geometry::pristina(0.1);
    let setup = Setup { grid: true, ..usual(0.2) };
    let tube = Spectrum::of_tube("Rh/Ag", 34).unwrap();
    let histories = Histories { photons: 1_000_000, seed: 4 };
    let exact = cylinder(80.0, 46.0, 0.0, 1.5);
    let exact = examine(exact, &setup, &geometry, &tube, histories).unwrap();
    // The formula has no skin at the chest wall: the surface goes on behind it by that much.
    let mut surface = sides(80.0, 46.0, 120);
    for point in &mut surface.points {
        point.y = if point.y < 1e-9 { -1.5 } else { point.y };
    }
    let body = Closed::new(&surface, 2.0, 1.5, MEDIA).unwrap();
    let meshed = examine(body, &setup, &geometry, &tube, histories).unwrap();
    let ratio = meshed.dose_per_kerma.mean / exact.dose_per_kerma.mean;
    println!("{:?} {:?}: {ratio}", meshed.dose_per_kerma, exact.dose_per_kerma);
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    assert!((meshed.gland_g / exact.gland_g - 1.0).abs() < 0.01);
    let disc = |x: f64, y: f64| x.hypot(y - 35.0) < 20.0;
    let [a, b] = [&meshed, &exact].map(|e| e.scatter_to_primary(disc).unwrap());
    assert!((a.mean / b.mean - 1.0).abs() < 0.03 + 3.0 * a.relative_error(), "{a:?} {b:?}");
    let [a, b] = [&meshed, &exact].map(|e| e.behind_grid(disc).unwrap());
    println!("behind the grid {a:?} {b:?}");
    assert!(a.mean < 0.35 * meshed.scatter_to_primary(disc).unwrap().mean, "{a:?}");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let with = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let setup = Setup { grid: true, ..usual(0.2) };
            let tube = Spectrum::of_tube("Mo/Mo", 28).unwrap();
            let histories = Histories { photons: 40_000, seed };
            let body = cylinder(60.0, 30.0, 0.1, 1.5);
            examine(body, &setup, &Geometry::pristina(0.1), &tube, histories).unwrap()
        })
    };
    let one = with(1, 5);
    assert_eq!(one, with(2, 5));
    assert_eq!(one, with(3, 5));
    assert_ne!(one.dose_per_kerma, with(1, 6).dose_per_kerma);
}

/// Standard errors mean what they say: over seeds, means scatter as much.
#[test]
fn standard_errors_are_honest() {
    let runs: Vec<_> = (0..24)
        .map(|seed| {
            let setup = Setup { cells: None, ..usual(0.2) };
            let histories = Histories { photons: 20_000, seed };
            let body = cylinder(80.0, 46.0, 0.0, 1.5);
            let tube = Spectrum::mono(20.0);
            examine(body, &setup, &Geometry::pristina(0.1), &tube, histories)
                .unwrap()
                .dose_per_kerma
        })
        .collect();
    let mean = runs.iter().map(|r| r.mean).sum::<f64>() / 24.0;
    let spread = (runs.iter().map(|r| (r.mean - mean).powi(2)).sum::<f64>() / 23.0).sqrt();
    let said = (runs.iter().map(|r| r.error * r.error).sum::<f64>() / 24.0).sqrt();
    // 23 degrees of freedom: within 45 % in 99.8 % of all trials.
    assert!((0.55..1.45).contains(&(spread / said)), "{spread} {said}");
}

#[test]
fn what_cannot_be_is_refused() {
    let geometry = Geometry::pristina(0.1);
    let histories = Histories { photons: 1000, seed: 1 };
    let body = || cylinder(60.0, 30.0, 0.0, 1.5);
    let hard = examine(body(), &usual(0.2), &geometry, &Spectrum::mono(60.0), histories);
    assert!(hard.unwrap_err().to_string().contains("60 keV"));
    let fat = examine(body(), &usual(0.0), &geometry, &Spectrum::mono(20.0), histories);
    assert!(fat.unwrap_err().to_string().contains("gland"));
    let high = HalfCylinder { top: 659.0, ..body() };
    let above = examine(high, &usual(0.2), &geometry, &Spectrum::mono(20.0), histories);
    assert!(above.unwrap_err().to_string().contains("focal spot"));
    let air = Material::named("air").unwrap();
    let media = Media::new(vec![air.clone(), air.clone(), air]).unwrap();
    let bounds = Bounds::of([-10.0, 10.0], [0.0, 20.0], [5.0, 20.0]);
    let block = Block { bounds, medium: 0 };
    let world = Bounds::of([-100.0, 100.0], [-100.0, 100.0], [-20.0, 700.0]);
    let inside = Scene::new(media.clone(), 0, world, body(), &[block]);
    assert!(inside.unwrap_err().to_string().contains("overlap"));
    let missing = Scene::new(media, 9, world, body(), &[]);
    assert!(missing.unwrap_err().to_string().contains("medium 9 of 3"));
}

/// Flat half cylinders of Dance's make are Dance's; a wedge gets a little more dose than a flat
/// breast of the same nominal thickness.
#[test]
fn a_wedge_is_compared_with_dance() {
    let plan = StudyPlan {
        thickness_mm: vec![45.0],
        tilt_deg: vec![0.0, 3.0, 6.0],
        glandularity: vec![0.5],
        histories: Histories { photons: 200_000, seed: 1 },
        ..StudyPlan::default()
    };
    let study = compare(&plan, &|_| ()).unwrap();
    assert_eq!(study.cases.len(), 12);
    for case in &study.cases {
        println!(
            "{:13} {:12} {}° w {:.3}: MC / Dance {:.4}, tilted / flat {:.4} ± {:.4}",
            case.outline.name(),
            case.shield.name(),
            case.tilt_deg,
            case.wedge,
            case.monte_carlo.mean / case.dance,
            case.tilted_over_flat.mean,
            case.tilted_over_flat.error
        );
        assert!((0.9..1.15).contains(&case.tilted_over_flat.mean));
    }
    println!("{:?}", study.corrections);
    let flat = &study.cases[0];
    assert!((flat.monte_carlo.mean / flat.dance - 1.0).abs() < 0.04, "{flat:?}");
    let thin = study.cases.iter().find(|case| case.shield == Shield::Skin).unwrap();
    assert_ne!(thin.monte_carlo.mean, flat.monte_carlo.mean);
    assert_eq!(study.corrections.len(), 2);
    let flat_only = StudyPlan { tilt_deg: vec![3.0], ..plan };
    assert!(matches!(compare(&flat_only, &|_| ()), Err(StudyError::NoFlat)));
}
