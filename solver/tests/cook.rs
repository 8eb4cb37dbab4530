//! Cook's membrane, nearly incompressible, in plane strain: a tapered panel, clamped at its left
//! side and sheared at its right one. Linear tetrahedra against quadratic ones.

use crate::common;

use common::{loads::DeadForces, roughness, shapes::brick};
use mammotwin_data::{Vec3, mesh::TetMesh, progress::Silent, study::LawName};
use mammotwin_solver::assemble::{Assembly, State};
use mammotwin_solver::materials::Law;
use mammotwin_solver::mesh::quadratic::QuadraticMesh;
use mammotwin_solver::terms::{Bulk, Load, QuadraticBulk, quadratic::Rule};
use mammotwin_solver::{Model, Options, solve};

/// Tissue, and shear at the right side (kPa).
#[derive(Clone, Copy)]
struct Case {
    law: Law,
    shear_kpa: f64,
}

impl Case {
    fn new(young_kpa: f64, poisson: f64, shear_kpa: f64) -> Self {
        Self { law: Law::new(LawName::NeoHookean, young_kpa, poisson, None).unwrap(), shear_kpa }
    }
}

/// 48 mm wide, 44 mm high at the left and 16 mm at the right, one element thick.
fn panel(n: usize) -> TetMesh {
    let thick = 48.0 / n as f64;
    brick([n, n, 1], |i, j, k| {
        let (x, up) = (i as f64 / n as f64, j as f64 / n as f64);
        let (low, high) = (44.0 * x, 44.0 + 16.0 * x);
        Vec3::new(48.0 * x, low + up * (high - low), thick * k as f64)
    })
}

/// A model of the panel but for its tissue; `share` is the area (mm²) of the right side that a
/// node there carries.
fn load(case: Case, points: &[Vec3], share: impl Fn(&Vec3) -> f64) -> Model {
    let mut model = Model::new(&TetMesh { points: points.to_vec(), ..TetMesh::default() });
    for (node, p) in points.iter().enumerate() {
        model.fix(node as u32, 2);
        if p.x == 0.0 {
            model.fix_node(node as u32);
        }
    }
    let right = points.iter().enumerate().filter(|(_, p)| p.x == 48.0);
    let forces =
        right.map(|(node, p)| (node as u32, Vec3::new(0.0, case.shear_kpa * share(p), 0.0)));
    model.add(DeadForces::new(forces)).unwrap();
    model
}

fn tip(points: &[Vec3], rest: &[Vec3]) -> f64 {
    let at = rest.iter().position(|p| p.x == 48.0 && p.y == 60.0).unwrap();
    points[at].y - rest[at].y
}

/// Height (mm) that the upper right corner gains, and the roughness of the nodal pressures.
fn linear(case: Case, n: usize) -> (f64, f64) {
    let mesh = panel(n);
    let thick = 48.0 / n as f64;
    let area = 16.0 / n as f64 * thick;
    let edge = |p: &Vec3| p.y == 44.0 || p.y == 60.0;
    // The trapezoidal rule along the height; half for each side.
    let mut model = load(case, &mesh.points, |p| area * if edge(p) { 0.25 } else { 0.5 });
    model.add(Bulk::new("panel", &mesh, vec![case.law; mesh.tets.len()]).unwrap()).unwrap();
    let solution = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
    assert!(solution.checks.iterations <= 60, "{:?}", solution.checks);
    let mut assembly = Assembly::new(&model).unwrap();
    let state = State::new(&model, solution.points.clone(), Load::GRAVITY);
    let mut pressure = Vec::new();
    assembly.energy(&model, &state, &solution.points, &mut pressure).unwrap();
    (tip(&solution.points, &mesh.points), roughness(&mesh, &pressure))
}

fn quadratic(case: Case, n: usize) -> f64 {
    let mesh = QuadraticMesh::new(&panel(n));
    let thick = 48.0 / n as f64;
    let area = 16.0 / n as f64 * thick;
    // Simpson's rule along the height; on plane strain only the sum over the thickness counts.
    let share = |p: &Vec3| {
        let j = ((p.y - 44.0) / 16.0 * 2.0 * n as f64).round() as usize;
        let middle = p.z > 0.1 * thick && p.z < 0.9 * thick;
        let weight = match (j, j % 2) {
            (_, 1) => 4.0,
            (0, _) => 1.0,
            (j, _) if j == 2 * n => 1.0,
            _ => 2.0,
        };
        if middle { 0.0 } else { area * weight / 12.0 }
    };
    let mut model = load(case, &mesh.points, share);
    let laws = vec![case.law; mesh.tets.len()];
    model.add(QuadraticBulk::new("panel", &mesh, laws, Rule::Four).unwrap()).unwrap();
    tip(&solve(&model, &mesh.points, &Options::default(), &Silent).unwrap().points, &mesh.points)
}

/// Verifies: Cook's membrane, ν = 0.499: tip | quadratic tetrahedra | 2 % at 32 elements
/// Verifies: Cook's membrane, 8, 16, 32 elements: observed order | theory: two without corners | over 1.2
/// Verifies: Cook's membrane: no checkerboard of pressures | roughness of neighbours | below 0.2, 2 is a checkerboard
#[test]
fn the_tapered_panel_bends_as_with_quadratic_tetrahedra() {
    let case = Case::new(1.0, 0.499, 0.02);
    let truth = quadratic(case, 16);
    let coarser = quadratic(case, 8);
    println!("quadratic: {coarser:.3} mm, {truth:.3} mm");
    assert!((coarser / truth - 1.0).abs() < 0.01, "the reference has converged");
    let found = [8, 16, 32].map(|n| {
        let (tip, rough) = linear(case, n);
        println!("{n}: {tip:.3} mm, roughness of the pressure {rough:.3}");
        (tip, rough)
    });
    let errors = found.map(|(tip, _)| (tip / truth - 1.0).abs());
    assert!(errors[2] < 0.02 && errors[1] < 0.05, "{errors:?}");
    let order = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    println!("errors {errors:.4?}, observed order {order:.2?}");
    // Corners that are clamped keep it below two.
    assert!(order.iter().all(|order| *order > 1.2), "{order:?}");
    // A checkerboard would stay at two.
    assert!(found[2].1 < found[1].1 && found[2].1 < 0.2, "{found:?}");
}

/// Verifies: Cook's membrane, E 240.565, ν 0.4999, 6.25 kPa, quadratic tetrahedra | 6.9083 mm (128 x 128, Elguedj et al. 2008) | 1 %
/// Verifies: Cook's membrane, μ 1, incompressible, 0.05 kPa, quadratic tetrahedra | 4.7011 mm (Müller 2015) | 1 %
/// Verifies: the same with linear tetrahedra, 32 elements | the same | 2 %
#[test]
fn the_tapered_panel_bends_as_published() {
    // Elguedj, Bazilevs, Calo & Hughes, Comput. Methods Appl. Mech. Eng. 197 (2008) 2732; Müller, thesis,
    // Universität Duisburg-Essen (2015). Both values as other codes quote them.
    let cases =
        [(Case::new(240.565, 0.4999, 6.25), 6.9083), (Case::new(2.9998, 0.4999, 0.05), 4.7011)];
    for (case, published) in cases {
        let [coarse, fine] = [8, 16].map(|n| quadratic(case, n));
        let (tip, _) = linear(case, 32);
        println!("quadratic {coarse:.4}, {fine:.4} mm, linear {tip:.4} mm for {published} mm");
        assert!((fine / published - 1.0).abs() < 0.01, "{fine} for {published} mm");
        assert!((tip / published - 1.0).abs() < 0.02, "{tip} for {published} mm");
    }
}
