//! Microcalcifications: irregular, closed, volume as asked.

use mammotwin_data::{Vec3, surface::TriMesh};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::{collections::BTreeMap, f64::consts::TAU};

/// Times that each triangle of the icosahedron is split in four: 1280 triangles.
const SPLITS: usize = 3;
/// Root mean square of the radius about its mean, over the mean.
const ROUGHNESS: f64 = 0.15;
/// Waves that deform the sphere.
const WAVES: usize = 16;

/// A randomly deformed sphere with the volume of a sphere of this diameter (Mîra 2018, § 5.2.2:
/// "initially spherical objects were randomly deformed"; by how much is not said, 15 % rms of the
/// radius is ours). A seed gives the same shape at any diameter and place.
///
/// The radius is 1 + a Σ cos(k d·n + φ) in direction d, over random n, φ and wave numbers k of
/// 2 to 5: dents of a fifth to half of the diameter.
pub fn irregular(center: &Vec3, diameter_mm: f64, seed: u64) -> TriMesh {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let waves: Vec<(Vec3, f64)> = (0..WAVES)
        .map(|_| (direction(&mut random) * random.random_range(2.0..5.0), random.random::<f64>()))
        .collect();
    let amplitude = ROUGHNESS * (2.0 / WAVES as f64).sqrt();
    let mut surface = sphere(SPLITS);
    for point in &mut surface.points {
        let wave = |(wave, phase): &(Vec3, f64)| (point.dot(wave) + TAU * phase).cos();
        *point *= 1.0 + amplitude * waves.iter().map(wave).sum::<f64>();
    }
    let wanted = TAU / 12.0 * diameter_mm.powi(3);
    let scale = (wanted / surface.volume_mm3()).cbrt();
    for point in &mut surface.points {
        *point = center + scale * *point;
    }
    surface
}

/// Uniform on the unit sphere.
fn direction(random: &mut ChaCha8Rng) -> Vec3 {
    let z: f64 = random.random_range(-1.0..1.0);
    let angle = random.random_range(0.0..TAU);
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Unit sphere: an icosahedron whose triangles are split in four, again and again.
pub fn sphere(splits: usize) -> TriMesh {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<Vec3> = Vec::new();
    for [a, b] in [[-1.0, golden], [1.0, golden], [-1.0, -golden], [1.0, -golden]] {
        points.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)]);
    }
    for point in &mut points {
        point.normalize_mut();
    }
    let mut triangles = hull_of_icosahedron(&points);
    for _ in 0..splits {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    TriMesh { points, triangles }
}

/// Triples of mutual neighbours, counter-clockwise from outside.
fn hull_of_icosahedron(points: &[Vec3]) -> Vec<[u32; 3]> {
    let near = |a: usize, b: usize| (points[a] - points[b]).norm() < 1.1;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = points[a].dot(&points[b].cross(&points[c])) > 0.0;
                    let [b, c] = if outward { [b, c] } else { [c, b] };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_a_sphere() {
        let ball = sphere(4);
        assert_eq!(ball.triangles.len(), 20 * 256);
        assert!((ball.volume_mm3() / (TAU / 1.5) - 1.0).abs() < 3e-3);
        assert!((0..ball.triangles.len()).all(|t| {
            let [a, b, c] = ball.corners(t);
            ball.area_vector(t).dot(&(a + b + c)) > 0.0
        }));
    }

    #[test]
    fn a_calcification_is_irregular_and_has_its_volume() {
        let center = Vec3::new(10.0, 40.0, 23.0);
        let first = irregular(&center, 0.3, 7);
        let ball = TAU / 12.0 * 0.027;
        assert!((volume_about(&first, &center) / ball - 1.0).abs() < 1e-9);
        let radii: Vec<f64> = first.points.iter().map(|p| (p - center).norm()).collect();
        let mean = radii.iter().sum::<f64>() / radii.len() as f64;
        let variance = radii.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / radii.len() as f64;
        assert!((0.05..0.25).contains(&(variance.sqrt() / mean)), "{}", variance.sqrt() / mean);
        assert_eq!(first, irregular(&center, 0.3, 7));
        assert_ne!(first, irregular(&center, 0.3, 8));
    }

    fn volume_about(surface: &TriMesh, center: &Vec3) -> f64 {
        let points = surface.points.iter().map(|p| p - center).collect();
        TriMesh { points, triangles: surface.triangles.clone() }.volume_mm3()
    }
}
