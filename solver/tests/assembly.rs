//! The assembled gradient and matrix of a body on which everything acts, and their bits.

use crate::common;

use common::shapes::brick;
use mammotwin_data::{Vec3, mesh::Patch, progress::Silent, study::LawName};
use mammotwin_solver::assemble::{Analyses, Assembly, State};
use mammotwin_solver::linear::Ldlt;
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::{Outline, RoundedPlate};
use mammotwin_solver::terms::plate::{Plate, PlateKind};
use mammotwin_solver::terms::target::Cylinder;
use mammotwin_solver::terms::{Bulk, Cable, Cables, Curvature, Gravity, Load, Membrane, Sliding};
use mammotwin_solver::{Model, Options, solve};
use std::sync::Arc;

/// A brick of two tissues with skin, cables, weight, on a cylinder and between two plates.
fn everything() -> Model {
    let mesh = brick([3, 2, 3], |i, j, k| 8.0 * Vec3::new(i as f64, j as f64, k as f64));
    let stiff = Law::new(LawName::Gent, 0.8, 0.49, Some(2.0)).unwrap();
    let soft = Law::new(LawName::NeoHookean, 0.3, 0.499, None).unwrap();
    let laws = (0..mesh.tets.len()).map(|n| if n % 3 == 0 { stiff } else { soft });
    let points = &mesh.points;
    let faces = mesh.patch(Patch::Skin);
    let mut model = Model::new(&mesh);
    model.add(Bulk::new("tissue", &mesh, laws.collect()).unwrap()).unwrap();
    model.add(Membrane::uniform("skin", points, faces, 2.0, stiff).unwrap()).unwrap();
    model.add(Gravity::new("gravity", &mesh, 0.98, Vec3::new(0.1, 0.3, -1.0))).unwrap();
    let cable = Cable {
        node: 5,
        anchor: Vec3::new(-30.0, 0.0, 0.0),
        natural_mm: 20.0,
        stiffness_mn_per_mm: 0.4,
    };
    model.add(Cables::new("cables", vec![cable]).unwrap()).unwrap();
    let wall = Cylinder { point: Vec3::new(12.0, 8.0, -90.0), axis: Vec3::x(), radius_mm: 89.0 };
    let base = mesh.patch(Patch::ChestWall);
    model.add(Sliding::new("wall", points, base, Arc::new(wall))).unwrap();
    let shape = RoundedPlate {
        into: Vec3::y(),
        away: Vec3::z(),
        edge_mm: 5.0,
        radius_mm: 4.0,
        middle_mm: 0.0,
        outline: Outline::ENDLESS,
    };
    for kind in [PlateKind::Receptor, PlateKind::Paddle] {
        model.add(Plate::new(kind, shape, points, faces)).unwrap();
    }
    model.fix(0, 0);
    model.fix_node(3);
    model
}

/// Verifies: assembled gradient and matrix | differences of the energy | 1e-7; matrix 1e-5
#[test]
fn gradient_and_matrix_are_derivatives_of_the_energy() {
    let model = everything();
    let mut assembly = Assembly::new(&model).unwrap();
    let wave = |n: f64| Vec3::new((1.3 * n).sin(), (2.1 * n).cos(), (0.7 * n + 1.0).sin());
    let points: Vec<Vec3> =
        model.rest.iter().enumerate().map(|(n, p)| 1.02 * p + 0.3 * wave(n as f64)).collect();
    let load = Load { gravity: 0.7, receptor_mm: 0.5, thickness_mm: 14.5, ..Load::GRAVITY };
    let mut state = State::new(&model, points.clone(), load);
    state.update_multipliers(&model);
    let contact = state.contact(&model);
    assert!(contact.gap_mm > 0.1 && contact.penetration_mm > 0.1, "{contact:?}");
    let direction: Vec<Vec3> = (0..points.len())
        .map(|n| {
            let wave = wave(2.7 * n as f64 + 0.5);
            let free = [0, 1, 2].map(|axis| f64::from(u8::from(assembly.is_free(n, axis))));
            wave.component_mul(&Vec3::from(free))
        })
        .collect();
    let mut at = |t: f64| {
        let moved: Vec<Vec3> = points.iter().zip(&direction).map(|(p, d)| p + t * d).collect();
        let mut moved = State { points: moved, ..state.clone() };
        let mut pressure = Vec::new();
        let energy = assembly.energy(&model, &moved, &moved.points, &mut pressure).unwrap();
        moved.pressure = pressure;
        let (mut gradient, mut values) = (Vec::new(), Vec::new());
        assembly
            .newton_system(&model, &moved, Curvature::Exact, &mut gradient, &mut values)
            .unwrap();
        (energy, gradient, values)
    };
    let step = 1e-4;
    let (_, gradient, values) = at(0.0);
    let [far, near] = [2.0, 1.0].map(|n| [at(-n * step), at(n * step)]);
    // Fourth-order central differences.
    let slope = |near: f64, far: f64| (8.0 * near - far) / (12.0 * step);
    let energy = slope(near[1].0 - near[0].0, far[1].0 - far[0].0);
    let along: f64 = gradient.iter().zip(&direction).map(|(g, d)| g.dot(d)).sum();
    assert!((energy / along - 1.0).abs() < 1e-7, "slope {energy}, gradient {along}");
    let change: Vec<Vec3> = (0..points.len())
        .map(|n| {
            (8.0 * (near[1].1[n] - near[0].1[n]) - (far[1].1[n] - far[0].1[n])) / (12.0 * step)
        })
        .collect();
    // The matrix, pressures eliminated, takes the direction to the change of the gradient.
    let mut system = Ldlt::analyse(assembly.pattern().clone()).unwrap();
    system.factor(&values).unwrap();
    let mut x = Vec::new();
    system.solve(&assembly.right_hand_side(&change), &mut x).unwrap();
    let back = assembly.displacement(&x);
    let error = back.iter().zip(&direction).map(|(b, d)| (b + d).norm()).fold(0.0, f64::max);
    assert!(error < 1e-5, "{error:.1e}");
}

fn hanging() -> Model {
    common::hanging(Law::new(LawName::NeoHookean, 0.5, 0.49, None).unwrap())
}

fn solved(model: &Model) -> Vec<Vec3> {
    solve(model, &model.rest, &Options::default(), &Silent).unwrap().points
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let [one, two] = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solved(&hanging()))
    });
    assert!(one == two);
    assert!(one != hanging().rest);
}

#[test]
fn models_of_the_same_elements_share_an_analysis_and_keep_their_bits() {
    let alone = solved(&hanging());
    let shared = Analyses::default();
    let with = |change: &dyn Fn(&mut Model)| {
        let mut model = hanging();
        model.share(&shared);
        change(&mut model);
        solved(&model)
    };
    // Other supports and other elements are another matrix.
    let free = |model: &Model| {
        (0..model.rest.len() as u32).rfind(|&n| model.fixed()[n as usize] == [false; 3]).unwrap()
    };
    let held = with(&|model| model.fix_node(free(model)));
    let tied = with(&|model| {
        let node = free(model);
        let anchor = model.rest[node as usize] - 20.0 * Vec3::z();
        let cable = Cable { node, anchor, natural_mm: 20.0, stiffness_mn_per_mm: 40.0 };
        model.add(Cables::new("cables", vec![cable]).unwrap()).unwrap();
    });
    assert!(held != alone && tied != alone && held != tied);
    assert!(with(&|_| ()) == alone);
    assert_eq!(shared.count(), 3);
    // Other rest positions are not.
    let wide = with(&|model| model.rest.iter_mut().for_each(|p| p.x *= 1.01));
    assert!(wide != alone && with(&|_| ()) == alone);
    assert_eq!(shared.count(), 3);
}
