//! Cables that pull but never push, on a block that they hold on both sides.

use crate::common;

use common::loads::{DeadForces, Pull};
use common::shapes::brick;
use mammotwin_data::{Vec3, solution::Solution};
use mammotwin_solver::materials::Law;
use mammotwin_solver::solve::follow;
use mammotwin_solver::terms::{Bulk, Cable, Cables, Load};
use mammotwin_solver::{Model, Options};

const LENGTH_MM: f64 = 50.0;
const SLACK_MM: f64 = 2.0;
const STIFFNESS: f64 = 3.0;

/// Where the block is (mm) and what the left and the right cables pull (mN) under forces along x.
fn held(forces_mn: &[f64]) -> Vec<(f64, f64, f64)> {
    let mesh = brick([1, 1, 1], |i, j, l| 10.0 * Vec3::new(i as f64, j as f64, l as f64));
    let mut model = Model::new(&mesh);
    let law = Law::neo_hookean_coupled(1e3, 0.3).unwrap();
    model.add(Bulk::new("block", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    let nodes = mesh.points.len();
    for (name, side) in [("left", -1.0), ("right", 1.0)] {
        let cable = |n: usize| Cable {
            node: n as u32,
            anchor: mesh.points[n] + side * LENGTH_MM * Vec3::x(),
            natural_mm: LENGTH_MM + SLACK_MM,
            stiffness_mn_per_mm: STIFFNESS / nodes as f64,
        };
        model.add(Cables::new(name, (0..nodes).map(cable).collect()).unwrap()).unwrap();
    }
    let each = Vec3::x() / nodes as f64;
    model.add(Pull(DeadForces::new((0..nodes as u32).map(|n| (n, each))))).unwrap();
    for n in 0..nodes as u32 {
        model.fix(n, 1);
        model.fix(n, 2);
    }
    let at = |force: &f64| Load { receptor_mm: *force, ..Load::GRAVITY };
    let path: Vec<Load> = forces_mn.iter().map(at).collect();
    // Between slack cables the block is nowhere in particular: it begins near the taut ones.
    let start: Vec<Vec3> = mesh.points.iter().map(|p| p + 3.0 * Vec3::x()).collect();
    let found = follow(&model, &start, &path, &Options::default()).unwrap();
    let mean = |s: &Solution| s.points.iter().map(|p| p.x).sum::<f64>() / nodes as f64 - 5.0;
    found.iter().map(|s| (mean(s), s.forces["left"].x, s.forces["right"].x)).collect()
}

/// Verifies: tension-only cables, slack and taut | closed form | 1e-4 mm, 1e-5 mN, slack exactly none
#[test]
fn a_slack_cable_does_not_push_and_a_taut_one_is_a_spring() {
    let forces = [6.0, 30.0, 3.0];
    for ((x, left, right), force) in held(&forces).into_iter().zip(forces) {
        // The smoothing of the kink lengthens a taut cable by half of a thousandth.
        let want = SLACK_MM + force / STIFFNESS + 0.5e-3 * (LENGTH_MM + SLACK_MM);
        println!("{force} mN: {x:.5} mm for {want:.5}, {left:.6} and {right:.6} mN");
        assert!((x - want).abs() < 1e-4, "{x} for {want} mm");
        assert!((left + force).abs() < 1e-5 && right == 0.0, "{left} {right} mN");
    }
}
