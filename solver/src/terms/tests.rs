//! Every term against finite differences.

use super::{At, Bulk, Gravity, Load, Membrane, testing};
use crate::materials::Law;
use mammotwin_data::{Vec3, labels::Tissue, mesh::TetMesh, study::LawName};

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
    testing::check(term, &At { points, pressure: &pressure, memory: &memory, load: Load::GRAVITY });
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
