//! Distances against closed forms and brute force.

use super::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Cube from -half to half, outward.
fn cube(half: f64) -> TriMesh {
    let sign = |n: u32, bit: u32| if n >> bit & 1 == 1 { half } else { -half };
    let points = (0..8).map(|n| Vec3::new(sign(n, 0), sign(n, 1), sign(n, 2))).collect();
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points, triangles }
}

fn random_point(rng: &mut ChaCha8Rng, scale: f64) -> Vec3 {
    Vec3::from_fn(|_, _| scale * (2.0 * rng.random::<f64>() - 1.0))
}

#[test]
fn signed_distance_to_a_cube_is_the_closed_form() {
    let half = 3.0;
    assert!((cube(half).volume_mm3() - 216.0).abs() < 1e-9);
    let index = SurfaceIndex::new(&cube(half)).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..2000 {
        let p = random_point(&mut rng, 6.0);
        let q = p.abs().add_scalar(-half);
        let outside = q.sup(&Vec3::zeros()).norm();
        let exact = if q.max() > 0.0 { outside } else { q.max() };
        let got = index.closest(&p).unwrap().signed_mm(&p);
        assert!((got - exact).abs() < 1e-12, "{p:?}: {got} for {exact}");
    }
}

/// Nearest point by dense search over a triangle: slow, plain and independent.
fn brute_force(surface: &TriMesh, p: &Vec3) -> f64 {
    let segment = |a: &Vec3, b: &Vec3| {
        let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
        (p - (a + t * (b - a))).norm()
    };
    let triangle = |t: usize| {
        let [a, b, c] = surface.corners(t);
        let normal = (b - a).cross(&(c - a)).normalize();
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(u, v)| normal.dot(&(v - u).cross(&(p - u))) >= 0.0);
        if inside {
            (p - a).dot(&normal).abs()
        } else {
            segment(&a, &b).min(segment(&b, &c)).min(segment(&c, &a))
        }
    };
    (0..surface.triangles.len()).map(triangle).fold(f64::INFINITY, f64::min)
}

#[test]
fn distances_of_a_random_soup_agree_with_brute_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let points: Vec<Vec3> = (0..60).map(|_| random_point(&mut rng, 10.0)).collect();
    let corner = |rng: &mut ChaCha8Rng| rng.random_range(0..60u32);
    let mut triangles = Vec::new();
    while triangles.len() < 80 {
        let t = [corner(&mut rng), corner(&mut rng), corner(&mut rng)];
        if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
            triangles.push(t);
        }
    }
    let soup = TriMesh { points, triangles };
    let index = SurfaceIndex::new(&soup).unwrap();
    for _ in 0..500 {
        let p = random_point(&mut rng, 15.0);
        let got = index.closest(&p).unwrap().distance_mm;
        assert!((got - brute_force(&soup, &p)).abs() < 1e-9);
    }
}

#[test]
fn a_shifted_copy_has_the_distances_of_the_closed_form() {
    // Cube corners pushed outwards by a factor: all corners are one distance away.
    let (inner, outer) = (cube(3.0), cube(4.0));
    let all: Vec<u32> = (0..8).collect();
    let d =
        compare(Active { surface: &outer, nodes: &all }, Active { surface: &inner, nodes: &all })
            .unwrap();
    let corner = 3f64.sqrt();
    for (got, exact) in [
        (d.min, corner),
        (d.max, corner),
        (d.mean, corner),
        (d.p95, corner),
        (d.hausdorff, corner),
        (d.modified_hausdorff, corner),
    ] {
        assert!((got - exact).abs() < 1e-12);
    }
    // Seen from inside, each corner is 1 mm from the nearest face.
    let back = compare(
        Active { surface: &inner, nodes: &all },
        Active { surface: &outer, nodes: &all[..3] },
    )
    .unwrap();
    assert!((back.mean - 1.0).abs() < 1e-12 && (back.modified_hausdorff - corner).abs() < 1e-12);
}

#[test]
fn bad_input_is_refused_with_its_reason() {
    let mut surface = cube(1.0);
    let nodes = [0, 99];
    let active = Active { surface: &surface, nodes: &nodes };
    assert_eq!(
        node_distances(active, &surface),
        Err(DistanceError::NoSuchNode { node: 99, points: 8 })
    );
    let none = Active { surface: &surface, nodes: &[] };
    assert_eq!(node_distances(none, &surface), Err(DistanceError::NoNode));
    assert!(SurfaceIndex::new(&surface).unwrap().closest(&Vec3::repeat(f64::NAN)).is_none());
    surface.triangles[3][1] = 8;
    let error = SurfaceIndex::new(&surface).err().unwrap();
    assert_eq!(error, DistanceError::NoSuchVertex { triangle: 3, vertex: 8, points: 8 });
    surface = cube(1.0);
    surface.points[5].y = f64::INFINITY;
    assert_eq!(SurfaceIndex::new(&surface).err(), Some(DistanceError::NotFinite(5)));
    surface.triangles.clear();
    assert_eq!(SurfaceIndex::new(&surface).err(), Some(DistanceError::NoTriangle));
}
