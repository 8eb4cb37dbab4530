//! Closed shapes with known path lengths, for tests.

use mammotwin_data::{Vec3, surface::TriMesh};

/// A prism over a convex outline, counter-clockwise in (x, y), between two heights that may depend
/// on the place.
pub fn prism(
    outline: &[[f64; 2]],
    bottom: impl Fn([f64; 2]) -> f64,
    top: impl Fn([f64; 2]) -> f64,
) -> TriMesh {
    let n = outline.len() as u32;
    let lift = |height: &dyn Fn([f64; 2]) -> f64| -> Vec<Vec3> {
        outline.iter().map(|&p| Vec3::new(p[0], p[1], height(p))).collect()
    };
    let mut points = lift(&bottom);
    points.extend(lift(&top));
    let mut triangles = Vec::new();
    for k in 1..n - 1 {
        triangles.push([0, k + 1, k]);
        triangles.push([n, n + k, n + k + 1]);
    }
    for k in 0..n {
        let next = (k + 1) % n;
        triangles.push([k, next, n + next]);
        triangles.push([k, n + next, n + k]);
    }
    TriMesh { points, triangles }
}

/// A box between two corners.
pub fn cuboid(low: [f64; 3], high: [f64; 3]) -> TriMesh {
    let outline = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
    prism(&outline, |_| low[2], |_| high[2])
}

/// A half cylinder with upright axis on the detector's edge: a breast between plates.
pub fn half_cylinder(radius: f64, bottom: f64, top: f64, facets: usize) -> TriMesh {
    let angle = |k: usize| std::f64::consts::PI * k as f64 / facets as f64;
    let outline: Vec<[f64; 2]> =
        (0..=facets).map(|k| [radius * angle(k).cos(), radius * angle(k).sin()]).collect();
    prism(&outline, |_| bottom, |_| top)
}

/// Path (mm) from (0, 0, height) to (x, y, 0) inside the exact half cylinder.
pub fn half_cylinder_path(radius: f64, bottom: f64, top: f64, height: f64, at: [f64; 2]) -> f64 {
    // Ray: (s x, s y, height (1 - s)); inside while s r <= radius and z within bottom..top.
    let r = at[0].hypot(at[1]);
    let enter = 1.0 - top / height;
    let leave = (1.0 - bottom / height).min(radius / r);
    (leave - enter).max(0.0) * (r * r + height * height).sqrt()
}
