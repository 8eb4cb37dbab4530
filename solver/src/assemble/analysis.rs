//! What the elements of a model say of its matrix, found once for all models that have them.
//!
//! The order of elimination, the sparsity and where the factors are non-zero depend on which nodes
//! the elements join and what is fixed, not on any number: a body that is solved a hundred times
//! with other moduli, rest positions and loads is analysed once.

use super::AssemblyError;
use super::slots::{NONE, pattern_of, slots_of};
use crate::linear::Symbolic;
use crate::model::{Model, ModelError};
use crate::ordering::{Graph, elimination_order};
use crate::terms::Term;
use std::sync::{Arc, Mutex, PoisonError};

/// Analyses that are kept: of a body, and of variants that have a term more or hold other nodes.
const KEPT: usize = 4;

/// Which nodes the elements join, and what is fixed.
#[derive(Debug, PartialEq)]
struct Topology {
    /// For each term, whether it has pressures and how many nodes each of its elements has.
    terms: Vec<(bool, Vec<u8>)>,
    nodes: Vec<u32>,
    fixed: Vec<[bool; 3]>,
}

impl Topology {
    fn of(model: &Model, terms: &[&dyn Term]) -> Self {
        let elements = |t: &&dyn Term| (0..t.elements()).map(|e| t.nodes(e).len() as u8).collect();
        Self {
            terms: terms.iter().map(|t| (t.is_mixed(), elements(t))).collect(),
            nodes: all(terms).flat_map(|(t, e)| t.nodes(e)).copied().collect(),
            fixed: model.fixed().to_vec(),
        }
    }
}

/// All elements of all terms.
fn all<'a>(terms: &'a [&'a dyn Term]) -> impl Iterator<Item = (&'a dyn Term, usize)> {
    terms.iter().flat_map(|&t| (0..t.elements()).map(move |e| (t, e)))
}

/// Unknowns, sparsity and symbolic factors of the matrix of a model.
pub(super) struct Analysis {
    topology: Topology,
    /// Unknowns of each node: three displacements and the pressure.
    pub unknowns: Vec<[u32; 4]>,
    /// For each term and element, the value that each entry of its lower triangle adds to.
    pub slots: Vec<Vec<u32>>,
    pub system: Arc<Symbolic>,
    /// Pressure unknown of each node within the compliance.
    pub pressures: Vec<u32>,
    /// Of the pressures alone.
    pub compliance: Option<Arc<Symbolic>>,
}

impl Analysis {
    /// # Errors
    /// A free node without tissue, or too little memory.
    fn new(topology: Topology, model: &Model, terms: &[&dyn Term]) -> Result<Self, AssemblyError> {
        let nodes = model.rest.len();
        let graph = Graph::of_elements(nodes, all(terms).map(|(t, e)| t.nodes(e)));
        let mut has_pressure = vec![false; nodes];
        for (term, element) in all(terms) {
            if term.is_mixed() {
                for &n in term.nodes(element) {
                    has_pressure[n as usize] = true;
                }
            }
        }
        let mut unknowns = vec![[NONE; 4]; nodes];
        let mut pressures = vec![NONE; nodes];
        let (mut count, mut pressure_count) = (0, 0);
        for node in elimination_order(&graph) {
            let node = node as usize;
            let free = model.fixed()[node].map(|fixed| !fixed);
            if free != [false; 3] && graph.row(node).is_empty() {
                return Err(ModelError::Loose { node, place: model.rest[node].into() }.into());
            }
            for (axis, &wanted) in free.iter().chain([&has_pressure[node]]).enumerate() {
                if wanted {
                    unknowns[node][axis] = count;
                    count += 1;
                }
            }
            if has_pressure[node] {
                pressures[node] = pressure_count;
                pressure_count += 1;
            }
        }
        let pattern = pattern_of(&graph, &unknowns, count as usize);
        let slots = terms.iter().map(|&t| slots_of(t, &unknowns, &pattern)).collect();
        let compliance = if pressure_count == 0 {
            None
        } else {
            let alone: Vec<[u32; 4]> = pressures.iter().map(|&p| [p, NONE, NONE, NONE]).collect();
            let pattern = pattern_of(&graph, &alone, pressure_count as usize);
            Some(Arc::new(Symbolic::of(pattern)?))
        };
        let system = Arc::new(Symbolic::of(pattern)?);
        Ok(Self { topology, unknowns, slots, system, pressures, compliance })
    }
}

/// Analyses that models with the same elements share.
#[derive(Clone, Default)]
pub struct Analyses(Arc<Mutex<Vec<Arc<Analysis>>>>);

impl Analyses {
    /// How many are kept.
    pub fn count(&self) -> usize {
        self.kept().len()
    }

    fn kept(&self) -> std::sync::MutexGuard<'_, Vec<Arc<Analysis>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The analysis of a model whose terms are now `terms`.
    ///
    /// # Errors
    /// A free node without tissue, or too little memory.
    pub(super) fn of(
        &self,
        model: &Model,
        terms: &[&dyn Term],
    ) -> Result<Arc<Analysis>, AssemblyError> {
        let topology = Topology::of(model, terms);
        let used_now = |kept: &mut Vec<Arc<Analysis>>, topology: &Topology| {
            let place = kept.iter().position(|known| known.topology == *topology)?;
            let known = kept.remove(place);
            kept.push(known.clone());
            Some(known)
        };
        if let Some(known) = used_now(&mut self.kept(), &topology) {
            return Ok(known);
        }
        // Not under the lock: its loops may be handed a job that waits for the lock, too.
        let found = Arc::new(Analysis::new(topology, model, terms)?);
        let mut kept = self.kept();
        // Another thread may have been as far.
        if let Some(known) = used_now(&mut kept, &found.topology) {
            return Ok(known);
        }
        // The one that was not used for longest goes.
        if kept.len() == KEPT {
            kept.remove(0);
        }
        kept.push(found.clone());
        Ok(found)
    }
}
