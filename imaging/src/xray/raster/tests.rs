//! Path lengths against closed forms, and no cracks.

use super::*;
use crate::xray::{
    calcification::{irregular, sphere},
    shapes::{cuboid, half_cylinder, half_cylinder_path, prism},
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const HEIGHT: f64 = 660.0;

fn window(low: [f64; 2], pitch_mm: f64, columns: usize, rows: usize) -> Window {
    Window { left_mm: low[0], first_row_mm: low[1], pitch_mm, columns, rows }
}

/// (x, y, path) of every sample.
fn samples(window: &Window, paths: &[f32]) -> Vec<([f64; 2], f64)> {
    let place = |n: usize| {
        [
            window.left_mm + (n % window.columns) as f64 * window.pitch_mm,
            window.first_row_mm + (n / window.columns) as f64 * window.pitch_mm,
        ]
    };
    paths.iter().enumerate().map(|(n, &path)| (place(n), f64::from(path))).collect()
}

fn ray([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y + HEIGHT * HEIGHT).sqrt()
}

#[test]
fn a_slab_is_its_thickness_along_the_slanted_ray() {
    let slab = cuboid([-300.0, -300.0, 5.0], [300.0, 300.0, 51.0]);
    let w = window([-142.3, 0.05], 1.37, 200, 170);
    for (at, path) in samples(&w, &path_lengths(&slab, HEIGHT, &w).unwrap()) {
        let exact = 46.0 * ray(at) / HEIGHT;
        assert!((path / exact - 1.0).abs() < 1e-6, "{at:?}: {path} {exact}");
    }
}

#[test]
fn a_tilted_slab_is_cut_where_the_ray_meets_its_planes() {
    let (slope, low, high) = ([0.05, -0.12], 20.0, 61.0);
    let outline = [[-400.0, -400.0], [400.0, -400.0], [400.0, 400.0], [-400.0, 400.0]];
    let tilt = |p: [f64; 2]| slope[0] * p[0] + slope[1] * p[1];
    // Stays above the detector over the field of view alone: keep the field small.
    let slab = prism(&outline, |p| low + tilt(p), |p| high + tilt(p));
    let w = window([-60.0, 0.0], 0.83, 140, 130);
    for (at, path) in samples(&w, &path_lengths(&slab, HEIGHT, &w).unwrap()) {
        // height (1 - s) = z + s (slope · at)
        let s = |z: f64| (HEIGHT - z) / (HEIGHT + slope[0] * at[0] + slope[1] * at[1]);
        let exact = (s(low) - s(high)) * ray(at);
        assert!((path / exact - 1.0).abs() < 1e-6, "{at:?}: {path} {exact}");
    }
}

/// The paths lie between those of the exact cylinders inside and around the facets.
#[test]
fn a_half_cylinder_agrees_with_the_closed_form() {
    let (radius, bottom, top, facets) = (100.0, 20.0, 66.0, 2000);
    let w = window([-142.45, 0.05], 0.7, 408, 342);
    let surface = half_cylinder(radius, bottom, top, facets);
    let inner = radius * (0.5 * std::f64::consts::PI / facets as f64).cos();
    // Half a 1/4096 pixel, as seen along the steepest ray at the side wall.
    let rounding = 0.7 / 4096.0 * HEIGHT / radius;
    for (at, path) in samples(&w, &path_lengths(&surface, HEIGHT, &w).unwrap()) {
        let [low, high] = [inner, radius].map(|r| half_cylinder_path(r, bottom, top, HEIGHT, at));
        assert!(low - rounding < path && path < high + rounding, "{at:?}: {low} {path} {high}");
    }
}

/// The paths lie between the chords of the spheres inside and around the facets.
#[test]
fn a_sphere_agrees_with_its_chords() {
    let (center, radius) = (Vec3::new(12.0, 40.0, 31.0), 18.0);
    let ball = sphere(6);
    let flat = |t: usize| ball.area_vector(t).normalize().dot(&ball.corners(t)[0]);
    let inner = (0..ball.triangles.len()).map(flat).fold(1.0, f64::min);
    let points = ball.points.iter().map(|p| center + radius * p).collect();
    let ball = TriMesh { points, triangles: ball.triangles };
    let w = window([-20.0, 5.0], 0.31, 230, 240);
    for (at, path) in samples(&w, &path_lengths(&ball, HEIGHT, &w).unwrap()) {
        let source = Vec3::new(0.0, 0.0, HEIGHT);
        let along = (Vec3::new(at[0], at[1], 0.0) - source) / ray(at);
        let to = center - source;
        let beside2 = to.norm_squared() - to.dot(&along).powi(2);
        let chord2 = |r: f64| 4.0 * (r * r - beside2).max(0.0);
        // On the screen vertices move by 0.04 µm at most: 8 r of that in the square.
        let [low, high] = [chord2(inner * radius) - 0.01, chord2(radius) + 0.01];
        assert!((low..high).contains(&path.powi(2)), "{at:?}: {low} {} {high}", path.powi(2));
    }
}

/// Edges that pass exactly through sample points, and vertices on them.
#[test]
fn samples_on_edges_belong_to_one_triangle() {
    // A grid of height-field cells whose corners project exactly onto samples: source far above.
    let n = 24u32;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let place = |k: u32| [f64::from(k % (n + 1)), f64::from(k / (n + 1))];
    let count = (n + 1) * (n + 1);
    let height = 1e9;
    let mut points: Vec<Vec3> = Vec::new();
    for z in [1.0, 9.0] {
        for k in 0..count {
            points.push(Vec3::new(place(k)[0], place(k)[1], z));
        }
    }
    let mut triangles = Vec::new();
    for k in (0..count).filter(|k| k % (n + 1) < n && k / (n + 1) < n) {
        let [a, b, c, d] = [k, k + 1, k + n + 2, k + n + 1];
        for lift in [0, count] {
            let split =
                if random.random() { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            for t in split {
                let [a, b, c] = t.map(|k| k + lift);
                triangles.push(if lift == 0 { [a, c, b] } else { [a, b, c] });
            }
        }
    }
    let rim: Vec<u32> = (0..n)
        .chain((0..n).map(|r| r * (n + 1) + n))
        .chain((1..=n).rev().map(|c| n * (n + 1) + c))
        .chain((1..=n).rev().map(|r| r * (n + 1)))
        .collect();
    for (k, &a) in rim.iter().enumerate() {
        let b = rim[(k + 1) % rim.len()];
        triangles.push([a, b, b + count]);
        triangles.push([a, b + count, a + count]);
    }
    let surface = TriMesh { points, triangles };
    let w = window([-3.0, -3.0], 0.5, 61, 61);
    let paths = path_lengths(&surface, height, &w).unwrap();
    let mut on_rim = 0;
    for ([x, y], path) in samples(&w, &paths) {
        let [out_x, out_y] = [x, y].map(|a| (a - 12.0).abs() - 12.0);
        let out = f64::max(out_x, out_y);
        if out == 0.0 {
            on_rim += 1;
            assert!(path.abs() < 1e-5 || (path - 8.0).abs() < 1e-5, "{x} {y}: {path}");
        } else {
            let exact = if out < 0.0 { 8.0 } else { 0.0 };
            assert!((path - exact).abs() < 1e-5, "{x} {y}: {path}");
        }
    }
    assert_eq!(on_rim, 4 * 48);
}

/// A million rays through a rough closed surface of 82 k triangles, some 0.2 pixel small. A crack
/// would leave an entry without exit: several hundred mm instead of a few.
#[test]
fn no_ray_is_lost_in_a_rough_surface() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut surface = sphere(6);
    for point in &mut surface.points {
        let rough = 1.0 + 0.02 * random.random::<f64>();
        *point = Vec3::new(5.0, 60.0, 40.0) + 25.0 * rough * *point;
    }
    let w = window([-25.0, 30.0], 0.06, 1000, 1050);
    let paths = path_lengths(&surface, HEIGHT, &w).unwrap();
    let (mut inside, mut low, mut high) = (0, 0f32, 0f32);
    for path in paths {
        inside += usize::from(path > 0.0);
        low = low.min(path);
        high = high.max(path);
    }
    assert!(inside > 500_000, "{inside}");
    assert!(low >= -1e-9 && high < 52.0, "{low} {high}");
}

#[test]
fn an_edge_falls_where_it_is_within_a_hundredth_of_a_pixel() {
    let w = window([0.0, 0.0], 1.0, 100, 40);
    let area = |x: f64| {
        // A slanted edge: the number of covered samples measures its place.
        let outline = [[x, -1.0], [x + 4.0, 41.0], [-10.0, 41.0], [-10.0, -1.0]];
        let blade = prism(&outline, |_| 0.0, |_| 1e-6);
        path_lengths(&blade, HEIGHT, &w).unwrap().iter().filter(|&&p| p > 0.0).count() as f64
    };
    let shift = (area(50.5) - area(40.0)) / 40.0;
    assert!((shift - 10.5).abs() < 0.03, "{shift}");
}

#[test]
fn the_volume_of_a_calcification_is_found_again() {
    let grain = irregular(&Vec3::new(20.0, 50.0, 23.0), 0.3, 3);
    let magnification = HEIGHT / (HEIGHT - 23.0);
    let middle = [20.0 * magnification, 50.0 * magnification];
    let w = window([middle[0] - 0.4, middle[1] - 0.4], 0.0125, 64, 64);
    let paths = path_lengths(&grain, HEIGHT, &w).unwrap();
    let shadow: f64 = paths.iter().map(|&p| f64::from(p) * 0.0125 * 0.0125).sum();
    // An area on the detector is wider than in the grain, and seen at a slant.
    let slant = HEIGHT / ray(middle);
    let volume = shadow * slant / magnification.powi(2);
    let exact = std::f64::consts::PI / 6.0 * 0.027;
    assert!((volume / exact - 1.0).abs() < 2e-3, "{volume} {exact}");
}

#[test]
fn what_lies_below_the_detector_does_not_count() {
    let slab = cuboid([-50.0, -50.0, -30.0], [50.0, 50.0, 10.0]);
    let w = window([0.0, 0.0], 1.0, 3, 3);
    let paths = path_lengths(&slab, HEIGHT, &w).unwrap();
    assert!((paths[0] - 10.0).abs() < 1e-5, "{}", paths[0]);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let surface = half_cylinder(90.0, 0.0, 46.0, 300);
    let w = window([-100.0, 0.05], 0.4, 500, 300);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| path_lengths(&surface, HEIGHT, &w).unwrap())
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn a_window_without_samples_has_no_paths() {
    let slab = cuboid([-5.0, -5.0, 0.0], [5.0, 5.0, 7.0]);
    for [columns, rows] in [[0, 4], [4, 0]] {
        let w = window([0.0, 0.0], 1.0, columns, rows);
        assert!(path_lengths(&slab, HEIGHT, &w).unwrap().is_empty());
    }
}

#[test]
fn open_surfaces_and_points_above_the_source_are_refused() {
    let mut slab = cuboid([-5.0, -5.0, 0.0], [5.0, 5.0, 700.0]);
    let w = window([0.0, 0.0], 1.0, 4, 4);
    let above = path_lengths(&slab, HEIGHT, &w).unwrap_err();
    assert!(matches!(above, RasterError::OutOfView { .. }));
    slab.triangles.pop();
    assert_eq!(path_lengths(&slab, HEIGHT, &w).unwrap_err(), RasterError::Open { edges: 3 });
}
