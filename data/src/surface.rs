//! Triangulated surfaces.

use crate::Vec3;

/// Triangles counter-clockwise seen from outside. Points in mm. May be open (a patch).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriMesh {
    /// Vertices (mm).
    pub points: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|n| self.points[n as usize])
    }

    /// Area vector of a triangle (mm²): outward, its norm is the area.
    pub fn area_vector(&self, triangle: usize) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        0.5 * (b - a).cross(&(c - a))
    }

    /// Area (mm²).
    pub fn area_mm2(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.area_vector(t).norm()).sum()
    }

    /// Enclosed volume (mm³), by the divergence theorem; positive when outward.
    pub fn volume_mm3(&self) -> f64 {
        let signed = |t: usize| {
            let [a, b, c] = self.corners(t);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..self.triangles.len()).map(signed).sum()
    }

    /// Area-weighted unit normals of the vertices; zero where no triangle is.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.points.len()];
        for t in 0..self.triangles.len() {
            let area = self.area_vector(t);
            for n in self.triangles[t] {
                normals[n as usize] += area;
            }
        }
        normals.iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect()
    }

    /// The same surface without vertices that no triangle uses, and for each kept vertex its
    /// former index.
    pub fn compacted(&self) -> (Self, Vec<u32>) {
        let mut new = vec![u32::MAX; self.points.len()];
        let mut old = Vec::new();
        let mut triangles = self.triangles.clone();
        for n in triangles.iter_mut().flatten() {
            if new[*n as usize] == u32::MAX {
                new[*n as usize] = old.len() as u32;
                old.push(*n);
            }
            *n = new[*n as usize];
        }
        let points = old.iter().map(|&n| self.points[n as usize]).collect();
        (Self { points, triangles }, old)
    }
}

/// Barycentric coordinates of a point of a triangle, of one beside it those of a point inside; thirds where the
/// triangle has no area.
pub fn barycentric([a, b, c]: [Vec3; 3], p: &Vec3) -> [f64; 3] {
    let normal = (b - a).cross(&(c - a));
    let part = |x: Vec3, y: Vec3| (x - p).cross(&(y - p)).dot(&normal);
    let parts = [part(b, c), part(c, a), part(a, b)].map(|part| part.max(0.0));
    let sum: f64 = parts.iter().sum();
    if sum > 0.0 { parts.map(|part| part / sum) } else { [1.0 / 3.0; 3] }
}
