//! The convex stiffness that Newton's method adds where the energy is not convex.

use super::slots::{NONE, entries, scatter};
use super::{Assembly, State};
use crate::model::Model;
use crate::terms::Block;

/// Least stiffness (mN/mm) where no tissue gives any.
const LEAST: f64 = 1.0;

impl Assembly {
    /// The lower values of the convex stiffness of [`crate::terms::Term::shift`] in this state.
    /// Displacements that no tissue stiffens get the mean diagonal.
    pub fn shift(&self, model: &Model, state: &State, values: &mut Vec<f64>) {
        values.clear();
        values.resize(self.pattern().rows.len(), 0.0);
        for (index, &term) in state.terms(model).iter().enumerate() {
            let at = state.at(index);
            let mut block = Block::ZERO;
            let mut slots = &self.analysis.slots[index][..];
            for element in 0..term.elements() {
                let nodes = term.nodes(element).len();
                let (own, rest) = slots.split_at(entries(nodes, term.is_mixed()));
                slots = rest;
                block.clear(nodes);
                if term.shift(element, &at, &mut block) {
                    scatter(&block, nodes, term.is_mixed(), &mut own.iter(), values);
                }
            }
        }
        let displacements =
            || self.analysis.unknowns.iter().flat_map(|u| &u[..3]).filter(|&&u| u != NONE);
        let diagonals = || displacements().map(|&u| self.pattern().starts[u as usize]);
        let (sum, count) = diagonals()
            .map(|at| values[at])
            .filter(|&value| value > 0.0)
            .fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
        let mean = f64::max(LEAST, sum / f64::from(count.max(1)));
        for at in diagonals() {
            if !(values[at] > 0.0) {
                values[at] = mean;
            }
        }
    }
}
