//! Contacts that have moved on: a model's term in its place until its elements touch other nodes.

use crate::model::Model;
use crate::terms::Term;
use mammotwin_data::Vec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Terms that stand for those of a model, by their number.
#[derive(Clone, Default)]
pub struct Moved(BTreeMap<usize, Arc<dyn Term>>);

impl std::fmt::Debug for Moved {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "Moved({:?})", self.0.keys())
    }
}

impl Moved {
    /// The terms of a model as they are now.
    pub fn terms<'a>(&'a self, model: &'a Model) -> Vec<&'a dyn Term> {
        let own = model.terms().iter().enumerate();
        own.map(|(n, term)| self.0.get(&n).map_or(term.as_ref(), |moved| moved.as_ref())).collect()
    }

    /// Lets the terms move on with the nodes at `points` (mm); whether any did.
    pub fn follow(&mut self, model: &Model, points: &[Vec3]) -> bool {
        let each = self.terms(model).into_iter().enumerate();
        let moved: Vec<_> = each.filter_map(|(n, t)| Some((n, t.moved_on(points)?))).collect();
        let any = !moved.is_empty();
        self.0.extend(moved);
        any
    }

    /// Whether the terms are the very ones of another.
    pub fn same(&self, other: &Self) -> bool {
        let mut pairs = self.0.iter().zip(&other.0);
        self.0.len() == other.0.len()
            && pairs.all(|(one, two)| one.0 == two.0 && Arc::ptr_eq(one.1, two.1))
    }
}
