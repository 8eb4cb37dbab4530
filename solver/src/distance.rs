//! Distances from points to triangulated surfaces (Mîra 2018, Appendix A).
//!
//! The one file that knows the bounding-volume hierarchy of `parry3d`.

use mammotwin_data::{Vec3, surface::TriMesh};
use parry3d_f64::{
    math::Vector,
    query::PointQueryWithLocation,
    shape::{TriMesh as ParryMesh, TrianglePointLocation},
};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Why a surface or a set of nodes cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DistanceError {
    /// Nothing to measure to.
    #[error("the surface has no triangle; check the labels it was made of")]
    NoTriangle,
    /// A corner that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are only {points}")]
    NoSuchVertex {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        points: usize,
    },
    /// An active node that does not exist, or no active node at all.
    #[error("active node {node} is not among {points} points")]
    NoSuchNode {
        /// The node.
        node: u32,
        /// Number of points.
        points: usize,
    },
    /// No active node.
    #[error("no active node to measure from; widen the region of active nodes")]
    NoNode,
    /// A coordinate is NaN or infinite.
    #[error("point {0} is not finite; the solution that made it did not converge")]
    NotFinite(usize),
}

/// The point of a surface nearest to another point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// On the surface (mm).
    pub point: Vec3,
    /// Distance (mm), not negative.
    pub distance_mm: f64,
    /// Index of the triangle that holds `point`.
    pub triangle: usize,
    /// Unit normal there, outward: of the face, or the pseudonormal of the edge or vertex
    /// (Bærentzen & Aanæs 2005, doi:10.1109/TVCG.2005.49). Zero on a degenerate triangle.
    pub normal: Vec3,
}

impl Closest {
    /// Distance of `from` (mm), negative behind the surface. Exact for closed surfaces; for an open
    /// patch it is the side of the nearest face.
    pub fn signed_mm(&self, from: &Vec3) -> f64 {
        self.distance_mm.copysign((from - self.point).dot(&self.normal))
    }
}

/// A surface that answers which of its points is nearest.
pub struct SurfaceIndex {
    parry: ParryMesh,
    faces: Vec<Vec3>,
    edges: BTreeMap<[u32; 2], Vec3>,
    vertices: Vec<Vec3>,
}

impl SurfaceIndex {
    /// Builds the hierarchy. Points that no triangle uses are ignored.
    pub fn new(surface: &TriMesh) -> Result<Self, DistanceError> {
        let points = surface.points.len();
        if surface.triangles.is_empty() {
            return Err(DistanceError::NoTriangle);
        }
        for (triangle, corners) in surface.triangles.iter().enumerate() {
            for &vertex in corners {
                let Some(p) = surface.points.get(vertex as usize) else {
                    return Err(DistanceError::NoSuchVertex { triangle, vertex, points });
                };
                finite(vertex as usize, p)?;
            }
        }
        let (used, _) = surface.compacted();
        let vertices = used.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let parry = ParryMesh::new(vertices, used.triangles.clone())
            .map_err(|_| DistanceError::NoTriangle)?;
        let mut index = Self {
            parry,
            faces: Vec::with_capacity(used.triangles.len()),
            edges: BTreeMap::new(),
            vertices: vec![Vec3::zeros(); used.points.len()],
        };
        for (t, corners) in used.triangles.iter().enumerate() {
            let normal = used.area_vector(t).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            index.faces.push(normal);
            for n in 0..3 {
                let [a, b, c] = [n, (n + 1) % 3, (n + 2) % 3].map(|m| corners[m]);
                let [pa, pb, pc] = [a, b, c].map(|m| used.points[m as usize]);
                *index.edges.entry(sorted(a, b)).or_insert_with(Vec3::zeros) += normal;
                index.vertices[a as usize] += (pb - pa).angle(&(pc - pa)) * normal;
            }
        }
        Ok(index)
    }

    /// Nearest point of the surface; `None` when `p` is not finite.
    pub fn closest(&self, p: &Vec3) -> Option<Closest> {
        if !p.iter().all(|v| v.is_finite()) {
            return None;
        }
        let at = Vector::new(p.x, p.y, p.z);
        let (found, (triangle, location)) =
            self.parry.project_local_point_and_get_location(at, false);
        let corners = self.parry.indices()[triangle as usize];
        let normal = match location {
            TrianglePointLocation::OnVertex(n) => self.vertices[corners[n as usize] as usize],
            TrianglePointLocation::OnEdge(n, _) => {
                let [a, b] = [[0, 1], [1, 2], [0, 2]][n as usize].map(|m: usize| corners[m]);
                self.edges.get(&sorted(a, b)).copied().unwrap_or_else(Vec3::zeros)
            }
            _ => self.faces[triangle as usize],
        };
        let point = Vec3::new(found.point.x, found.point.y, found.point.z);
        Some(Closest {
            point,
            distance_mm: (p - point).norm(),
            triangle: triangle as usize,
            normal: normal.try_normalize(0.0).unwrap_or_else(Vec3::zeros),
        })
    }

    /// Nearest points of many; the first point that is not finite is an error.
    pub fn closest_of(&self, points: &[Vec3]) -> Result<Vec<Closest>, DistanceError> {
        let find = |(n, p): (usize, &Vec3)| self.closest(p).ok_or(DistanceError::NotFinite(n));
        points.par_iter().enumerate().map(find).collect()
    }
}

fn sorted(a: u32, b: u32) -> [u32; 2] {
    if a < b { [a, b] } else { [b, a] }
}

fn finite(n: usize, p: &Vec3) -> Result<(), DistanceError> {
    if p.iter().all(|v| v.is_finite()) { Ok(()) } else { Err(DistanceError::NotFinite(n)) }
}

/// Distances from the active nodes of one surface to another surface, mm (Mîra 2018, eqs. A.3-A.7).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Distances {
    /// Of the nearest node (eq. A.3).
    pub min: f64,
    /// Of the farthest node (eq. A.4).
    pub max: f64,
    /// Mean over the nodes (eq. A.5).
    pub mean: f64,
    /// 95 % of the nodes are nearer.
    pub p95: f64,
    /// The larger of the maxima of both directions (eq. A.6).
    pub hausdorff: f64,
    /// The larger of the means of both directions (eq. A.7).
    pub modified_hausdorff: f64,
}

/// One surface and the vertices that take part in a comparison.
#[derive(Debug, Clone, Copy)]
pub struct Active<'a> {
    /// The whole surface: distances to it are to all its triangles.
    pub surface: &'a TriMesh,
    /// Vertices that distances are measured from; repeated nodes count repeatedly.
    pub nodes: &'a [u32],
}

/// Compares two surfaces by their active nodes.
///
/// `min`, `max`, `mean` and `p95` are from `here` to `there`; the Hausdorff distances go both ways.
pub fn compare(here: Active, there: Active) -> Result<Distances, DistanceError> {
    let away = node_distances(here, there.surface)?;
    let back = node_distances(there, here.surface)?;
    Distances::of(away, &back)
}

impl Distances {
    /// Where nothing was compared.
    pub const NONE: Self = Self {
        min: f64::NAN,
        max: f64::NAN,
        mean: f64::NAN,
        p95: f64::NAN,
        hausdorff: f64::NAN,
        modified_hausdorff: f64::NAN,
    };

    /// Of the distances (mm) of one surface's nodes to the other surface, and the other way.
    ///
    /// # Errors
    /// [`DistanceError::NoNode`] when either is empty.
    pub fn of(mut away: Vec<f64>, back: &[f64]) -> Result<Self, DistanceError> {
        let rank = (0.95 * away.len() as f64).ceil() as usize;
        let (max, mean) = (maximum(&away), average(&away));
        away.sort_unstable_by(f64::total_cmp);
        let (Some(&min), false) = (away.first(), back.is_empty()) else {
            return Err(DistanceError::NoNode);
        };
        Ok(Self {
            min,
            max,
            mean,
            p95: away[rank.saturating_sub(1)],
            hausdorff: max.max(maximum(back)),
            modified_hausdorff: mean.max(average(back)),
        })
    }
}

/// Distance (mm) of each active node to `surface` (eq. A.2), in the order of the nodes.
pub fn node_distances(from: Active, surface: &TriMesh) -> Result<Vec<f64>, DistanceError> {
    if from.nodes.is_empty() {
        return Err(DistanceError::NoNode);
    }
    let points = from.surface.points.len();
    let at = |&node: &u32| {
        let p = from.surface.points.get(node as usize).copied();
        p.ok_or(DistanceError::NoSuchNode { node, points })
    };
    let nodes = from.nodes.iter().map(at).collect::<Result<Vec<Vec3>, _>>()?;
    let found = SurfaceIndex::new(surface)?.closest_of(&nodes)?;
    Ok(found.iter().map(|c| c.distance_mm).collect())
}

fn maximum(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests;
