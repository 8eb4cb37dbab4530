//! Descent to a minimum of the energy at one load: Newton's method that may only go down.
//!
//! The exact second derivatives come first. Only when they give an ascent direction, or no step
//! along it goes down, the element blocks are projected to positive semi-definite ones; when that
//! fails too, a proximal stiffness is added, which fades as steps succeed. A step that inverts an
//! element or passes a limiting stretch has infinite energy and is shortened.

use crate::assemble::{Assembly, Curvature, EnergyError, State};
use crate::linear::Ldlt;
use crate::model::Model;
use mammotwin_data::Vec3;

/// When a minimum is found, and when the search is given up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonOptions {
    /// Newton iterations in one minimisation.
    pub max_iterations: usize,
    /// Largest unbalanced nodal force over the largest force of any term.
    pub residual: f64,
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { max_iterations: 80, residual: 1e-8 }
    }
}

/// How a minimisation failed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NewtonError {
    /// The starting state is not admissible.
    Start(EnergyError),
    /// No direction goes down although forces are out of balance; often an element that
    /// cannot follow.
    Stuck {
        /// Node with the largest unbalanced force.
        node: usize,
        /// What the last rejected step ran into.
        ran_into: Option<EnergyError>,
    },
    /// Too many iterations.
    Slow {
        /// Node with the largest unbalanced force.
        node: usize,
    },
}

/// Line search: sufficient decrease, and the shortest step.
const ARMIJO: f64 = 1e-4;
const SHORTEST: f64 = 1e-6;
/// Energy differences below this fraction of the energy exchanged are rounding.
const ROUNDING: f64 = 1e-13;
/// Forces are compared with at least this (mN), so that a body without load is in balance.
const LEAST_FORCE: f64 = 1.0;
/// First proximal stiffness, and its change, in units of the mean diagonal.
const PROXIMAL: f64 = 1e-4;
const PROXIMAL_GROWTH: f64 = 10.0;
const PROXIMAL_ROUNDS: usize = 6;

/// Buffers and factors that live through many minimisations of one model.
pub struct Newton {
    /// Sums of the terms.
    pub assembly: Assembly,
    system: Ldlt,
    gradient: Vec<Vec3>,
    values: Vec<f64>,
    step: Vec<f64>,
}

impl Newton {
    /// Analyses a model once.
    ///
    /// # Errors
    /// A free node without tissue, or too little memory.
    pub fn new(model: &Model) -> Result<Self, crate::assemble::AssemblyError> {
        let assembly = Assembly::new(model)?;
        let system = Ldlt::analyse(assembly.pattern().clone())?;
        Ok(Self { assembly, system, gradient: Vec::new(), values: Vec::new(), step: Vec::new() })
    }

    /// Moves `state` to a minimum of the energy and returns the number of iterations. On failure
    /// the state is the lowest one reached.
    ///
    /// # Errors
    /// How the search failed.
    pub fn minimise(
        &mut self,
        model: &Model,
        state: &mut State,
        options: &NewtonOptions,
    ) -> Result<usize, NewtonError> {
        let mut pressure = Vec::new();
        let mut energy = self
            .assembly
            .energy(model, state, &state.points, &mut pressure)
            .map_err(NewtonError::Start)?;
        std::mem::swap(&mut state.pressure, &mut pressure);
        let scale = self.force_scale(model, state)?;
        let mut proximal = 0.0;
        for iteration in 0..options.max_iterations {
            self.derivatives(model, state, Curvature::Exact)?;
            let (node, unbalanced) = self.unbalanced();
            if unbalanced <= options.residual * scale {
                return Ok(iteration);
            }
            let mut ran_into = None;
            let mut found = None;
            for attempt in 0..=PROXIMAL_ROUNDS {
                if attempt == 1 {
                    self.derivatives(model, state, Curvature::Projected)?;
                }
                if attempt > 1 {
                    proximal = f64::max(PROXIMAL, proximal * PROXIMAL_GROWTH);
                }
                let Some(direction) = self.direction(proximal) else { continue };
                match self.search(model, state, energy, &direction) {
                    Ok(lower) => {
                        found = Some(lower);
                        break;
                    }
                    Err(cause) => ran_into = cause,
                }
            }
            let Some(lower) = found else {
                return Err(NewtonError::Stuck { node, ran_into });
            };
            energy = lower;
            proximal = if proximal > PROXIMAL { proximal / PROXIMAL_GROWTH } else { 0.0 };
        }
        Err(NewtonError::Slow { node: self.unbalanced().0 })
    }

    fn derivatives(
        &mut self,
        model: &Model,
        state: &State,
        curvature: Curvature,
    ) -> Result<(), NewtonError> {
        self.assembly
            .newton_system(model, state, curvature, &mut self.gradient, &mut self.values)
            .map_err(|refusal| NewtonError::Start(refusal.into()))
    }

    /// The free node with the largest unbalanced force, and the force (mN).
    fn unbalanced(&self) -> (usize, f64) {
        let free = |node: usize, axis: usize| {
            if self.assembly.is_free(node, axis) { self.gradient[node][axis] } else { 0.0 }
        };
        let norms = (0..self.gradient.len())
            .map(|n| (n, Vec3::new(free(n, 0), free(n, 1), free(n, 2)).norm()));
        norms.fold((0, 0.0), |worst, next| if next.1 > worst.1 { next } else { worst })
    }

    /// The descent direction of the assembled system; `None` when it has none.
    fn direction(&mut self, proximal: f64) -> Option<Vec<Vec3>> {
        if proximal > 0.0 {
            let mut values = self.values.clone();
            let stiffness = proximal * self.assembly.mean_diagonal(&values);
            self.assembly.add_to_diagonal(stiffness, &mut values);
            self.system.factor(&values).ok()?;
        } else {
            self.system.factor(&self.values).ok()?;
        }
        // More negative pivots than pressures: the energy is not convex here, and Newton's step
        // leads to a saddle.
        if self.system.negative_pivots() != self.assembly.pressures() {
            return None;
        }
        let rhs = self.assembly.right_hand_side(&self.gradient);
        self.system.solve(&rhs, &mut self.step).ok()?;
        let direction = self.assembly.displacement(&self.step);
        (self.slope(&direction) < 0.0).then_some(direction)
    }

    fn slope(&self, direction: &[Vec3]) -> f64 {
        self.gradient.iter().zip(direction).map(|(g, d)| g.dot(d)).sum()
    }

    /// Moves the state down along a direction and returns the new energy, or what was in the way.
    fn search(
        &mut self,
        model: &Model,
        state: &mut State,
        energy: f64,
        direction: &[Vec3],
    ) -> Result<f64, Option<EnergyError>> {
        let slope = self.slope(direction);
        // What the forces exchange on this step bounds the rounding of its energy.
        let exchanged: f64 =
            self.gradient.iter().zip(direction).map(|(g, d)| g.norm() * d.norm()).sum();
        let slack = ROUNDING * (energy.abs() + exchanged);
        let mut cause = None;
        let mut length = 1.0;
        let mut pressure = Vec::new();
        while length > SHORTEST {
            let points: Vec<Vec3> =
                state.points.iter().zip(direction).map(|(p, d)| p + length * d).collect();
            match self.assembly.energy(model, state, &points, &mut pressure) {
                Ok(trial) if trial <= energy + ARMIJO * length * slope + slack => {
                    state.points = points;
                    state.pressure = pressure;
                    return Ok(trial);
                }
                Ok(_) => {}
                Err(error) => cause = Some(error),
            }
            length *= 0.5;
        }
        Err(cause)
    }

    /// The largest force of any term (mN): the sum of the norms of its nodal forces.
    fn force_scale(&self, model: &Model, state: &State) -> Result<f64, NewtonError> {
        let gradients = self
            .assembly
            .term_gradients(model, state)
            .map_err(|refusal| NewtonError::Start(refusal.into()))?;
        let force = |g: &Vec<Vec3>| g.iter().map(|f| f.norm()).sum::<f64>();
        Ok(gradients.iter().map(force).fold(LEAST_FORCE, f64::max))
    }
}
