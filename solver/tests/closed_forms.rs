//! Columns, balloons, sheets and beams against closed forms.

use crate::common;

use common::loads::{Cavity, CurvedCavity, DeadForces};
use common::shapes::{brick, hollow_sphere};
use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
    progress::Silent,
    solution::Solution,
    study::LawName,
    units::WEIGHT_OF_G_PER_CM3,
};
use mammotwin_solver::materials::Law;
use mammotwin_solver::mesh::quadratic::QuadraticMesh;
use mammotwin_solver::newton::NewtonOptions;
use mammotwin_solver::terms::{
    Bulk, Gravity, Membrane, QuadraticBulk, QuadraticMembrane, quadratic::Rule,
};
use mammotwin_solver::{Model, Options, solve, solve_near};
use std::collections::BTreeMap;

fn options() -> Options {
    let newton = NewtonOptions { residual: 1e-11, ..NewtonOptions::default() };
    Options { newton, ..Options::default() }
}

fn neo_hookean(young_kpa: f64, poisson: f64) -> Law {
    Law::new(LawName::NeoHookean, young_kpa, poisson, None).unwrap()
}

/// Where a rising function is zero.
fn root([mut low, mut high]: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        *(if value(middle) > 0.0 { &mut high } else { &mut low }) = middle;
    }
    0.5 * (low + high)
}

/// A model of bare nodes.
fn of_nodes(points: &[Vec3]) -> Model {
    Model::new(&TetMesh { points: points.to_vec(), ..TetMesh::default() })
}

/// A column in a smooth tube, under its weight: height and density (mm, g/cm³), moduli.
struct Column {
    young_kpa: f64,
    poisson: f64,
}

const HEIGHT_MM: f64 = 100.0;
const DENSITY: f64 = 0.981;

impl Column {
    /// Stretch at a height, where the stress along the column is the weight above.
    fn stretch(&self, z: f64) -> f64 {
        let shear = self.young_kpa / 2.0 / (1.0 + self.poisson);
        let pressure = DENSITY * WEIGHT_OF_G_PER_CM3 * (HEIGHT_MM - z);
        root([0.3, 1.5], |l| {
            let apart = shear * l.powf(-2.0 / 3.0) * (l - (2.0 + l * l) / (3.0 * l));
            apart + self.mean_kpa(l) + pressure
        })
    }

    /// Mean stress at a stretch.
    fn mean_kpa(&self, l: f64) -> f64 {
        self.young_kpa / 3.0 / (1.0 - 2.0 * self.poisson) * (l - 1.0)
    }

    /// How far the top sinks: Simpson's rule.
    fn sinks_mm(&self) -> f64 {
        let (count, h) = (200, HEIGHT_MM / 200.0);
        let weight = |n: usize| if n == 0 || n == count { 1.0 } else { [2.0, 4.0][n % 2] };
        (0..=count).map(|n| h / 3.0 * weight(n) * (1.0 - self.stretch(h * n as f64))).sum()
    }

    /// Errors of how far the top sinks and of the mean stress (parts of the largest).
    fn errors(&self, layers: usize, is_quadratic: bool) -> [f64; 2] {
        let mesh = brick([2, 2, layers], |i, j, l| {
            let z = HEIGHT_MM / layers as f64 * l as f64;
            Vec3::new(5.0 * i as f64, 5.0 * j as f64, z)
        });
        let law = neo_hookean(self.young_kpa, self.poisson);
        let laws = vec![law; mesh.tets.len()];
        let fine = QuadraticMesh::new(&mesh);
        let points = if is_quadratic { &fine.points } else { &mesh.points };
        let mut model = of_nodes(points);
        if is_quadratic {
            model.add(QuadraticBulk::new("column", &fine, laws, Rule::Four).unwrap()).unwrap();
            let weight = Gravity::quadratic("gravity", &fine, DENSITY, -Vec3::z());
            model.add(weight.unwrap()).unwrap();
        } else {
            model.add(Bulk::new("column", &mesh, laws).unwrap()).unwrap();
            model.add(Gravity::new("gravity", &mesh, DENSITY, -Vec3::z())).unwrap();
        }
        for (n, p) in points.iter().enumerate() {
            model.fix(n as u32, 0);
            model.fix(n as u32, 1);
            if p.z == 0.0 {
                model.fix(n as u32, 2);
            }
        }
        let found = solve(&model, points, &options(), &Silent).unwrap();
        let top = mesh.patch_nodes(Patch::Skin);
        let sunk = top.iter().map(|&n| HEIGHT_MM - found.points[n as usize].z);
        let sunk = sunk.sum::<f64>() / top.len() as f64;
        let largest = self.mean_kpa(self.stretch(0.0)).abs();
        let off = mesh.tets.iter().zip(&found.cauchy_kpa).map(|(tet, stress)| {
            let z = tet.iter().map(|&n| mesh.points[n as usize].z).sum::<f64>() / 4.0;
            (stress.trace() / 3.0 - self.mean_kpa(self.stretch(z))).abs()
        });
        [(sunk / self.sinks_mm() - 1.0).abs(), off.fold(0.0, f64::max) / largest]
    }
}

/// Verifies: column in a tube under its weight, linear tetrahedra, ν 0.49, 0.499 | closed form of stretch and pressure over height | 0.5 %, stress 3 %, first order
/// Verifies: the same, quadratic tetrahedra | closed form | 1e-6, stress 1e-5
#[test]
fn a_column_bears_the_pressure_of_what_is_above() {
    for poisson in [0.49, 0.499] {
        let column = Column { young_kpa: 0.5, poisson };
        let whole = DENSITY * WEIGHT_OF_G_PER_CM3 * HEIGHT_MM;
        let below = column.mean_kpa(column.stretch(0.0));
        println!(
            "ν {poisson}: {below:.4} kPa below for {whole:.4} of water, sinks {:.4} mm",
            column.sinks_mm()
        );
        for (is_quadratic, most) in [(false, [0.005, 0.03]), (true, [1e-6, 1e-5])] {
            let errors = [10, 20].map(|layers| column.errors(layers, is_quadratic));
            println!("quadratic {is_quadratic}: {errors:?}");
            assert!(errors[1][0] < most[0] && errors[1][1] < most[1], "{errors:?}");
            assert!(errors[1][1] < 0.6 * errors[0][1], "{errors:?}");
        }
    }
}

const RADIUS_MM: f64 = 50.0;
const SKIN_MM: f64 = 1.0;
const SKIN_YOUNG_KPA: f64 = 90.0;

/// Nodes of the sphere that are used by some faces, and the faces with those.
fn shell<const N: usize>(points: &[Vec3], faces: &[[u32; N]]) -> (Vec<Vec3>, Vec<[u32; N]>) {
    let mut own: BTreeMap<u32, u32> = BTreeMap::new();
    let mut placed = Vec::new();
    let mut renamed = faces.to_vec();
    for node in renamed.iter_mut().flatten() {
        *node = *own.entry(*node).or_insert_with(|| {
            placed.push(RADIUS_MM * points[*node as usize].normalize());
            placed.len() as u32 - 1
        });
    }
    (placed, renamed)
}

/// Pressure (kPa) of a neo-Hookean balloon of a stretch: 2 μ t/R (1/λ - 1/λ⁷).
fn balloon_kpa(stretch: f64) -> f64 {
    let shear = SKIN_YOUNG_KPA / 3.0;
    2.0 * shear * SKIN_MM / RADIUS_MM * (stretch.recip() - stretch.powi(-7))
}

/// Largest error of the radius (part of its growth) of a balloon with `n` elements along an eighth.
fn balloon(n: usize, is_quadratic: bool) -> f64 {
    let stretch = 1.2;
    let pressure_kpa = balloon_kpa(stretch);
    let law = neo_hookean(SKIN_YOUNG_KPA, 0.49);
    let mesh = hollow_sphere(n, 1, RADIUS_MM - 1.0, RADIUS_MM);
    let fine = QuadraticMesh::new(&mesh);
    let (points, mut model) = if is_quadratic {
        let (points, faces) = shell(&fine.points, &fine.patches[&Patch::Skin]);
        let mut model = of_nodes(&points);
        let skin = QuadraticMembrane::uniform("skin", &points, &faces, SKIN_MM, law);
        model.add(skin.unwrap()).unwrap();
        // The edges' nodes follow their corners.
        let out = |[a, b, c, d, e, f]: [u32; 6]| {
            let [p, q, r] = [a, b, c].map(|n| points[n as usize]);
            if p.dot(&q.cross(&r)) > 0.0 { [a, b, c, d, e, f] } else { [a, c, b, f, e, d] }
        };
        let faces = faces.into_iter().map(out).collect();
        model.add(CurvedCavity { faces, pressure_kpa }).unwrap();
        (points, model)
    } else {
        let (points, faces) = shell(&mesh.points, mesh.patch(Patch::Skin));
        let mut model = of_nodes(&points);
        let skin = Membrane::uniform("skin", &points, &faces, SKIN_MM, law);
        model.add(skin.unwrap()).unwrap();
        let out = |[a, b, c]: [u32; 3]| {
            let [p, q, r] = [a, b, c].map(|n| points[n as usize]);
            if p.dot(&q.cross(&r)) > 0.0 { [a, b, c] } else { [a, c, b] }
        };
        let faces = faces.into_iter().map(out).collect();
        model.add(Cavity { faces, pressure_kpa }).unwrap();
        (points, model)
    };
    for (node, p) in points.iter().enumerate() {
        for axis in (0..3).filter(|axis| p[*axis].abs() < 1e-9) {
            model.fix(node as u32, axis);
        }
    }
    // Slack skin has no stiffness across: it begins taut.
    let start: Vec<Vec3> = points.iter().map(|p| 1.1 * p).collect();
    let found = solve_near(&model, &start, &options(), &Silent).unwrap();
    let radii = found.points.iter().map(|p| p.norm() / RADIUS_MM);
    radii.map(|r| (r - stretch).abs() / (stretch - 1.0)).fold(0.0, f64::max)
}

/// Verifies: balloon under pressure, three-node sheets | closed form 2 μ t/R (1/λ - 1/λ⁷) | 3 % of the growth at 16 elements, order 2 ± 0.4
/// Verifies: the same, six-node sheets | closed form | 0.1 % of the growth at 8 elements, order over 3
#[test]
fn a_balloon_grows_as_its_pressure_says() {
    let linear = [4, 8, 16].map(|n| balloon(n, false));
    let quadratic = [2, 4, 8].map(|n| balloon(n, true));
    let order = |e: &[f64; 3]| [(e[0] / e[1]).log2(), (e[1] / e[2]).log2()];
    println!("three nodes: {linear:?}, order {:.2?}", order(&linear));
    println!("six nodes: {quadratic:?}, order {:.2?}", order(&quadratic));
    assert!(linear[2] < 0.03 && (order(&linear)[1] - 2.0).abs() < 0.4, "{linear:?}");
    assert!(quadratic[2] < 0.001 && order(&quadratic)[1] > 3.0, "{quadratic:?}");
}

/// Places (mm) along a strip of skin of six thicknesses that is pulled, and those that they should have.
fn strip(is_quadratic: bool) -> Vec<[f64; 2]> {
    let thickness = [2.0, 0.5, 1.0, 3.0, 0.8, 1.5];
    let (width, force, shear) = (20.0, 600.0, 30.0);
    let mesh = brick([6, 2, 1], |i, j, l| Vec3::new(10.0 * i as f64, 10.0 * j as f64, l as f64));
    let fine = QuadraticMesh::new(&mesh);
    let law = neo_hookean(3.0 * shear, 0.49);
    let column = |x: f64| (x / 10.0) as usize;
    let flat =
        |points: &[Vec3]| points.iter().map(|p| Vec3::new(p.x, p.y, 0.0)).collect::<Vec<_>>();
    let top = |n: &u32, points: &[Vec3]| points[*n as usize].z == 1.0;
    let (points, mut model);
    if is_quadratic {
        points = flat(&fine.points);
        let faces = &fine.patches[&Patch::Skin];
        assert!(faces.iter().flatten().all(|n| top(n, &fine.points)));
        let mean =
            |face: &[u32; 6]| face[..3].iter().map(|&n| points[n as usize].x).sum::<f64>() / 3.0;
        let thick: Vec<f64> = faces.iter().map(|face| thickness[column(mean(face))]).collect();
        let laws = vec![law; faces.len()];
        let skin = QuadraticMembrane::new("skin", &points, faces, &thick, &laws).unwrap();
        model = of_nodes(&points);
        model.add(skin).unwrap();
    } else {
        points = flat(&mesh.points);
        let faces = mesh.patch(Patch::Skin);
        let mean = |face: &[u32; 3]| face.iter().map(|&n| points[n as usize].x).sum::<f64>() / 3.0;
        let thick: Vec<f64> = faces.iter().map(|face| thickness[column(mean(face))]).collect();
        let laws = vec![law; faces.len()];
        model = of_nodes(&points);
        model.add(Membrane::new("skin", &points, faces, &thick, &laws).unwrap()).unwrap();
    }
    let used = |n: usize| {
        let z = if is_quadratic { fine.points[n].z } else { mesh.points[n].z };
        z == 1.0
    };
    let mut forces = Vec::new();
    for (n, p) in points.iter().enumerate() {
        if !used(n) || p.x == 0.0 {
            model.fix_node(n as u32);
            continue;
        }
        model.fix(n as u32, 1);
        model.fix(n as u32, 2);
        if p.x == 60.0 {
            // Trapezoidal and Simpson's rule along two edges.
            let part = match (is_quadratic, p.y) {
                (true, 5.0 | 15.0) => 4.0 / 12.0,
                (true, 10.0) => 2.0 / 12.0,
                (true, _) => 1.0 / 12.0,
                (false, 10.0) => 0.5,
                (false, _) => 0.25,
            };
            forces.push((n as u32, part * force * Vec3::x()));
        }
    }
    model.add(DeadForces::new(forces)).unwrap();
    let start: Vec<Vec3> = points.iter().map(|p| Vec3::new(1.1 * p.x, p.y, p.z)).collect();
    let found: Solution = solve_near(&model, &start, &options(), &Silent).unwrap();
    // Held at its sides: μ t (λ - 1/λ³) is the force over the width.
    let stretch =
        thickness.map(|t| root([1.0, 10.0], |l| shear * t * (l - l.powi(-3)) - force / width));
    let place = |x: f64| {
        let full: f64 = stretch[..column(x)].iter().map(|l| 10.0 * l).sum();
        let rest = x - 10.0 * column(x) as f64;
        full + if rest > 0.0 { rest * stretch[column(x)] } else { 0.0 }
    };
    let nodes = (0..points.len()).filter(|&n| used(n));
    nodes.map(|n| [found.points[n].x, place(points[n].x)]).collect()
}

/// Verifies: skin of six thicknesses in series, three- and six-node sheets | closed form μ t (λ - 1/λ³) | 1e-6 mm
#[test]
fn skin_of_several_thicknesses_stretches_as_springs_in_series() {
    for is_quadratic in [false, true] {
        let places = strip(is_quadratic);
        let off = places.iter().map(|[got, want]| (got - want).abs()).fold(0.0, f64::max);
        let end = places.iter().map(|[got, _]| *got).fold(0.0, f64::max);
        println!("quadratic {is_quadratic}: 60 mm to {end:.4} mm, off by {off:.1e} mm");
        assert!(end > 75.0 && off < 1e-6, "{off:e} mm");
    }
}

/// A beam of quadratic tetrahedra along x, clamped at x = 0, under a force across its free end (mN): how far the middle of the
/// end goes along x and z (mm).
fn cantilever(size: [f64; 3], elements: [usize; 3], young_kpa: f64, force: f64) -> [f64; 2] {
    let mesh = brick(elements, |i, j, l| {
        let at = [i, j, l].map(|n| n as f64);
        Vec3::from_fn(|axis, _| size[axis] * (at[axis] / elements[axis] as f64))
    });
    let fine = QuadraticMesh::new(&mesh);
    let mut model = of_nodes(&fine.points);
    // Hardly any lateral contraction, as beams have none where they are clamped.
    let laws = vec![Law::neo_hookean_coupled(young_kpa, 1e-3).unwrap(); fine.tets.len()];
    model.add(QuadraticBulk::new("beam", &fine, laws, Rule::Four).unwrap()).unwrap();
    let end = |p: &Vec3| p.x == size[0];
    let count = fine.points.iter().filter(|p| end(p)).count() as f64;
    let mut forces = Vec::new();
    for (n, p) in fine.points.iter().enumerate() {
        if p.x == 0.0 {
            model.fix_node(n as u32);
        } else if end(p) {
            forces.push((n as u32, force / count * Vec3::z()));
        }
    }
    model.add(DeadForces::new(forces)).unwrap();
    let found = solve(&model, &fine.points, &options(), &Silent).unwrap();
    let moved = fine.points.iter().zip(&found.points).filter(|(p, _)| end(p));
    let sum: Vec3 = moved.map(|(p, q)| q - p).sum();
    [sum.x / count, sum.z / count]
}

/// Verifies: short cantilever of quadratic tetrahedra, small load | P L³/3EI + P L/κGA (Timoshenko) | 0.5 %
/// Verifies: slender cantilever of quadratic tetrahedra, P L²/EI of 1 and 2 | elastica: 0.3017, 0.4935 L across, 0.0564, 0.1606 L along (Mattiasson 1981) | 1 %, along 2 %
#[test]
fn a_cantilever_bends_as_a_beam() {
    let young = 1e4;
    let (length, height, width) = (100.0f64, 20.0f64, 10.0);
    let inertia = width * height.powi(3) / 12.0;
    let force = 10.0;
    let bending = force * length.powi(3) / (3.0 * young * inertia);
    let shear = force * length / (5.0 / 6.0 * 0.5 * young * width * height);
    let [_, down] = cantilever([length, width, height], [20, 2, 4], young, force);
    println!("{down:.6} mm for {bending:.6} of bending and {shear:.6} of shear");
    assert!((down / (bending + shear) - 1.0).abs() < 0.005, "{down}");
    // Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145, table 1; 40 times as long as high.
    let (length, side) = (200.0, 5.0);
    let inertia = side * side * side * side / 12.0;
    for (load, along, across) in [(1.0, 0.05643, 0.30172), (2.0, 0.16064, 0.49346)] {
        let force = load * young * inertia / (length * length);
        let [back, down] = cantilever([length, side, side], [40, 1, 1], young, force);
        println!("{load}: {:.5} L along, {:.5} L across", -back / length, down / length);
        assert!((down / length / across - 1.0).abs() < 0.01, "{down}");
        assert!((-back / length / along - 1.0).abs() < 0.02, "{back}");
    }
}
