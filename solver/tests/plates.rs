//! Paddles that end somewhere: finite plates, spot, window, foam, and surfaces from CAD.
//!
//! The block is 160 x 120 x 40 mm of 0.5 kPa (z along the compression, y away from the chest wall) on
//! the receptor; it is held so that it has a place, and is frictionless.

use crate::common;

use common::shapes::brick;
use mammotwin_data::{
    Vec3,
    io::stl,
    mesh::{Patch, TetMesh},
    progress::Silent,
    surface::TriMesh,
};
use mammotwin_solver::compress::{Closing, Compressed, Plates, Step, Stops, compress};
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::{
    AT_REST, Biopsy, CadError, CadPaddle, CurvedPlate, Cushion, Lift, Outline, Paddle,
    RoundedRectangle, Spot, SpotShape,
};
use mammotwin_solver::terms::Bulk;
use mammotwin_solver::{Model, Options};
use std::sync::Arc;

const HEIGHT_MM: f64 = 40.0;
const RADIUS_MM: f64 = 6.0;

/// A block with its middle above the origin, its edges along y at `low_mm`; its top is lifted by
/// `crown`.
fn block(
    cells: [usize; 3],
    size: [f64; 2],
    low_mm: f64,
    crown: impl Fn(f64, f64) -> f64,
) -> TetMesh {
    brick(cells, |i, j, k| {
        let x = size[0] * (i as f64 / cells[0] as f64 - 0.5);
        let y = low_mm + size[1] * j as f64 / cells[1] as f64;
        let z = (HEIGHT_MM + crown(x, y)) * k as f64 / cells[2] as f64;
        Vec3::new(x, y, z)
    })
}

/// Presses on a block from above until a thickness.
fn press(mesh: &TetMesh, law: Law, paddle: Paddle, outline: Outline, to_mm: f64) -> Compressed {
    press_until(mesh, law, paddle, outline, Stops::at_thickness(to_mm))
}

fn press_until(
    mesh: &TetMesh,
    law: Law,
    paddle: Paddle,
    outline: Outline,
    stops: Stops,
) -> Compressed {
    let mut model = Model::new(mesh);
    model.add(Bulk::new("block", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    // A place: two nodes of the bottom near its middle.
    let near = |x: f64| {
        let far = |n: &&u32| (mesh.points[**n as usize] - Vec3::new(x, 60.0, 0.0)).norm();
        let nodes = mesh.patch_nodes(Patch::ChestWall);
        *nodes.iter().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap()
    };
    let (first, second) = (near(0.0), near(40.0));
    model.fix(first, 0);
    model.fix(first, 1);
    model.fix(second, 1);
    let faces = [Patch::ChestWall, Patch::Skin].iter().flat_map(|&p| mesh.patch(p)).copied();
    let plates = Plates {
        axis: Vec3::z(),
        away: Vec3::y(),
        edge_mm: 0.0,
        radius_mm: RADIUS_MM,
        friction: 0.0,
        paddle,
        outline,
        middle_mm: 0.0,
        faces: faces.collect(),
    };
    let closing = Closing {
        receptor_mm: 0.0,
        thickness_mm: mesh.points.iter().map(|p| p.z).fold(0.0, f64::max),
        receptor_share: 0.0,
        lift_mm: 0.0,
        step_mm: 2.0,
        stops,
    };
    let clock = std::time::Instant::now();
    let done =
        compress(model, &plates, &closing, &mesh.points, &Options::default(), &Silent).unwrap();
    let step = done.steps.last().unwrap();
    println!(
        "{:.1} mm {:.4} N {:.4} N, {:.0} mm² face, {:.0} front, {:.0} edges, mean {:.3} peak {:.3} kPa, \
         gives way {:.3}, bulge {:.2} mm, {} steps of Newton, {:?}",
        step.thickness_mm,
        step.paddle_force_mn / 1e3,
        step.receptor_force_mn / 1e3,
        step.contact_area_mm2,
        step.front_area_mm2,
        step.edge_area_mm2,
        step.mean_pressure_kpa,
        step.peak_pressure_kpa,
        step.deflection_mm,
        step.bulge_mm,
        done.solution.checks.iterations,
        clock.elapsed()
    );
    done
}

fn soft() -> Law {
    Law::neo_hookean_coupled(0.5, 0.45).unwrap()
}

#[track_caller]
fn balances(done: &Compressed) -> &Step {
    assert!(done.stopped_early.is_none(), "{:?}", done.stopped_early);
    let step = done.steps.last().unwrap();
    let ratio = step.paddle_force_mn / step.receptor_force_mn;
    assert!((ratio - 1.0).abs() < 0.01 && step.paddle_force_mn > 0.0, "{ratio}");
    step
}

/// Verifies: spot paddle: area in contact; paddle and receptor | its own area; balance | 10 %; 1 %
#[test]
fn a_spot_paddle_presses_on_its_own_area_and_tissue_bulges_beside_it() {
    let mesh = block([20, 18, 3], [130.0, 120.0], 0.0, |_, _| 0.0);
    let endless = press(&mesh, soft(), Paddle::Rigid, Outline::ENDLESS, 34.0);
    let endless = balances(&endless).paddle_force_mn;
    for shape in [SpotShape::Round, SpotShape::Square(15.0)] {
        let spot = Spot { shape, size_mm: 90.0, along_mm: 0.0, away_mm: 20.0 };
        let done = press(&mesh, soft(), Paddle::Rigid, spot.outline(), 34.0);
        let step = balances(&done);
        let (side, corner) = match shape {
            SpotShape::Round => (90.0, 45.0),
            SpotShape::Square(corner) => (90.0, corner),
        };
        let area = side * side - (4.0 - std::f64::consts::PI) * corner * corner;
        let share = step.contact_area_mm2 / area;
        println!("{share:.3} of the spot's area");
        // Nodes at the rounded edge, each for the skin around it, 5 mm wide.
        assert!(share > 0.9 && share < 1.1, "{share}");
        assert!(step.bulge_mm > 5.0, "6 mm deep, and pushed up beside it: {}", step.bulge_mm);
        for pressing in &step.pressing[1] {
            let p = step.points[pressing.node as usize];
            assert!(spot.outline().distance([p.x, p.y]).value < 0.05, "{p}");
        }
        assert!(endless > step.paddle_force_mn);
    }
}

#[test]
fn a_compression_that_reaches_nothing_at_5_mm_says_so() {
    let thin = block([8, 6, 2], [80.0, 60.0], 30.0, |_, _| 7.5 - HEIGHT_MM);
    let stops = Stops { force_mn: Some(1e9), ..Stops::default() };
    let done = press_until(&thin, soft(), Paddle::Rigid, Outline::ENDLESS, stops);
    let steps: Vec<f64> = done.steps.iter().map(|step| step.thickness_mm).collect();
    assert_eq!(steps, [7.5, 5.5, 5.0]);
    assert_eq!(done.met, None);
    let why = done.stopped_early.unwrap().to_string();
    assert!(why.contains("5.0 mm, the thinnest that is tried, only 0 %"), "{why}");
}

#[test]
fn steps_to_a_final_thickness_are_alike() {
    let mesh = block([8, 6, 2], [80.0, 60.0], 30.0, |_, _| 0.0);
    let done = press(&mesh, soft(), Paddle::Rigid, Outline::ENDLESS, 35.0);
    // 5 mm in steps of at most 2.
    assert_eq!(done.steps.len(), 4);
    for (n, step) in done.steps.iter().enumerate() {
        assert!((step.thickness_mm - (40.0 - 5.0 * n as f64 / 3.0)).abs() < 1e-9);
    }
    assert_eq!(done.steps[3].thickness_mm, 35.0);
    // The most that a node moves between two states, over all of them, is no less than on the whole way.
    let [first, last] = [0, 3].map(|n| &done.steps[n]);
    let way = |n: usize| (last.points[n] - first.points[n]).norm();
    let longest = (0..first.points.len()).map(way).fold(0.0, f64::max);
    let moved: f64 = done.steps.iter().map(|step| step.moved_mm).sum();
    assert!(
        first.moved_mm == 0.0 && moved >= longest && moved < 1.2 * longest,
        "{moved} {longest}"
    );
}

/// Verifies: finite plate larger than the block | endless plate | 1e-9
#[test]
fn a_finite_plate_larger_than_the_block_is_an_endless_one() {
    let mesh = block([16, 12, 3], [160.0, 120.0], 15.0, |_, _| 0.0);
    let large = RoundedRectangle::new([290.0, 240.0], 20.0, 0.0, 0.0);
    let large = Outline { plate: Some(large), window: None };
    let forces = [large, Outline::ENDLESS].map(|outline| {
        balances(&press(&mesh, soft(), Paddle::Rigid, outline, 36.0)).paddle_force_mn
    });
    assert!((forces[0] / forces[1] - 1.0).abs() < 1e-9, "{forces:?}");
}

#[test]
fn tissue_bulges_into_the_window_of_a_biopsy_paddle() {
    let mesh = block([20, 18, 3], [130.0, 120.0], 0.0, |_, _| 0.0);
    let biopsy = Biopsy {
        plate: RoundedRectangle::new([240.0, 180.0], 20.0, 0.0, 0.0),
        window: RoundedRectangle::new([50.0, 50.0], 5.0, 0.0, 40.0),
    };
    let done = press(&mesh, soft(), Paddle::Rigid, biopsy.outline(), 34.0);
    let step = balances(&done);
    let flat = Outline { plate: Some(biopsy.plate), window: None };
    let closed = press(&mesh, soft(), Paddle::Rigid, flat, 34.0);
    assert!(balances(&closed).paddle_force_mn > step.paddle_force_mn);
    assert!(step.bulge_mm > 1.0 && step.bulge_mm < 6.0, "{}", step.bulge_mm);
    assert!(balances(&closed).bulge_mm == 0.0, "nothing is open above the block");
    // The highest place is in the middle of the window, and nothing presses there.
    let top = mesh.patch_nodes(Patch::Skin);
    let height = |n: &u32| step.points[*n as usize].z;
    let highest = top.iter().max_by(|a, b| height(a).total_cmp(&height(b))).unwrap();
    let p = step.points[*highest as usize];
    assert!(p.x.abs() < 6.0 && (p.y - 65.0).abs() < 6.0, "{p}");
    assert!((p.z - step.thickness_mm - step.bulge_mm).abs() < 1e-9);
    for pressing in &step.pressing[1] {
        let p = step.points[pressing.node as usize];
        assert!(biopsy.window.distance([p.x, p.y]).value > -0.05, "{p}");
    }
    let round = step.pressing[1].iter().filter(|p| p.facing(&Vec3::z()) < 0.99).count();
    assert!(round > 10, "the rounded edge of the window is touched: {round}");
}

/// Verifies: foam on a stiff block | E/t δ A | 1 %
/// Verifies: foam in series with a soft block | closed form | force 1 %, thickness 0.1 %
#[test]
fn a_cushion_is_a_spring_before_the_block() {
    let mesh = block([8, 6, 2], [80.0, 60.0], 30.0, |_, _| 0.0);
    // A stiff flat block: the foam alone gives way.
    let stiff = Law::neo_hookean_coupled(1e5, 0.3).unwrap();
    let foam = Cushion { thickness_mm: 5.0, young_kpa: 50.0 };
    let done = press(&mesh, stiff, Paddle::Cushioned(foam), Outline::ENDLESS, 38.0);
    let step = balances(&done);
    let area = 80.0 * 60.0;
    let want = 50.0 / 5.0 * 2.0 * area;
    println!("{} for {want} mN", step.paddle_force_mn);
    assert!((step.paddle_force_mn / want - 1.0).abs() < 0.01);
    assert!((step.deflection_mm / 2.0 - 1.0).abs() < 0.01);
    for pressing in &step.pressing[1] {
        assert!((pressing.pressure_kpa() / 20.0 - 1.0).abs() < 0.01);
    }
    // A soft one that spreads: springs in series, foam over the area that the block covers, and
    // the block's neo-Hookean uniaxial law E/3 (l - 1/l²), of which ν = 0.499 is 0.2 % away.
    let young = 30.0;
    let law = Law::neo_hookean_coupled(young, 0.499).unwrap();
    let done = press(&mesh, law, Paddle::Cushioned(foam), Outline::ENDLESS, 35.0);
    let step = balances(&done);
    let off = |stretch: f64| {
        let indentation = stretch * HEIGHT_MM - 35.0;
        let foam = 10.0 * indentation * area / stretch;
        foam + young / 3.0 * (stretch - stretch.powi(-2)) * area
    };
    let (mut low, mut high): (f64, f64) = (0.8, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if off(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    let want = young / 3.0 * (low.powi(-2) - low) * area;
    println!("{} for {want} mN, the block at {:.3} of its height", step.paddle_force_mn, low);
    assert!((step.paddle_force_mn / want - 1.0).abs() < 0.01);
    assert!((step.gaps_mm[1] / (low * HEIGHT_MM) - 1.0).abs() < 0.001);
    assert!(done.solution.checks.friction_lag < 1e-4);
}

#[test]
fn a_cushion_lowers_the_peak_on_a_round_body_and_ends_when_it_is_pressed_flat() {
    let crown = |x: f64, y: f64| -0.004 * (x * x + (y - 60.0).powi(2));
    let mesh = block([16, 12, 4], [80.0, 60.0], 30.0, crown);
    let law = Law::neo_hookean_coupled(20.0, 0.45).unwrap();
    let foam = Cushion { thickness_mm: 5.0, young_kpa: 20.0 };
    let hard = press(&mesh, law, Paddle::Rigid, Outline::ENDLESS, 36.0);
    let hard = balances(&hard);
    let mut model_stops = None;
    // At the same force.
    for to_mm in [35.5, 35.0, 34.5, 34.0, 33.5, 33.0] {
        let done = press(&mesh, law, Paddle::Cushioned(foam), Outline::ENDLESS, to_mm);
        let step = balances(&done);
        if step.paddle_force_mn >= hard.paddle_force_mn {
            model_stops = Some((step.peak_pressure_kpa, step.mean_pressure_kpa));
            break;
        }
    }
    let (peak, mean) = model_stops.unwrap();
    println!("peak {peak:.2} for {:.2} kPa", hard.peak_pressure_kpa);
    assert!(peak < hard.peak_pressure_kpa && mean < hard.mean_pressure_kpa);

    let thin = Cushion { thickness_mm: 1.0, young_kpa: 1.0 };
    let done = press(&mesh, law, Paddle::Cushioned(thin), Outline::ENDLESS, 34.0);
    let why = done.stopped_early.unwrap().to_string();
    assert!(why.contains("foam") && why.contains("1 mm"), "{why}");
    assert!(done.steps.last().unwrap().deflection_mm <= 1.0);
}

/// A solid whose lower side is at `lower`, over a plate of `size` with square corners that begins
/// at `corner`; the facets are `facet_mm` wide.
fn solid(
    corner: [f64; 2],
    size: [f64; 2],
    facet_mm: f64,
    lower: impl Fn(f64, f64) -> f64,
) -> TriMesh {
    let [nx, ny] = size.map(|length| (length / facet_mm).round() as usize);
    let mut points = Vec::new();
    for top in [false, true] {
        for j in 0..=ny {
            for i in 0..=nx {
                let x = corner[0] + size[0] * i as f64 / nx as f64;
                let y = corner[1] + size[1] * j as f64 / ny as f64;
                points.push(Vec3::new(x, y, if top { 60.0 } else { lower(x, y) }));
            }
        }
    }
    let at = |i: usize, j: usize, top: bool| {
        (usize::from(top) * (nx + 1) * (ny + 1) + j * (nx + 1) + i) as u32
    };
    let mut triangles = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let square =
                |top| [at(i, j, top), at(i + 1, j, top), at(i + 1, j + 1, top), at(i, j + 1, top)];
            let [a, b, c, d] = square(false);
            triangles.extend([[a, c, b], [a, d, c]]);
            let [a, b, c, d] = square(true);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut wall = |from: [usize; 2], to: [usize; 2]| {
        let [a, b] = [from, to].map(|[i, j]| at(i, j, false));
        let [c, d] = [to, from].map(|[i, j]| at(i, j, true));
        triangles.extend([[a, b, c], [a, c, d]]);
    };
    for i in 0..nx {
        wall([i, 0], [i + 1, 0]);
        wall([i + 1, ny], [i, ny]);
    }
    for j in 0..ny {
        wall([0, j + 1], [0, j]);
        wall([nx, j], [nx, j + 1]);
    }
    TriMesh { points, triangles }
}

/// What a program for CAD would hand over: through a file, in single precision.
fn through_a_file(surface: &TriMesh) -> TriMesh {
    let name = format!("plates-{}-{}.stl", std::process::id(), surface.points.len());
    let path = std::env::temp_dir().join(name);
    stl::write(&path, surface).unwrap();
    let found = stl::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(found.triangles.len(), surface.triangles.len());
    found
}

/// Verifies: plates through an STL file | the plates themselves | 1 %
#[test]
fn surfaces_from_cad_press_as_what_they_are_made_of() {
    let mesh = block([16, 12, 3], [120.0, 90.0], 5.0, |_, _| 0.0);
    let curve = CurvedPlate { rise_mm: 8.0, reach_mm: 60.0, arch_radius_mm: 900.0 };
    let rise = |x: f64, y: f64| curve.bend([x, y], &AT_REST).value;
    let size = [240.0, 180.0];
    // Nowhere near the origin of the file.
    let file = [300.0, -50.0];
    let corner = [file[0] - 0.5 * size[0], file[1]];
    let flat = solid(corner, size, 20.0, |_, _| 12.5);
    let curved = solid(corner, size, 3.0, |x, y| 30.0 + rise(x - file[0], y - file[1]));
    // The arch is lowest at the sides: that is zero for a surface from CAD.
    let lowest = rise(0.5 * size[0], size[1]);
    for (surface, rigid, shift) in
        [(flat, Paddle::Rigid, 0.0), (curved, Paddle::Lifted(Arc::new(curve)), -lowest)]
    {
        let cad = CadPaddle::new(&through_a_file(&surface), RADIUS_MM).unwrap();
        assert_eq!(cad.outline.plate.unwrap().half, [120.0, 90.0]);
        let same = Outline { plate: cad.outline.plate, window: None };
        let known = press(&mesh, soft(), rigid, same, 34.0);
        let read =
            press(&mesh, soft(), Paddle::Lifted(Arc::new(cad.field)), cad.outline, 34.0 - shift);
        let forces = [balances(&known).paddle_force_mn, balances(&read).paddle_force_mn];
        println!("{forces:?} mN");
        assert!((forces[1] / forces[0] - 1.0).abs() < 0.01, "{forces:?}");
    }
}

#[test]
fn a_surface_from_cad_is_read_with_its_corners_and_smoothly() {
    let wave = |x: f64, y: f64| 2.0 * (x / 30.0).sin() * (y / 40.0).cos();
    let cad = CadPaddle::new(&solid([0.0, 0.0], [120.0, 90.0], 2.0, wave), RADIUS_MM).unwrap();
    let place = |x: f64, y: f64| cad.field.bend([x - 60.0, y], &AT_REST);
    let zero = place(33.0, 41.0).value - wave(33.0, 41.0);
    for (x, y) in [(1.0, 2.0), (15.3, 70.1), (60.0, 45.0), (118.0, 88.0), (104.2, 20.0)] {
        let here = place(x, y);
        assert!((here.value - zero - wave(x, y)).abs() < 0.01, "{x} {y}: {}", here.value - zero);
        let slope = 2.0 / 30.0 * (x / 30.0).cos() * (y / 40.0).cos();
        assert!((here.slope[0] - slope).abs() < 0.01, "{} for {slope}", here.slope[0]);
    }
    // A disc of 48 corners: as round as the area says.
    let (mut points, mut triangles) =
        (vec![Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 9.0)], vec![]);
    let count = 48;
    for n in 0..count {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(n) / f64::from(count)).sin_cos();
        points.extend([0.0, 9.0].map(|z| Vec3::new(45.0 * cos, 45.0 * sin, z)));
    }
    for n in 0..count as u32 {
        let next = (n + 1) % count as u32;
        let [a, b, c, d] = [2 + 2 * n, 2 + 2 * next, 3 + 2 * next, 3 + 2 * n];
        triangles.extend([[0, b, a], [1, d, c], [a, b, c], [a, c, d]]);
    }
    let disc = CadPaddle::new(&TriMesh { points, triangles }, RADIUS_MM).unwrap();
    let plate = disc.outline.plate.unwrap();
    assert!((plate.corner_mm / 45.0 - 1.0).abs() < 0.02, "{plate:?}");
    assert!(disc.field.bend([44.0, 80.0], &AT_REST).value.abs() < 1e-9);
}

#[test]
fn surfaces_that_are_no_paddle_are_refused_with_the_reason() {
    let plate = |lower: &dyn Fn(f64, f64) -> f64| solid([0.0, 0.0], [120.0, 90.0], 5.0, lower);
    let refused = |surface: &TriMesh| CadPaddle::new(surface, RADIUS_MM).unwrap_err();
    let good = plate(&|_, _| 0.0);
    assert!(CadPaddle::new(&good, RADIUS_MM).is_ok());

    let mut metres = good.clone();
    metres.points.iter_mut().for_each(|p| *p *= 1e-3);
    let why = refused(&metres).to_string();
    assert!(why.contains("0.1200 x 0.0900") && why.contains("metres"), "{why}");

    let mut open = good.clone();
    open.triangles.remove(40);
    let why = refused(&open).to_string();
    assert!(why.contains("3 edges") && why.contains("closed"), "{why}");

    let mut turned = good.clone();
    turned.triangles[7].swap(0, 1);
    assert!(matches!(refused(&turned), CadError::Open { .. }));

    let mut inside_out = good.clone();
    inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    // Its lower side is the upper one then: an endless wall would be read.
    assert!(matches!(refused(&inside_out), CadError::InsideOut));

    // A bracket that hangs in the air above the plate.
    let mut bracket = solid([40.0, 40.0], [30.0, 30.0], 10.0, |_, _| 20.0);
    bracket.points.iter_mut().for_each(|p| p.z += 60.0);
    let mut overhang = good.clone();
    let count = overhang.points.len() as u32;
    overhang.points.extend(bracket.points);
    overhang.triangles.extend(bracket.triangles.iter().map(|t| t.map(|n| n + count)));
    let why = refused(&overhang).to_string();
    assert!(why.contains("overhang") && why.contains("z = 0.0") && why.contains("80.0"), "{why}");

    // A window right through it: a frame of four bars would do, here its parts far apart.
    let mut parts = solid([0.0, 0.0], [50.0, 90.0], 5.0, |_, _| 0.0);
    let other = solid([80.0, 0.0], [40.0, 90.0], 5.0, |_, _| 0.0);
    let count = parts.points.len() as u32;
    parts.points.extend(other.points);
    parts.triangles.extend(other.triangles.iter().map(|t| t.map(|n| n + count)));
    let why = refused(&parts).to_string();
    assert!(why.contains("hole"), "{why}");

    let steep = plate(&|x, _| if x > 60.0 { 15.0 } else { 0.0 });
    assert!(matches!(refused(&steep), CadError::Steep { .. }));
}
