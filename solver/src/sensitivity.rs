//! Derivatives of an equilibrium by the numbers of its model: moduli, weight, stiffness, load.
//!
//! In equilibrium the forces R of all terms on the free nodes vanish, g - M p = 0 for the nodal
//! pressures, and d = 0 where a contact is closed, with tractions t there. By the implicit function
//! theorem a number θ of the model moves nodes, pressures and tractions by
//!
//! ⎡K  G  B⎤ ⎡u⎤     ⎡∂R/∂θ        ⎤
//! ⎢Gᵀ -M  ⎥ ⎢p⎥ = - ⎢∂(g - M p)/∂θ⎥
//! ⎣Bᵀ     ⎦ ⎣t⎦     ⎣∂d/∂θ        ⎦
//!
//! The converged tangent is factorised once, with the penalties of the contacts in K; the last row
//! is met by conjugate gradients on the tractions, a few more substitutions, so that no derivative
//! depends on a penalty.
//! *Direct*: one solution for each number, for any observables ([`Linearised::response`]).
//! *Adjoint*: the matrix is symmetric, one solution for each observable does for any numbers
//! ([`Linearised::adjoint`]) (Michaleris, Tortorelli & Vidal, *Int. J. Numer. Meth. Engng.* 37
//! (1994) 2471, <https://doi.org/10.1002/nme.1620371408>).
//!
//! What depends on θ at fixed nodes, pressures and tractions is differenced centrally from the
//! assembled sums of two models beside this one: nothing is solved again, and for a number that the
//! forces are linear in (modulus, density, stiffness) the difference is exact but for rounding.
//!
//! Friction and foam lag behind the state and remember their way: models with them are refused. A
//! derivative is that of the contacts as they are: nodes about to open or close are not foreseen.

mod error;
mod observable;

pub use error::SensitivityError;
pub use observable::Observable;

use observable::Functional;

use crate::assemble::{Assembly, State};
use crate::linear::{Ldlt, Precision};
use crate::model::Model;
use crate::solve::{self, Options};
use crate::terms::{Block, Curvature, Load, Order, Term, Touching};
use mammotwin_data::{
    Vec3,
    progress::Silent,
    solution::{Checks, Solution},
};

/// Distances of closed contacts change by less than this part of the largest displacement.
const CLOSED: f64 = 1e-13;
/// The largest part that is let pass when more rounds do not help.
const LOOSE: f64 = 1e-8;
/// Most rounds of multipliers.
const ROUNDS: usize = 40;

/// What a number θ changes at fixed nodes, pressures and tractions.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// ∂(∂E/∂x)/∂θ of each term and node (mN by unit of θ).
    gradients: Vec<Vec<Vec3>>,
    /// ∂(g - M p)/∂θ by node (mm³ by unit).
    dilatation: Vec<f64>,
    /// ∂d/∂θ of the closed contacts (mm by unit).
    distance: Vec<f64>,
}

/// How the equilibrium follows a number θ.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// ∂(position)/∂θ by node (mm by unit); zero where nodes are fixed.
    pub moved: Vec<Vec3>,
    /// ∂(pressure)/∂θ by node (kPa by unit), positive in tension.
    pub pressure: Vec<f64>,
    /// ∂(traction)/∂θ of the closed contacts (kPa by unit).
    traction: Vec<f64>,
}

/// The adjoint state of one observable.
pub struct Adjoint {
    state: Response,
    functional: Functional,
}

/// An equilibrium with its tangent, factorised.
pub struct Linearised<'a> {
    model: &'a Model,
    state: State,
    assembly: Assembly,
    factors: Ldlt,
    /// Closed contacts, with the index of their term.
    closed: Vec<(usize, Touching)>,
}

impl<'a> Linearised<'a> {
    /// The equilibrium under gravity, as [`solve::solve`] finds it.
    ///
    /// # Errors
    /// No equilibrium, or one without derivatives.
    pub fn solve(
        model: &'a Model,
        start: &[Vec3],
        options: &Options,
    ) -> Result<(Solution, Self), SensitivityError> {
        let first = Load { gravity: 0.0, ..Load::GRAVITY };
        Self::follow(model, start, first, &[Load::GRAVITY], options)
    }

    /// The equilibrium at the end of a path of loads from `first`, with the nodes first at `start`
    /// (mm).
    ///
    /// # Errors
    /// No equilibrium, or one without derivatives.
    pub fn follow(
        model: &'a Model,
        start: &[Vec3],
        first: Load,
        path: &[Load],
        options: &Options,
    ) -> Result<(Solution, Self), SensitivityError> {
        if let Some(term) = model.terms().iter().find(|term| term.lags() || term.gives_way()) {
            return Err(SensitivityError::Lags(term.name().into()));
        }
        let (mut newton, mut state) = solve::prepare(model, start, first)?;
        let mut counts = Checks::default();
        for load in path {
            solve::walk(&mut newton, model, &mut state, *load, options, &mut counts, &Silent)?;
        }
        let solution = solve::finish(&newton, model, &state, counts)?;
        let assembly = newton.assembly;
        let mut factors = assembly.system(Precision::Double)?;
        let (mut gradient, mut values) = (Vec::new(), Vec::new());
        assembly.newton_system(model, &state, Curvature::Exact, &mut gradient, &mut values)?;
        factors.factor(&values)?;
        let (negative, pressures) = (factors.negative_pivots(), assembly.pressures());
        if negative != pressures {
            return Err(SensitivityError::Unstable { negative, pressures });
        }
        let closed = touching(model, &state).filter(|(_, t)| t.closed).collect();
        Ok((solution, Self { model, state, assembly, factors, closed }))
    }

    /// What a number changes, from two models that have it smaller and larger by `step`, each under
    /// its own load; they have this model's elements.
    ///
    /// # Errors
    /// Other elements, or a model that cannot be in this state.
    pub fn change(
        &self,
        [smaller, larger]: [(&Model, Load); 2],
        step: f64,
    ) -> Result<Change, SensitivityError> {
        let [low, high] = [self.beside(smaller.0, smaller.1)?, self.beside(larger.0, larger.1)?];
        let slope = |low: f64, high: f64| (high - low) / (2.0 * step);
        let slopes =
            |low: &[f64], high: &[f64]| low.iter().zip(high).map(|(l, h)| slope(*l, *h)).collect();
        let vectors = |(low, high): (&Vec<Vec3>, &Vec<Vec3>)| {
            low.iter().zip(high).map(|(l, h)| (h - l) / (2.0 * step)).collect()
        };
        Ok(Change {
            gradients: low.gradients.iter().zip(&high.gradients).map(vectors).collect(),
            dilatation: slopes(&low.dilatation, &high.dilatation),
            distance: slopes(&low.distance, &high.distance),
        })
    }

    /// The same for a number of the model alone, under the load of the equilibrium.
    ///
    /// # Errors
    /// As [`Self::change`].
    pub fn change_of_model(
        &self,
        [smaller, larger]: [&Model; 2],
        step: f64,
    ) -> Result<Change, SensitivityError> {
        self.change([smaller, larger].map(|model| (model, self.state.load)), step)
    }

    /// Sums of another model in this state.
    fn beside(&self, model: &Model, load: Load) -> Result<Change, SensitivityError> {
        let other = |name: &str| Err(SensitivityError::Other(name.into()));
        if model.rest.len() != self.model.rest.len() || model.terms().len() != self.memories() {
            return other("the model");
        }
        for (own, term) in self.model.terms().iter().zip(model.terms()) {
            if own.name() != term.name()
                || own.elements() != term.elements()
                || (0..own.elements()).any(|e| own.nodes(e) != term.nodes(e))
            {
                return other(own.name());
            }
        }
        let state = State { load, ..self.state.clone() };
        let gradients = self.assembly.term_gradients(model, &state)?;
        let mut dilatation = vec![0.0; model.rest.len()];
        let mut block = Block::ZERO;
        for (index, term) in model.terms().iter().enumerate().filter(|(_, term)| term.is_mixed()) {
            for element in 0..term.elements() {
                (block.energy, block.dilatation) = (0.0, 0.0);
                let refused = |cause: crate::materials::MaterialError| SensitivityError::Refused {
                    term: index,
                    element,
                    cause: cause.to_string(),
                };
                term.block(element, &state.at(index), Order::Value, &mut block).map_err(refused)?;
                let compliance = term.compliance(element);
                let nodes = term.nodes(element);
                for (a, &node) in nodes.iter().enumerate() {
                    let part =
                        |(b, &n): (usize, &u32)| compliance[(a, b)] * state.pressure[n as usize];
                    let pressed: f64 = nodes.iter().enumerate().map(part).sum();
                    dilatation[node as usize] += block.dilatation - pressed;
                }
            }
        }
        let own = touching(self.model, &self.state);
        let distance = own.zip(touching(model, &state)).filter(|((_, own), _)| own.closed);
        let distance = distance.map(|(_, (_, beside))| beside.distance_mm).collect();
        Ok(Change { gradients, dilatation, distance })
    }

    fn memories(&self) -> usize {
        self.state.memory.len()
    }

    /// How the equilibrium follows a number: the direct way.
    ///
    /// # Errors
    /// A tangent that cannot be solved with.
    pub fn response(&mut self, change: &Change) -> Result<Response, SensitivityError> {
        let load = negative(change);
        self.saddle(&load)
    }

    /// Derivative of an observable by the number of a change, from its response.
    ///
    /// # Errors
    /// A term that is not there.
    pub fn derivative(
        &self,
        observable: &Observable,
        change: &Change,
        response: &Response,
    ) -> Result<f64, SensitivityError> {
        let functional = self.functional(observable)?;
        Ok(functional.of(response) + functional.explicit(change))
    }

    /// The adjoint state of an observable.
    ///
    /// # Errors
    /// A term that is not there, or a tangent that cannot be solved with.
    pub fn adjoint(&mut self, observable: &Observable) -> Result<Adjoint, SensitivityError> {
        let functional = self.functional(observable)?;
        // The rows of the constraints are those of areas times distances.
        let per_area = |(traction, (_, t)): (&f64, &(usize, Touching))| traction / t.area_mm2;
        let load = Response {
            moved: functional.moved.clone(),
            pressure: functional.pressure.clone(),
            traction: functional.traction.iter().zip(&self.closed).map(per_area).collect(),
        };
        Ok(Adjoint { state: self.saddle(&load)?, functional })
    }

    /// Derivative of the observable of an adjoint state by the number of a change.
    pub fn adjoint_derivative(&self, adjoint: &Adjoint, change: &Change) -> f64 {
        let load = negative(change);
        let Response { moved, pressure, traction } = &adjoint.state;
        let works = moved.iter().zip(&load.moved).map(|(w, f)| w.dot(f));
        let swells = pressure.iter().zip(&load.pressure).map(|(w, f)| w * f);
        let opens = traction.iter().zip(&load.traction).zip(&self.closed);
        let opens = opens.map(|((w, gap), (_, t))| t.area_mm2 * w * gap);
        let sum = works.sum::<f64>() + swells.sum::<f64>() + opens.sum::<f64>();
        sum + adjoint.functional.explicit(change)
    }

    /// Solves the tangent with its contacts closed. `load` has forces (mN), dilatations (mm³) and,
    /// for each closed contact, the change of its distance (mm) by the displacement.
    ///
    /// The tractions are found by conjugate gradients. With the penalties in the tangent these are
    /// nearly the inverse of what tractions do to the distances, hence a few rounds do.
    fn saddle(&mut self, load: &Response) -> Result<Response, SensitivityError> {
        let (mut moved, mut pressure) = self.solve_with(&load.moved, &load.pressure)?;
        let mut traction = vec![0.0; self.closed.len()];
        let none = vec![0.0; pressure.len()];
        let opened = self.opened(&moved);
        let mut left: Vec<f64> =
            opened.iter().zip(&load.traction).map(|(moved, wanted)| moved - wanted).collect();
        let mut search = Vec::new();
        let (mut before, mut off, mut far) = (0.0, f64::INFINITY, f64::MIN_POSITIVE);
        for _ in 0..ROUNDS {
            far = moved.iter().map(|u| u.norm()).fold(far, f64::max);
            off = left.iter().fold(0.0, |off: f64, gap| off.max(gap.abs())) / far;
            if off <= CLOSED {
                break;
            }
            let pull: Vec<f64> = left.iter().zip(&self.closed).map(penalised).collect();
            let size = self.work(&left, &pull);
            let share = if before > 0.0 { size / before } else { 0.0 };
            before = size;
            search.resize(pull.len(), 0.0);
            search
                .iter_mut()
                .zip(&pull)
                .for_each(|(search, pull)| *search = pull + share * *search);
            let (by, _) = self.solve_with(&self.tractions(&search), &none)?;
            let opens = self.opened(&by);
            let step = size / self.work(&opens, &search);
            if !step.is_finite() {
                break;
            }
            traction.iter_mut().zip(&search).for_each(|(t, s)| *t += step * s);
            left.iter_mut().zip(&opens).for_each(|(left, by)| *left -= step * by);
            let mut forces = self.tractions(&traction);
            forces.iter_mut().zip(&load.moved).for_each(|(pulled, load)| *pulled = load - *pulled);
            (moved, pressure) = self.solve_with(&forces, &load.pressure)?;
        }
        if off > LOOSE {
            return Err(SensitivityError::Contact(off));
        }
        Ok(Response { moved, pressure, traction })
    }

    /// Displacements (mm) and pressures (kPa) of the tangent with its penalties under forces (mN)
    /// and dilatations (mm³).
    fn solve_with(
        &mut self,
        forces: &[Vec3],
        dilatation: &[f64],
    ) -> Result<(Vec<Vec3>, Vec<f64>), SensitivityError> {
        let rhs = self.assembly.gather(forces, dilatation);
        let mut solved = Vec::new();
        self.factors.solve(&rhs, &mut solved)?;
        Ok(self.assembly.spread(&solved))
    }

    /// Gradients (mN) that tractions (kPa) of the closed contacts are.
    fn tractions(&self, traction: &[f64]) -> Vec<Vec3> {
        let mut forces = vec![Vec3::zeros(); self.state.points.len()];
        for (t, (_, contact)) in traction.iter().zip(&self.closed) {
            forces[contact.node as usize] += contact.area_mm2 * *t * contact.normal;
        }
        forces
    }

    /// How far (mm) displacements open the closed contacts.
    fn opened(&self, moved: &[Vec3]) -> Vec<f64> {
        let opens = |(_, c): &(usize, Touching)| c.normal.dot(&moved[c.node as usize]);
        self.closed.iter().map(opens).collect()
    }

    /// Work (µJ) of tractions on distances.
    fn work(&self, distance: &[f64], traction: &[f64]) -> f64 {
        let pairs = distance.iter().zip(traction).zip(&self.closed);
        pairs.map(|((d, t), (_, contact))| contact.area_mm2 * d * t).sum()
    }
}

/// Traction (kPa) of the penalty of a contact that is open by a distance (mm).
fn penalised((distance, (_, contact)): (&f64, &(usize, Touching))) -> f64 {
    contact.penalty_kpa_per_mm * distance
}

/// The right-hand side of a change.
fn negative(change: &Change) -> Response {
    let nodes = change.dilatation.len();
    let sum = |n: usize| -change.gradients.iter().map(|g| g[n]).sum::<Vec3>();
    Response {
        moved: (0..nodes).map(sum).collect(),
        pressure: change.dilatation.iter().map(|v| -v).collect(),
        traction: change.distance.iter().map(|v| -v).collect(),
    }
}

/// Nodes that all contacts may touch, with the index of their term.
fn touching<'a>(
    model: &'a Model,
    state: &'a State,
) -> impl Iterator<Item = (usize, Touching)> + 'a {
    let each = |(index, term): (usize, &'a dyn Term)| {
        term.touching(&state.at(index)).into_iter().map(move |touching| (index, touching))
    };
    model.terms().iter().map(|term| term.as_ref()).enumerate().flat_map(each)
}
