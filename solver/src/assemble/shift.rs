//! The convex stiffness that Newton's method adds where the energy is not convex.

use super::slots::NONE;
use crate::linear::Pattern;
use crate::model::Model;
use std::collections::BTreeMap;

/// Least stiffness (mN/mm) where no tissue gives any.
const LEAST: f64 = 1.0;

/// Entries of the stiffness, by their places among the values of the matrix. Displacements that
/// no tissue stiffens get the mean diagonal.
pub(super) fn entries(model: &Model, unknowns: &[[u32; 4]], pattern: &Pattern) -> Vec<(u32, f64)> {
    let mut sums: BTreeMap<u32, f64> = BTreeMap::new();
    let mut add = |p: u32, q: u32, stiffness: f64| {
        if p != NONE && q != NONE {
            let at = pattern.position(p.max(q) as usize, p.min(q) as usize);
            let at = at.expect("neighbours are in the pattern") as u32;
            *sums.entry(at).or_insert(0.0) += stiffness;
        }
    };
    for term in model.terms().iter().filter(|term| term.is_mixed()) {
        for element in 0..term.elements() {
            let local = term.shift(element);
            let nodes = term.nodes(element);
            for a in 0..nodes.len() {
                for b in 0..=a {
                    let (row, column) =
                        (&unknowns[nodes[a] as usize], &unknowns[nodes[b] as usize]);
                    for axis in 0..3 {
                        add(row[axis], column[axis], local[(a, b)]);
                    }
                }
            }
        }
    }
    let diagonals: Vec<u32> = unknowns
        .iter()
        .flat_map(|u| &u[..3])
        .filter(|&&u| u != NONE)
        .map(|&u| pattern.starts[u as usize] as u32)
        .collect();
    let known: Vec<f64> = diagonals.iter().filter_map(|at| sums.get(at).copied()).collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    for at in diagonals {
        sums.entry(at).or_insert(mean.max(LEAST));
    }
    sums.into_iter().collect()
}
