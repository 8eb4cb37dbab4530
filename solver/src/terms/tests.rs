//! Every term against finite differences.

use super::plate::{Plate, PlateKind};
use super::{
    At, Bulk, Cable, Cables, Gravity, Load, Membrane, Sliding, Term as _, target::Cylinder, testing,
};
use crate::materials::Law;
use crate::paddles::RoundedPlate;
use mammotwin_data::{Vec3, labels::Tissue, mesh::TetMesh, study::LawName};
use std::sync::Arc;

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
        ..TetMesh::default()
    }
}

fn moved(mesh: &TetMesh) -> Vec<Vec3> {
    let shift = |n: f64| 0.7 * Vec3::new((1.3 * n).sin(), (2.1 * n).cos(), (0.7 * n + 1.0).sin());
    mesh.points.iter().enumerate().map(|(n, p)| 1.02 * p + shift(n as f64)).collect()
}

fn laws() -> [Law; 3] {
    [
        Law::new(LawName::NeoHookean, 0.5, 0.49, None).unwrap(),
        Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap(),
        Law::neo_hookean_coupled(0.5, 0.49).unwrap(),
    ]
}

#[track_caller]
fn check(term: &dyn super::Term, points: &[Vec3]) {
    let pressure = [0.3, -0.2, 0.5, 0.1, -0.4];
    let memory = term.first_memory(points);
    let shear_kpa = &[0.2; 5];
    let (memory, load) = (&memory, Load::GRAVITY);
    testing::check(
        term,
        &At { points, pressure: &pressure, memory, shear_kpa, load, curvature: Curvature::Exact },
    );
}

#[test]
fn bulk() {
    let mesh = pair();
    for law in laws() {
        check(&Bulk::new("bulk", &mesh, vec![law; 2]).unwrap(), &moved(&mesh));
    }
}

#[test]
fn membrane() {
    let mesh = pair();
    for law in laws() {
        let faces = [[0, 1, 3], [1, 4, 3]];
        let skin = Membrane::uniform("skin", &mesh.points, &faces, 2.0, law).unwrap();
        check(&skin, &moved(&mesh));
    }
}

#[test]
fn gravity() {
    let mesh = pair();
    check(&Gravity::new("gravity", &mesh, 0.98, Vec3::new(0.3, -0.5, 0.9)), &moved(&mesh));
}

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

#[test]
fn sliding() {
    let mesh = pair();
    let axis = Vec3::new(0.6, 0.0, 0.8);
    let cylinder = Cylinder { point: Vec3::new(4.0, -7.0, 1.0), axis, radius_mm: 9.0 };
    let faces = [[0, 1, 3], [1, 4, 3]];
    let term = Sliding::new("wall", &mesh.points, &faces, Arc::new(cylinder), 0.0).unwrap();
    check(&term, &moved(&mesh));
    let mut memory = term.first_memory(&mesh.points);
    term.update_multipliers(&mesh.points, &[0.2; 5], Load::GRAVITY, &mut memory);
    assert!(memory.iter().all(|m| *m != 0.0));
    assert!(Sliding::new("wall", &mesh.points, &faces, Arc::new(cylinder), 0.1).is_err());
}

#[test]
fn plate() {
    let mesh = pair();
    let shape = RoundedPlate {
        into: Vec3::new(0.0, 0.6, 0.8),
        away: Vec3::new(0.0, -0.8, 0.6),
        edge_mm: -6.0,
        radius_mm: 7.0,
    };
    let faces = [[0, 1, 3], [1, 4, 3]];
    for (kind, receptor_mm, thickness_mm) in
        [(PlateKind::Receptor, -1.0, 5.0), (PlateKind::Paddle, 0.0, 2.0)]
    {
        let term = Plate::new(kind, shape, &mesh.points, &faces);
        let points = moved(&mesh);
        let load = Load { gravity: 1.0, receptor_mm, thickness_mm };
        let mut memory = term.first_memory(&points);
        let shear_kpa = &[0.2; 5];
        for _ in 0..2 {
            let curvature = Curvature::Exact;
            let at =
                At { points: &points, pressure: &[], memory: &memory, shear_kpa, load, curvature };
            testing::check(&term, &at);
            assert!(term.contact(&at).unwrap().penetration_mm > 0.0);
            assert!(!term.node_forces(&at).is_empty());
            term.update_multipliers(&points, shear_kpa, load, &mut memory);
        }
    }
}
