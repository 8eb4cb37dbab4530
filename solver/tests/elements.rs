//! Linear and quadratic tetrahedra against closed forms: patch test, stretched bar, hollow sphere.

use crate::common;

use common::laws::every;
use common::loads::Cavity;
use common::shapes::{brick, hollow_sphere};
use mammotwin_data::{
    Mat3, Vec3,
    mesh::{Patch, TetMesh},
    progress::Silent,
    solution::Solution,
    study::LawName,
};
use mammotwin_solver::assemble::{Assembly, State};
use mammotwin_solver::materials::{Law, Material};
use mammotwin_solver::mesh::quadratic::QuadraticMesh;
use mammotwin_solver::newton::NewtonOptions;
use mammotwin_solver::terms::{Bulk, Curvature, Load, QuadraticBulk, quadratic::Rule};
use mammotwin_solver::{Model, Options, solve};

/// The equilibrium, as near as rounding allows.
fn solved(model: &Model, start: &[Vec3]) -> Solution {
    let newton = NewtonOptions { residual: 1e-12, ..NewtonOptions::default() };
    solve(model, start, &Options { newton, ..Options::default() }, &Silent).unwrap()
}

/// A brick of 20 mm with crooked elements inside, and which of its nodes are on the outside.
fn crooked() -> (TetMesh, Vec<bool>) {
    let inside = |i: usize| i > 0 && i < 4;
    let mesh = brick([4, 4, 4], |i, j, k| {
        let p = 5.0 * Vec3::new(i as f64, j as f64, k as f64);
        let n = (i + 7 * j + 31 * k) as f64;
        let shift = Vec3::new((1.3 * n).sin(), (2.9 * n).cos(), (4.1 * n).sin());
        if inside(i) && inside(j) && inside(k) { p + shift } else { p }
    });
    let edge = |x: f64| x == 0.0 || x == 20.0;
    let outside = mesh.points.iter().map(|p| edge(p.x) || edge(p.y) || edge(p.z)).collect();
    (mesh, outside)
}

/// Boundary nodes moved by one F: the others are in balance there, and find back when shaken.
fn patch_test(model: &mut Model, outside: impl Fn(usize) -> bool) {
    let f = Mat3::new(1.2, 0.25, -0.1, 0.05, 0.9, 0.2, -0.15, 0.1, 0.95);
    let moved: Vec<Vec3> = model.rest.iter().map(|x| f * x).collect();
    for (n, p) in moved.iter().enumerate().filter(|(n, _)| outside(*n)) {
        model.hold(n as u32, *p);
    }
    let mut assembly = Assembly::new(model).unwrap();
    let mut state = State::new(model, moved.clone(), Load::GRAVITY);
    let (mut pressure, mut gradient, mut values) = (Vec::new(), Vec::new(), Vec::new());
    assembly.energy(model, &state, &moved, &mut pressure).unwrap();
    state.pressure = pressure;
    let exact = Curvature::Exact;
    assembly.newton_system(model, &state, exact, &mut gradient, &mut values).unwrap();
    let (held, free): (Vec<_>, Vec<_>) = (0..moved.len()).partition(|n| outside(*n));
    let largest = |nodes: Vec<usize>| nodes.iter().map(|n| gradient[*n].norm()).fold(0.0, f64::max);
    let (reaction, unbalanced) = (largest(held), largest(free));
    assert!(unbalanced < 1e-12 * reaction, "{unbalanced:.1e} mN against {reaction:.1e} mN");
    for own in &state.report(model).deformation_gradient {
        assert!((own - f).norm() < 1e-13 * f.norm(), "{own}");
    }
    // As near as energy differences tell.
    let shaken = moved.iter().map(|p| p + 0.2 * Vec3::new(p.y.sin(), p.z.sin(), p.x.sin()));
    let solution = solved(model, &shaken.collect::<Vec<_>>());
    let error = moved.iter().zip(&solution.points).map(|(m, p)| (m - p).norm());
    let error = error.fold(0.0, f64::max);
    assert!(error < 1e-6, "nodes off by {error:.1e} mm");
}

/// Verifies: patch test, crooked linear tetrahedra, every law | closed form | balance 1e-12, nodes 1e-6 mm
/// Verifies: patch test, crooked quadratic tetrahedra, every law | closed form | balance 1e-12, nodes 1e-6 mm
#[test]
fn a_constant_deformation_is_reproduced_by_crooked_elements() {
    let (mesh, outside) = crooked();
    for (name, law) in every(0.5, 0.499) {
        println!("{name}");
        let mut model = Model::new(&mesh);
        model.add(Bulk::new("body", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        patch_test(&mut model, |n| outside[n]);
    }
    let edge = |x: f64| x == 0.0 || x == 20.0;
    let fine = QuadraticMesh::new(&mesh);
    for (name, law) in every(0.5, 0.49) {
        println!("{name}, quadratic");
        let mut model = Model::new(&TetMesh { points: fine.points.clone(), ..TetMesh::default() });
        let bulk = QuadraticBulk::new("body", &fine, vec![law; fine.tets.len()], Rule::Four);
        model.add(bulk.unwrap()).unwrap();
        let p = &fine.points;
        patch_test(&mut model, |n| edge(p[n].x) || edge(p[n].y) || edge(p[n].z));
    }
}

/// Stress (kPa) along a Gent bar (Mira 2018, eq. 2.39) of a stretch, free at its sides.
fn gent_bar(shear: f64, bulk: f64, limit: f64, long: f64) -> f64 {
    // Principal Cauchy stress at the stretches (long, narrow, narrow).
    let stress = |narrow: f64, own: f64| {
        let j = long * narrow * narrow;
        let scale = j.powf(-2.0 / 3.0);
        let i1 = scale * (long * long + 2.0 * narrow * narrow);
        let slope = shear / (1.0 - (i1 - 3.0) / limit);
        slope * (scale * own * own - i1 / 3.0) / j + 0.5 * bulk * (j - 1.0 / j)
    };
    // The sides are free: bisection for their stretch.
    let (mut low, mut high) = (0.9 * long.powf(-0.5), 1.1 * long.powf(-0.5));
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if stress(middle, middle) > 0.0 { high = middle } else { low = middle }
    }
    stress(low, long)
}

/// Verifies: Gent bar, stretches 0.6 - 1.9 | closed form (Mira 2018, eq. 2.39) | 1e-6
#[test]
fn a_gent_bar_has_the_stress_of_the_closed_form() {
    let (mesh, _) = crooked();
    let (young, poisson, limit) = (0.5, 0.49, 2.0);
    let law = Law::new(LawName::Gent, young, poisson, Some(limit)).unwrap();
    let (shear, bulk) = (young / 2.0 / (1.0 + poisson), young / 3.0 / (1.0 - 2.0 * poisson));
    for long in [0.6, 0.8, 1.2, 1.6, 1.9] {
        let mut model = Model::new(&mesh);
        model.add(Bulk::new("bar", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        let mut start = mesh.points.clone();
        let narrow = f64::powf(long, -0.5);
        for (n, p) in mesh.points.iter().enumerate() {
            start[n] = Vec3::new(long * p.x, narrow * p.y, narrow * p.z);
            for axis in (0..3).filter(|axis| p[*axis] == 0.0) {
                model.fix(n as u32, axis);
            }
            if p.x == 20.0 {
                model.fix(n as u32, 0);
            }
        }
        let solution = solved(&model, &start);
        let want = gent_bar(shear, bulk, limit, long);
        for stress in &solution.cauchy_kpa {
            assert!((stress.m11 - want).abs() < 1e-6 * want.abs(), "{long}: {stress} {want}");
            assert!(stress.m22.abs() < 1e-6 * want.abs());
        }
        assert!(solution.checks.iterations <= 15, "{:?}", solution.checks);
    }
}

/// Inner and outer radius of a hollow sphere (mm), and the inner one under pressure.
const INNER_MM: f64 = 10.0;
const OUTER_MM: f64 = 20.0;
const GROWN_MM: f64 = 12.5;
/// Nearly none of the volume gives way.
const POISSON: f64 = 0.4999;

/// Stretches of the incompressible sphere outside and inside.
fn stretches() -> [f64; 2] {
    let outside = OUTER_MM.powi(3) + GROWN_MM.powi(3) - INNER_MM.powi(3);
    [outside.cbrt() / OUTER_MM, GROWN_MM / INNER_MM]
}

/// Pressure (kPa) that holds the sphere so: the integral of the law's stress along the radius, by Simpson's rule
/// (Ogden 1984, § 5.3.2).
fn pressure_by_radius(law: &Law) -> f64 {
    let [from, to] = stretches();
    let slope = |l: f64| {
        let p = law.stress(&Mat3::from_diagonal(&Vec3::new(l.powi(-2), l, l))).unwrap();
        (p.m22 + p.m33 - 2.0 * l.powi(-3) * p.m11) / (l.powi(3) - 1.0)
    };
    let (count, h) = (400, (to - from) / 400.0);
    let weight = |n: usize| if n == 0 || n == count { 1.0 } else { [2.0, 4.0][n % 2] };
    (0..=count).map(|n| h / 3.0 * weight(n) * slope(from + n as f64 * h)).sum()
}

/// Radius (mm) to which the inside of the sphere grows under a pressure (kPa).
fn inflated(n: usize, law: Law, pressure_kpa: f64) -> f64 {
    let mesh = hollow_sphere(n, n, INNER_MM, OUTER_MM);
    let mut model = Model::new(&mesh);
    model.add(Bulk::new("wall", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    // The inside's faces point away from the wall, towards the centre.
    let faces = mesh.patch(Patch::ChestWall).iter().map(|&[a, b, c]| {
        let [p, q, r] = [a, b, c].map(|n| mesh.points[n as usize]);
        if p.dot(&q.cross(&r)) > 0.0 { [a, b, c] } else { [a, c, b] }
    });
    model.add(Cavity { faces: faces.collect(), pressure_kpa }).unwrap();
    for (node, p) in mesh.points.iter().enumerate() {
        for axis in (0..3).filter(|axis| p[*axis].abs() < 1e-9) {
            model.fix(node as u32, axis);
        }
    }
    let solution = solved(&model, &mesh.points);
    assert!(solution.checks.iterations <= 25, "{:?}", solution.checks);
    let inside = mesh.patch_nodes(Patch::ChestWall);
    let radii = inside.iter().map(|&n| solution.points[n as usize].norm());
    radii.sum::<f64>() / inside.len() as f64
}

/// Verifies: thick sphere under pressure, ν = 0.4999 | Ogden 1984, § 5.3.2 | order over 1.8, 2 % of the growth
#[test]
fn an_inflated_sphere_converges_with_second_order() {
    let young = 3.0;
    let law = Law::new(LawName::NeoHookean, young, POISSON, None).unwrap();
    let shell = |stretch: f64| 2.0 / stretch + 0.5 / stretch.powi(4);
    let [outside, inside] = stretches().map(shell);
    let pressure_kpa = young / 3.0 * (outside - inside);
    let errors = [4, 8, 16].map(|n| {
        let radius = inflated(n, law, pressure_kpa);
        println!("{n} elements: {radius:.4} mm for {GROWN_MM} mm");
        (radius - GROWN_MM).abs()
    });
    // Rising to two: 1.7 and 1.9.
    let order = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    println!("order {order:.2?}");
    assert!(order[0] > 1.6 && order[1] > 1.8, "order {order:.2?}: {errors:?}");
    assert!(errors[2] < 0.02 * (12.5 - 10.0), "{errors:?}");
}

/// Verifies: thick sphere under pressure, every law, ν = 0.4999 | quadrature of the stress along the radius | 5 % of the growth at 8 elements, order over 1.6
#[test]
fn a_sphere_of_every_law_grows_as_its_stress_along_the_radius_says() {
    for (name, law) in every(3.0, POISSON) {
        let pressure_kpa = pressure_by_radius(&law);
        let errors = [4, 8].map(|n| (inflated(n, law, pressure_kpa) - GROWN_MM).abs());
        let order = (errors[0] / errors[1]).log2();
        let part = errors[1] / (GROWN_MM - INNER_MM);
        println!(
            "{name}: {pressure_kpa:.4} kPa, {:.2} % of the growth off, order {order:.2}",
            100.0 * part
        );
        assert!(part < 0.05 && order > 1.6, "{name}: {errors:?}");
    }
}
