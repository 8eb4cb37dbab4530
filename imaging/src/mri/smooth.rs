//! Smoothing of surfaces without shrinkage.

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

/// Smooths a closed surface by steps that alternately shrink and swell it.
///
/// Taubin 1995, A signal processing approach to fair surface design, doi:10.1145/218380.218473, with
/// weights 1 over the number of neighbours, `λ = 0.5` and `μ = -0.526` (pass band 0.1).
pub fn taubin(surface: &TriMesh, rounds: usize) -> TriMesh {
    let neighbors = neighbors(surface);
    let step = |points: &[Vec3], weight: f64| -> Vec<Vec3> {
        let moved = |n: usize| {
            let around = &neighbors[n];
            if around.is_empty() {
                return points[n];
            }
            let sum: Vec3 = around.iter().map(|&m| points[m as usize]).sum();
            points[n] + weight * (sum / around.len() as f64 - points[n])
        };
        (0..points.len()).into_par_iter().map(moved).collect()
    };
    let mut points = surface.points.clone();
    for _ in 0..rounds {
        points = step(&points, 0.5);
        points = step(&points, -0.526);
    }
    TriMesh { points, triangles: surface.triangles.clone() }
}

/// Vertices that share an edge with each vertex, ascending.
fn neighbors(surface: &TriMesh) -> Vec<Vec<u32>> {
    let mut neighbors = vec![Vec::new(); surface.points.len()];
    for [a, b, c] in &surface.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            neighbors[*from as usize].push(*to);
            neighbors[*to as usize].push(*from);
        }
    }
    for around in &mut neighbors {
        around.sort_unstable();
        around.dedup();
    }
    neighbors
}
