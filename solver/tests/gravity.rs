//! A breast-like body pulled away from the chest wall by its weight.
//!
//! E = 0.5 kPa, ν = 0.49 or 0.499, 0.981 g/cm³; the base is fixed. Quadratic tetrahedra of
//! FEBio 4 (coupled law) give the nipple's displacement: 34.90 mm on the coarse mesh, 35.03 mm on
//! the fine one, 34.20 mm at ν = 0.499. Linear tetrahedra lock: 28.49 mm and, at ν = 0.499, 15.53 mm.

use crate::common;

use common::{Body, coarse, fine};
use mammotwin_data::{Vec3, mesh::Patch, progress::Silent, solution::Solution, study::LawName};
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
