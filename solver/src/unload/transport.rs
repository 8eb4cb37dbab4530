//! From displacements of the loaded body to displacements of its rest shape.
//!
//! Moving X by δX with x kept is moving x by -F δX with X kept, seen from the moved rest shape:
//! the loaded body follows its rest shape by F δX, boundary and supports included.

use crate::model::Model;
use mammotwin_data::{Mat3, Vec3};

/// F⁻¹ at each node with the nodes at `known`: the mean of the tetrahedra around it, by size.
pub(super) fn pull_back(model: &Model, rest: &[Vec3], known: &[Vec3]) -> Vec<Mat3> {
    let mut sums = vec![Mat3::zeros(); rest.len()];
    let mut sizes = vec![0.0; rest.len()];
    for term in model.terms().iter().filter(|term| term.is_mixed()) {
        for element in 0..term.elements() {
            let nodes = term.nodes(element);
            let edges = |points: &[Vec3]| {
                let corner = |n: usize| points[nodes[n] as usize];
                Mat3::from_columns(&[1, 2, 3].map(|n| corner(n) - corner(0)))
            };
            let (before, after) = (edges(rest), edges(known));
            let size = after.determinant().abs();
            let Some(inverse) = after.try_inverse() else { continue };
            for &n in nodes {
                sums[n as usize] += size * (before * inverse);
                sizes[n as usize] += size;
            }
        }
    }
    let mean = |(sum, size): (Mat3, f64)| if size > 0.0 { sum / size } else { Mat3::identity() };
    sums.into_iter().zip(sizes).map(mean).collect()
}
