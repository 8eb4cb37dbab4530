//! What the supports of a body leave free at each node: fixed axes and surfaces to glide on.

use crate::model::Model;
use mammotwin_data::Vec3;

/// A surface whose normal has less than this along the free axes does not restrict them.
const LEAST_NORMAL: f64 = 1e-2;
/// Distance (mm) from its surface below which a node is on it, and rounds to bring it there.
const ON_SURFACE_MM: f64 = 1e-10;
const ROUNDS: usize = 20;

/// Normals within the free axes, of unit length, by gliding node.
pub(super) type Normals = Vec<(usize, Vec3)>;

/// `vector` along the free axes of a node.
fn free(model: &Model, node: usize, mut vector: Vec3) -> Vec3 {
    for axis in 0..3 {
        if model.fixed()[node][axis] {
            vector[axis] = 0.0;
        }
    }
    vector
}

/// The surfaces' normals with the nodes at `points` (mm).
pub(super) fn normals(model: &Model, points: &[Vec3]) -> Normals {
    let mut normals = Vec::new();
    for term in model.terms() {
        let Some(surface) = term.surface() else { continue };
        for node in (0..term.elements()).flat_map(|e| term.nodes(e)) {
            let node = *node as usize;
            let normal = free(model, node, surface.distance(&points[node]).1);
            normals.extend(normal.try_normalize(LEAST_NORMAL).map(|normal| (node, normal)));
        }
    }
    normals
}

/// Takes out of a nodal field what the supports prevent.
pub(super) fn tangential(model: &Model, normals: &Normals, field: &mut [Vec3]) {
    for (node, vector) in field.iter_mut().enumerate() {
        *vector = free(model, node, *vector);
    }
    for (node, normal) in normals {
        let along = field[*node].dot(normal);
        field[*node] -= along * normal;
    }
}

/// Brings gliding nodes onto their surfaces, along free axes; returns the longest way (mm).
pub(super) fn onto_surfaces(model: &Model, points: &mut [Vec3]) -> f64 {
    let mut longest: f64 = 0.0;
    for term in model.terms() {
        let Some(surface) = term.surface() else { continue };
        for node in (0..term.elements()).flat_map(|e| term.nodes(e)) {
            let node = *node as usize;
            let from = points[node];
            for _ in 0..ROUNDS {
                let (distance, slope, _) = surface.distance(&points[node]);
                let slope = free(model, node, slope);
                if distance.abs() <= ON_SURFACE_MM || slope.norm() < LEAST_NORMAL {
                    break;
                }
                points[node] -= distance / slope.norm_squared() * slope;
            }
            longest = longest.max((points[node] - from).norm());
        }
    }
    longest
}
