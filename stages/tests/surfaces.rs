//! Surfaces of labels beside the shapes that the labels were taken from.

use crate::common;

use common::{around_right_breast, field_of_view, from_zero, labels, p95_and_max, torso};
use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Tissue},
    progress::Silent,
    store::Stage,
    surface::TriMesh,
    volume::Grid,
};
use mammotwin_imaging::mri::surface::{crossings::crossings, surface};
use mammotwin_stages::{surface::Surface, volunteer::Torso};
use rayon::prelude::*;

fn check_crossings(preset: &str, seed: u64, voxel_mm: [f64; 3]) {
    let torso = torso(preset, seed);
    let labels = labels(&torso, &field_of_view(&torso, voxel_mm));
    let found = Surface::default().run(&labels, &Silent).unwrap();
    for surface in [&found.skin, &found.chest_wall] {
        let pairs = crossings(surface);
        assert!(surface.triangles.len() > 100_000);
        assert!(pairs.is_empty(), "{preset} {seed} {voxel_mm:?}: {} pairs", pairs.len());
    }
}

#[test]
fn no_surface_passes_through_itself() {
    check_crossings("tiny", 0, [2.5; 3]);
    check_crossings("large", 0, [3.0; 3]);
}

#[test]
#[ignore = "a minute: 15 persons"]
fn no_surface_of_many_passes_through_itself() {
    for seed in 0..3 {
        check_crossings("tiny", seed, [2.5; 3]);
        check_crossings("tiny", seed, [1.6, 1.6, 3.3]);
        check_crossings("small", seed, [2.0; 3]);
        check_crossings("large", seed, [3.0; 3]);
        check_crossings("large", seed, [2.0, 2.0, 4.0]);
    }
}

/// One triangle of a surface: its middle (mm), its normal, its area (mm²), its distance (mm) from the shape,
/// and the shape's normal there.
struct Facet {
    middle: Vec3,
    normal: Vec3,
    area: f64,
    off: f64,
    true_normal: Vec3,
}

/// What of a surface lies `inside` and well inside of a grid: where the picture ends, it is cut.
fn facets(
    found: &TriMesh,
    grid: &Grid,
    level: impl Fn(&Vec3) -> f64 + Sync,
    inside: impl Fn(&Vec3) -> bool + Sync,
) -> Vec<Facet> {
    const RIM_MM: f64 = 12.0;
    let [low, high] = [grid.center([0; 3]), grid.center(grid.shape.map(|n| n - 1))];
    let inside = |p: &Vec3| {
        let within = |axis: usize| p[axis] > low[axis] + RIM_MM && p[axis] < high[axis] - RIM_MM;
        within(0) && within(2) && p.y > low.y + RIM_MM && inside(p)
    };
    let facet = |t: usize| {
        let middle = found.corners(t).iter().sum::<Vec3>() / 3.0;
        inside(&middle).then(|| {
            let (off, true_normal) = from_zero(&level, &middle);
            let area = found.area_vector(t);
            Facet { middle, normal: area.normalize(), area: area.norm(), off, true_normal }
        })
    };
    (0..found.triangles.len()).into_par_iter().filter_map(facet).collect()
}

/// The skin in front of the chest wall.
fn skin_facets(skin: &TriMesh, grid: &Grid, torso: &Torso) -> Vec<Facet> {
    facets(skin, grid, |p| torso.skin(p), |p| torso.chest_wall(p) > 0.0)
}

fn right_breast(preset: &str, seed: u64, voxel_mm: [f64; 3]) -> (Torso, LabelMap) {
    let torso = torso(preset, seed);
    let labels = labels(&torso, &around_right_breast(&torso, voxel_mm));
    (torso, labels)
}

/// The skin, nipple included, and the front of the muscle within `limits` (mm; 95 % and all of it), and the
/// volume of the skin within 0.5 % of that between it and the muscle.
fn check_surfaces(preset: &str, seed: u64, voxel_mm: f64, spacing_mm: f64, limits: [f64; 2]) {
    let (torso, labels) = right_breast(preset, seed, [voxel_mm; 3]);
    let found = Surface { spacing_mm }.run(&labels, &Silent).unwrap();
    let skin = skin_facets(&found.skin, &labels.grid, &torso);
    // Where it is the front of a muscle in a breast: what lies beside it is the side of the picture.
    let of_breast = |p: &Vec3| torso.skin(p) < -5.0;
    let wall = facets(&found.chest_wall, &labels.grid, |p| torso.chest_wall(p), of_breast);
    let voxels = labels.values.iter().filter(|tissue| tissue.is_soft()).count();
    let volume = voxels as f64 * labels.grid.voxel_mm3();
    let change = skin.iter().map(|facet| facet.off * facet.area).sum::<f64>() / volume;
    for (name, facets) in [("skin", &skin), ("muscle", &wall)] {
        let [p95, max] = p95_and_max(facets.iter().map(|facet| facet.off));
        println!(
            "{preset} {seed}, {voxel_mm} mm, spacing {spacing_mm} mm, {name}: 95 % within {p95:.3} mm, all \
             within {max:.3} mm of {} facets; volume {:.3} %",
            facets.len(),
            100.0 * change
        );
        assert!(facets.len() > 10_000 && p95 <= limits[0] && max <= limits[1], "{name}");
    }
    assert!(change.abs() < 5e-3);
}

#[test]
fn surfaces_are_within_half_a_voxel_of_the_shape() {
    check_surfaces("small", 3, 1.0, 1.5, [0.5, 1.5]);
}

#[test]
#[ignore = "minutes: tens of millions of voxels"]
fn surfaces_of_more_people_and_fine_voxels_are_within_half_of_one() {
    for (preset, seed) in [("large", 3), ("small", 11), ("large", 12)] {
        check_surfaces(preset, seed, 1.0, 1.5, [0.5, 1.5]);
    }
    for spacing_mm in [1.5, 0.9] {
        check_surfaces("small", 3, 0.6, spacing_mm, [0.3, 1.0]);
    }
}

/// Angles (deg) between the surface and the shape, but for 15 mm around the nipple, which is no larger
/// than a few voxels.
fn turned(facets: &[Facet], torso: &Torso) -> [f64; 2] {
    let far = facets.iter().filter(|f| (f.middle - torso.breasts[0].apex).norm() > 15.0);
    p95_and_max(far.map(|f| f.normal.angle(&f.true_normal).to_degrees()))
}

/// Slices of 3.3 mm, three voxels of the other edges.
#[test]
fn thick_slices_leave_no_stairs_on_a_breast() {
    for (preset, limits) in [("small", [8.0, 20.0]), ("large", [12.0, 35.0])] {
        let (torso, labels) = right_breast(preset, 3, [1.0, 1.0, 3.3]);
        let skin = Surface::default().run(&labels, &Silent).unwrap().skin;
        let all = skin_facets(&skin, &labels.grid, &torso);
        let [p95, max] = turned(&all, &torso);
        let [off, _] = p95_and_max(all.iter().map(|facet| facet.off));
        // The same labels without a blur are what stairs look like.
        let mask = labels.map(|t| if t == Tissue::Background { 0.5 } else { -0.5 });
        let stairs = skin_facets(&surface(&mask), &labels.grid, &torso);
        let [stair_p95, stair_max] = turned(&stairs, &torso);
        println!(
            "{preset}: 95 % within {off:.3} mm and {p95:.1} degrees, all within {max:.1}; without a \
             blur {stair_p95:.1}, {stair_max:.1}"
        );
        assert!(p95 < limits[0] && max < limits[1] && stair_p95 > 25.0);
        assert!(off < 0.5);
    }
}
