//! Every term against finite differences.

use super::plate::{Plate, PlateKind};
use super::quadratic::{self, Rule};
use super::{
    At, Bulk, Cable, Cables, Curvature, Fibres, Gravity, Load, Membrane, Opening, QuadraticBulk,
    QuadraticMembrane, Sliding, Slip, Term, target::Cylinder, testing,
};
use crate::materials::Law;
use crate::mesh::quadratic::QuadraticMesh;
use crate::paddles::{
    CurvedPlate, Cushion, ElasticPlate, Gimbal, HeightField, Lift, Outline, RoundedPlate,
    RoundedRectangle, Sheet, Support,
};
use mammotwin_data::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    study::{LawConstants, LawName},
};
use std::{collections::BTreeMap, sync::Arc};

/// Two tetrahedra on a common face, one of them crooked.
fn pair() -> TetMesh {
    let points = vec![
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(9.0, 1.0, 0.5),
        Vec3::new(-1.0, 8.0, 1.0),
        Vec3::new(1.0, 2.0, 10.0),
        Vec3::new(8.0, 9.0, 7.0),
    ];
    TetMesh {
        points,
        tets: vec![[0, 1, 2, 3], [1, 4, 2, 3]],
        tissues: vec![Tissue::AdiposeLeft; 2],
        patches: BTreeMap::from([(Patch::Skin, vec![[0, 1, 3], [1, 4, 3]])]),
    }
}

fn moved(mesh: &TetMesh) -> Vec<Vec3> {
    let shift = |n: f64| 0.7 * Vec3::new((1.3 * n).sin(), (2.1 * n).cos(), (0.7 * n + 1.0).sin());
    mesh.points.iter().enumerate().map(|(n, p)| 1.02 * p + shift(n as f64)).collect()
}

fn laws() -> [Law; 5] {
    let second = LawConstants { second_share: Some(0.3), ..LawConstants::default() };
    [
        Law::new(LawName::NeoHookean, 0.5, 0.49, None).unwrap(),
        Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap(),
        Law::neo_hookean_coupled(0.5, 0.49).unwrap(),
        Law::with_constants(LawName::MooneyRivlin, 0.5, 0.49, None, &second).unwrap(),
        Law::new(LawName::Linear, 0.5, 0.49, None).unwrap(),
    ]
}

#[track_caller]
fn check(term: &dyn Term, points: &[Vec3]) {
    let pressure = [0.3, -0.2, 0.5, 0.1, -0.4];
    let memory = term.first_memory(points, Load::GRAVITY);
    let shear_kpa = &[0.2; 5];
    let (memory, load) = (&memory, Load::GRAVITY);
    testing::check(
        term,
        &At { points, pressure: &pressure, memory, shear_kpa, load, curvature: Curvature::Exact },
    );
}

/// Verifies: linear tetrahedra, five laws: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn bulk() {
    let mesh = pair();
    for law in laws() {
        check(&Bulk::new("bulk", &mesh, vec![law; 2]).unwrap(), &moved(&mesh));
    }
}

/// Verifies: three-node sheets: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn membrane() {
    let mesh = pair();
    for law in laws() {
        let faces = [[0, 1, 3], [1, 4, 3]];
        let skin = Membrane::uniform("skin", &mesh.points, &faces, 2.0, law).unwrap();
        check(&skin, &moved(&mesh));
    }
}

/// The pair with curved edges.
fn quadratic() -> QuadraticMesh {
    let mut mesh = QuadraticMesh::new(&pair());
    for (n, point) in mesh.points.iter_mut().enumerate().skip(5) {
        *point += 0.3 * Vec3::new((2.0 * n as f64).sin(), (3.0 * n as f64).cos(), 0.5);
    }
    mesh
}

/// Verifies: ten-node tetrahedra and six-node sheets: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn quadratic_bulk_and_membrane() {
    let mesh = quadratic();
    let shift = |n: f64| 0.2 * Vec3::new((1.3 * n).sin(), (2.1 * n).cos(), (0.7 * n + 1.0).sin());
    let points: Vec<Vec3> =
        mesh.points.iter().enumerate().map(|(n, p)| 1.02 * p + shift(n as f64)).collect();
    let (load, curvature) = (Load::GRAVITY, Curvature::Exact);
    let at = At { points: &points, pressure: &[], memory: &[], shear_kpa: &[], load, curvature };
    let faces: Vec<[u32; 6]> = mesh.patches.values().flatten().copied().collect();
    for law in laws() {
        let bulk = QuadraticBulk::new("bulk", &mesh, vec![law; 2], Rule::Fourteen).unwrap();
        testing::check(&bulk, &at);
        let skin = QuadraticMembrane::uniform("skin", &mesh.points, &faces, 2.0, law).unwrap();
        testing::check(&skin, &at);
    }
}

/// Verifies: weight of ten-node tetrahedra on 1, z, z² | integrals | 1e-11
#[test]
fn quadratic_weights_do_the_work_of_a_body_force() {
    // The work of a linear and of a quadratic motion; exact on straight edges.
    let mesh = QuadraticMesh::new(&pair());
    let force = Vec3::new(0.3, -0.5, 0.9);
    let weights = quadratic::nodal_weights(&mesh, force).unwrap();
    let sum = |motion: &dyn Fn(&Vec3) -> f64| -> Vec3 {
        weights.iter().zip(&mesh.points).map(|(w, p)| motion(p) * w).sum()
    };
    let (mut volume, mut first, mut second) = (0.0, 0.0, 0.0);
    for tet in &pair().tets {
        let v = TetMesh::tet_volume(&mesh.points, tet);
        let z = tet.map(|n| mesh.points[n as usize].z);
        let total: f64 = z.iter().sum();
        volume += v;
        first += v * total / 4.0;
        second += v * (total * total + z.iter().map(|z| z * z).sum::<f64>()) / 20.0;
    }
    assert!((sum(&|_| 1.0) - volume * force).norm() < 1e-11 * volume);
    assert!((sum(&|p| p.z) - first * force).norm() < 1e-11 * first);
    assert!((sum(&|p| p.z * p.z) - second * force).norm() < 1e-11 * second);
}

#[test]
fn gravity() {
    let mesh = pair();
    check(&Gravity::new("gravity", &mesh, 0.98, Vec3::new(0.3, -0.5, 0.9)), &moved(&mesh));
}

/// Verifies: fibres in tissue: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn fibres() {
    let mesh = pair();
    let directions = [Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, -0.6, 0.8)];
    let fibres = Fibres::new("fibres", &mesh, &directions, 2.0).unwrap();
    // All taut, and as they fall.
    let stretched: Vec<Vec3> = moved(&mesh).iter().map(|p| 1.3 * p).collect();
    check(&fibres, &stretched);
    check(&fibres, &moved(&mesh));
}

/// Verifies: cables: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn cables() {
    let mesh = pair();
    let anchor = Vec3::new(-20.0, 5.0, 3.0);
    let length = |node: usize| (moved(&mesh)[node] - anchor).norm();
    let cable = |node: u32, stretch: f64| Cable {
        node,
        anchor,
        natural_mm: length(node as usize) / stretch,
        stiffness_mn_per_mm: 3.0,
    };
    // Slack, barely taut, taut.
    let list = vec![cable(0, 0.9), cable(1, 1.0005), cable(2, 1.2)];
    let cables = Cables::new("cables", list).unwrap();
    check(&cables, &moved(&mesh));
    let tensions = cables.tensions(&moved(&mesh));
    assert!(tensions[0] == 0.0 && tensions[1] > 0.0 && tensions[2] > 1.0, "{tensions:?}");
}

/// Verifies: sliding contact with friction: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn sliding() {
    let mesh = pair();
    let axis = Vec3::new(0.6, 0.0, 0.8);
    let cylinder = Cylinder { point: Vec3::new(4.0, -7.0, 1.0), axis, radius_mm: 9.0 };
    let faces = [[0, 1, 3], [1, 4, 3]];
    let glide = || Sliding::new("wall", &mesh.points, &faces, Arc::new(cylinder));
    let mut memory = glide().first_memory(&mesh.points, Load::GRAVITY);
    glide().update_multipliers(&mesh.points, &[0.2; 5], Load::GRAVITY, &mut memory);
    assert!(memory.iter().all(|m| *m != 0.0));
    for opening in [Opening::Never, Opening::Free] {
        for slip in [Slip::Free, Slip::Coulomb(0.3), Slip::Never] {
            let term = glide().opening(opening).slip(slip, &mesh.points).unwrap();
            check_contact(&term, &mesh.points, Load::GRAVITY);
        }
    }
    let bits = glide().slip(Slip::Coulomb(0.0), &mesh.points).unwrap();
    assert_eq!(bits.first_memory(&mesh.points, Load::GRAVITY).len(), memory.len());
    for friction in [-0.1, f64::NAN, f64::INFINITY] {
        assert!(glide().slip(Slip::Coulomb(friction), &mesh.points).is_err());
    }
}

/// A contact before anything is known of it, after two rounds at which nodes slip, and where they
/// stick in the next load step.
#[track_caller]
fn check_contact(term: &dyn Term, rest: &[Vec3], load: Load) {
    let shear_kpa = &[0.2; 5];
    let check = |points: &[Vec3], memory: &[f64]| {
        let curvature = Curvature::Exact;
        testing::check(term, &At { points, pressure: &[], memory, shear_kpa, load, curvature });
    };
    let points = moved(&pair());
    let mut memory = term.first_memory(rest, load);
    check(&points, &memory);
    for _ in 0..2 {
        term.update_multipliers(&points, shear_kpa, load, &mut memory);
        check(&points, &memory);
    }
    term.accept(&points, load, &mut memory);
    let nudge = |(n, p): (usize, &Vec3)| p - 0.03 * (p - rest[n]).normalize();
    check(&points.iter().enumerate().map(nudge).collect::<Vec<_>>(), &memory);
}

const SLANTED: RoundedPlate = RoundedPlate {
    into: Vec3::new(0.0, 0.6, 0.8),
    away: Vec3::new(0.0, -0.8, 0.6),
    edge_mm: -6.0,
    radius_mm: 7.0,
    middle_mm: 1.5,
    outline: Outline::ENDLESS,
};

/// Verifies: steps along surfaces: distances | those that the straight step foretells | 1e-9 mm, departure of second order
#[test]
fn steps_keep_to_surfaces() {
    let mesh = pair();
    let faces = [[0, 1, 3], [1, 4, 3]];
    let axis = Vec3::new(0.6, 0.0, 0.8);
    let cylinder = Cylinder { point: Vec3::new(4.0, -7.0, 1.0), axis, radius_mm: 9.0 };
    let load = Load { receptor_mm: 0.0, thickness_mm: 2.0, ..Load::GRAVITY };
    let wall = Sliding::new("wall", &mesh.points, &faces, Arc::new(cylinder));
    let paddle = Plate::new(PlateKind::Paddle, SLANTED, &mesh.points, &faces);
    let from = moved(&mesh);
    let (mut closed, mut open) = (0, 0);
    for (term, never) in [(&wall as &dyn Term, true), (&paddle, false)] {
        let memory = &term.first_memory(&mesh.points, load)[..];
        let curvature = Curvature::Exact;
        let at =
            |points| At { points, pressure: &[], memory, shear_kpa: &[0.2; 5], load, curvature };
        // Where nodes come from the straight line by a length, and how far they lie from it.
        let go = |length: f64| {
            let way = |n: usize| Vec3::new(0.4, 0.3 - 0.2 * n as f64, 0.5 * (n as f64).sin());
            let step: Vec<Vec3> = (0..5).map(|n| length * way(n)).collect();
            let line: Vec<Vec3> = from.iter().zip(&step).map(|(p, s)| p + s).collect();
            let mut points = line.clone();
            term.keep_to_surface(&at(&from), &step, &mut points);
            let aside: Vec<f64> = points.iter().zip(&line).map(|(p, l)| (p - l).norm()).collect();
            (step, line, points, aside)
        };
        let (step, line, points, aside) = go(1.0);
        let half = go(0.5).3;
        let [start, straight, end] =
            [&from, &line, &points].map(|points| term.touching(&at(points)));
        for ((start, straight), end) in start.iter().zip(&straight).zip(&end) {
            let node = start.node as usize;
            let foretold = start.distance_mm + start.normal.dot(&step[node]);
            if never || start.closed && foretold < 0.0 {
                assert!(
                    (end.distance_mm - foretold).abs() < 1e-9,
                    "{} {foretold}",
                    end.distance_mm
                );
                assert!(aside[node] < 1e-9 || (3.0..5.0).contains(&(aside[node] / half[node])));
                closed += 1;
            } else {
                // Without a multiplier nothing is borne at a distance of zero.
                assert!((end.distance_mm - straight.distance_mm.max(-1e-4)).abs() < 1e-9);
                open += 1;
            }
        }
    }
    println!("{closed} nodes follow a surface, {open} do not");
    assert!(closed > 4 && open > 0);
}

/// Verifies: plates with friction: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn plate() {
    let mesh = pair();
    let faces = [[0, 1, 3], [1, 4, 3]];
    for (kind, receptor_mm, thickness_mm) in
        [(PlateKind::Receptor, -1.0, 5.0), (PlateKind::Paddle, 0.0, 2.0)]
    {
        let load = Load { gravity: 1.0, receptor_mm, thickness_mm, ..Load::GRAVITY };
        for friction in [0.0, 0.3] {
            let term = Plate::new(kind, SLANTED, &mesh.points, &faces);
            let term = term.slip(Slip::Coulomb(friction)).unwrap();
            check_contact(&term, &mesh.points, load);
            let (points, shear_kpa) = (&moved(&mesh)[..], &[0.2; 5]);
            let mut memory = term.first_memory(&mesh.points, load);
            term.update_multipliers(points, shear_kpa, load, &mut memory);
            let (memory, curvature) = (&memory, Curvature::Exact);
            let at = At { points, pressure: &[], memory, shear_kpa, load, curvature };
            assert!(term.contact(&at).unwrap().penetration_mm > 0.0);
            // Every node slips by more than the smoothing: friction is at its limit.
            let forces = term.node_forces(&at);
            assert!(!forces.is_empty());
            for force in forces {
                let (n, f) = (force.normal.norm(), force.friction.norm());
                // The multiplier was renewed at this place: its penalty presses once more.
                assert!(f <= friction * n + 1e-12 && f >= 0.49 * friction * n, "{n} {f}");
            }
        }
        assert!(Plate::new(kind, SLANTED, &mesh.points, &faces).slip(Slip::Coulomb(-1.0)).is_err());
    }
}

fn energy(term: &dyn Term, at: &At) -> f64 {
    let one = |element: usize| {
        let mut block = super::Block::ZERO;
        term.block(element, at, super::Order::Value, &mut block).unwrap();
        block.energy
    };
    (0..term.elements()).map(one).sum()
}

/// Verifies: tilting plate: derivatives, torque | differences of the energy | 1e-7, 1e-5
#[test]
fn a_plate_that_tilts() {
    let mesh = pair();
    let plate = Plate::new(PlateKind::Paddle, SLANTED, &mesh.points, &[[0, 1, 3], [1, 4, 3]]);
    let plate = plate.tilting(9.0);
    let (points, shear_kpa, pressure) = (&moved(&mesh)[..], &[0.2; 5][..], &[][..]);
    for tilt_rad in [-0.2, 0.0, 0.3] {
        let load = Load { receptor_mm: 0.0, thickness_mm: 2.0, tilt_rad, ..Load::GRAVITY };
        check_contact(&plate, &mesh.points, load);
        // The torque is minus the derivative of the energy by the tilt.
        let memory = &plate.first_memory(points, load)[..];
        let curvature = Curvature::Exact;
        let at = |change: f64| {
            let mut load = load;
            load.tilt_rad += change;
            At { points, pressure, memory, shear_kpa, load, curvature }
        };
        let energy = |change: f64| energy(&plate, &at(change));
        let (torque, size) = plate.torque(&at(0.0));
        let want = -(energy(1e-5) - energy(-1e-5)) / 2e-5;
        assert!((torque - want).abs() < 1e-5 * size && size > 0.0, "{torque} for {want}");
    }
}

/// Verifies: bent plate: derivatives, push | differences of the energy | 1e-7, 1e-5
#[test]
fn a_plate_that_is_lifted() {
    let mesh = pair();
    let sheet = Sheet {
        width_mm: 40.0,
        depth_mm: 30.0,
        thickness_mm: 0.2,
        young_kpa: 1e3,
        poisson: 0.4,
        support: Support::Frame,
        lip_mm: 0.0,
    };
    let lifts: [Arc<dyn Lift>; 3] = [
        Arc::new(ElasticPlate::new(sheet).unwrap()),
        Arc::new(Gimbal { axis_mm: 5.0, tilt_mn_mm: 1.0, roll_mn_mm: 1.0 }),
        Arc::new(CurvedPlate { rise_mm: 2.0, reach_mm: 20.0, arch_radius_mm: 50.0 }),
    ];
    let (points, shear_kpa, pressure) = (&moved(&mesh)[..], &[0.2; 5][..], &[][..]);
    for lift in lifts {
        let plate = Plate::new(PlateKind::Paddle, SLANTED, &mesh.points, &[[0, 1, 3], [1, 4, 3]]);
        let plate = plate.lifted(lift.clone());
        let mut pose = crate::paddles::AT_REST;
        pose[..3].copy_from_slice(&[0.3, -0.2, 0.1]);
        let load = Load { receptor_mm: 0.0, thickness_mm: 2.0, pose, ..Load::GRAVITY };
        check_contact(&plate, &mesh.points, load);
        // The push is minus the derivative of the energy by each coordinate.
        let memory = &plate.first_memory(points, load)[..];
        let at = |n: usize, change: f64| {
            let mut load = load;
            load.pose[n] += change;
            At { points, pressure, memory, shear_kpa, load, curvature: Curvature::Exact }
        };
        let energy = |at: At| energy(&plate, &at);
        let push = plate.push(&at(0, 0.0));
        for n in 0..lift.coordinates() {
            let want = -(energy(at(n, 1e-5)) - energy(at(n, -1e-5))) / 2e-5;
            assert!((push[n] - want).abs() < 1e-5 * (1.0 + want.abs()), "{} for {want}", push[n]);
        }
        assert!(lift.coordinates() == 0 || push[0] != 0.0);
    }
}

/// A wavy height field of 40 x 30 mm.
fn wavy() -> HeightField {
    let (count, spacing) = ([11, 9], [4.0, 3.75]);
    let at = |n: usize| {
        let [i, j] = [n % count[0], n / count[0]].map(|k| k as f64);
        0.8 * (0.7 * i).sin() * (0.5 * j).cos()
    };
    let heights = (0..count[0] * count[1]).map(at).collect();
    HeightField::through([-20.0, 0.0], spacing, count, heights)
}

/// Verifies: finite plates: derivatives of the energy | fourth-order differences | 1e-7, second 1e-6
#[test]
fn a_plate_that_is_finite() {
    let mesh = pair();
    let small = RoundedRectangle::new([12.0, 11.0], 5.5, 1.0, -2.0);
    let window = RoundedRectangle::new([8.0, 7.0], 3.0, 0.0, 6.0);
    for outline in [
        Outline { plate: Some(small), window: None },
        Outline { plate: None, window: Some(window) },
    ] {
        let shape = RoundedPlate { outline, radius_mm: 3.0, ..SLANTED };
        let load = Load { receptor_mm: 0.0, thickness_mm: 2.0, ..Load::GRAVITY };
        let plate = || Plate::new(PlateKind::Paddle, shape, &mesh.points, &[[0, 1, 3], [1, 4, 3]]);
        check_contact(&plate(), &mesh.points, load);
        check_contact(&plate().lifted(Arc::new(wavy())), &mesh.points, load);
        let tilted = Load { tilt_rad: 0.2, ..load };
        check_contact(&plate().tilting(4.0), &mesh.points, tilted);
    }
}

#[test]
fn a_plate_under_foam_is_a_spring_by_area() {
    let mesh = pair();
    let faces = [[0, 1, 3], [1, 4, 3]];
    let cushion = Cushion { thickness_mm: 5.0, young_kpa: 50.0 };
    let load = Load { receptor_mm: 0.0, thickness_mm: 2.0, ..Load::GRAVITY };
    for slip in [Slip::Free, Slip::Coulomb(0.3)] {
        let plate = Plate::new(PlateKind::Paddle, SLANTED, &mesh.points, &faces);
        let plate = plate.cushioned(cushion, &faces).slip(slip).unwrap();
        check_contact(&plate, &mesh.points, load);
        // Rounds change the areas alone: neither depth nor stiffness grows.
        let (points, shear_kpa) = (&moved(&mesh)[..], &[0.2; 5][..]);
        let mut memory = plate.first_memory(points, load);
        let mut last = f64::NAN;
        for _ in 0..3 {
            plate.update_multipliers(points, shear_kpa, load, &mut memory);
            let curvature = Curvature::Exact;
            let at = At { points, pressure: &[], memory: &memory, shear_kpa, load, curvature };
            let forces = plate.node_forces(&at);
            let sum: f64 = forces.iter().map(|force| force.normal.norm()).sum();
            assert!(sum > 0.0 && (last.is_nan() || sum == last), "{sum} after {last}");
            last = sum;
            for force in forces {
                let point = &points[force.node as usize];
                let pressure = 10.0 * plate.indentation(point, &load);
                let area = super::contact::skin_around(points, &faces)[&force.node]
                    .facing(-force.normal.normalize());
                assert!((force.normal.norm() - pressure * area).abs() < 1e-9 * sum);
            }
            let check = plate.contact(&at).unwrap();
            assert_eq!((check.penetration_mm, check.gap_mm), (0.0, 0.0));
            assert!(slip != Slip::Free || check.friction_lag < 1e-12);
        }
    }
}

#[test]
fn a_height_field_passes_through_its_heights_and_has_the_derivatives_it_claims() {
    let field = wavy();
    let pose = &crate::paddles::AT_REST;
    for (i, j) in [(0, 0), (3, 5), (10, 8), (0, 8)] {
        let place = [4.0 * f64::from(i) - 20.0, 3.75 * f64::from(j)];
        let want = 0.8 * (0.7 * f64::from(i)).sin() * (0.5 * f64::from(j)).cos();
        assert!((field.bend(place, pose).value - want).abs() < 1e-12);
    }
    // On the plate, across a line of the grid, and beyond the ends.
    for place in [[1.3, 11.0], [-4.0, 7.5], [19.7, 0.2], [26.0, 10.0], [-25.0, -9.0]] {
        let here = field.bend(place, pose);
        for axis in 0..2 {
            let moved = |step: f64| {
                let mut place = place;
                place[axis] += step;
                field.bend(place, pose)
            };
            let (up, down) = (moved(1e-5), moved(-1e-5));
            assert!(((up.value - down.value) / 2e-5 - here.slope[axis]).abs() < 1e-8);
            for other in 0..2 {
                let slope = (up.slope[other] - down.slope[other]) / 2e-5;
                assert!((slope - here.curvature[axis + other]).abs() < 1e-6);
            }
        }
    }
    // A parabola is its own spline.
    let square = |n: usize| ((n % 6) as f64).powi(2) - 2.0 * ((n / 6) as f64).powi(2);
    let heights = (0..36).map(square).collect();
    let field = HeightField::through([0.0, 0.0], [1.0, 1.0], [6, 6], heights);
    let bend = field.bend([0.3, 4.6], pose);
    assert!((bend.value - (0.09 - 2.0 * 21.16)).abs() < 1e-12);
    assert!((bend.curvature[0] - 2.0).abs() < 1e-12 && (bend.curvature[2] + 4.0).abs() < 1e-12);
}
