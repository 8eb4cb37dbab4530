//! Where the blocks of the elements go in the sparse matrix.

use crate::linear::Pattern;
use crate::ordering::Graph;
use crate::terms::{Block, Term};
use rayon::prelude::*;

/// Unknown that is not there.
pub(super) const NONE: u32 = u32::MAX;

/// Number of slots of an element.
pub(super) fn entries(nodes: usize, mixed: bool) -> usize {
    9 * nodes * (nodes - 1) / 2 + 6 * nodes + if mixed { 3 * nodes * nodes } else { 0 }
}

/// Adds a block to the matrix, in the order of [`slots_of`].
pub(super) fn scatter<'a>(
    block: &Block,
    nodes: usize,
    mixed: bool,
    slots: &mut impl Iterator<Item = &'a u32>,
    values: &mut [f64],
) {
    let mut add = |value: f64| {
        let slot = *slots.next().expect("one slot for each entry");
        if slot != NONE {
            values[slot as usize] += value;
        }
    };
    for a in 0..nodes {
        for b in 0..=a {
            for i in 0..3 {
                for j in 0..if a == b { i + 1 } else { 3 } {
                    add(block.hessian[a][b][(i, j)]);
                }
            }
        }
    }
    if mixed {
        for gradient in &block.dilatation_gradient[..nodes] {
            for i in 0..3 {
                for _ in 0..nodes {
                    add(gradient[i]);
                }
            }
        }
    }
}

/// Where the entries of each element go, in the order in which [`scatter`] visits them.
pub(super) fn slots_of(term: &dyn Term, unknowns: &[[u32; 4]], pattern: &Pattern) -> Vec<u32> {
    let position = |p: u32, q: u32| match (p, q) {
        (NONE, _) | (_, NONE) => NONE,
        (p, q) => pattern
            .position(p.max(q) as usize, p.min(q) as usize)
            .expect("neighbours are in the pattern") as u32,
    };
    let each = |element: usize| {
        let nodes = term.nodes(element);
        let mut slots = Vec::new();
        for (a, &row) in nodes.iter().enumerate() {
            for (b, &column) in nodes[..=a].iter().enumerate() {
                for i in 0..3 {
                    for j in 0..if a == b { i + 1 } else { 3 } {
                        let (p, q) = (unknowns[row as usize][i], unknowns[column as usize][j]);
                        slots.push(position(p, q));
                    }
                }
            }
        }
        if term.is_mixed() {
            for &row in nodes {
                for i in 0..3 {
                    for &column in nodes {
                        let (p, q) = (unknowns[row as usize][i], unknowns[column as usize][3]);
                        slots.push(position(p, q));
                    }
                }
            }
        }
        slots
    };
    (0..term.elements()).into_par_iter().flat_map_iter(each).collect()
}

/// Lower sparsity of all pairs of unknowns of neighbouring nodes.
pub(super) fn pattern_of(graph: &Graph, unknowns: &[[u32; 4]], count: usize) -> Pattern {
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); count];
    for node in 0..graph.len() {
        let near = graph.row(node).iter().map(|&n| n as usize).chain([node]);
        let mut rows: Vec<u32> = near.flat_map(|n| unknowns[n]).filter(|&u| u != NONE).collect();
        rows.sort_unstable();
        for &column in unknowns[node].iter().filter(|&&u| u != NONE) {
            let from = rows.partition_point(|&row| row < column);
            columns[column as usize] = rows[from..].iter().map(|&row| row as usize).collect();
        }
    }
    let mut starts = vec![0];
    let mut rows = Vec::new();
    for column in columns {
        rows.extend(column);
        starts.push(rows.len());
    }
    Pattern { starts, rows }
}
