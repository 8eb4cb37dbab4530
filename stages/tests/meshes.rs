//! Tetrahedra of digital volunteers: shape of the elements, distance of their faces from the surface.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod common;

use common::{field_of_view, from_zero, labels, p95_and_max, sorted, torso};
use mammotwin_data::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    progress::Silent,
    store::Stage,
    study::MeshPlan,
    surface::TriMesh,
    volume::{Grid, Volume},
};
use mammotwin_imaging::mri::surface::surface;
use mammotwin_solver::{
    distance::SurfaceIndex,
    mesh::{
        domain::Domain,
        quality::{Summary, quality},
        tetrahedralize::{Meshing, tetrahedralize},
    },
};
use mammotwin_stages::{
    mesh::Mesh,
    volunteer::{Preset, Torso},
};
use rayon::prelude::*;

/// A random person, meshed from the labels of her voxels: preset, size of voxels and elements in turn.
/// Her numbers vary by a quarter, not by the tenth that the presets have.
fn random_mesh(n: u64) -> (String, Result<Summary, String>) {
    let mut preset = Preset::named(["tiny", "small", "large"][n as usize % 3]).unwrap();
    preset.variation = 0.25;
    let part = |step: f64| (n as f64 * step).fract();
    let size_mm = 5.0 + 10.0 * part(0.618_034);
    let voxel_mm = 1.5 + 1.5 * part(0.754_878);
    let torso = Torso::new(preset.person(n), n);
    let labels = labels(&torso, &field_of_view(&torso, [voxel_mm; 3]));
    let plan = MeshPlan { size_mm, ..MeshPlan::default() };
    let name = format!("{n} {}, {size_mm:.1} mm on voxels of {voxel_mm:.1} mm", preset.name);
    let mesh = Mesh(plan).run(&labels, &Silent);
    (name, mesh.map(|mesh| mesh.quality.summary).map_err(|cause| cause.to_string()))
}

#[test]
#[ignore = "minutes: 50 meshes"]
fn fifty_random_anatomies() {
    for n in 0..50 {
        let start = std::time::Instant::now();
        let (name, mesh) = random_mesh(n);
        match mesh {
            Ok(s) => println!(
                "{name}: {} tets, worst {:.3}, mean {:.3}, over 0.75 {}, aspect {:.2}, angle {:.1}, {:.1?}",
                s.tets,
                s.max_skewness,
                s.mean_skewness,
                s.over_075,
                s.max_aspect_ratio,
                s.max_angle_deg,
                start.elapsed()
            ),
            Err(cause) => println!("{name}: {cause}"),
        }
    }
}

/// Distances (mm) of a patch's faces from a zero level: at ten places of each face.
fn faces_off(mesh: &TetMesh, patch: Patch, level: &(impl Fn(&Vec3) -> f64 + Sync)) -> Vec<f64> {
    let faces = mesh.patch(patch);
    let place = |corners: [Vec3; 3], n: usize| {
        let (i, j) =
            [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0)][n];
        let [u, v] = [i as f64 / 3.0, j as f64 / 3.0];
        corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v
    };
    faces
        .par_iter()
        .flat_map_iter(|face| {
            let corners = face.map(|n| mesh.points[n as usize]);
            (0..10).map(move |n| from_zero(level, &place(corners, n)).0)
        })
        .collect()
}

/// The level as a fine surface.
fn fine(torso: &Torso, level: &(impl Fn(&Vec3) -> f64 + Sync)) -> TriMesh {
    let (low, high) = torso.bounds();
    let count = |axis: usize| ((high[axis] - low[axis]) / 2.0) as usize + 8;
    let grid = Grid::aligned([count(0), count(1), count(2)], [2.0; 3], low.add_scalar(-6.0));
    let values = (0..grid.len())
        .into_par_iter()
        .map(|n| level(&grid.center(grid.voxel(n))) as f32)
        .collect();
    surface(&Volume { grid, values })
}

#[test]
fn faces() {
    for preset in ["small", "large"] {
        let torso = torso(preset, 3);
        let skin = |p: &Vec3| torso.smooth_skin(p);
        let wall = |p: &Vec3| torso.chest_wall(p);
        for size_mm in [5.0, 8.0, 11.0] {
            let start = std::time::Instant::now();
            let mesh = tetrahedralize(&torso, &Meshing::of_size(size_mm), |_| Tissue::AdiposeRight)
                .unwrap();
            let t_mesh = start.elapsed();
            let report = |mesh: &TetMesh| {
                for (patch, off) in [
                    (Patch::Skin, faces_off(mesh, Patch::Skin, &skin)),
                    (Patch::ChestWall, faces_off(mesh, Patch::ChestWall, &wall)),
                ] {
                    let truth = if patch == Patch::Skin {
                        fine(&torso, &skin)
                    } else {
                        fine(&torso, &wall)
                    };
                    let index = SurfaceIndex::new(&mesh.patch_surface(patch)).unwrap();
                    let inside =
                        |p: &&Vec3| torso.limits.contain(p) && torso.distances(p).max() < 0.02;
                    let points: Vec<Vec3> = truth.points.iter().filter(inside).copied().collect();
                    let back: Vec<f64> =
                        index.closest_of(&points).unwrap().iter().map(|c| c.distance_mm).collect();
                    let mean = off.iter().sum::<f64>() / off.len() as f64;
                    println!(
                        "{preset} {size_mm} {patch:?}: faces {:.3?} mean {mean:.3}, back {:.3?} of {}",
                        p95_and_max(&sorted(off)),
                        p95_and_max(&sorted(back)),
                        points.len()
                    );
                }
                let s = quality(&mesh.points, &mesh.tets).summary;
                println!(
                    "  volume {:.3} ml, {} tets, worst {:.3}, over 0.75 {}, {t_mesh:?}",
                    mesh.volume_mm3() / 1e3,
                    s.tets,
                    s.max_skewness,
                    s.over_075
                );
            };
            report(&mesh);
            // Skin nodes out by what the faces around them lie in.
            let mut moved = mesh.clone();
            for _ in 0..2 {
                let mut sum = vec![(0.0, 0.0); mesh.points.len()];
                let surface = moved.patch_surface(Patch::Skin);
                let off = faces_off(&moved, Patch::Skin, &skin);
                for (t, face) in moved.patch(Patch::Skin).iter().enumerate() {
                    let area = surface.area_vector(t).norm();
                    let o = &off[10 * t..10 * t + 10];
                    // Corners weigh 1/30 each, the middle 9/20, the edges 3/40 ... of a cubic rule.
                    let corner = (o[0] + o[3] + o[9]) / 30.0;
                    let edges = (o[1] + o[2] + o[4] + o[6] + o[7] + o[8]) * 3.0 / 40.0;
                    let mean = corner + edges + 0.45 * o[5];
                    for n in face {
                        sum[*n as usize].0 += mean * area;
                        sum[*n as usize].1 += area;
                    }
                }
                for (n, (s, a)) in sum.iter().enumerate() {
                    if *a > 0.0 {
                        let p = &mut moved.points[n];
                        let normal = from_zero(skin, p).1;
                        *p -= normal * (s / a);
                    }
                }
            }
            print!("  moved: ");
            report(&moved);
        }
    }
}
