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

/// Distance (mm) of a node from its surface with the nodes at some places (mm), and its gradient.
type Above<'a> = Box<dyn Fn(&[Vec3]) -> (f64, Vec3) + 'a>;

/// Nodes that glide, each with its distance (mm) from the surface and the gradient of that, with the nodes at
/// `points`.
fn gliding<'a>(model: &'a Model) -> impl Iterator<Item = (usize, Above<'a>)> + 'a {
    model.terms().iter().flat_map(|term| {
        let wanted = term.surface().is_some() || term.gives_way();
        (0..if wanted { term.elements() } else { 0 }).map(move |element| {
            let node = term.nodes(element)[0] as usize;
            let distance = move |points: &[Vec3]| match term.surface() {
                Some(surface) => {
                    let (distance, slope, _) = surface.distance(&points[node]);
                    (distance, slope)
                }
                None => term.above(element, points).unwrap_or((0.0, Vec3::zeros())),
            };
            (node, Box::new(distance) as Above<'a>)
        })
    })
}

/// The surfaces' normals with the nodes at `points` (mm).
pub(super) fn normals(model: &Model, points: &[Vec3]) -> Normals {
    let normal = |(node, distance): (usize, Above<'_>)| {
        let normal = free(model, node, distance(points).1);
        normal.try_normalize(LEAST_NORMAL).map(|normal| (node, normal))
    };
    gliding(model).filter_map(normal).collect()
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
    for (node, distance) in gliding(model) {
        let from = points[node];
        for _ in 0..ROUNDS {
            let (distance, slope) = distance(points);
            let slope = free(model, node, slope);
            if distance.abs() <= ON_SURFACE_MM || slope.norm() < LEAST_NORMAL {
                break;
            }
            points[node] -= distance / slope.norm_squared() * slope;
        }
        longest = longest.max((points[node] - from).norm());
    }
    longest
}
