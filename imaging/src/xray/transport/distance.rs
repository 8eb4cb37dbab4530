//! Signed distances from a closed surface on a grid.

use crate::xray::{
    raster::{RasterError, open_edges},
    transport::scene::Bounds,
};
use mammotwin_data::{Vec3, surface::TriMesh};
use parry3d_f64::{
    math::Vector,
    query::PointQuery,
    shape::{TriMesh as Shape, TriMeshFlags},
};
use rayon::prelude::*;

/// Depth (mm) below a closed surface at the nodes of a grid, linear between them.
#[derive(Debug, Clone)]
pub struct DistanceGrid {
    bounds: Bounds,
    /// Cells along x, y, z.
    cells: [usize; 3],
    /// Cells per mm, by axis.
    per_mm: Vec3,
    /// Length (mm) of the diagonal of a cell.
    diagonal: f64,
    /// Depth (mm) at the nodes, x fastest; negative outside.
    depth: Vec<f32>,
}

impl DistanceGrid {
    /// Distances on cells of at most this step (mm) in the box around the surface.
    ///
    /// Between the nodes the error is about step² / 8 over the radius of curvature; edges sharper
    /// than a cell are rounded.
    pub fn of(surface: &TriMesh, step_mm: f64) -> Result<Self, RasterError> {
        let edges = open_edges(surface);
        if edges > 0 || surface.triangles.is_empty() {
            return Err(RasterError::Open { edges });
        }
        let (surface, _) = surface.compacted();
        let first = surface.points[0];
        let low = surface.points.iter().fold(first, |low, p| low.inf(p));
        let high = surface.points.iter().fold(first, |high, p| high.sup(p));
        let bounds = Bounds { low, high };
        let cells = [0, 1, 2].map(|k| ((high[k] - low[k]) / step_mm).ceil().max(1.0) as usize);
        let size = Vec3::from_fn(|k, _| (high[k] - low[k]) / cells[k] as f64);
        let vertices = surface.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let shape = Shape::with_flags(vertices, surface.triangles.clone(), TriMeshFlags::ORIENTED)
            .map_err(|_| RasterError::Open { edges: 0 })?;
        let [nx, ny, nz] = cells.map(|n| n + 1);
        let depth = (0..nx * ny * nz)
            .into_par_iter()
            .map(|n| {
                let at = [n % nx, n / nx % ny, n / (nx * ny)];
                let p = Vec3::from_fn(|k, _| low[k] + at[k] as f64 * size[k]);
                let found = shape.project_local_point(Vector::new(p.x, p.y, p.z), false);
                let foot = Vec3::new(found.point.x, found.point.y, found.point.z);
                let distance = (p - foot).norm();
                (if found.is_inside { distance } else { -distance }) as f32
            })
            .collect();
        let per_mm = size.map(|size| 1.0 / size);
        Ok(Self { bounds, cells, per_mm, diagonal: size.norm(), depth })
    }

    /// The box around the surface.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Depth (mm) below the surface, negative outside. Deeper than `layer`, and outside, it is only
    /// sure to be that.
    pub fn depth(&self, point: &Vec3, layer: f64) -> f64 {
        let (mut at, mut part) = ([0; 3], [0.0; 3]);
        for k in 0..3 {
            let place = (point[k] - self.bounds.low[k]) * self.per_mm[k];
            at[k] = (place.max(0.0) as usize).min(self.cells[k] - 1);
            part[k] = place - at[k] as f64;
        }
        let (row, layer_of) = (self.cells[0] + 1, (self.cells[0] + 1) * (self.cells[1] + 1));
        let first = at[0] + at[1] * row + at[2] * layer_of;
        let node = f64::from(self.depth[first]);
        if node > layer + self.diagonal || node < -self.diagonal {
            return node;
        }
        let along = |n: usize| {
            let [a, b] = [self.depth[n], self.depth[n + 1]].map(f64::from);
            a + part[0] * (b - a)
        };
        let across = |n: usize| {
            let [a, b] = [along(n), along(n + row)];
            a + part[1] * (b - a)
        };
        let [a, b] = [across(first), across(first + layer_of)];
        a + part[2] * (b - a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xray::{calcification::sphere, shapes::cuboid};

    #[test]
    fn depth_in_a_ball_is_radius_less_distance() {
        let center = Vec3::new(10.0, 50.0, 30.0);
        let ball = sphere(5);
        let points = ball.points.iter().map(|p| center + 25.0 * p).collect();
        let grid = DistanceGrid::of(&TriMesh { points, ..ball }, 2.0).unwrap();
        for n in 0..2000 {
            let t = f64::from(n);
            let direction = Vec3::new(t.sin(), (1.7 * t).cos(), (0.3 * t).sin()).normalize();
            let r = 25.0 * (0.6 + 0.4 * (0.618 * t).fract());
            let error = grid.depth(&(center + r * direction), 2.0) - (25.0 - r);
            if r > 23.0 {
                assert!(error.abs() < 0.06, "{r}: {error}");
            } else {
                assert!(grid.depth(&(center + r * direction), 2.0) > 2.0);
            }
        }
    }

    #[test]
    fn flat_sides_are_exact_and_open_surfaces_refused() {
        let mut block = cuboid([-30.0, 0.0, 0.0], [30.0, 50.0, 46.0]);
        let grid = DistanceGrid::of(&block, 2.0).unwrap();
        for z in [0.0, 0.7, 1.9, 2.1, 44.3, 46.0] {
            let depth = grid.depth(&Vec3::new(3.3, 20.1, z), 2.0);
            assert!((depth - z.min(46.0 - z)).abs() < 1e-5, "{z}: {depth}");
        }
        block.triangles.pop();
        assert!(matches!(DistanceGrid::of(&block, 2.0), Err(RasterError::Open { .. })));
    }
}
