//! Simple closed shapes.

use mammotwin_data::{Vec3, surface::TriMesh};
use std::f64::consts::PI;

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
    let angle = |k: usize| PI * k as f64 / facets as f64;
    let outline: Vec<[f64; 2]> =
        (0..=facets).map(|k| [radius * angle(k).cos(), radius * angle(k).sin()]).collect();
    prism(&outline, |_| bottom, |_| top)
}

/// An ellipsoid along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Middle (mm).
    pub center: Vec3,
    /// Half axes (mm).
    pub radii: Vec3,
}

impl Ellipsoid {
    /// Whether a point (mm) lies in it.
    #[inline]
    pub fn contains(&self, point: &Vec3) -> bool {
        (point - self.center).component_div(&self.radii).norm_squared() <= 1.0
    }

    /// Where the way between two points (mm) enters and leaves, as shares of it; `None` when it
    /// misses.
    pub fn chord(&self, from: &Vec3, to: &Vec3) -> Option<[f64; 2]> {
        // A unit ball around the origin after scaling; |a + t d|² = 1.
        let a = (from - self.center).component_div(&self.radii);
        let d = (to - from).component_div(&self.radii);
        let (dd, ad) = (d.norm_squared(), a.dot(&d));
        // The part of a across d keeps the digits that |a|² - 1 would lose.
        let across = (a - d * (ad / dd)).norm_squared();
        let half = ((1.0 - across) / dd).sqrt();
        let middle = -ad / dd;
        (half > 0.0).then_some([middle - half, middle + half])
    }
}

/// A compressed breast: half an ellipse with round sides of half the thickness, under a paddle that may
/// be tilted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounded {
    /// Extent (mm), rim included: half its width, and away from the chest wall.
    pub extent_mm: [f64; 2],
    /// Nominal thickness (mm).
    pub thickness_mm: f64,
    /// Height (mm) of the upper side at the chest wall.
    pub top_mm: f64,
    /// How much the upper side sinks per mm away from the chest wall.
    pub slope: f64,
    /// How far (mm) it goes on behind the chest wall, so that a layer of skin lies there.
    pub behind_mm: f64,
}

impl Rounded {
    /// Its closed surface, of so many facets around and up.
    pub fn surface(&self, around: u32, up: u32) -> TriMesh {
        let half = 0.5 * self.thickness_mm;
        let [width, length] = self.extent_mm;
        let mut points = vec![];
        for k in 0..=up {
            let angle = PI * (f64::from(k) / f64::from(up) - 0.5);
            let (share, out) = (0.5 + 0.5 * angle.sin(), half * angle.cos() - half);
            for n in 0..=around {
                let turn = PI * f64::from(n) / f64::from(around);
                let (x, y) = ((width + out) * turn.cos(), (length + out) * turn.sin());
                let y = if n == 0 || n == around { -self.behind_mm } else { y };
                points.push(Vec3::new(x, y, share * (self.top_mm - self.slope * y.max(0.0))));
            }
        }
        let at = |k: u32, n: u32| k * (around + 1) + n;
        let mut triangles = vec![];
        for k in 0..up {
            for n in 0..around {
                triangles.push([at(k, n), at(k, n + 1), at(k + 1, n + 1)]);
                triangles.push([at(k, n), at(k + 1, n + 1), at(k + 1, n)]);
            }
            triangles.push([at(k, around), at(k, 0), at(k + 1, 0)]);
            triangles.push([at(k, around), at(k + 1, 0), at(k + 1, around)]);
        }
        for n in 1..around {
            triangles.push([at(0, 0), at(0, n + 1), at(0, n)]);
            triangles.push([at(up, 0), at(up, n), at(up, n + 1)]);
        }
        TriMesh { points, triangles }
    }
}

/// Path (mm) from (0, 0, height) to (x, y, 0) inside the exact half cylinder.
pub fn half_cylinder_path(radius: f64, bottom: f64, top: f64, height: f64, at: [f64; 2]) -> f64 {
    // Ray: (s x, s y, height (1 - s)); inside while s r <= radius and z within bottom..top.
    let r = at[0].hypot(at[1]);
    let enter = 1.0 - top / height;
    let leave = (1.0 - bottom / height).min(radius / r);
    (leave - enter).max(0.0) * (r * r + height * height).sqrt()
}
