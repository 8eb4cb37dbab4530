//! Tetrahedra of digital volunteers: shape of the elements, distance of their faces from the surface.

use crate::common;

use common::{faces_off, field_of_view, labels, p95_and_max, torso};
use mammotwin_data::{
    Failure, Vec3,
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
        quality::Summary,
        tetrahedralize::{Meshing, tetrahedralize},
    },
};
use mammotwin_stages::{
    mesh::Mesh,
    volunteer::{Preset, Torso},
};
use rayon::prelude::*;

/// A random person, meshed from the labels of her voxels: preset, size of elements (5 to 15 mm) and of
/// voxels (1.5 to 3 mm) in turn. Her numbers vary by a quarter, not by the tenth that presets have.
fn random_mesh(n: u64) -> (String, Result<Summary, Failure>) {
    let mut preset = Preset::named(["tiny", "small", "large"][n as usize % 3]).unwrap();
    preset.variation = 0.25;
    // Parts of irrational numbers fill the unit square evenly.
    let part = |step: f64| (n as f64 * step).fract();
    let size_mm = 5.0 + 10.0 * part(0.618_034);
    let voxel_mm = 1.5 + 1.5 * part(0.754_878);
    let torso = Torso::new(preset.person(n), n);
    let labels = labels(&torso, &field_of_view(&torso, [voxel_mm; 3]));
    let plan = MeshPlan { size_mm, ..MeshPlan::default() };
    let name = format!("{n} {}, {size_mm:.1} mm on voxels of {voxel_mm:.1} mm", preset.name);
    (name, Mesh(plan).run(&labels, &Silent).map(|mesh| mesh.quality.summary))
}

/// All of them mesh, and every element is good.
fn check_random(numbers: impl Iterator<Item = u64>) {
    let mut failed = Vec::new();
    let (mut worst, mut share) = (Summary::default(), 0.0f64);
    worst.min_scaled_jacobian = f64::MAX;
    for n in numbers {
        let (name, mesh) = random_mesh(n);
        match mesh {
            Ok(s) => {
                println!(
                    "{name}: {} tetrahedra, skewness {:.3}, {} over 0.75, aspect ratio {:.2}, {:.1} degrees, \
                     scaled Jacobian {:.2}",
                    s.tets,
                    s.max_skewness,
                    s.over_075,
                    s.max_aspect_ratio,
                    s.max_angle_deg,
                    s.min_scaled_jacobian
                );
                worst.over_095 += s.over_095;
                worst.tets += s.tets;
                worst.max_skewness = worst.max_skewness.max(s.max_skewness);
                worst.max_aspect_ratio = worst.max_aspect_ratio.max(s.max_aspect_ratio);
                worst.max_angle_deg = worst.max_angle_deg.max(s.max_angle_deg);
                worst.min_scaled_jacobian = worst.min_scaled_jacobian.min(s.min_scaled_jacobian);
                share = share.max(s.over_075 as f64 / s.tets as f64);
            }
            Err(cause) => failed.push(format!("{name}: {cause}")),
        }
    }
    println!("largest share over 0.75: {share:.1e}; {worst:?}");
    assert!(failed.is_empty(), "{failed:#?}");
    assert!(worst.tets > 0 && worst.over_095 == 0 && share < 1e-3);
    assert!(worst.max_aspect_ratio < 20.0 && worst.max_angle_deg < 165.0);
    // No corner is nearly flat.
    assert!(worst.min_scaled_jacobian > 0.2, "{}", worst.min_scaled_jacobian);
}

#[test]
fn random_anatomies_mesh_with_good_elements() {
    check_random([1, 3, 6, 8, 19].into_iter());
}

#[test]
#[ignore = "minutes: 50 meshes"]
fn fifty_random_anatomies_mesh_with_good_elements() {
    check_random(0..50);
}

/// The zero level of a function as a fine surface, around the breasts.
fn fine(torso: &Torso, level: &(impl Fn(&Vec3) -> f64 + Sync)) -> TriMesh {
    const SPACING_MM: f64 = 2.0;
    let (low, high) = torso.bounds();
    let count = |axis: usize| ((high[axis] - low[axis]) / SPACING_MM) as usize + 8;
    let low = low.add_scalar(-3.0 * SPACING_MM);
    let grid = Grid::aligned([count(0), count(1), count(2)], [SPACING_MM; 3], low);
    let value = |n: usize| level(&grid.center(grid.voxel(n))) as f32;
    let values = (0..grid.len()).into_par_iter().map(value).collect();
    surface(&Volume { grid, values })
}

/// Elements of 3, 8 and 15 mm: as many as tetrahedra of the lattice fill the body, and all good. A mesh has one
/// size everywhere; grading it is not offered.
#[test]
fn meshes_of_3_to_15_mm_have_the_elements_of_their_size() {
    let torso = torso("tiny", 3);
    let labels = labels(&torso, &field_of_view(&torso, [2.0; 3]));
    for size_mm in [15.0, 8.0, 3.0] {
        let found =
            Mesh(MeshPlan { size_mm, ..MeshPlan::default() }).run(&labels, &Silent).unwrap();
        let s = found.quality.summary;
        let mesh = &found.mesh;
        let volume: f64 = mesh.tets.iter().map(|tet| TetMesh::tet_volume(&mesh.points, tet)).sum();
        // Twelve tetrahedra fill a cell, whose edge is 1.098 of their mean edge.
        let wanted = 12.0 * volume / (1.098 * size_mm).powi(3);
        let edges: Vec<f64> = mesh
            .tets
            .iter()
            .flat_map(|t| [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]].map(|e| e.map(|n| t[n])))
            .map(|[a, b]| (mesh.points[a as usize] - mesh.points[b as usize]).norm())
            .collect();
        let mean = edges.iter().sum::<f64>() / edges.len() as f64;
        println!(
            "{size_mm} mm: {} tetrahedra ({:.2} of the lattice's), mean edge {mean:.2} mm, skewness {:.3}, \
             {} over 0.75, aspect ratio {:.2}, {:.1} degrees, scaled Jacobian {:.2}",
            s.tets,
            s.tets as f64 / wanted,
            s.max_skewness,
            s.over_075,
            s.max_aspect_ratio,
            s.max_angle_deg,
            s.min_scaled_jacobian
        );
        // Cut elements at the surface are smaller: the more, the thinner the body for its elements.
        assert!((0.8..2.5).contains(&(s.tets as f64 / wanted)), "{} for {wanted}", s.tets);
        assert!((mean / size_mm - 1.0).abs() < 0.25, "{mean}");
        assert!(s.over_095 == 0 && (s.over_075 as f64) < 1e-3 * s.tets as f64);
        assert!(
            s.max_aspect_ratio < 20.0 && s.max_angle_deg < 165.0 && s.min_scaled_jacobian > 0.2
        );
    }
}

/// Distances (mm) between a patch and the surface that it was made of: of its faces from the surface, then
/// of the surface from its faces; 95 % and all of them.
fn between(
    mesh: &TetMesh,
    torso: &Torso,
    patch: Patch,
    level: &(impl Fn(&Vec3) -> f64 + Sync),
) -> [[f64; 2]; 2] {
    let off = faces_off(mesh, patch, level);
    let index = SurfaceIndex::new(&mesh.patch_surface(patch)).unwrap();
    let bounding = |p: &&Vec3| torso.distances(p).max() < 0.05;
    let points: Vec<Vec3> = fine(torso, level).points.iter().filter(bounding).copied().collect();
    assert!(points.len() > 10_000);
    let back = index.closest_of(&points).unwrap();
    [p95_and_max(off), p95_and_max(back.iter().map(|closest| closest.distance_mm))]
}

/// A chord of a curve of radius R is h²/8R from it: that is what faces are off their surface.
fn check_faces(preset: &str, sizes_mm: &[f64]) {
    let torso = torso(preset, 3);
    for &size_mm in sizes_mm {
        let meshing = Meshing::of_size(size_mm);
        let mesh = tetrahedralize(&torso, &meshing, |_| Tissue::AdiposeRight).unwrap();
        let [skin, wall] = [
            between(&mesh, &torso, Patch::Skin, &|p| torso.smooth_skin(p)),
            between(&mesh, &torso, Patch::ChestWall, &|p| torso.chest_wall(p)),
        ];
        println!("{preset}, {size_mm} mm: skin {skin:.3?}, chest wall {wall:.3?} mm");
        for [p95, max] in skin.into_iter().chain(wall) {
            // Edges of 8 mm and less; 11 mm have 0.3 mm by the square of their lengths.
            let limit = 0.3 * (size_mm / 8.0).powi(2).max(1.0);
            assert!(p95 < limit && max < 0.25 * size_mm, "{p95} {max}");
        }
    }
}

#[test]
fn faces_of_8_mm_are_within_0_3_mm_of_their_surface() {
    check_faces("small", &[8.0]);
}

#[test]
#[ignore = "minutes: 4 meshes"]
fn faces_are_as_near_to_their_surface_as_their_size_lets_them() {
    check_faces("small", &[5.0, 11.0]);
    check_faces("large", &[8.0, 11.0]);
}
