//! A breast-like body squeezed between two rigid plates with rounded edges, from 132 mm to 50 mm.
//!
//! E = 0.5 kPa, ν = 0.49; the base is fixed, the plates are frictionless, their edges 20 mm from the
//! base with a radius of 10 mm. An independent dense prototype (stabilised linear tetrahedra, coupled
//! neo-Hookean law) gives 0.98 N at 60 mm and 1.33 / 1.36 N (upper / lower plate) at 50 mm.

use crate::common;

use common::squeeze::{EDGE_MM, Squeeze};
use common::{Body, coarse, fine};
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, study::LawName};
use mammotwin_solver::compress::{Compressed, Plates, Step, Stops, compress};
use mammotwin_solver::materials::Law;
use mammotwin_solver::mesh::quadratic::{FACE_CHILDREN, QuadraticMesh};
use mammotwin_solver::paddles::{Hinge, Outline, Paddle, RoundedPlate};
use mammotwin_solver::terms::{QuadraticBulk, quadratic::Rule};
use mammotwin_solver::{Model, Options};

fn squeeze(body: &Body, law: Law, radius_mm: f64, goal_mm: f64) -> Compressed {
    press(body, law, radius_mm, goal_mm, None, 0.0)
}

fn press(
    body: &Body,
    law: Law,
    radius_mm: f64,
    goal_mm: f64,
    hinge: Option<Hinge>,
    friction: f64,
) -> Compressed {
    let squeeze = Squeeze {
        law,
        radius_mm,
        paddle: hinge.map_or(Paddle::Rigid, Paddle::Flex),
        outline: Outline::ENDLESS,
        middle_mm: 0.0,
        friction,
        step_mm: 5.0,
        stops: Stops::at_thickness(goal_mm),
    };
    let (plates, done) = (squeeze.plates(body), squeeze.run(body));
    // Friction at the rounded edges presses, too; a tilted paddle has a test of its own.
    for step in done.steps.iter().filter(|step| step.tilt_rad == 0.0 && friction == 0.0) {
        integrates(&plates, step);
    }
    done
}

/// The tractions on the skin, pressure times the plates' normal, sum up to what the plates press
/// with.
#[track_caller]
fn integrates(plates: &Plates, step: &Step) {
    let &Plates { axis, away, edge_mm, radius_mm, .. } = plates;
    let middle = step.receptor_mm + 0.5 * step.thickness_mm;
    let mut forces = [0.0, 0.0];
    for face in &plates.faces {
        let [a, b, c] = face.map(|n| step.points[n as usize]);
        let third = (b - a).cross(&(c - a)) / 6.0;
        for (n, p) in face.iter().zip([a, b, c]) {
            let above = p.dot(&axis) > middle;
            let (into, level) = if above {
                (axis, step.receptor_mm + step.thickness_mm)
            } else {
                (-axis, -step.receptor_mm)
            };
            let outline = Outline::ENDLESS;
            let plate = RoundedPlate { into, away, edge_mm, radius_mm, middle_mm: 0.0, outline };
            let normal = plate.distance(&p, level).1;
            let force = step.contact_pressure_kpa[*n as usize] * -third.dot(&normal) * normal;
            forces[usize::from(above)] -= force.dot(&into);
        }
    }
    let [low, high] = forces;
    for (sum, force) in [(low, step.receptor_force_mn), (high, step.paddle_force_mn)] {
        println!("{:.1} mm: {sum:.2} for {force:.2} mN", step.thickness_mm);
        assert!((sum - force).abs() <= 0.01 * force.abs() + 0.01, "{sum} for {force} mN");
    }
}

/// Force (N) of both plates at a thickness that was recorded.
fn forces_n(done: &Compressed, thickness_mm: f64) -> [f64; 2] {
    let at = |step: &&Step| (step.thickness_mm - thickness_mm).abs() < 1e-6;
    let step = done.steps.iter().find(at).unwrap();
    [step.paddle_force_mn / 1e3, step.receptor_force_mn / 1e3]
}

/// What every compression must be.
#[track_caller]
fn check(done: &Compressed, goal_mm: f64) {
    assert!(done.stopped_early.is_none(), "{:?}", done.stopped_early);
    let checks = &done.solution.checks;
    assert!((done.steps.last().unwrap().thickness_mm - goal_mm).abs() < 1e-9);
    assert!(checks.max_penetration_mm < 0.05 && checks.max_gap_mm < 0.05, "{checks:?}");
    assert!(checks.residual < 1e-6 && checks.force_imbalance < 1e-6, "{checks:?}");
    assert!(checks.min_det_f > 0.1 && checks.internal_imbalance < 1e-10, "{checks:?}");
    for pair in done.steps.windows(2) {
        let [before, after] = [0, 1].map(|n| pair[n].paddle_force_mn + pair[n].receptor_force_mn);
        assert!(after >= before - 1.0, "the force falls from {before} to {after} mN");
    }
}

/// Verifies: compression to 50 mm: forces of both plates | independent prototype: 1.33, 1.36 N | 2 %, gaps 0.05 mm
#[test]
fn a_neo_hookean_breast_reaches_50_mm() {
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    let done = squeeze(&coarse(), law, 10.0, 50.0);
    check(&done, 50.0);
    let [upper, lower] = forces_n(&done, 50.0);
    assert!((upper / 1.33 - 1.0).abs() < 0.02 && (lower / 1.36 - 1.0).abs() < 0.02);
    assert!(done.solution.checks.iterations < 500, "{:?}", done.solution.checks);
}

/// Verifies: compression to 50 mm, three edges: pressures sum up | force of the plates | 1 %, balance 1e-6
#[test]
fn a_gent_breast_reaches_50_mm_with_any_edge() {
    let law = Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap();
    for radius_mm in [3.0, 10.0, 20.0] {
        check(&squeeze(&coarse(), law, radius_mm, 50.0), 50.0);
    }
}

/// Verifies: compression to 45 mm, Jₘ 1, ν = 0.499 | equilibrium | balance 1e-6, gaps 0.05 mm
#[test]
fn a_gent_breast_near_its_limit_reaches_45_mm() {
    let law = Law::new(LawName::Gent, 0.5, 0.499, Some(1.0)).unwrap();
    check(&squeeze(&coarse(), law, 10.0, 45.0), 45.0);
}

/// Torque (mN mm) of the contact pressures on a tilted paddle about its axis, from the pressures,
/// the deformed skin and the paddle's shape.
fn torque_of_pressures(body: &Body, step: &Step, axis_mm: f64) -> f64 {
    let (sin, cos) = step.tilt_rad.sin_cos();
    let axis = Vec3::new(0.0, step.receptor_mm + step.thickness_mm, EDGE_MM + axis_mm);
    let (into, away) = (Vec3::new(0.0, cos, sin), Vec3::new(0.0, -sin, cos));
    let edge_mm = away.dot(&axis) - axis_mm;
    let paddle = RoundedPlate {
        into,
        away,
        edge_mm,
        radius_mm: 10.0,
        middle_mm: 0.0,
        outline: Outline::ENDLESS,
    };
    let mut torque = 0.0;
    for face in body.mesh.patch(Patch::Skin) {
        let [a, b, c] = face.map(|n| step.points[n as usize]);
        let third = (b - a).cross(&(c - a)) / 6.0;
        for (n, p) in face.iter().zip([a, b, c]) {
            if p.y > step.receptor_mm + 0.5 * step.thickness_mm {
                let normal = paddle.distance(&p, into.dot(&axis)).1;
                let push = step.contact_pressure_kpa[*n as usize] * third.dot(&normal) * normal;
                torque += (p - axis).cross(&push).x;
            }
        }
    }
    torque
}

#[test]
#[ignore = "minutes: skin that sticks to the plates"]
fn skin_that_rubs_on_the_plates_spreads_less() {
    let law = Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap();
    let body = coarse();
    let done = [0.0, 0.1, 0.3].map(|friction| press(&body, law, 10.0, 50.0, None, friction));
    // How far (mm) skin under the plates went along them.
    let spread = |done: &Compressed| {
        let step = done.steps.last().unwrap();
        let touched = |n: &usize| step.contact_pressure_kpa[*n] > 0.0;
        let way = |n: usize| {
            let way = step.points[n] - body.mesh.points[n];
            way.x.hypot(way.z)
        };
        let ways: Vec<f64> = (0..step.points.len()).filter(touched).map(way).collect();
        ways.iter().sum::<f64>() / ways.len() as f64
    };
    let spread_mm = done.each_ref().map(spread);
    println!("skin spreads by {spread_mm:.2?} mm");
    for done in &done {
        assert!(done.stopped_early.is_none(), "{:?}", done.stopped_early);
        let checks = &done.solution.checks;
        assert!(checks.residual < 1e-6 && checks.force_imbalance < 1e-6, "{checks:?}");
        assert!(checks.friction_lag <= 1e-4, "{checks:?}");
    }
    assert!(spread_mm[0] > spread_mm[1] && spread_mm[1] > spread_mm[2]);
}

/// Verifies: hinged paddle: torque | contact pressures of the skin | 2 %; hard hinge 1e-3
#[test]
fn a_paddle_on_a_hinge_tilts_until_torques_balance() {
    let body = coarse();
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    let hinge = |linear_mn_mm: f64, axis_mm: f64| Hinge {
        axis_mm,
        linear_mn_mm,
        quadratic_mn_mm: 5.0 * linear_mn_mm,
    };
    let rigid = squeeze(&body, law, 10.0, 92.0);
    let hard = press(&body, law, 10.0, 92.0, Some(hinge(1e12, 30.0)), 0.0);
    let [a, b] = [&rigid, &hard].map(|d| d.steps.last().unwrap().paddle_force_mn);
    assert!((a / b - 1.0).abs() < 1e-3, "a stiff hinge is none: {a} {b}");
    // The axis behind the breast: all of it lifts the side of the nipple. Beyond it: the reverse.
    for (axis_mm, sign) in [(0.0, -1.0), (30.0, 0.0), (120.0, 1.0)] {
        let hinge = hinge(2e5, axis_mm);
        let soft = press(&body, law, 10.0, 92.0, Some(hinge), 0.0);
        assert!(soft.stopped_early.is_none(), "{:?}", soft.stopped_early);
        let step = soft.steps.last().unwrap();
        let (torque, tilt) = (hinge.torque(step.tilt_rad), step.tilt_rad);
        let pressures = torque_of_pressures(&body, step, axis_mm);
        println!("{axis_mm}: {:.2}°, {torque:.0} of {pressures:.0} mN mm", tilt.to_degrees());
        assert!((pressures / torque - 1.0).abs() < 0.02, "{torque} of {pressures} mN mm");
        assert!(sign == 0.0 || sign * tilt > 0.001, "tilts by {tilt}");
        assert!(soft.solution.checks.force_imbalance < 1e-6);
    }
}

#[test]
#[ignore = "a minute: 20 k tetrahedra"]
fn a_fine_breast_reaches_50_mm() {
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    check(&squeeze(&fine(), law, 10.0, 50.0), 50.0);
}

/// Force (N) at 80 mm of ten-node tetrahedra of FEBio 4 on the mesh of 5 k, as it was noted: two digits. Its linear ones
/// have 0.68 N.
const PUBLISHED_N: f64 = 0.40;
/// The same of our ten-node tetrahedra, mean of both plates ([`quadratic_n`]).
const QUADRATIC_N: f64 = 0.4105;

#[track_caller]
fn check_force(body: &Body, tolerance: f64) {
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    let found = forces_n(&squeeze(body, law, 10.0, 80.0), 80.0);
    println!("{found:.4?} N");
    for force in found {
        assert!((force / QUADRATIC_N - 1.0).abs() < tolerance, "{force} N");
        assert!((force / PUBLISHED_N - 1.0).abs() < tolerance + 0.03, "{force} N");
    }
}

/// Verifies: force of both plates at 80 mm, linear tetrahedra of 5 k | own quadratic: 0.4105 N; FEBio 4, quadratic: 0.40 N | 9 %; 12 %
#[test]
fn the_force_is_near_that_of_quadratic_tetrahedra() {
    check_force(&coarse(), 0.09);
}

/// Verifies: force of both plates at 80 mm, linear tetrahedra of 20 k | own quadratic: 0.4105 N; FEBio 4, quadratic: 0.40 N | 5 %; 8 %
#[test]
#[ignore = "half a minute: 20 k tetrahedra"]
fn the_force_of_finer_tetrahedra_is_nearer() {
    check_force(&fine(), 0.05);
}

/// Force (N) of both plates on ten-node tetrahedra.
fn quadratic_n(body: &Body, law: Law, goal_mm: f64) -> [f64; 2] {
    let mesh = QuadraticMesh::new(&body.mesh);
    let mut model = Model::new(&TetMesh { points: mesh.points.clone(), ..TetMesh::default() });
    let laws = vec![law; mesh.tets.len()];
    model.add(QuadraticBulk::new("breast", &mesh, laws, Rule::Four).unwrap()).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    let whole = Squeeze::rigid(law, 18.0, goal_mm);
    let parts = |face: &[u32; 6]| FACE_CHILDREN.map(|part| part.map(|n| face[n]));
    let faces = mesh.patches[&Patch::Skin].iter().flat_map(parts).collect();
    let plates = Plates { faces, ..whole.plates(body) };
    let clock = std::time::Instant::now();
    let done =
        compress(model, &plates, &whole.closing(), &mesh.points, &Options::default(), &Silent)
            .unwrap();
    println!("{:?}: {:?}", clock.elapsed(), done.solution.checks);
    check(&done, goal_mm);
    forces_n(&done, goal_mm)
}

/// Verifies: force of both plates at 80 mm, ten-node tetrahedra of 5 k | FEBio 4, quadratic: 0.40 N | 3.5 %
#[test]
#[ignore = "half a minute: ten-node tetrahedra"]
fn the_force_on_quadratic_tetrahedra_is_that_of_another_code() {
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    let found = quadratic_n(&coarse(), law, 80.0);
    println!("{found:.4?} N");
    for force in found {
        assert!((force / PUBLISHED_N - 1.0).abs() < 0.035, "{found:?} N");
        assert!((force / QUADRATIC_N - 1.0).abs() < 0.005, "{found:?} N");
    }
}
