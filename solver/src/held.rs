//! Whether something holds every part of a body: one that may move as a rigid body has no place of its own.
//!
//! Parts are what elements tie together. A part is held when no rigid motion leaves all its fixed
//! coordinates as they are. Nodes of a contact count as held along its normal, whether it touches them or not, since a
//! plate may come to them, and in every direction where there is friction; those of cables in every direction, since a cable
//! may turn. Two bodies that glide on each other are one part.

use crate::assemble::State;
use crate::model::{Model, ModelError};
use mammotwin_data::Vec3;
use nalgebra::{DMatrix, Matrix3x6, Matrix6, SymmetricEigen};
use std::collections::BTreeMap;

/// Mean square of the displacement of a rigid motion below which it is none, and part of it at held
/// coordinates below which nothing holds it: one of a hundred thousand nodes is enough.
const NO_MOTION: f64 = 1e-9;
const NOT_HELD: f64 = 1e-12;
/// A gradient of a distance shorter than this has no direction.
const NO_DIRECTION: f64 = 1e-9;

/// Checks that the body is held in a state.
///
/// # Errors
/// [`ModelError::Unheld`] with the first part that is not.
pub(crate) fn check(model: &Model, state: &State) -> Result<(), ModelError> {
    let points = &state.points;
    let mut held = model.fixed().to_vec();
    let mut along: Vec<Vec<Vec3>> = vec![Vec::new(); points.len()];
    for (index, term) in model.terms().iter().enumerate().filter(|(_, term)| term.ties()) {
        let touching = term.touching(&state.at(index));
        if touching.is_empty() {
            for &node in (0..term.elements()).flat_map(|e| term.nodes(e)) {
                held[node as usize] = [true; 3];
            }
        }
        for touching in touching {
            let node = touching.node as usize;
            match touching.normal.try_normalize(NO_DIRECTION) {
                Some(normal) if !touching.rubs => along[node].push(normal),
                _ => held[node] = [true; 3],
            }
        }
    }
    for nodes in parts(model) {
        let (of, motions) = free_motions(&nodes, points, &held, &along);
        if motions > 0 {
            let (count, node) = (nodes.len(), nodes[0]);
            let place = points[node].into();
            return Err(ModelError::Unheld { motions, of, nodes: count, node, place });
        }
    }
    Ok(())
}

/// Nodes of each part, in ascending order.
fn parts(model: &Model) -> Vec<Vec<usize>> {
    let mut parent: Vec<u32> = (0..model.rest.len() as u32).collect();
    fn root(parent: &mut [u32], node: u32) -> u32 {
        let mut at = node;
        while parent[at as usize] != at {
            // Halves the way for the next search.
            parent[at as usize] = parent[parent[at as usize] as usize];
            at = parent[at as usize];
        }
        at
    }
    for term in model.terms() {
        for element in 0..term.elements() {
            let nodes = term.nodes(element);
            for &node in &nodes[1..] {
                let (a, b) = (root(&mut parent, nodes[0]), root(&mut parent, node));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    let mut parts: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for node in 0..parent.len() as u32 {
        parts.entry(root(&mut parent, node)).or_default().push(node as usize);
    }
    parts.into_values().collect()
}

/// Number of independent rigid motions of some nodes, and of those that nothing resists: neither fixed axes nor what holds
/// nodes along unit vectors.
fn free_motions(
    nodes: &[usize],
    points: &[Vec3],
    held: &[[bool; 3]],
    along: &[Vec<Vec3>],
) -> (usize, usize) {
    let middle = nodes.iter().map(|&n| points[n]).sum::<Vec3>() / nodes.len() as f64;
    let far = nodes.iter().map(|&n| (points[n] - middle).norm()).fold(0.0, f64::max);
    let size = if far > 0.0 { far } else { 1.0 };
    let (mut all, mut resisted) = (Matrix6::<f64>::zeros(), Matrix6::<f64>::zeros());
    for &node in nodes {
        // Columns: shifts along the axes, and turns about them that move the farthest node by one.
        let mut moved = Matrix3x6::zeros();
        moved.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        let turned = -(points[node] - middle).cross_matrix() / size;
        moved.fixed_view_mut::<3, 3>(0, 3).copy_from(&turned);
        all += moved.transpose() * moved;
        for axis in (0..3).filter(|&axis| held[node][axis]) {
            resisted += moved.row(axis).transpose() * moved.row(axis);
        }
        for normal in &along[node] {
            let row = normal.transpose() * moved;
            resisted += row.transpose() * row;
        }
    }
    let found = SymmetricEigen::new(all / nodes.len() as f64);
    let motions: Vec<usize> = (0..6).filter(|&n| found.eigenvalues[n] > NO_MOTION).collect();
    // Motions of mean square one.
    let basis = DMatrix::from_fn(6, motions.len(), |row, n| {
        found.eigenvectors[(row, motions[n])] / found.eigenvalues[motions[n]].sqrt()
    });
    let resisted = DMatrix::from_fn(6, 6, |r, c| resisted[(r, c)] / nodes.len() as f64);
    let shares = SymmetricEigen::new(basis.transpose() * resisted * &basis).eigenvalues;
    (motions.len(), shares.iter().filter(|share| !(**share > NOT_HELD)).count())
}
