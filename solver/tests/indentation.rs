//! Rigid indenters on an elastic half-space, against Hertz and Boussinesq.
//!
//! An eighth of a ball stands for the half-space: on its outer surface it moves as under a force at a
//! point (Johnson, *Contact mechanics* (1985), § 3.2; § 3.4 and § 4.2 for punch and sphere).

use crate::common;

use common::shapes::brick;
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, solution::Solution};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{
    Bulk, Opening, Sliding, Target,
    target::{Plane, Sphere},
};
use mammotwin_solver::{Model, Options, solve};
use std::f64::consts::PI;
use std::sync::Arc;

const YOUNG_KPA: f64 = 10.0;
const POISSON: f64 = 0.3;
/// Radius (mm) within which the mesh is even.
const EVEN_MM: f64 = 1.5;
const OUTER_MM: f64 = 12.0;

fn plane_strain_kpa() -> f64 {
    YOUNG_KPA / (1.0 - POISSON * POISSON)
}

/// An eighth of a ball below z = 0, made of the shells of a cube, with `even` of them up to
/// [`EVEN_MM`] and two thirds as many, growing ones, beyond. Its flat top is the chest wall.
fn eighth(even: usize) -> TetMesh {
    let graded = 2 * even / 3;
    let radius = |step: usize| {
        if step <= even {
            EVEN_MM * step as f64 / even as f64
        } else {
            EVEN_MM * (OUTER_MM / EVEN_MM).powf((step - even) as f64 / graded as f64)
        }
    };
    let n = even + graded;
    brick([n, n, n], |i, j, k| {
        let shell = i.max(j).max(k);
        if shell == 0 {
            return Vec3::zeros();
        }
        let along = |step: usize| (0.25 * PI * step as f64 / shell as f64).tan();
        radius(shell) * Vec3::new(along(i), along(j), -along(k)).normalize()
    })
}

/// Displacement (mm) of a half-space below z = 0 under a force (mN) that presses on the origin.
fn under_a_point(force: f64, p: &Vec3) -> Vec3 {
    let (r, depth, reach) = (p.xy().norm(), -p.z, p.norm());
    let shear = YOUNG_KPA / (2.0 * (1.0 + POISSON));
    let scale = force / (4.0 * PI * shear * reach);
    let out = scale * (r * depth / (reach * reach) - (1.0 - 2.0 * POISSON) * r / (reach + depth));
    let down = scale * ((depth / reach).powi(2) + 2.0 * (1.0 - POISSON));
    let radial = if r > 0.0 { Vec3::new(p.x / r, p.y / r, 0.0) } else { Vec3::zeros() };
    out * radial - down * Vec3::z()
}

/// Presses a target on what of the top lies within `reach_mm` of the axis; far away the body moves as
/// under `force` (mN).
fn indent(mesh: &TetMesh, target: Arc<dyn Target>, reach_mm: f64, force: f64) -> Solution {
    let mut model = Model::new(mesh);
    let law = Law::neo_hookean_coupled(YOUNG_KPA, POISSON).unwrap();
    model.add(Bulk::new("block", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    let faces: Vec<[u32; 3]> = mesh.patch(Patch::ChestWall).to_vec();
    let beyond = |n: u32| mesh.points[n as usize].xy().norm() > reach_mm * (1.0 + 1e-9);
    let indenter = Sliding::new("indenter", &mesh.points, &faces, target);
    model.add(indenter.opening(Opening::Free).without(beyond)).unwrap();
    for (n, p) in mesh.points.iter().enumerate() {
        for axis in 0..2 {
            if p[axis].abs() < 1e-9 {
                model.fix(n as u32, axis);
            }
        }
        if p.norm() > OUTER_MM - 1e-6 {
            model.hold(n as u32, p + under_a_point(force, p));
        }
    }
    let options = Options { contact_mm: 1e-7, ..Options::default() };
    let clock = std::time::Instant::now();
    let found = solve(&model, &mesh.points, &options, &Silent).unwrap();
    println!("{} tetrahedra, {:?}, {:?}", mesh.tets.len(), clock.elapsed(), found.checks);
    found
}

/// Errors of the force on elements of 1/4 and 1/8 mm around the contact, and the finer solution.
fn errors(press: impl Fn(&TetMesh) -> Solution, want: f64) -> ([f64; 2], TetMesh, Solution) {
    let (coarse, fine) = (eighth(6), eighth(12));
    let found = [press(&coarse), press(&fine)];
    let errors = [0, 1].map(|n| -4.0 * found[n].forces["indenter"].z / want - 1.0);
    println!("{errors:.4?}");
    let [_, found] = found;
    (errors, fine, found)
}

/// Verifies: flat punch on a half-space | Johnson 1985, § 3.4 | 8 %, first order
#[test]
fn a_flat_punch_meets_boussinesq() {
    let (depth, radius) = (1e-3, 1.0);
    // The body is below the plane, which faces down.
    let punch = Plane { point: -depth * Vec3::z(), normal: -Vec3::z() };
    let want = 2.0 * plane_strain_kpa() * radius * depth;
    let press = |mesh: &TetMesh| indent(mesh, Arc::new(punch), radius, want);
    let ([coarse, fine], ..) = errors(press, want);
    // Of first order: the punch reaches part of an element beyond its edge.
    assert!(fine.abs() < 0.08 && fine.abs() < 0.5 * coarse.abs());
}

/// Verifies: rigid sphere: force | Hertz (Johnson 1985, § 4.2) | 4 %, extrapolated 1.5 %
/// Verifies: rigid sphere: surface beside the contact | Hertz (Johnson 1985, § 4.2) | 5 %
#[test]
fn a_sphere_meets_hertz() {
    let (radius, contact): (f64, f64) = (100.0, 0.9);
    let depth = contact * contact / radius;
    let sphere = Sphere { center: (radius - depth) * Vec3::z(), radius_mm: radius };
    let want = 4.0 / 3.0 * plane_strain_kpa() * radius.sqrt() * depth.powf(1.5);
    let press = |mesh: &TetMesh| indent(mesh, Arc::new(sphere), 2.0 * contact, want);
    let ([coarse, fine], mesh, found) = errors(press, want);
    // Of second order.
    let limit = (4.0 * fine - coarse) / 3.0;
    assert!(fine.abs() < 0.04 && limit.abs() < 0.015);
    // Beyond the contact the surface is where Hertz has it.
    for r in [1.125, 1.5] {
        let near = |n: &u32| (mesh.points[*n as usize] - Vec3::new(r, 0.0, 0.0)).norm() < 1e-9;
        let n = *mesh.patch_nodes(Patch::ChestWall).iter().find(|n| near(n)).unwrap();
        let got = -found.points[n as usize].z;
        let part: f64 = contact / r;
        let sunk = (2.0 - 1.0 / (part * part)) * part.asin() + (1.0 - part * part).sqrt() / part;
        let want = depth / PI * sunk;
        println!("sunk {got:.6} mm for {want:.6}");
        assert!((got / want - 1.0).abs() < 0.05, "{got} for {want}");
    }
}
