//! Surfaces of fields with closed forms.

use super::{crossings::crossings, *};
use crate::mri::{
    blur::gaussian,
    distance_field::{FieldPlan, distance_field},
    smooth::project,
};
use mammotwin_data::{Mat3, volume::Grid};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::{collections::BTreeMap, f64::consts::PI};

/// Each edge is run once in each direction.
#[track_caller]
fn check_closed(surface: &TriMesh) {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for [a, b, c] in &surface.triangles {
        for edge in [[*a, *b], [*b, *c], [*c, *a]] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    for ([a, b], count) in &edges {
        assert_eq!((*count, edges.get(&[*b, *a])), (1, Some(&1)));
    }
}

fn euler(surface: &TriMesh) -> i64 {
    surface.points.len() as i64 - surface.triangles.len() as i64 / 2
}

fn ball_mask(radius: f64, axes: Mat3) -> Volume<bool> {
    let shape = [0, 1, 2].map(|axis| (2.0 * (radius + 6.0) / axes.column(axis).norm()) as usize);
    let origin = -axes * Vec3::from(shape.map(|n| 0.5 * n as f64));
    let grid = Grid { shape, axes, origin };
    let values = (0..grid.len()).map(|n| grid.center(grid.voxel(n)).norm() < radius).collect();
    Volume { grid, values }
}

#[test]
fn a_voxel_ball_becomes_a_smooth_ball() {
    let radius = 30.0;
    for axes in [Mat3::identity(), Mat3::from_diagonal(&Vec3::new(-1.289, 1.289, 3.3))] {
        let field = distance_field(&ball_mask(radius, axes), &FieldPlan::of_spacing(1.0)).unwrap();
        let surface = surface(&field);
        check_closed(&surface);
        assert_eq!(euler(&surface), 2);
        let volume = surface.volume_mm3() / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0;
        let mut off: Vec<f64> = surface.points.iter().map(|p| (p.norm() - radius).abs()).collect();
        off.sort_unstable_by(f64::total_cmp);
        let p95 = off[off.len() * 95 / 100];
        println!(
            "volume {:.2} %, 95 % within {p95:.3} mm, worst {:.3} mm",
            100.0 * volume,
            off[off.len() - 1]
        );
        assert!(volume.abs() < 5e-3 && p95 < 0.5);
    }
}

/// Noise, from voxel to voxel or over a few of them: as hard for a surface as can be.
fn noise(seed: u64, flip: f64, rough: bool) -> Volume<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let axes = Mat3::from_diagonal(&Vec3::new(flip, 1.0, 1.0));
    let grid = Grid { shape: [24, 25, 26], axes, origin: Vec3::zeros() };
    let values = (0..grid.len()).map(|_| rng.random::<f32>() - 0.5).collect();
    let noise = Volume { grid, values };
    if rough { noise } else { gaussian(noise, [0.8; 3]) }
}

#[test]
fn random_noise_is_closed_too() {
    for (flip, rough) in [(1.0, true), (-1.0, true), (1.0, false)] {
        let surface = surface(&noise(3, flip, rough));
        check_closed(&surface);
        assert!(surface.volume_mm3() > 0.0, "outward");
    }
}

#[test]
fn no_noise_makes_a_surface_pass_through_itself() {
    let mut before = 0;
    for (seed, rough) in (0..4).flat_map(|seed| [(seed, true), (seed, false)]) {
        let field = noise(seed, 1.0, rough);
        let surface = surface(&field);
        let unmended = crossings(&project(&surface, &field)).len();
        println!("{} triangles, {unmended} pairs unmended", surface.triangles.len());
        assert!(crossings(&surface).is_empty());
        check_closed(&surface);
        before += unmended;
    }
    assert!(before > 0, "nothing had to be mended");
}

#[test]
fn nothing_inside_is_an_empty_surface() {
    let grid = Grid::aligned([3, 3, 3], [1.0; 3], Vec3::zeros());
    assert_eq!(surface(&Volume::filled(grid, 1.0)), TriMesh::default());
}
