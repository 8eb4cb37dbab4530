//! Signed distances from a closed surface on a grid.

use crate::xray::{inside::Inside, raster::RasterError, transport::scene::Bounds};
use mammotwin_data::{Vec3, surface::TriMesh};
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
    /// Thickness (mm) of the layer.
    layer: f64,
    /// What is in each cell, x fastest: small, so that it stays in the cache.
    kinds: Vec<Kind>,
}

/// Where a point is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zone {
    /// Not in the body.
    Outside,
    /// In the layer below its surface.
    Layer,
    /// Deeper.
    Deep,
}

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Outside,
    Deep,
    Mixed,
}

impl DistanceGrid {
    /// Distances on cells of at most this step (mm) in the box around the surface, or the part of it
    /// that lies in another box, and a layer of this thickness (mm) below the surface.
    ///
    /// Between the nodes the error is at most about step² / 8 times the sum of both curvatures of the
    /// surface of equal depth; edges sharper than a cell are rounded.
    pub fn of(
        surface: &TriMesh,
        part: Option<Bounds>,
        step_mm: f64,
        layer_mm: f64,
    ) -> Result<Self, RasterError> {
        if surface.triangles.is_empty() {
            return Err(RasterError::Empty);
        }
        let inside = Inside::of(surface)?;
        let (surface, _) = surface.compacted();
        let first = surface.points[0];
        let mut low = surface.points.iter().fold(first, |low, p| low.inf(p));
        let mut high = surface.points.iter().fold(first, |high, p| high.sup(p));
        if let Some(part) = part {
            (low, high) = (low.sup(&part.low), high.inf(&part.high));
        }
        if (0..3).any(|k| !(low[k] < high[k])) {
            return Err(RasterError::Empty);
        }
        let bounds = Bounds { low, high };
        let cells = [0, 1, 2].map(|k| ((high[k] - low[k]) / step_mm).ceil().max(1.0) as usize);
        let size = Vec3::from_fn(|k, _| (high[k] - low[k]) / cells[k] as f64);
        let [nx, ny, nz] = cells.map(|n| n + 1);
        let depth: Vec<f32> = (0..nx * ny * nz)
            .into_par_iter()
            .map(|n| {
                let at = [n % nx, n / nx % ny, n / (nx * ny)];
                let p = Vec3::from_fn(|k, _| low[k] + at[k] as f64 * size[k]);
                inside.depth_mm(&p) as f32
            })
            .collect();
        let diagonal = size.norm();
        let kind = |n: usize| {
            let [i, j, k] = [n % cells[0], n / cells[0] % cells[1], n / (cells[0] * cells[1])];
            let node = f64::from(depth[i + nx * (j + ny * k)]);
            // Distance changes by no more than the way.
            if node > layer_mm + diagonal {
                Kind::Deep
            } else if node < -diagonal {
                Kind::Outside
            } else {
                Kind::Mixed
            }
        };
        let kinds = (0..cells[0] * cells[1] * cells[2]).map(kind).collect();
        let per_mm = size.map(|size| 1.0 / size);
        Ok(Self { bounds, cells, per_mm, diagonal, depth, layer: layer_mm, kinds })
    }

    /// The box around the surface.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Cell of a point, and where it lies between the nodes.
    #[inline]
    fn place(&self, point: &Vec3) -> ([usize; 3], [f64; 3]) {
        let (mut at, mut part) = ([0; 3], [0.0; 3]);
        for k in 0..3 {
            let place = (point[k] - self.bounds.low[k]) * self.per_mm[k];
            at[k] = (place.max(0.0) as usize).min(self.cells[k] - 1);
            part[k] = place - at[k] as f64;
        }
        (at, part)
    }

    /// Where a point of the box is.
    #[inline]
    pub fn zone(&self, point: &Vec3) -> Zone {
        let (at, part) = self.place(point);
        match self.kinds[at[0] + self.cells[0] * (at[1] + self.cells[1] * at[2])] {
            Kind::Outside => Zone::Outside,
            Kind::Deep => Zone::Deep,
            Kind::Mixed => {
                let depth = self.between(at, part);
                if depth < 0.0 {
                    Zone::Outside
                } else if depth < self.layer {
                    Zone::Layer
                } else {
                    Zone::Deep
                }
            }
        }
    }

    /// Depth (mm) below the surface, linear between the nodes of a cell.
    #[inline]
    fn between(&self, at: [usize; 3], part: [f64; 3]) -> f64 {
        let (row, layer) = (self.cells[0] + 1, (self.cells[0] + 1) * (self.cells[1] + 1));
        let first = at[0] + at[1] * row + at[2] * layer;
        let along = |n: usize| {
            let [a, b] = [self.depth[n], self.depth[n + 1]].map(f64::from);
            a + part[0] * (b - a)
        };
        let across = |n: usize| {
            let [a, b] = [along(n), along(n + row)];
            a + part[1] * (b - a)
        };
        let [a, b] = [across(first), across(first + layer)];
        a + part[2] * (b - a)
    }

    /// Distance (mm) to the surface that a point outside has at least; 0 inside.
    #[inline]
    pub fn outside(&self, point: &Vec3) -> f64 {
        let (at, _) = self.place(point);
        let node = at[0] + (self.cells[0] + 1) * (at[1] + (self.cells[1] + 1) * at[2]);
        (-f64::from(self.depth[node]) - self.diagonal).max(0.0)
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
        let grid = DistanceGrid::of(&TriMesh { points, ..ball }, None, 2.0, 2.0).unwrap();
        for n in 0..4000 {
            let t = f64::from(n);
            let direction = Vec3::new(t.sin(), (1.7 * t).cos(), (0.3 * t).sin()).normalize();
            let r = 27.0 * (0.618 * t).fract();
            let point = center + r * direction;
            if !grid.bounds().contains(&point) {
                continue;
            }
            let (at, part) = grid.place(&point);
            let error = grid.between(at, part) - (25.0 - r);
            // step² / 8 · 2 / r at the cell's node that is nearest to the middle, which is a corner of
            // the distance; and the facets of the ball.
            let most = 2.0 * 2.0 / 8.0 * 2.0 / (r - 3.0_f64.sqrt());
            assert!(error.abs() < most + 0.01 || r < 5.0, "{r}: {error}");
            let zone = grid.zone(&point);
            let wanted = if r < 22.9 { Zone::Deep } else { Zone::Layer };
            match r {
                0.0..22.9 | 23.1..24.9 => assert_eq!(zone, wanted, "{r}"),
                25.1.. => assert_eq!(zone, Zone::Outside, "{r}"),
                _ => (),
            }
            assert!(grid.outside(&point) <= (r - 24.9).max(0.0));
        }
    }

    #[test]
    fn flat_sides_are_exact_and_open_surfaces_refused() {
        let mut block = cuboid([-30.0, 0.0, 0.0], [30.0, 50.0, 46.0]);
        let grid = DistanceGrid::of(&block, None, 2.0, 1.5).unwrap();
        for z in [0.0, 0.7, 1.49, 1.51, 1.9, 2.1, 44.3, 44.6, 46.0] {
            let depth = f64::min(z, 46.0 - z);
            let zone = grid.zone(&Vec3::new(3.3, 20.1, z));
            assert_eq!(zone, if depth < 1.5 { Zone::Layer } else { Zone::Deep }, "{z}");
        }
        block.triangles.pop();
        assert!(matches!(DistanceGrid::of(&block, None, 2.0, 1.5), Err(RasterError::Open { .. })));
    }
}
