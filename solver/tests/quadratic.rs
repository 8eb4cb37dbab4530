//! The breast-like body of `gravity.rs` with ten-node tetrahedra: what the linear ones must meet.
//!
//! E = 0.5 kPa, 0.981 g/cm³, gravity away from the chest, straight edges. Ten-node tetrahedra of
//! FEBio 4 (coupled law): 34.90 mm (5 k), 35.03 mm (20 k), and 34.20 mm at ν = 0.499 (5 k). Those of
//! CalculiX (isochoric law, Mira 2018, eq. 2.37): 35.79 mm (5 k), 35.93 mm (20 k), and 34.45 mm.

use crate::common;

use common::{Body, coarse, fine};
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, study::LawName};
use mammotwin_solver::materials::Law;
use mammotwin_solver::mesh::quadratic::QuadraticMesh;
use mammotwin_solver::terms::{Gravity, QuadraticBulk, quadratic::Rule};
use mammotwin_solver::{Model, Options, solve};

fn nipple_mm(body: &Body, law: Law, rule: Rule) -> f64 {
    let clock = std::time::Instant::now();
    let mesh = QuadraticMesh::new(&body.mesh);
    let mut model = Model::new(&TetMesh { points: mesh.points.clone(), ..TetMesh::default() });
    let laws = vec![law; mesh.tets.len()];
    model.add(QuadraticBulk::new("breast", &mesh, laws, rule).unwrap()).unwrap();
    let weight = Gravity::quadratic("gravity", &mesh, 0.981 * 9.81 / 9.80665, Vec3::z());
    model.add(weight.unwrap()).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    let solution = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
    let sunk = (solution.points[body.nipple] - body.mesh.points[body.nipple]).norm();
    println!("{rule:?}: {sunk:.3} mm in {:?}, {:?}", clock.elapsed(), solution.checks);
    sunk
}

#[track_caller]
fn check(body: &Body, law: Law, rule: Rule, published_mm: f64) {
    let sunk = nipple_mm(body, law, rule);
    assert!((sunk / published_mm - 1.0).abs() < 1e-3, "{sunk:.3} mm for {published_mm} mm");
}

fn isochoric(poisson: f64) -> Law {
    Law::new(LawName::NeoHookean, 0.5, poisson, None).unwrap()
}

/// Verifies: ten-node tetrahedra, coupled neo-Hookean law | FEBio 4: 34.90 mm | 1e-3
/// Verifies: ten-node tetrahedra, isochoric neo-Hookean law | CalculiX: 35.79 mm | 1e-3
#[test]
fn the_nipple_sinks_as_in_other_codes() {
    check(&coarse(), Law::neo_hookean_coupled(0.5, 0.49).unwrap(), Rule::Four, 34.90);
    check(&coarse(), isochoric(0.49), Rule::Four, 35.79);
}

/// Verifies: ten-node tetrahedra, ν = 0.499 | CalculiX: 34.45 mm | 1e-3
/// Verifies: ten-node tetrahedra, 20 k, two laws | FEBio 4 and CalculiX: 35.03, 35.93 mm | 1e-3
#[test]
#[ignore = "minutes: a finer rule, a higher Poisson's ratio, a finer mesh"]
fn the_nipple_sinks_as_in_other_codes_in_full() {
    check(&coarse(), isochoric(0.499), Rule::Four, 34.45);
    // More points see more of the dilatation, and are a little stiffer.
    let fourteen = nipple_mm(&coarse(), isochoric(0.49), Rule::Fourteen);
    assert!((fourteen / 35.79 - 1.0).abs() < 2e-3, "{fourteen:.3} mm");
    check(&fine(), Law::neo_hookean_coupled(0.5, 0.49).unwrap(), Rule::Four, 35.03);
    check(&fine(), isochoric(0.49), Rule::Four, 35.93);
}
