//! Loads that cannot be carried: how steps are cut and grow again, what is kept, and what the error says.

use crate::common;

use common::loads::{DeadForces, Pull};
use common::shapes::brick;
use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
    progress::{Progress, Silent},
    solution::Solution,
    study::LawName,
    units::WEIGHT_OF_G_PER_CM3,
};
use mammotwin_solver::assemble::State;
use mammotwin_solver::materials::{Law, MaterialError};
use mammotwin_solver::newton::{Newton, NewtonError, NewtonOptions};
use mammotwin_solver::solve::{Place, follow};
use mammotwin_solver::terms::{
    Bulk, Curvature, Gravity, Load, Opening, Sliding, Slip, target::Plane,
};
use mammotwin_solver::{Model, Options, SolveError, solve};
use std::sync::{Arc, Mutex};

/// Area of each node of the upper side of a mesh (mm²).
fn shares(mesh: &TetMesh) -> Vec<(u32, f64)> {
    let mut shares = vec![0.0; mesh.points.len()];
    for face in mesh.patch(Patch::Skin) {
        let [a, b, c] = face.map(|n| mesh.points[n as usize]);
        for &n in face {
            shares[n as usize] += (b - a).cross(&(c - a)).norm() / 6.0;
        }
    }
    mesh.patch_nodes(Patch::Skin).into_iter().map(|n| (n, shares[n as usize])).collect()
}

/// A bar of 10 x 10 mm along z, its lower end held along z; sides contract freely.
fn bar(layers: usize, height_mm: f64, law: Law) -> (TetMesh, Model) {
    let mesh = brick([2, 2, layers], |i, j, l| {
        Vec3::new(5.0 * i as f64, 5.0 * j as f64, height_mm / layers as f64 * l as f64)
    });
    let mut model = Model::new(&mesh);
    model.add(Bulk::new("bar", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    for (n, p) in mesh.points.iter().enumerate() {
        for axis in (0..3).filter(|&axis| p[axis] == 0.0) {
            model.fix(n as u32, axis);
        }
    }
    (mesh, model)
}

fn hencky(young_kpa: f64, poisson: f64) -> Law {
    Law::new(LawName::Linear, young_kpa, poisson, None).unwrap()
}

/// Fractions of the load that were reached, in their order.
#[derive(Default)]
struct Way(Mutex<Vec<f64>>);

impl Progress for Way {
    fn report(&self, fraction: f64, _doing: &str) {
        self.0.lock().unwrap().push(fraction);
    }
}

fn hanging(most: usize, smallest_step: f64, way: &Way) -> Result<Solution, SolveError> {
    let law = Law::neo_hookean_coupled(0.3, 0.49).unwrap();
    let (mesh, mut model) = bar(8, 60.0, law);
    model.add(Gravity::new("gravity", &mesh, 1.0, Vec3::z())).unwrap();
    let newton = NewtonOptions { max_iterations: most, ..NewtonOptions::default() };
    let options = Options { newton, smallest_step, ..Options::default() };
    solve(&model, &mesh.points, &options, way)
}

/// Verifies: descent that needs more iterations than it is given, smallest load step the whole | the same with enough | 1e-5 mm
#[test]
fn a_slow_descent_is_not_taken_for_a_fall() {
    let whole = hanging(80, 1.0, &Way::default()).unwrap();
    let most = whole.checks.iterations / 2;
    let slow = hanging(most, 1.0, &Way::default());
    let slow = slow.unwrap_or_else(|error| panic!("{error}"));
    println!("{:?} for {:?}", slow.checks, whole.checks);
    assert!(most > 1 && slow.checks.iterations > most, "{:?}", slow.checks);
    assert!(apart(&whole.points, &slow.points) < 1e-5);
}

/// Verifies: iterations of minimisations that end, are given up and cannot begin | what was done: 0 < n, the cap, 0 | exact
#[test]
fn a_failed_minimisation_counts_what_it_did() {
    let (mesh, mut model) = bar(8, 60.0, Law::neo_hookean_coupled(0.3, 0.49).unwrap());
    model.add(Gravity::new("gravity", &mesh, 1.0, Vec3::z())).unwrap();
    let mut newton = Newton::new(&model).unwrap();
    let mut minimise = |points: &[Vec3], max_iterations: usize| {
        let mut state = State::new(&model, points.to_vec(), Load::GRAVITY);
        let options = NewtonOptions { max_iterations, ..NewtonOptions::default() };
        let found = newton.minimise(&model, &mut state, &options, Curvature::Exact);
        (found.err(), newton.iterations())
    };
    let (found, whole) = minimise(&mesh.points, 80);
    assert!(found.is_none() && whole > 3 && whole < 80, "{found:?} after {whole}");
    let (found, given_up) = minimise(&mesh.points, whole - 1);
    assert!(matches!(found, Some(NewtonError::Slow { .. })) && given_up == whole - 1);
    let mut turned = mesh.points.clone();
    turned[mesh.tets[0][0] as usize] += 500.0 * Vec3::new(1.0, 1.0, 1.0);
    let (found, none) = minimise(&turned, 80);
    assert!(matches!(found, Some(NewtonError::Start(_))) && none == 0, "{found:?} after {none}");
}

fn apart(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Verifies: load step that fails: cut, growth, end | equilibrium in one step | 1e-5 mm
#[test]
fn a_step_that_fails_is_cut_and_steps_grow_again() {
    let whole = hanging(80, 1.0, &Way::default()).unwrap();
    assert_eq!(whole.checks.steps, 1);
    // Too few iterations for the whole load at once.
    let way = Way::default();
    let parts = hanging(5, 1.0 / 256.0, &way).unwrap();
    let way = way.0.into_inner().unwrap();
    let steps: Vec<f64> = [0.0].iter().chain(&way).zip(&way).map(|(from, to)| to - from).collect();
    println!("reached {way:.4?}, {:?}", parts.checks);
    assert!(steps[0] < 1.0, "the first step was cut: {way:?}");
    assert!(steps.windows(2).any(|pair| pair[1] > 1.5 * pair[0]), "none grew: {way:?}");
    assert!(way.is_sorted() && way.last() == Some(&1.0), "{way:?}");
    assert!(parts.checks.steps > way.len(), "failed steps count too: {:?}", parts.checks);
    let apart = apart(&whole.points, &parts.points);
    println!("{apart:.1e} mm apart");
    assert!(apart < 1e-5, "{apart} mm");
}

/// Verifies: bar whose force has a greatest value, E A/e, load beyond it | closed form (Hencky's law) | `NoStableState` within 1 % of it, last stretch 1e-6
#[test]
fn a_bar_has_no_stable_state_beyond_its_greatest_force() {
    let (young, area) = (3.0, 100.0);
    let (mesh, mut model) = bar(3, 20.0, hencky(young, 0.45));
    // Nominal stress is E ln λ / λ for every ν, at most E/e; the load goes to 1/0.6 of that.
    let greatest = young * area / std::f64::consts::E;
    let force = greatest / 0.6;
    let forces = shares(&mesh).into_iter().map(|(n, share)| (n, share / area * force * Vec3::z()));
    model.add(DeadForces::new(forces)).unwrap();
    let way = Way::default();
    let error = solve(&model, &mesh.points, &Options::default(), &way).unwrap_err();
    println!("{error}");
    let SolveError::NoStableState { falling, place, load_fraction, last } = &error else {
        panic!("{error:?}")
    };
    assert!(*falling > 0);
    // A step of 1/256 is the smallest that is tried.
    assert!(*load_fraction <= 0.6 && *load_fraction > 0.6 - 1.0 / 128.0, "{load_fraction}");
    assert_eq!(way.0.into_inner().unwrap().last(), Some(load_fraction));
    assert!(place.node.is_some() && error.to_string().contains("stiffen the tissue"));
    // Where it was before it ran away.
    assert!(place.mm.z <= 20.0 * std::f64::consts::E, "{place:?}");
    let last = last.as_ref().unwrap();
    let stretch = shares(&mesh).into_iter().map(|(n, _)| last.points[n as usize].z / 20.0);
    for stretch in stretch {
        let stress = young * stretch.ln() / stretch;
        let off = stress * area / (load_fraction * force) - 1.0;
        assert!(stretch < std::f64::consts::E && off.abs() < 1e-6, "{stretch}: {off:e}");
    }
}

/// Verifies: column too soft to hang, ρ g H / μ of 2 | limit of the top, 2 (1 + ν)/e (Hencky's law) | `NoStableState` within 5 %
#[test]
fn a_column_too_soft_for_its_weight_has_no_stable_state() {
    let (density, height, poisson) = (1.0, 100.0, 0.45);
    let weight = density * WEIGHT_OF_G_PER_CM3 * height;
    let shear = weight / 2.0;
    let young = 2.0 * (1.0 + poisson) * shear;
    let (mesh, mut model) = bar(40, height, hencky(young, poisson));
    model.add(Gravity::new("gravity", &mesh, density, Vec3::z())).unwrap();
    let error = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap_err();
    println!("{error}");
    let SolveError::NoStableState { falling, load_fraction, last, .. } = &error else {
        panic!("{error:?}")
    };
    let want = young / std::f64::consts::E / weight;
    println!("{falling} directions; {load_fraction} of the weight carried for {want}");
    assert!(*falling > 0 && last.is_some());
    assert!((load_fraction / want - 1.0).abs() < 0.05, "{load_fraction} for {want}");
}

/// A block of 40 x 40 x 20 mm on the plane z = 0, beside its model.
fn block(opening: Opening, slip: Slip) -> (TetMesh, Model) {
    let mesh = brick([4, 4, 2], |i, j, l| 10.0 * Vec3::new(i as f64, j as f64, l as f64));
    let mut model = Model::new(&mesh);
    let law = Law::neo_hookean_coupled(100.0, 0.3).unwrap();
    model.add(Bulk::new("block", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", &mesh, 0.981, -Vec3::z())).unwrap();
    let plane = Plane { point: Vec3::zeros(), normal: Vec3::z() };
    let faces = mesh.patch(Patch::ChestWall);
    let plane = Sliding::new("plane", &mesh.points, faces, Arc::new(plane));
    model.add(plane.opening(opening).slip(slip, &mesh.points).unwrap()).unwrap();
    (mesh, model)
}

/// Verifies: block pulled beyond its friction | closed form: half of the pull | load fraction 1/128, last balance 1e-4
#[test]
fn a_block_that_is_pulled_away_names_the_load_that_it_carried() {
    let (mesh, mut model) = block(Opening::Free, Slip::Coulomb(0.3));
    let weight = 40.0 * 40.0 * 20.0 * 0.981 * WEIGHT_OF_G_PER_CM3;
    // On the lower face, so that the block does not tilt.
    let nodes = mesh.patch_nodes(Patch::ChestWall);
    let each = Vec3::x() / nodes.len() as f64;
    model.add(Pull(DeadForces::new(nodes.iter().map(|&n| (n, each))))).unwrap();
    let pull = 2.0 * 0.3 * weight;
    let at = |force: f64| Load { receptor_mm: force, ..Load::GRAVITY };
    let path = [at(0.0), at(pull)];
    let error = follow(&model, &mesh.points, &path, &Options::default()).unwrap_err();
    println!("{error}");
    let SolveError::Stopped { place, load_fraction, remedy, last, .. } = &error else {
        panic!("{error:?}")
    };
    assert!((load_fraction - 0.5).abs() < 1.0 / 128.0, "{load_fraction}");
    assert!(place.node.is_some_and(|n| (place.mm - mesh.points[n]).norm() < 1.0), "{place:?}");
    assert!(remedy.contains("hold the body better"), "{remedy}");
    let last = last.as_ref().unwrap();
    let balance = last.forces["plane"].x + load_fraction * pull;
    assert!(balance.abs() < 1e-4 * weight, "{:?}", last.forces);
}

#[track_caller]
fn refused(error: SolveError) -> (String, Place, f64, &'static str) {
    println!("{error}");
    let text = error.to_string();
    let SolveError::Stopped { why, place, load_fraction, remedy, .. } = error else {
        panic!("{error:?}")
    };
    // All of it is told.
    let told = [why.as_str(), place.term.as_str(), remedy].iter().all(|part| text.contains(*part));
    assert!(told && text.contains(&format!("element {}", place.element)), "{text}");
    (why, *place, load_fraction, remedy)
}

/// Verifies: contact that cannot close | the node that is held farthest from it | exact
#[test]
fn a_contact_that_stays_open_names_its_worst_node() {
    let (mesh, mut model) = block(Opening::Never, Slip::Free);
    let nodes = mesh.patch_nodes(Patch::ChestWall);
    let (near, far) = (nodes[3], nodes[17]);
    for (node, up) in [(near, 1.0), (far, 3.0)] {
        model.hold(node, mesh.points[node as usize] + up * Vec3::z());
    }
    let error = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap_err();
    let (why, place, load_fraction, remedy) = refused(error);
    assert!(why.contains("contact") && remedy.contains("contact surfaces"), "{why}; {remedy}");
    assert_eq!((place.term.as_str(), place.node), ("plane", Some(far as usize)));
    assert_eq!(place.mm, mesh.points[far as usize] + 3.0 * Vec3::z());
    assert_eq!(load_fraction, 0.0);
}

#[test]
fn friction_that_does_not_settle_names_a_node_of_its_contact() {
    let (mesh, mut model) = block(Opening::Free, Slip::Coulomb(0.3));
    // One edge is held aside, so that the others slip by different ways.
    for (n, _) in mesh.points.iter().enumerate().filter(|(_, p)| p.x == 0.0 && p.z == 20.0) {
        model.hold(n as u32, mesh.points[n] + 2.0 * Vec3::x());
    }
    // No friction is as settled as this.
    let options = Options { friction: -1.0, ..Options::default() };
    let (why, place, _, remedy) =
        refused(solve(&model, &mesh.points, &options, &Silent).unwrap_err());
    assert!(why.contains("friction") && remedy.contains("friction"), "{why}; {remedy}");
    let nodes = mesh.patch_nodes(Patch::ChestWall);
    assert!(place.term == "plane" && place.mm.z.abs() < 0.06, "{place:?}");
    assert_eq!(place.node, Some(nodes[place.element] as usize));
}

#[test]
fn an_element_that_begins_inside_out_is_named() {
    let law = Law::neo_hookean_coupled(1.0, 0.3).unwrap();
    let (mesh, model) = bar(2, 10.0, law);
    let mut start = mesh.points.clone();
    let inner = mesh.points.iter().position(|p| *p == Vec3::new(5.0, 5.0, 5.0)).unwrap();
    start[inner].z = 30.0;
    let first = mesh.tets.iter().position(|tet| TetMesh::tet_volume(&start, tet) <= 0.0).unwrap();
    let error = solve(&model, &start, &Options::default(), &Silent).unwrap_err();
    let (why, place, load_fraction, remedy) = refused(error);
    assert!(why.starts_with(&MaterialError::Inverted { j: -1.0 }.to_string()[..20]), "{why}");
    let middle = mesh.tets[first].iter().map(|&n| start[n as usize]).sum::<Vec3>() / 4.0;
    assert_eq!((place.term.as_str(), place.element, place.node), ("bar", first, None));
    assert!((place.mm - middle).norm() < 1e-12 && load_fraction == 0.0);
    assert!(remedy.contains("improve the mesh"), "{remedy}");
}
