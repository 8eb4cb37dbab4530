//! Whether points lie in a closed surface.

use crate::xray::raster::{RasterError, open_edges};
use mammotwin_data::{Vec3, surface::TriMesh};
use parry3d_f64::{
    math::Vector,
    query::PointQuery,
    shape::{TriMesh as Shape, TriMeshFlags},
};

/// A closed surface that can be asked.
pub struct Inside(Shape);

impl Inside {
    /// Prepares a closed surface.
    pub fn of(surface: &TriMesh) -> Result<Self, RasterError> {
        let edges = open_edges(surface);
        if edges > 0 {
            return Err(RasterError::Open { edges });
        }
        let (surface, _) = surface.compacted();
        let vertices = surface.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        Shape::with_flags(vertices, surface.triangles, TriMeshFlags::ORIENTED)
            .map(Self)
            .map_err(|_| RasterError::Empty)
    }

    /// Depth (mm) of a point below the surface; negative outside.
    pub fn depth_mm(&self, p: &Vec3) -> f64 {
        let found = self.0.project_local_point(Vector::new(p.x, p.y, p.z), false);
        let distance = (p - Vec3::new(found.point.x, found.point.y, found.point.z)).norm();
        if found.is_inside { distance } else { -distance }
    }

    /// Whether a point (mm) lies in it.
    pub fn contains(&self, point: &Vec3) -> bool {
        self.depth_mm(point) > 0.0
    }
}
