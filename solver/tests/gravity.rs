//! A breast-like body pulled away from the chest wall by its weight.
//!
//! E = 0.5 kPa, ν = 0.49 or 0.499, 0.981 g/cm³; the base is fixed. Quadratic tetrahedra of
//! FEBio 4 (coupled law) give the nipple's displacement: 34.90 mm on the coarse mesh, 35.03 mm on
//! the fine one, 34.20 mm at ν = 0.499. Linear tetrahedra lock: 28.49 mm and, at ν = 0.499, 15.53 mm.

use crate::common;

use common::{Body, coarse, fine, squeeze::of_tissue};
use mammotwin_data::{
    Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, solution::Solution, study::LawName,
    units::WEIGHT_OF_G_PER_CM3,
};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{Bulk, Gravity};
use mammotwin_solver::{Model, Options, solve};

fn hang(body: &Body, law: Law) -> Solution {
    let mesh = &body.mesh;
    let mut model = Model::new(mesh);
    model.add(Bulk::new("breast", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", mesh, 0.981 * 9.81 / 9.80665, Vec3::z())).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    solve(&model, &mesh.points, &Options::default(), &Silent).unwrap()
}

fn nipple_mm(body: &Body, solution: &Solution) -> f64 {
    (solution.points[body.nipple] - body.mesh.points[body.nipple]).norm()
}

#[track_caller]
fn check(body: &Body, law: Law, quadratic_mm: f64, tolerance: f64) {
    let clock = std::time::Instant::now();
    let solution = hang(body, law);
    let got = nipple_mm(body, &solution);
    println!("{got:.3} mm for {quadratic_mm} mm in {:?}: {:?}", clock.elapsed(), solution.checks);
    assert!((got / quadratic_mm - 1.0).abs() < tolerance, "{got:.3} mm for {quadratic_mm} mm");
    let checks = solution.checks;
    assert!(checks.residual < 1e-7 && checks.force_imbalance < 1e-6, "{checks:?}");
    assert!(checks.internal_imbalance < 1e-10, "{checks:?}");
    assert!(checks.min_det_f > 0.2, "{checks:?}");
    assert!(checks.steps == 1 && checks.iterations <= 40, "{checks:?}");
}

/// Verifies: breast under gravity, 5 k linear tetrahedra | FEBio 4, quadratic: 34.90 mm | 3.5 %
/// Verifies: breast under gravity, 20 k linear tetrahedra | FEBio 4, quadratic: 35.03 mm | 2 %
#[test]
fn the_nipple_sinks_as_with_quadratic_tetrahedra() {
    let (coarse, fine) = (coarse(), fine());
    let coupled = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    check(&coarse, coupled, 34.90, 0.035);
    check(&fine, coupled, 35.03, 0.02);
}

/// Verifies: breast under gravity, ν = 0.499, two laws | FEBio 4, quadratic: 34.20 mm | 5 %
#[test]
fn nearly_incompressible_tissue_does_not_lock() {
    let coupled = Law::neo_hookean_coupled(0.5, 0.499).unwrap();
    check(&coarse(), coupled, 34.20, 0.05);
    // At this Poisson's ratio the two laws are one.
    let isochoric = Law::new(LawName::NeoHookean, 0.5, 0.499, None).unwrap();
    check(&coarse(), isochoric, 34.20, 0.05);
}

/// Verifies: what the tissue pulls at the fixed nodes of a hanging breast | density times volume (divergence theorem), less what hangs on these nodes | force 1e-6, moment 1e-6
#[test]
fn supports_bear_the_weight_of_the_volume() {
    let body = coarse();
    let mesh = &body.mesh;
    let (law, down) = (Law::neo_hookean_coupled(0.5, 0.49).unwrap(), Vec3::new(0.2, -0.3, 0.8));
    let mut model = Model::new(mesh);
    model.add(Bulk::new("breast", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", mesh, 0.981, down)).unwrap();
    let fixed = mesh.patch_nodes(Patch::ChestWall);
    for &node in &fixed {
        model.fix_node(node);
    }
    let found = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
    // The tissue alone at the fixed nodes.
    let tissue = of_tissue(mesh, law, &found.points);
    let pulls = fixed.iter().map(|&n| (found.points[n as usize], -tissue[n as usize]));
    let (mut pull, mut turn) = (Vec3::zeros(), Vec3::zeros());
    for (place, force) in pulls {
        pull += force;
        turn += place.cross(&force);
    }
    // The volume at rest from the surface alone; the part that hangs on fixed nodes never comes to the tissue.
    let volume: f64 = [Patch::ChestWall, Patch::Skin]
        .iter()
        .flat_map(|&patch| mesh.patch(patch))
        .map(|face| {
            let [a, b, c] = face.map(|n| mesh.points[n as usize]);
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum();
    let force = 0.981 * WEIGHT_OF_G_PER_CM3 * down;
    let mut hung = volume * force;
    let (mut arm, mut all) = (Vec3::zeros(), 0.0);
    for tet in &mesh.tets {
        let quarter = 0.25 * TetMesh::tet_volume(&mesh.points, tet);
        for n in tet {
            if fixed.contains(n) {
                hung -= quarter * force;
            } else {
                arm += quarter * found.points[*n as usize];
            }
            all += quarter;
        }
    }
    assert!((all / volume - 1.0).abs() < 1e-9, "{all} {volume} mm³");
    let off = [(pull - hung).norm() / hung.norm(), (turn - arm.cross(&force)).norm() / turn.norm()];
    println!("{pull:?} of {hung:?} mN, {turn:?}: {off:?}");
    assert!(off.iter().all(|off| *off < 1e-6), "{off:?}");
}
