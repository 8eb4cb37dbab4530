//! Sums the terms of a model into one energy, one gradient and one sparse matrix.
//!
//! Elements are evaluated in parallel and summed in their own order, so that the sums are the
//! same bits for any number of threads. Each node has four unknowns, three displacements and a
//! pressure, kept together in the elimination order; fixed ones and absent pressures are left out.

mod analysis;
pub mod moved;
mod shift;
mod slots;

use crate::linear::{Ldlt, LinearError, Pattern, Precision};
use crate::model::{Model, ModelError};
use crate::terms::{At, Block, ContactCheck, Curvature, Load, Order, Refusal, Term};
pub use analysis::Analyses;
use analysis::Analysis;
use mammotwin_data::{Vec3, solution::Solution};
use moved::Moved;
use rayon::prelude::*;
use slots::{NONE, scatter};
use std::sync::Arc;

/// Elements evaluated at once; bounds the memory and fixes the order of sums.
const CHUNK: usize = 256;

/// A state of the body during a solve.
#[derive(Debug, Clone)]
pub struct State {
    /// Node positions (mm).
    pub points: Vec<Vec3>,
    /// Nodal pressures (kPa, positive in tension) that belong to the points.
    pub pressure: Vec<f64>,
    /// Memory of each term.
    pub memory: Vec<Vec<f64>>,
    /// Modulus (kPa) that scales the penalties at each node: the shear modulus of its tissue, or
    /// more where that proved too soft.
    pub shear_kpa: Arc<[f64]>,
    /// What is switched on.
    pub load: Load,
    /// Contacts whose elements touch other nodes than those of the model.
    pub moved: Moved,
}

/// The term and element that refused a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TermRefusal {
    /// Index of the term in the model.
    pub term: usize,
    /// What it said.
    pub refusal: Refusal,
}

/// Sparsity, unknowns and compliance of a model.
pub struct Assembly {
    analysis: Arc<Analysis>,
    /// Constant part of the matrix: minus the compliance.
    constant: Vec<f64>,
    /// Compliance of the pressures, factorised.
    compliance: Option<Ldlt>,
}

impl Assembly {
    /// Analyses a model, or takes the analysis of one that has the same elements ([`Model::share`]).
    ///
    /// # Errors
    /// A free node without tissue, or too little memory.
    pub fn new(model: &Model) -> Result<Self, AssemblyError> {
        Self::of(model, model.analyses(), &Moved::default())
    }

    /// The same where contacts have moved on: to elements that no other model has.
    ///
    /// # Errors
    /// As [`Assembly::new`].
    pub fn moved(model: &Model, moved: &Moved) -> Result<Self, AssemblyError> {
        Self::of(model, &Analyses::default(), moved)
    }

    fn of(model: &Model, analyses: &Analyses, moved: &Moved) -> Result<Self, AssemblyError> {
        let analysis = analyses.of(model, &moved.terms(model))?;
        let compliance = analysis.compliance.clone();
        let compliance =
            compliance.map(|shared| Ldlt::new(shared, Precision::Double)).transpose()?;
        let constant = vec![0.0; analysis.system.pattern().rows.len()];
        let mut assembly = Self { analysis, constant, compliance };
        assembly.renew(model)?;
        Ok(assembly)
    }

    /// Room for the factors of the matrix.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn system(&self, precision: Precision) -> Result<Ldlt, LinearError> {
        Ldlt::new(self.analysis.system.clone(), precision)
    }

    /// Number of pressure unknowns.
    pub fn pressures(&self) -> usize {
        self.compliance.as_ref().map_or(0, |factors| factors.pattern().len())
    }

    /// Sparsity of the matrix.
    pub fn pattern(&self) -> &Pattern {
        self.analysis.system.pattern()
    }

    /// Takes the compliance anew from `model`: the analysed one with other rest positions.
    ///
    /// # Errors
    /// A compliance that is singular.
    pub fn renew(&mut self, model: &Model) -> Result<(), LinearError> {
        let Some(factors) = &mut self.compliance else { return Ok(()) };
        let Analysis { pressures, unknowns, system, .. } = &*self.analysis;
        let mut values = vec![0.0; factors.pattern().rows.len()];
        self.constant.fill(0.0);
        for term in model.terms().iter().filter(|term| term.is_mixed()) {
            for element in 0..term.elements() {
                let local = term.compliance(element);
                let nodes = term.nodes(element);
                for a in 0..4 {
                    for b in 0..=a {
                        let (a_node, b_node) = (nodes[a] as usize, nodes[b] as usize);
                        let (p, q) = (pressures[a_node], pressures[b_node]);
                        let at = factors.pattern().position(p.max(q) as usize, p.min(q) as usize);
                        values[at.expect("neighbours are in the pattern")] += local[(a, b)];
                        let (p, q) = (unknowns[a_node][3], unknowns[b_node][3]);
                        let at = system.pattern().position(p.max(q) as usize, p.min(q) as usize);
                        self.constant[at.expect("neighbours are in the pattern")] -= local[(a, b)];
                    }
                }
            }
        }
        factors.factor(&values)
    }

    /// Energy (µJ) of a state with the nodes at `points`, and the pressures that belong to them.
    ///
    /// # Errors
    /// The first term and element that cannot be in this state.
    pub fn energy(
        &mut self,
        model: &Model,
        state: &State,
        points: &[Vec3],
        pressure: &mut Vec<f64>,
    ) -> Result<f64, EnergyError> {
        let mut energy = 0.0;
        let mut dilatation = vec![0.0; self.pressures()];
        for (index, &term) in state.terms(model).iter().enumerate() {
            let at = At { points, pressure: &[], ..state.at(index) };
            let parts: Vec<Result<(f64, f64), Refusal>> = (0..term.elements())
                .into_par_iter()
                .with_min_len(256)
                .map_init(
                    || Block::ZERO,
                    |block, element| {
                        (block.energy, block.dilatation) = (0.0, 0.0);
                        match term.block(element, &at, Order::Value, block) {
                            Ok(()) => Ok((block.energy, block.dilatation)),
                            Err(cause) => Err(Refusal { element, cause }),
                        }
                    },
                )
                .collect();
            for (element, part) in parts.into_iter().enumerate() {
                let (own, theta) = part.map_err(|refusal| TermRefusal { term: index, refusal })?;
                energy += own;
                if theta != 0.0 {
                    for &n in term.nodes(element) {
                        dilatation[self.analysis.pressures[n as usize] as usize] += theta;
                    }
                }
            }
        }
        pressure.clear();
        pressure.resize(points.len(), 0.0);
        if let Some(compliance) = &mut self.compliance {
            let mut solved = Vec::new();
            compliance.solve(&dilatation, &mut solved)?;
            energy += 0.5 * dilatation.iter().zip(&solved).map(|(g, p)| g * p).sum::<f64>();
            for (node, &unknown) in self.analysis.pressures.iter().enumerate() {
                if unknown != NONE {
                    pressure[node] = solved[unknown as usize];
                }
            }
        }
        if energy.is_finite() { Ok(energy) } else { Err(EnergyError::NotFinite) }
    }

    /// Gradient (mN) by node, fixed nodes included, and the lower values of the Newton matrix.
    ///
    /// # Errors
    /// The first term and element that cannot be in this state.
    pub fn newton_system(
        &self,
        model: &Model,
        state: &State,
        curvature: Curvature,
        gradient: &mut Vec<Vec3>,
        values: &mut Vec<f64>,
    ) -> Result<(), TermRefusal> {
        gradient.clear();
        gradient.resize(model.rest.len(), Vec3::zeros());
        values.clear();
        values.extend_from_slice(&self.constant);
        let mut blocks = vec![Block::ZERO; CHUNK];
        for (index, &term) in state.terms(model).iter().enumerate() {
            let mut slots = self.analysis.slots[index].iter();
            let evaluate = |element: usize, block: &mut Block| {
                block.clear(term.nodes(element).len());
                let at = At { curvature, ..state.at(index) };
                term.block(element, &at, Order::Hessian, block)?;
                if curvature == Curvature::Projected {
                    block.project(term.nodes(element).len());
                }
                Ok(())
            };
            for first in (0..term.elements()).step_by(CHUNK) {
                let size = CHUNK.min(term.elements() - first);
                evaluate_chunk(first, &mut blocks[..size], &evaluate)
                    .map_err(|refusal| TermRefusal { term: index, refusal })?;
                for (offset, block) in blocks[..size].iter().enumerate() {
                    let nodes = term.nodes(first + offset);
                    for (a, &n) in nodes.iter().enumerate() {
                        gradient[n as usize] += block.gradient[a];
                    }
                    scatter(block, nodes.len(), term.is_mixed(), &mut slots, values);
                }
            }
        }
        Ok(())
    }

    /// Gradient (mN) of each term alone, by term and node.
    ///
    /// # Errors
    /// The first term and element that cannot be in this state.
    pub fn term_gradients(
        &self,
        model: &Model,
        state: &State,
    ) -> Result<Vec<Vec<Vec3>>, TermRefusal> {
        let terms = state.terms(model);
        let one = |index: usize| {
            let term = terms[index];
            let mut gradient = vec![Vec3::zeros(); model.rest.len()];
            let mut blocks = vec![Block::ZERO; CHUNK.min(term.elements())];
            let evaluate = |element: usize, block: &mut Block| {
                block.clear(term.nodes(element).len());
                term.block(element, &state.at(index), Order::Gradient, block)
            };
            for first in (0..term.elements()).step_by(CHUNK) {
                let size = CHUNK.min(term.elements() - first);
                evaluate_chunk(first, &mut blocks[..size], &evaluate)
                    .map_err(|refusal| TermRefusal { term: index, refusal })?;
                for (offset, block) in blocks[..size].iter().enumerate() {
                    for (a, &n) in term.nodes(first + offset).iter().enumerate() {
                        gradient[n as usize] += block.gradient[a];
                    }
                }
            }
            Ok(gradient)
        };
        (0..model.terms().len()).map(one).collect()
    }

    /// Gathers minus the free part of a nodal gradient as a right-hand side.
    pub fn right_hand_side(&self, gradient: &[Vec3]) -> Vec<f64> {
        let mut rhs = vec![0.0; self.pattern().len()];
        for (node, unknowns) in self.analysis.unknowns.iter().enumerate() {
            for axis in 0..3 {
                if unknowns[axis] != NONE {
                    rhs[unknowns[axis] as usize] = -gradient[node][axis];
                }
            }
        }
        rhs
    }

    /// Gathers nodal forces (mN) and dilatations (mm³) as a right-hand side; what belongs to no
    /// unknown is left out.
    pub fn gather(&self, forces: &[Vec3], dilatation: &[f64]) -> Vec<f64> {
        let mut rhs = vec![0.0; self.pattern().len()];
        for ((unknowns, force), swelling) in
            self.analysis.unknowns.iter().zip(forces).zip(dilatation)
        {
            let values = [force.x, force.y, force.z, *swelling];
            for (&unknown, value) in unknowns.iter().zip(values) {
                if unknown != NONE {
                    rhs[unknown as usize] = value;
                }
            }
        }
        rhs
    }

    /// Displacements and pressures of a solution of the Newton system, by node; zero where there is
    /// no unknown.
    pub fn spread(&self, x: &[f64]) -> (Vec<Vec3>, Vec<f64>) {
        let value = |u: &[u32; 4]| if u[3] == NONE { 0.0 } else { x[u[3] as usize] };
        (self.displacement(x), self.analysis.unknowns.iter().map(value).collect())
    }

    /// Spreads a solution of the Newton system over the nodes; fixed ones stay at zero.
    pub fn displacement(&self, x: &[f64]) -> Vec<Vec3> {
        let value = |unknown: u32| if unknown == NONE { 0.0 } else { x[unknown as usize] };
        self.analysis
            .unknowns
            .iter()
            .map(|u| Vec3::new(value(u[0]), value(u[1]), value(u[2])))
            .collect()
    }

    /// Whether a displacement is free.
    pub fn is_free(&self, node: usize, axis: usize) -> bool {
        self.analysis.unknowns[node][axis] != NONE
    }
}

impl State {
    /// Stores what the next load step must know of this one.
    pub(crate) fn accept(&mut self, model: &Model) {
        for (term, memory) in self.moved.terms(model).iter().zip(&mut self.memory) {
            term.accept(&self.points, self.load, memory);
        }
    }

    /// A state with the nodes at `points` and nothing remembered yet.
    pub fn new(model: &Model, points: Vec<Vec3>, load: Load) -> Self {
        let memory = model.terms().iter().map(|term| term.first_memory(&points, load)).collect();
        let mut shear_kpa = vec![0.0; points.len()];
        for term in model.terms() {
            term.raise_shear(&mut shear_kpa);
        }
        Self {
            pressure: vec![0.0; points.len()],
            points,
            memory,
            shear_kpa: shear_kpa.into(),
            load,
            moved: Moved::default(),
        }
    }

    /// The terms of the model, those that have moved on among them.
    pub fn terms<'a>(&'a self, model: &'a Model) -> Vec<&'a dyn Term> {
        self.moved.terms(model)
    }

    /// What term `index` sees.
    pub fn at(&self, index: usize) -> At<'_> {
        At {
            points: &self.points,
            pressure: &self.pressure,
            memory: &self.memory[index],
            shear_kpa: &self.shear_kpa,
            load: self.load,
            curvature: Curvature::Exact,
        }
    }

    /// The worst of all contacts.
    pub fn contact(&self, model: &Model) -> ContactCheck {
        let terms = self.terms(model).into_iter().enumerate();
        let each = terms.filter_map(|(n, t)| t.contact(&self.at(n)));
        each.fold(ContactCheck::default(), ContactCheck::worst)
    }

    /// Lets contacts move on to the elements that their nodes are over; whether any did.
    pub fn moves_on(&mut self, model: &Model) -> bool {
        self.moved.follow(model, &self.points)
    }

    /// Whether contacts know what they touch with the nodes at `points` as well as they do now.
    pub(crate) fn is_near(&self, model: &Model, points: &[Vec3]) -> bool {
        self.terms(model).iter().all(|term| term.is_near(&self.points, points))
    }

    /// Lets every contact update its multipliers.
    pub fn update_multipliers(&mut self, model: &Model) {
        for (term, memory) in self.moved.terms(model).iter().zip(&mut self.memory) {
            term.update_multipliers(&self.points, &self.shear_kpa, self.load, memory);
        }
    }

    /// Makes the penalties of all contacts stiffer.
    pub fn stiffen_contacts(&mut self, factor: f64) {
        self.shear_kpa = self.shear_kpa.iter().map(|shear| factor * shear).collect();
    }

    /// Fields of a solution that the terms know.
    pub fn report(&self, model: &Model) -> Solution {
        let mut solution = Solution { points: self.points.clone(), ..Solution::default() };
        for (index, term) in self.terms(model).iter().enumerate() {
            term.report(&self.at(index), &mut solution);
        }
        solution
    }
}

/// Why an assembly cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AssemblyError {
    /// The model is incomplete.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The linear algebra refused.
    #[error(transparent)]
    Linear(#[from] LinearError),
}

/// Why a state has no energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EnergyError {
    /// An element cannot be in this state.
    Refused(TermRefusal),
    /// The pressures cannot be found.
    Linear(LinearError),
    /// An overflow or NaN.
    NotFinite,
}

impl From<TermRefusal> for EnergyError {
    fn from(refusal: TermRefusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<LinearError> for EnergyError {
    fn from(error: LinearError) -> Self {
        Self::Linear(error)
    }
}

/// Evaluates consecutive elements in parallel; the refusal is that of the first one.
fn evaluate_chunk(
    first: usize,
    blocks: &mut [Block],
    evaluate: &(impl Fn(usize, &mut Block) -> Result<(), crate::materials::MaterialError> + Sync),
) -> Result<(), Refusal> {
    let refusals: Vec<Option<Refusal>> = blocks
        .par_iter_mut()
        .with_min_len(32)
        .enumerate()
        .map(|(offset, block)| {
            let element = first + offset;
            evaluate(element, block).err().map(|cause| Refusal { element, cause })
        })
        .collect();
    refusals.into_iter().flatten().next().map_or(Ok(()), Err)
}
