//! Gland and masses in a phantom against closed forms: path lengths, pictures, photon transport.

use mammotwin_data::{
    Vec3,
    study::{MammogramPlan, MassPlan},
    surface::TriMesh,
};
use mammotwin_imaging::xray::{
    attenuation::Material,
    calcification::sphere,
    calibration::Unit,
    exposure::transmission,
    geometry::Geometry,
    phantom::{Form, Inclusion, Phantom, PhantomError},
    project::project,
    shapes::{Ellipsoid, cuboid},
    spectrum::Spectrum,
    transport::{
        bodies::Closed,
        exam::{INCLUSIONS, MEDIA, Setup, examine},
        photon::Histories,
        scene::volumes_mm3,
    },
};

fn geometry() -> Geometry {
    Geometry { source_height_mm: 660.0, columns: 400, rows: 400, pitch_mm: 0.25 }
}

fn ball(center: Vec3, radius: f64, splits: usize) -> TriMesh {
    let unit = sphere(splits);
    let points = unit.points.iter().map(|p| center + radius * p).collect();
    TriMesh { points, ..unit }
}

fn slab(inclusions: Vec<Inclusion>) -> Phantom {
    Phantom {
        surface: cuboid([-90.0, -50.0, 0.0], [90.0, 140.0, 46.0]),
        thickness_mm: 46.0,
        tissue: Material::breast(0.0).unwrap(),
        inclusions,
        calcium: Material::calcification().unwrap(),
        calcifications: vec![],
    }
}

const GLAND: Ellipsoid =
    Ellipsoid { center: Vec3::new(5.0, 50.0, 20.0), radii: Vec3::new(15.0, 15.0, 15.0) };
const MASS: Ellipsoid =
    Ellipsoid { center: Vec3::new(9.0, 46.0, 24.0), radii: Vec3::new(4.0, 6.0, 3.0) };

/// A ball of gland, and a mass that lies partly in it: each pixel gets exp(-Σ µ l) of the closed
/// forms, in which the mass replaces gland and fat alike.
#[test]
fn gland_and_a_mass_across_its_border_are_their_closed_forms() {
    // The mass reaches out of the gland.
    let mass = Ellipsoid { center: Vec3::new(18.0, 50.0, 22.0), ..MASS };
    let water = Material::named("water").unwrap();
    let gland = Material::breast(1.0).unwrap();
    let surface = ball(GLAND.center, 15.0, 7);
    let inclusion = |form, material: &Material| Inclusion { form, material: material.clone() };
    let unit = Unit { geometry: geometry(), ..Unit::pristina(0.25, 24.0) };
    for form in [mass, MASS] {
        let phantom = slab(vec![
            inclusion(Form::Surface(surface.clone()), &gland),
            inclusion(Form::Ellipsoid(form), &water),
        ]);
        let projection = project(&phantom, &unit.geometry).unwrap();
        let picture = transmission(&phantom, &projection, &unit).unwrap();
        let mu = [&phantom.tissue, &gland, &water].map(|m| m.attenuation_per_mm(24.0).unwrap());
        let source = Vec3::new(0.0, 0.0, 660.0);
        let mut worst: f64 = 0.0;
        for (n, &pixel) in picture.pixels.iter().enumerate() {
            let [x, y] = unit.geometry.pixel_mm(n / 400, n % 400);
            let (to, ray) = (Vec3::new(x, y, 0.0), unit.geometry.ray_mm([x, y]));
            let chord = |form: &Ellipsoid| form.chord(&source, &to).unwrap_or([0.0; 2]);
            let ([a, b], [c, d]) = (chord(&GLAND), chord(&form));
            let both = (b.min(d) - a.max(c)).max(0.0);
            let [whole, in_mass] = [(b - a), (d - c)];
            let in_gland = whole - both;
            let fat = 46.0 / 660.0 - in_gland - in_mass;
            let depth = ray * (mu[0] * fat + mu[1] * in_gland + mu[2] * in_mass);
            let exact = (-depth).exp() * unit.geometry.relative_fluence([x, y]);
            worst = worst.max((f64::from(pixel) / exact - 1.0).abs());
        }
        println!("largest error {worst:.1e}");
        // At grazing rays the facets of the ball (0.01 mm deep) are 0.6 mm of way.
        assert!(worst < 0.02 * (mu[1] - mu[0]) * 100.0 && worst < 0.03, "{worst}");
        let sum = |region: usize| -> f64 {
            projection.regions[region].path_mm.iter().map(|&p| f64::from(p)).sum()
        };
        assert!(sum(1) > 0.0);
    }
}

fn plan(masses: Vec<MassPlan>) -> MammogramPlan {
    MammogramPlan { masses, ..MammogramPlan::default() }
}

fn mass(center: [f64; 3], radii_mm: [f64; 3]) -> MassPlan {
    let material = "glandular_hammerstein".into();
    MassPlan { material, radii_mm, center_mm: Some(center), center_share: None }
}

#[test]
fn masses_outside_of_the_breast_or_in_each_other_are_refused() {
    let block = || cuboid([-60.0, -20.0, 0.0], [60.0, 90.0, 46.0]);
    let with = |masses| Phantom::new(block(), None, 46.0, &plan(masses), 0.3, 1);
    let good = with(vec![mass([0.0, 40.0, 23.0], [5.0, 5.0, 5.0])]).unwrap();
    assert_eq!(good.inclusions.len(), 1);
    let outside = with(vec![mass([58.0, 40.0, 23.0], [5.0, 2.0, 2.0])]).unwrap_err();
    assert!(matches!(outside, PhantomError::MassOutside { number: 0, beyond_mm, .. }
        if (beyond_mm - 3.0).abs() < 0.1));
    assert!(outside.to_string().starts_with("mammogram.masses[0]"), "{outside}");
    let two = vec![mass([0.0, 40.0, 23.0], [5.0; 3]), mass([0.0, 48.0, 23.0], [5.0; 3])];
    let overlap = with(two).unwrap_err();
    assert_eq!(overlap, PhantomError::MassesOverlap { first: 0, second: 1 });
    let share =
        MassPlan { center_mm: None, center_share: Some([0.5; 3]), ..mass([0.0; 3], [5.0; 3]) };
    let placed = with(vec![share]).unwrap();
    let Form::Ellipsoid(form) = &placed.inclusions[0].form else { panic!("no ellipsoid") };
    assert!((form.center - Vec3::new(0.0, 45.0, 23.0)).norm() < 1.5, "{form:?}");
}

/// Columns of the matrix are 10 mm apart: in a breast of 22 mm the outer ones would lie 1 mm below its sides.
#[test]
fn no_grain_lies_in_the_skin_of_a_side() {
    let narrow = cuboid([-11.0, -50.0, 0.0], [11.0, 140.0, 46.0]);
    let phantom = Phantom::new(narrow, None, 46.0, &plan(vec![]), 0.3, 1).unwrap();
    let sides: Vec<f64> =
        phantom.calcifications.iter().map(|one| 11.0 - one.site.center.x.abs()).collect();
    assert!(sides.len() >= 7 && sides.iter().all(|side| *side >= 2.0), "{sides:?}");
}

#[test]
fn a_matrix_at_a_stated_place_outside_of_the_breast_is_refused() {
    let block = cuboid([-60.0, -20.0, 0.0], [60.0, 90.0, 46.0]);
    let mut plan = MammogramPlan::default();
    plan.calcifications.center_mm = Some([0.0, 45.0]);
    assert_eq!(
        Phantom::new(block.clone(), None, 46.0, &plan, 0.3, 1).unwrap().calcifications.len(),
        21
    );
    plan.calcifications.center_mm = Some([55.0, 45.0]);
    let told = Phantom::new(block, None, 46.0, &plan, 0.3, 1).unwrap_err();
    assert!(matches!(told, PhantomError::CalcificationOutside { column: 2, .. }), "{told:?}");
    assert!(told.to_string().contains("outside of the breast"), "{told}");
}

/// What a grain replaces is what is around it.
#[test]
fn grains_know_what_they_replace() {
    let block = cuboid([-60.0, -20.0, 0.0], [60.0, 90.0, 46.0]);
    let gland = ball(Vec3::new(0.0, 45.0, 23.0), 20.0, 4);
    let mut plan = plan(vec![mass([0.0, 45.0, 23.0], [3.0; 3])]);
    plan.calcifications.center_mm = Some([0.0, 45.0]);
    let phantom = Phantom::new(block, Some(&gland), 46.0, &plan, 0.3, 1).unwrap();
    assert_eq!(phantom.tissue.glandularity(), 0.0);
    for grain in &phantom.calcifications {
        let far = (grain.site.center - Vec3::new(0.0, 45.0, 23.0)).norm();
        let name = grain.around.as_ref().map(|m| m.name.as_str());
        let wanted = match far {
            ..3.0 => Some("glandular_hammerstein"),
            ..20.0 => Some("breast, 100 % gland by mass"),
            _ => None,
        };
        assert_eq!(name, wanted, "{far}");
    }
}

/// Fat filled with gland is gland: dose and scatter of both are alike. A ball of gland has its volume.
#[test]
fn photons_meet_gland_and_masses() {
    let block = cuboid([-60.0, -20.0, 0.0], [60.0, 70.0, 46.0]);
    let filling = cuboid([-70.0, -30.0, -5.0], [70.0, 80.0, 50.0]);
    let histories = Histories { photons: 400_000, seed: 3 };
    let tube = Spectrum::of_tube("Rh/Ag", 34).unwrap();
    let exam = |body: Closed, setup: Setup| {
        examine(body, &setup, &Geometry::pristina(0.1), &tube, histories).unwrap()
    };
    let usual = |gland: f64| Setup { grid: false, ..Setup::usual(gland).unwrap() };
    let mixed = exam(Closed::new(&block, 2.0, 1.45, MEDIA).unwrap(), usual(1.0));
    let body = Closed::new(&block, 2.0, 1.45, MEDIA).unwrap();
    let body = body.with_gland(&filling, 2.0, INCLUSIONS).unwrap();
    let fat = Material::breast(0.0).unwrap();
    let pure = Material::breast(1.0).unwrap();
    let setup = Setup { tissue: fat, inclusions: vec![pure], ..usual(1.0) };
    let filled = exam(body, setup);
    let ratio = filled.dose_per_kerma.mean / mixed.dose_per_kerma.mean;
    let error = filled.dose_per_kerma.relative_error() + mixed.dose_per_kerma.relative_error();
    println!("filled over mixed {ratio:.4} ± {error:.4}");
    assert!((ratio - 1.0).abs() < 3.0 * error, "{ratio}");
    assert!((filled.gland_g / mixed.gland_g - 1.0).abs() < 1e-9);

    let body = Closed::new(&block, 2.0, 1.45, MEDIA).unwrap();
    let gland = ball(Vec3::new(0.0, 35.0, 23.0), 15.0, 5);
    let body = body.with_gland(&gland, 1.0, INCLUSIONS).unwrap();
    let form = Ellipsoid { center: Vec3::new(0.0, 35.0, 23.0), radii: Vec3::new(4.0, 5.0, 6.0) };
    let body = body.with_mass(form, INCLUSIONS + 1);
    let volumes = volumes_mm3(&body, 0.5, |_| true);
    let of_mass = 4.0 / 3.0 * std::f64::consts::PI * 120.0;
    let of_gland = 4.0 / 3.0 * std::f64::consts::PI * 15.0f64.powi(3) - of_mass;
    assert!((volumes[INCLUSIONS + 1] / of_mass - 1.0).abs() < 0.01, "{volumes:?}");
    assert!((volumes[INCLUSIONS] / of_gland - 1.0).abs() < 0.01, "{volumes:?}");
}
