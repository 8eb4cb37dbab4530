//! Coulomb friction on closed forms: blocks on an incline, on a bed of springs, and in tension.
//!
//! The block is stiff, 40 x 40 x 20 mm, and weighs about 0.3 N; its lower face is the chest wall.

use crate::common;

use common::loads::{DeadForces, Pull};
use common::{coarse, shapes::brick, squeeze};
use mammotwin_data::{
    Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, solution::Solution, study::LawName,
};
use mammotwin_solver::assemble::{Assembly, State};
use mammotwin_solver::materials::Law;
use mammotwin_solver::solve::follow;
use mammotwin_solver::terms::{
    Bulk, Cable, Cables, Gravity, Load, Membrane, Opening, Sliding, Slip, Term,
    friction::SMOOTHING_MM,
    target::{Cylinder, Plane},
};
use mammotwin_solver::{Model, Options, SolveError, solve};
use std::sync::Arc;

const SIZE: [usize; 3] = [4, 4, 2];

fn block() -> TetMesh {
    brick(SIZE, |i, j, l| 10.0 * Vec3::new(i as f64, j as f64, l as f64))
}

/// The block under gravity of a direction and any length, on the plane z = 0.
struct Case {
    gravity: Vec3,
    opening: Opening,
    slip: Slip,
    /// Stiffness (mN/mm) of long springs along x on the whole block; none when zero.
    springs_mn_per_mm: f64,
}

const FAR_MM: f64 = 1e4;

impl Case {
    fn model(&self, mesh: &TetMesh) -> Model {
        let mut model = Model::new(mesh);
        let law = Law::neo_hookean_coupled(100.0, 0.3).unwrap();
        model.add(Bulk::new("block", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        model.add(Gravity::new("gravity", mesh, 0.981, self.gravity)).unwrap();
        let plane = Plane { point: Vec3::zeros(), normal: Vec3::z() };
        let faces = mesh.patch(Patch::ChestWall);
        let sliding = Sliding::new("plane", &mesh.points, faces, Arc::new(plane));
        let sliding = sliding.opening(self.opening).slip(self.slip, &mesh.points).unwrap();
        model.add(sliding).unwrap();
        if self.springs_mn_per_mm > 0.0 {
            // Taut by FAR_MM/1000 at rest, on both sides: springs that pull and push.
            let each = 0.5 * self.springs_mn_per_mm / mesh.points.len() as f64;
            for (name, sign) in [("springs", -1.0), ("more_springs", 1.0)] {
                let cable = |(n, p): (usize, &Vec3)| Cable {
                    node: n as u32,
                    anchor: p + sign * FAR_MM * Vec3::x(),
                    natural_mm: 0.997 * FAR_MM,
                    stiffness_mn_per_mm: each,
                };
                let cables = mesh.points.iter().enumerate().map(cable).collect();
                model.add(Cables::new(name, cables).unwrap()).unwrap();
            }
        }
        model
    }

    fn solve(&self, options: &Options) -> Result<Solution, SolveError> {
        let mesh = block();
        solve(&self.model(&mesh), &mesh.points, options, &Silent)
    }
}

/// Weight (mN) of the block under standard gravity.
fn weight_mn() -> f64 {
    40.0 * 40.0 * 20.0 * 0.981 * 9.80665e-3
}

/// Gravity down a slope of this tangent.
fn slope(tangent: f64) -> Vec3 {
    Vec3::new(tangent, 0.0, -1.0).normalize()
}

/// Largest and mean displacement (mm) of the lower face along x.
fn slid(solution: &Solution) -> (f64, f64) {
    let mesh = block();
    let nodes = mesh.patch_nodes(Patch::ChestWall);
    let along: Vec<f64> =
        nodes.iter().map(|&n| (solution.points[n as usize] - mesh.points[n as usize]).x).collect();
    let far = along.iter().fold(0.0, |far: f64, x| far.max(x.abs()));
    (far, along.iter().sum::<f64>() / along.len() as f64)
}

/// Verifies: block that sticks on an incline | closed form | slip 0.075 mm, balance 1e-4
#[test]
fn a_block_sticks_below_the_angle_of_friction() {
    for (friction, part) in [(0.1, 0.9), (0.5, 0.9), (0.5, 0.99), (1.0, 0.8)] {
        let gravity = slope(part * friction);
        let (opening, slip) = (Opening::Free, Slip::Coulomb(friction));
        let case = Case { gravity, opening, slip, springs_mn_per_mm: 0.0 };
        let found = case.solve(&Options::default()).unwrap();
        let (far, mean) = slid(&found);
        let force = found.forces["plane"];
        println!("{friction} {part}: {far:.4} {mean:.4} mm, {force:?} {:?}", found.checks);
        let balance = force + weight_mn() * gravity;
        assert!(balance.norm() < 1e-4 * weight_mn(), "{balance:?}");
        assert!(far < 1.5 * SMOOTHING_MM, "slid by {far} mm");
    }
}

/// Verifies: block that slips on an incline | closed form | force 1 %, place 2 %
#[test]
fn a_block_slips_beyond_the_angle_of_friction_with_the_force_of_coulomb() {
    for friction in [0.1, 0.3, 0.5] {
        let gravity = slope(1.3 * friction);
        let (opening, slip) = (Opening::Free, Slip::Coulomb(friction));
        let case = Case { gravity, opening, slip, springs_mn_per_mm: 10.0 };
        let found = case.solve(&Options::default()).unwrap();
        let force = found.forces["plane"];
        let normal = -weight_mn() * gravity.z;
        println!("{friction}: {:?} mm, {force:?} {:?}", slid(&found), found.checks);
        assert!((force.z / normal - 1.0).abs() < 1e-4, "{force:?}, N = {normal}");
        assert!((force.x / (-friction * force.z) - 1.0).abs() < 0.01, "{force:?}");
        let want = (weight_mn() * gravity.x - friction * normal) / case.springs_mn_per_mm;
        assert!((slid(&found).1 / want - 1.0).abs() < 0.02, "{:?}, {want} mm", slid(&found));
    }
}

/// Verifies: block that nothing holds; rough plane | closed form | `Stopped` with place, no load carried; 0.1 mN
#[test]
fn nothing_holds_a_block_that_slips() {
    let (gravity, opening) = (slope(0.36), Opening::Free);
    let case = Case { gravity, opening, slip: Slip::Coulomb(0.3), springs_mn_per_mm: 0.0 };
    let error = case.solve(&Options::default()).unwrap_err();
    println!("{error}");
    // It slips at the smallest load already, as a whole: the search stalls, and names where.
    let SolveError::Stopped { place, load_fraction, remedy, last, .. } = error else {
        panic!("{error:?}")
    };
    let mesh = block();
    assert!(load_fraction == 0.0 && last.is_none(), "{load_fraction}");
    assert!(place.node.is_some_and(|node| node < mesh.points.len()) && !place.term.is_empty());
    assert!(place.mm.iter().all(|x| (-1.0..41.0).contains(x)), "{place:?}");
    assert!(remedy.contains("hold the body better"), "{remedy}");
    // A rough plane holds it.
    let found = Case { slip: Slip::Never, ..case }.solve(&Options::default()).unwrap();
    assert!(
        slid(&found).0 < SMOOTHING_MM
            && (found.forces["plane"].x + 0.36 * found.forces["plane"].z).abs() < 0.1
    );
}

/// Verifies: no-separation interface in tension, μ 0, 0.1, 0.5 | independence of μ | 1e-6 mm, last two to the bit
#[test]
fn a_surface_that_is_held_back_knows_no_friction() {
    // Hanging below the plane and pulled askew, held by springs.
    let gravity = Vec3::new(0.1, 0.03, 1.0);
    let found = [0.0, 0.1, 0.5].map(|friction| {
        let slip = Slip::Coulomb(friction);
        let case = Case { gravity, opening: Opening::Never, slip, springs_mn_per_mm: 20.0 };
        let options = Options { contact_mm: 1e-10, ..Options::default() };
        case.solve(&options).unwrap()
    });
    for other in &found[1..] {
        let apart = found[0].points.iter().zip(&other.points).map(|(a, b)| (a - b).norm());
        let apart = apart.fold(0.0, f64::max);
        println!("{apart:e} mm apart; {:?}", other.forces);
        assert!(apart < 1e-6, "{apart} mm");
    }
    // The body has to go down first where it sticks; from there on it is the same.
    assert_eq!(found[1].points, found[2].points);
    assert!(slid(&found[0]).1 > 0.1);
}

#[test]
fn no_friction_is_a_coefficient_of_zero() {
    let mesh = block();
    let plane = Plane { point: Vec3::zeros(), normal: Vec3::z() };
    let case =
        |slip| Case { gravity: slope(0.2), opening: Opening::Never, slip, springs_mn_per_mm: 9.0 };
    let [free, zero] = [Slip::Free, Slip::Coulomb(0.0)].map(|s| case(s).solve(&Options::default()));
    assert_eq!(free.unwrap().points, zero.unwrap().points);
    let plain = Sliding::new("plane", &mesh.points, mesh.patch(Patch::ChestWall), Arc::new(plane));
    assert_eq!(plain.elements(), 25);
}

/// Pulls the block to and fro along x; returns where it is (mm) and the solutions.
fn pulled(friction: f64, springs_mn_per_mm: f64, pulls_mn: &[f64]) -> Vec<f64> {
    let mesh = block();
    let gravity = -Vec3::z();
    let (opening, slip) = (Opening::Free, Slip::Coulomb(friction));
    let case = Case { gravity, opening, slip, springs_mn_per_mm };
    let mut model = case.model(&mesh);
    // On the lower face, so that the block does not tilt.
    let nodes = mesh.patch_nodes(Patch::ChestWall);
    let each = Vec3::x() / nodes.len() as f64;
    model.add(Pull(DeadForces::new(nodes.iter().map(|&n| (n, each))))).unwrap();
    let at = |pull: f64| Load { receptor_mm: pull, ..Load::GRAVITY };
    let path: Vec<Load> = [0.0].iter().chain(pulls_mn).map(|&pull| at(pull)).collect();
    let found = follow(&model, &mesh.points, &path, &Options::default()).unwrap();
    found[1..].iter().map(|s| slid(s).1).collect()
}

/// Verifies: hysteresis of a block on springs | closed form | 0.125 mm of 6 mm
#[test]
fn friction_remembers_the_path() {
    let (friction, k) = (0.2, 20.0);
    let limit = friction * weight_mn();
    // Out, back to nothing, and to the other side: f leads the springs by the limit when it slips.
    let pulls = [3.0 * limit, 2.0 * limit, 0.0, -3.0 * limit, 0.0];
    let leads = [limit, limit, -limit, -limit, limit];
    let got = pulled(friction, k, &pulls);
    let mut last = 0.0;
    for (n, (pull, lead)) in pulls.iter().zip(leads).enumerate() {
        // Back from 3 to 2 limits it sticks.
        let want = if n == 1 { last } else { (pull - lead) / k };
        println!("{:6.1} mN: {:.4} mm for {want:.4}", pull, got[n]);
        assert!((got[n] - want).abs() < 2.5 * SMOOTHING_MM, "{} for {want}", got[n]);
        last = want;
    }
}

/// Verifies: hysteresis in 1, 4, 16 load steps; creep in 30 | independence of steps | 1e-3; 1e-5 mm
#[test]
fn friction_knows_no_steps() {
    let (friction, k) = (0.2, 20.0);
    let limit = friction * weight_mn();
    let steps = |count: usize, from: f64, to: f64| {
        (1..=count).map(move |n| from + (to - from) * n as f64 / count as f64)
    };
    let ends = [1, 4, 16].map(|count| {
        let out = steps(count, 0.0, 3.0 * limit).chain(steps(count, 3.0 * limit, 0.5 * limit));
        let found = pulled(friction, k, &out.collect::<Vec<_>>());
        [found[count - 1], found[2 * count - 1]]
    });
    println!("{ends:?}");
    for other in &ends[1..] {
        for (one, other) in ends[0].iter().zip(other) {
            assert!((one - other).abs() < 1e-3 * one.abs().max(1.0), "{one} {other} mm");
        }
    }
    // A block that sticks does not creep, however often it is asked.
    let waits: Vec<f64> = (0..30).map(|_| 0.9 * limit).collect();
    let found = pulled(friction, k, &waits);
    assert!((found[29] - found[0]).abs() < 1e-5, "crept from {} to {} mm", found[0], found[29]);
}

/// Verifies: all forces and moments on a sliding breast | equilibrium | 1e-6
/// Verifies: forces and moments of tissue and sheets alone | equilibrium | 1e-12
#[test]
fn a_breast_that_slides_against_friction_is_in_balance() {
    let body = coarse();
    let mesh = &body.mesh;
    let mut turned = Vec::new();
    for friction in [0.0, 0.1, 0.3] {
        let mut model = Model::new(mesh);
        let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
        model.add(Bulk::new("breast", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        model.add(Gravity::new("gravity", mesh, 0.981, Vec3::new(0.4, 0.0, -0.6))).unwrap();
        let law = Law::new(LawName::NeoHookean, 4.0, 0.49, None).unwrap();
        let faces = mesh.patch(Patch::Skin);
        model.add(Membrane::uniform("skin", &mesh.points, faces, 2.0, law).unwrap()).unwrap();
        let law = Law::new(LawName::NeoHookean, 120.0, 0.49, None).unwrap();
        let faces = mesh.patch(Patch::ChestWall);
        model.add(Membrane::uniform("fascia", &mesh.points, faces, 0.1, law).unwrap()).unwrap();
        let wall = Cylinder { point: -150.0 * Vec3::z(), axis: Vec3::y(), radius_mm: 150.0 };
        let faces = mesh.patch(Patch::ChestWall);
        let wall = Sliding::new("wall", &mesh.points, faces, Arc::new(wall));
        model.add(wall.slip(Slip::Coulomb(friction), &mesh.points).unwrap()).unwrap();
        for &node in &body.rim {
            model.fix_node(node);
        }
        let clock = std::time::Instant::now();
        let found = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
        let base = mesh.patch_nodes(Patch::ChestWall);
        let way = |&n: &u32| (found.points[n as usize] - mesh.points[n as usize]).norm();
        let mean = base.iter().map(way).sum::<f64>() / base.len() as f64;
        println!("{friction}: base {mean:.3} mm, {:?}, {:?}", clock.elapsed(), found.checks);
        let checks = found.checks;
        assert!(checks.force_imbalance < 1e-6 && checks.moment_imbalance < 1e-6, "{checks:?}");
        assert!(checks.internal_imbalance < 1e-10, "{checks:?}");
        assert!(checks.friction_lag <= 1e-4 && checks.max_gap_mm < 0.05, "{checks:?}");
        // Tissue and skin alone exert neither force nor moment.
        let mut assembly = Assembly::new(&model).unwrap();
        let mut state = State::new(&model, found.points.clone(), Load::GRAVITY);
        let mut pressure = Vec::new();
        assembly.energy(&model, &state, &found.points, &mut pressure).unwrap();
        state.pressure = pressure;
        for gradient in &assembly.term_gradients(&model, &state).unwrap()[..4] {
            let force: Vec3 = gradient.iter().sum();
            let moment: Vec3 = found.points.iter().zip(gradient).map(|(p, g)| p.cross(g)).sum();
            let sum: f64 = gradient.iter().map(|g| g.norm()).sum();
            let arm: f64 =
                found.points.iter().zip(gradient).map(|(p, g)| p.norm() * g.norm()).sum();
            turned.push((force.norm() / sum, moment.norm() / arm));
        }
        turned.remove(turned.len() - 3); // gravity, the only one of the four from outside
    }
    for (force, moment) in &turned {
        assert!(*force < 1e-12 && *moment < 1e-12, "{turned:?}");
    }
}

/// Verifies: forces of rough plates | each other, and less friction | 1e-4, rising
#[test]
fn plates_with_friction_hold_what_they_touch() {
    let mesh = block();
    let law = Law::neo_hookean_coupled(1.0, 0.49).unwrap();
    let mut last = 0.0;
    for friction in [0.0, 0.1, 0.5, 2.0] {
        let (_, done) = squeeze::flat(&mesh, law, friction);
        assert!(done.stopped_early.is_none(), "{:?}", done.stopped_early);
        let step = done.steps.last().unwrap();
        let spread = mesh.patch_nodes(Patch::Skin).iter().fold(0.0, |far: f64, &n| {
            far.max((step.points[n as usize] - mesh.points[n as usize]).xy().norm())
        });
        println!(
            "{friction}: {:.1} {:.1} mN, spread {spread:.3} mm, {:?}",
            step.paddle_force_mn, step.receptor_force_mn, done.solution.checks
        );
        assert!((step.paddle_force_mn / step.receptor_force_mn - 1.0).abs() < 1e-4);
        assert!(step.paddle_force_mn > last, "friction stiffens");
        last = step.paddle_force_mn;
    }
}

/// A large soft block, 400 x 400 x 80 mm, on a rough plane under gravity that is put on in `steps` and then stays for
/// four more.
fn rough(steps: usize) -> (TetMesh, Vec<Solution>) {
    let mesh =
        brick([4, 4, 2], |i, j, l| Vec3::new(100.0 * i as f64, 100.0 * j as f64, 40.0 * l as f64));
    let mut model = Model::new(&mesh);
    let law = Law::neo_hookean_coupled(1.8, 0.45).unwrap();
    model.add(Bulk::new("block", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", &mesh, 0.981, slope(0.6))).unwrap();
    let plane = Plane { point: Vec3::zeros(), normal: Vec3::z() };
    let faces = mesh.patch(Patch::ChestWall);
    let plane = Sliding::new("plane", &mesh.points, faces, Arc::new(plane));
    let plane = plane.opening(Opening::Free).slip(Slip::Never, &mesh.points).unwrap();
    model.add(plane).unwrap();
    let at = |n: usize| Load { gravity: n as f64 / steps as f64, ..Load::GRAVITY };
    let path: Vec<Load> = (0..=steps).chain([steps; 4]).map(at).collect();
    let options = Options { contact_mm: 1e-4, ..Options::default() };
    let found = follow(&model, &mesh.points, &path, &options).unwrap();
    (mesh, found)
}

/// Verifies: soft block sheared on a rough plane, 1 and 8 load steps, creep in 4 more | equilibrium, no slip, independence of steps | balance 1e-6, slip 1e-4, apart 1e-3, creep 1e-6 mm
#[test]
fn a_rough_plane_holds_a_soft_block_without_creep() {
    let apart =
        |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let ends = [1, 8].map(|steps| {
        let (mesh, found) = rough(steps);
        let (loaded, last) = (&found[steps], &found[steps + 4]);
        let way = |n: u32| loaded.points[n as usize] - mesh.points[n as usize];
        let nodes = mesh.patch_nodes(Patch::ChestWall);
        // Corners of the side that is drawn away may lift.
        let pressed: Vec<u32> = nodes.iter().copied().filter(|&n| way(n).z < 1e-3).collect();
        assert!(pressed.len() >= 20, "{} of {}", pressed.len(), nodes.len());
        let slip = pressed.iter().map(|&n| way(n).xy().norm()).fold(0.0, f64::max);
        let crept = apart(&loaded.points, &last.points);
        println!(
            "{steps} steps, {} nodes: slip {slip:.2e}, creep {crept:.2e} mm, {:?}",
            pressed.len(),
            loaded.checks
        );
        for state in &found[1..] {
            assert!(state.checks.residual < 1e-6, "{:?}", state.checks);
            assert!(state.checks.force_imbalance < 1e-6, "{:?}", state.checks);
        }
        assert!(slip < 1e-4, "slipped by {slip} mm");
        assert!(crept < 1e-6, "crept by {crept} mm");
        loaded.points.clone()
    });
    let off = apart(&ends[0], &ends[1]);
    println!("{off:.2e} mm apart");
    assert!(off < 1e-3, "{off} mm");
}
