//! Contact pressure as it is written, against forces that no contact knows: those of the tissue.
//!
//! The pressure, linear over each deformed face of the skin, is integrated with the plate's own normal at points of
//! quadrature; the force of a plate is what the tissue's stress does to the nodes before it. There is no weight.

use crate::common;

use common::shapes::brick;
use common::squeeze::{self, Squeeze};
use common::{Body, coarse, fine};
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, study::LawName};
use mammotwin_solver::compress::{Plates, Step};
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::RoundedPlate;

/// Each face is cut into so many parts along an edge.
const CUTS: usize = 8;

/// Force (mN) of receptor and paddle along the axis by the pressures.
fn of_pressures(plates: &Plates, step: &Step) -> [f64; 2] {
    let &Plates { axis, away, edge_mm, radius_mm, middle_mm, outline, .. } = plates;
    let middle = step.receptor_mm + 0.5 * step.thickness_mm;
    let mut forces = [0.0, 0.0];
    for face in &plates.faces {
        let corners = face.map(|n| step.points[n as usize]);
        let pressures = face.map(|n| step.contact_pressure_kpa[n as usize]);
        let [a, b, c] = corners;
        let part = (b - a).cross(&(c - a)) / (2.0 * (CUTS * CUTS) as f64);
        let mut add = |i: f64, j: f64| {
            let l = [i, j, CUTS as f64 - i - j].map(|x| x / CUTS as f64);
            let x: Vec3 = (0..3).map(|n| l[n] * corners[n]).sum();
            let pressure: f64 = (0..3).map(|n| l[n] * pressures[n]).sum();
            let above = x.dot(&axis) > middle;
            let (into, level) = if above {
                (axis, step.receptor_mm + step.thickness_mm)
            } else {
                (-axis, -step.receptor_mm)
            };
            let plate = RoundedPlate { into, away, edge_mm, radius_mm, middle_mm, outline };
            let normal = plate.distance(&x, level).1;
            let force = pressure * -part.dot(&normal) * normal;
            forces[usize::from(above)] -= force.dot(&into);
        };
        for i in 0..CUTS {
            for j in 0..CUTS - i {
                let third = 1.0 / 3.0;
                add(i as f64 + third, j as f64 + third);
                if i + j + 1 < CUTS {
                    add(i as f64 + 2.0 * third, j as f64 + 2.0 * third);
                }
            }
        }
    }
    forces
}

/// Force (mN) of receptor and paddle along the axis by the tissue alone, whose nodes that `held` names are on neither.
fn of_tissue(
    mesh: &TetMesh,
    law: Law,
    plates: &Plates,
    step: &Step,
    held: impl Fn(u32) -> bool,
) -> [f64; 2] {
    let gradient = squeeze::of_tissue(mesh, law, &step.points);
    let middle = step.receptor_mm + 0.5 * step.thickness_mm;
    let mut forces = [0.0, 0.0];
    for (n, force) in gradient.iter().enumerate().filter(|(n, _)| !held(*n as u32)) {
        let above = step.points[n].dot(&plates.axis) > middle;
        let along = force.dot(&plates.axis);
        forces[usize::from(above)] += if above { -along } else { along };
    }
    forces
}

/// Largest part by which pressures miss the force of the tissue, and by which recorded forces do.
fn missed(
    mesh: &TetMesh,
    law: Law,
    plates: &Plates,
    step: &Step,
    held: impl Fn(u32) -> bool,
) -> [f64; 2] {
    let tissue = of_tissue(mesh, law, plates, step, held);
    let by_pressure = of_pressures(plates, step);
    let recorded = [step.receptor_force_mn, step.paddle_force_mn];
    println!(
        "{:5.1} mm: tissue {tissue:.2?}, pressures {by_pressure:.2?}, recorded {recorded:.2?} mN",
        step.thickness_mm
    );
    let off = |of: [f64; 2]| (0..2).map(|n| (of[n] / tissue[n] - 1.0).abs()).fold(0.0, f64::max);
    [off(by_pressure), off(recorded)]
}

fn breast(body: &Body, radius_mm: f64) -> Vec<(f64, [f64; 2])> {
    let law = Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap();
    let squeeze = Squeeze { radius_mm, ..Squeeze::rigid(law, 11.0, 50.0) };
    let (plates, done) = (squeeze.plates(body), squeeze.press(body));
    let held = body.mesh.patch_nodes(Patch::ChestWall);
    let held = |n: u32| held.contains(&n);
    let steps = done.steps.iter().filter(|step| step.paddle_force_mn > 50.0);
    let found = steps.map(|step| (step.thickness_mm, missed(&body.mesh, law, &plates, step, held)));
    found.collect()
}

/// Verifies: contact pressure over deformed faces of 8 mm, plates with edges of 20, 10 and 3 mm | nodal forces of the tissue's stress | 1, 14, 22 %
/// Verifies: recorded forces of both plates | nodal forces of the tissue's stress | 1e-5
#[test]
fn pressures_on_round_edges_sum_up_to_what_the_tissue_bears() {
    for (radius_mm, most) in [(3.0, 0.22), (10.0, 0.14), (20.0, 0.01)] {
        for (thickness, [pressure, recorded]) in breast(&coarse(), radius_mm) {
            println!("{radius_mm} mm edge, {thickness:.1} mm: {pressure:.4} {recorded:.1e}");
            assert!(recorded < 1e-5 && pressure < most, "{recorded} {pressure}");
        }
    }
}

/// Verifies: contact pressure over deformed faces of 5 mm, plates with edges of 20 and 10 mm | nodal forces of the tissue's stress | 1, 1.5 %
#[test]
#[ignore = "a minute: 20 k tetrahedra"]
fn pressures_on_finer_skin_are_nearer_to_what_the_tissue_bears() {
    for (radius_mm, most) in [(10.0, 0.015), (20.0, 0.01)] {
        for (thickness, [pressure, recorded]) in breast(&fine(), radius_mm) {
            println!("{radius_mm} mm edge, {thickness:.1} mm: {pressure:.4} {recorded:.1e}");
            assert!(recorded < 1e-5 && pressure < most, "{recorded} {pressure}");
        }
    }
}

/// Verifies: contact pressure under flat rough plates over deformed faces | nodal forces of the tissue's stress | 1 %
#[test]
fn pressures_of_flat_plates_sum_up_to_what_the_tissue_bears() {
    let mesh = brick([4, 4, 2], |i, j, l| 10.0 * Vec3::new(i as f64, j as f64, l as f64));
    let law = Law::neo_hookean_coupled(1.0, 0.49).unwrap();
    for friction in [0.0, 0.5] {
        let (plates, done) = squeeze::flat(&mesh, law, friction);
        let step = done.steps.last().unwrap();
        let [pressure, recorded] = missed(&mesh, law, &plates, step, |_| false);
        println!("friction {friction}: {pressure:.2e}, {recorded:.1e}");
        assert!(pressure < 0.01 && recorded < 1e-5, "{pressure} {recorded}");
    }
}
