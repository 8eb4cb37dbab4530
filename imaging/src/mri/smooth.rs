//! Surfaces put onto smooth fields.

use super::distance_field::cubic;
use mammotwin_data::{Vec3, surface::TriMesh, volume::Volume};
use rayon::prelude::*;

/// Moves the vertices onto the zero level of a smooth field, each by less than one voxel. Vertices
/// outside of the field's grid stay.
pub fn project(surface: &TriMesh, field: &Volume<f32>) -> TriMesh {
    let to_voxel = field.grid.to_voxel();
    let last = field.grid.shape.map(|n| n as f64 - 1.0);
    let foot = |start: &Vec3| -> Option<Vec3> {
        let start = to_voxel.apply(start);
        let mut at = start;
        let mut step = Vec3::repeat(f64::INFINITY);
        for _ in 0..4 {
            if !(0..3).all(|axis| (0.0..=last[axis]).contains(&at[axis])) {
                return None;
            }
            let (value, slope) = cubic(field, &at);
            let slope = Vec3::from(slope.map(f64::from));
            step = slope * (f64::from(value) / slope.norm_squared());
            at -= step;
        }
        (step.norm() < 0.1 && (at - start).norm() < 1.0).then(|| field.grid.world(&at))
    };
    let points = surface.points.par_iter().map(|p| foot(p).unwrap_or(*p)).collect();
    TriMesh { points, triangles: surface.triangles.clone() }
}
