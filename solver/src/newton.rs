//! Descent to a minimum of the energy at one load: Newton's method that may only go down.
//!
//! The exact second derivatives come first. Where they are not positive definite, or no step along
//! Newton's direction goes down, just enough of a convex stiffness is added (the H¹ norm weighted
//! with the shear modulus); it grows until a step succeeds and fades afterwards. Barely enough is
//! what matters: past a point of buckling the step then follows the direction of negative
//! curvature with long strides, where a Hessian made convex element by element creeps. A step that
//! inverts an element or passes a limiting stretch has infinite energy and is shortened.

mod convexity;

use crate::assemble::{Assembly, AssemblyError, EnergyError, State, moved::Moved};
use crate::linear::{Ldlt, Precision};
use crate::model::Model;
use crate::terms::{At, Curvature, Load};
use convexity::{Convexity, GREATEST_SHARE, stride};
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
/// Least part of a step that is kept for contacts to stay near to what they touch.
const NEAREST: f64 = 0.01;
/// Energy differences below this fraction of the energy exchanged are rounding.
const ROUNDING: f64 = 1e-13;
/// Part of a load step over which the change of forces is differenced.
const NEARBY: f64 = 1e-5;
/// A step that only rounding would notice, or that leads nowhere lower, ends the search below this multiple of the
/// residual.
const NEARLY: f64 = 100.0;
/// Part of the diagonal of the stiffness that is rounding.
const NOTHING: f64 = 1e-9;
/// Forces are compared with at least this (mN), so that a body without load is in balance.
///
/// Rounding leaves 1.4e-6 mN on a body of 200 mm with skin of 10 kPa that nothing loads.
const LEAST_FORCE: f64 = 1000.0;

/// How a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// At a minimum.
    Minimum,
    /// Lower, where contacts have to look anew at what they touch ([`crate::terms::Term::is_near`]).
    Away,
}

/// Buffers and factors that live through many minimisations of one model.
pub struct Newton {
    /// Sums of the terms.
    pub assembly: Assembly,
    /// The contacts that it was analysed with.
    moved: Moved,
    system: Ldlt,
    gradient: Vec<Vec3>,
    values: Vec<f64>,
    shift: Vec<f64>,
    step: Vec<f64>,
    /// Directions in which the last system was not convex.
    excess: usize,
    /// Iterations of the last minimisation, also of one that failed.
    iterations: usize,
}

impl Newton {
    /// Analyses a model once.
    ///
    /// # Errors
    /// A free node without tissue, or too little memory.
    pub fn new(model: &Model) -> Result<Self, AssemblyError> {
        let assembly = Assembly::new(model)?;
        let system = assembly.system(Precision::Single)?;
        Ok(Self {
            assembly,
            moved: Moved::default(),
            system,
            gradient: Vec::new(),
            values: Vec::new(),
            shift: Vec::new(),
            step: Vec::new(),
            excess: 0,
            iterations: 0,
        })
    }

    /// Iterations of the last minimisation: steps that were taken, and where it failed the one that found no step.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Analyses the model anew where contacts of `state` have moved on.
    fn follow(&mut self, model: &Model, state: &State) -> Result<(), NewtonError> {
        if self.moved.same(&state.moved) {
            return Ok(());
        }
        let analysed = Assembly::moved(model, &state.moved).and_then(|assembly| {
            let system = assembly.system(Precision::Single)?;
            Ok((assembly, system))
        });
        let cause = |error| match error {
            AssemblyError::Linear(error) => NewtonError::Start(EnergyError::Linear(error)),
            AssemblyError::Model(_) => NewtonError::Start(EnergyError::NotFinite),
        };
        (self.assembly, self.system) = analysed.map_err(cause)?;
        self.moved = state.moved.clone();
        Ok(())
    }

    /// Moves `state` to a minimum of the energy, or as near to it as contacts know what they touch; `first` are the second
    /// derivatives of the first iteration. On failure the state is the lowest one reached.
    ///
    /// # Errors
    /// How the search failed.
    pub fn minimise(
        &mut self,
        model: &Model,
        state: &mut State,
        options: &NewtonOptions,
        first: Curvature,
    ) -> Result<End, NewtonError> {
        // From within the pool its loops need not be handed over to another thread.
        rayon::scope(|_| self.descend(model, state, options, first))
    }

    fn descend(
        &mut self,
        model: &Model,
        state: &mut State,
        options: &NewtonOptions,
        first: Curvature,
    ) -> Result<End, NewtonError> {
        self.iterations = 0;
        self.follow(model, state)?;
        let mut pressure = Vec::new();
        let mut energy = self
            .assembly
            .energy(model, state, &state.points, &mut pressure)
            .map_err(NewtonError::Start)?;
        std::mem::swap(&mut state.pressure, &mut pressure);
        let scale = self.force_scale(model, state)?;
        let mut convexity = Convexity::default();
        for iteration in 0..options.max_iterations {
            let convex = convexity.share > 0.0 || iteration == 0 && first == Curvature::Convex;
            let mut curvature = if convex { Curvature::Convex } else { Curvature::Exact };
            self.derivatives(model, state, curvature)?;
            let (node, unbalanced) = self.unbalanced();
            if unbalanced <= options.residual * scale {
                return Ok(End::Minimum);
            }
            let mut ran_into = None;
            let mut shifted = false;
            let (lower, length, away) = loop {
                let share = convexity.share;
                if share > 0.0 && curvature == Curvature::Exact {
                    curvature = Curvature::Convex;
                    self.derivatives(model, state, curvature)?;
                }
                if share > 0.0 && !shifted {
                    self.assembly.shift(model, state, &mut self.shift);
                    shifted = true;
                }
                if let Some(direction) = self.direction(share) {
                    let nearly = unbalanced <= NEARLY * options.residual * scale;
                    if nearly && -self.slope(&direction) <= self.rounding(energy, &direction) {
                        return Ok(End::Minimum);
                    }
                    let longest = if share > 0.0 { stride(&direction) } else { 1.0 };
                    let near = self.near(model, state, &direction, longest);
                    match self.search(model, state, energy, &direction, near) {
                        Ok((energy, length)) => {
                            break (energy, length, length >= near && near < longest);
                        }
                        // Stiff tissue at rest: its energy is too small for `rounding` to tell.
                        Err(_) if nearly => return Ok(End::Minimum),
                        Err(cause) => {
                            tracing::trace!(share, longest, ?cause, "no step goes down");
                            ran_into = cause;
                        }
                    }
                }
                convexity.raise(self.excess);
                if convexity.share > GREATEST_SHARE {
                    self.iterations += 1;
                    return Err(NewtonError::Stuck { node, ran_into });
                }
            };
            energy = lower;
            self.iterations += 1;
            let place_mm = state.points[node];
            tracing::trace!(
                iteration,
                energy,
                unbalanced,
                node,
                ?place_mm,
                share = convexity.share,
                length,
                "newton"
            );
            if away {
                return Ok(End::Away);
            }
            convexity.lower(length >= 1.0);
        }
        Err(NewtonError::Slow { node: self.unbalanced().0 })
    }

    /// Moves a state that is in balance along the path of equilibria towards the load `target`, to
    /// first order, as far as the energy there falls; the state's load becomes `target`.
    pub fn predict(&mut self, model: &Model, state: &mut State, target: Load) {
        if state.load == target || self.follow(model, state).is_err() {
            return;
        }
        let mut moved = state.clone();
        moved.load = Load::between(state.load, target, NEARBY);
        let forces = [&*state, &moved].map(|s| self.assembly.term_gradients(model, s));
        state.load = target;
        let ([Ok(here), Ok(near)], Ok(())) =
            (forces, self.derivatives(model, &moved, Curvature::Exact))
        else {
            return;
        };
        self.gradient.fill(Vec3::zeros());
        for (here, near) in here.iter().zip(&near) {
            for ((sum, a), b) in self.gradient.iter_mut().zip(here).zip(near) {
                *sum += (b - a) / NEARBY;
            }
        }
        let Some(direction) = self.direction(0.0) else { return };
        let mut pressure = Vec::new();
        let energy = self.assembly.energy(model, state, &state.points, &mut pressure);
        let mut lowest = energy.unwrap_or(f64::INFINITY);
        let from = state.points.clone();
        for length in [0.25, 0.5, 1.0] {
            let points: Vec<Vec3> =
                from.iter().zip(&direction).map(|(p, d)| p + length * d).collect();
            if !state.is_near(model, &points) {
                break;
            }
            match self.assembly.energy(model, state, &points, &mut pressure) {
                Ok(energy) if energy < lowest => {
                    lowest = energy;
                    state.points = points;
                    state.pressure.clone_from(&pressure);
                }
                _ => {}
            }
        }
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

    /// The descent direction of the assembled system with a share of the convex stiffness; `None`
    /// when it has none.
    fn direction(&mut self, share: f64) -> Option<Vec<Vec3>> {
        self.excess = 0;
        self.system.factor_sum(&self.values, share, &self.shift).ok()?;
        if !self.is_convex(share) {
            return None;
        }
        let rhs = self.assembly.right_hand_side(&self.gradient);
        self.system.solve(&rhs, &mut self.step).ok()?;
        // What factors of single precision cannot solve has others now.
        if !self.is_convex(share) {
            return None;
        }
        let direction = self.assembly.displacement(&self.step);
        (self.slope(&direction) < 0.0).then_some(direction)
    }

    /// Whether the factors have no more negative pivots than there are pressures: else the energy is not convex, and
    /// Newton's step leads to a saddle.
    fn is_convex(&mut self, share: f64) -> bool {
        let (negative, pressures) = (self.system.negative_pivots(), self.assembly.pressures());
        self.excess = negative.saturating_sub(pressures);
        if negative != pressures {
            tracing::trace!(share, negative, pressures, "not convex");
        }
        negative == pressures
    }

    /// Directions in which the energy falls to second order from a state: negative eigenvalues of its
    /// exact second derivatives beyond those of the pressures. Zero where it has none.
    pub fn falling(&mut self, model: &Model, state: &State) -> usize {
        let known = self.follow(model, state);
        if known.and_then(|()| self.derivatives(model, state, Curvature::Exact)).is_err() {
            return 0;
        }
        // Motions that cost nothing, as those of a body that slips, do not count.
        let starts = &self.assembly.pattern().starts;
        for &diagonal in &starts[..starts.len() - 1] {
            self.values[diagonal] += NOTHING * self.values[diagonal].max(0.0);
        }
        // The verdict rests on small eigenvalues.
        let Ok(mut system) = self.assembly.system(Precision::Double) else { return 0 };
        let known = system.factor(&self.values).is_ok();
        let negative = if known { system.negative_pivots() } else { 0 };
        negative.saturating_sub(self.assembly.pressures())
    }

    /// The longest step along a direction, at most `longest`, on which contacts stay near to what they touch.
    fn near(&self, model: &Model, state: &State, direction: &[Vec3], longest: f64) -> f64 {
        let is_near = |length: f64| {
            let ways = state.points.iter().zip(direction);
            state.is_near(model, &ways.map(|(p, d)| p + length * d).collect::<Vec<Vec3>>())
        };
        if is_near(longest) {
            return longest;
        }
        let mut length = 0.5 * longest;
        while length > NEAREST * longest && !is_near(length) {
            length *= 0.5;
        }
        length
    }

    fn slope(&self, direction: &[Vec3]) -> f64 {
        self.gradient.iter().zip(direction).map(|(g, d)| g.dot(d)).sum()
    }

    /// Changes of the energy on this step that are rounding: what its forces exchange bounds them.
    fn rounding(&self, energy: f64, direction: &[Vec3]) -> f64 {
        let exchanged: f64 =
            self.gradient.iter().zip(direction).map(|(g, d)| g.norm() * d.norm()).sum();
        ROUNDING * (energy.abs() + exchanged)
    }

    /// Nodes that have gone a `length` along a direction `from` where they were, those in contact
    /// along their surfaces: on a straight line they would soon press into these or leave them.
    fn along(
        &self,
        model: &Model,
        state: &State,
        from: &[Vec3],
        direction: &[Vec3],
        length: f64,
    ) -> Vec<Vec3> {
        let step: Vec<Vec3> = direction.iter().map(|d| length * d).collect();
        let mut points: Vec<Vec3> = from.iter().zip(&step).map(|(p, d)| p + d).collect();
        for (index, term) in state.terms(model).iter().enumerate() {
            term.keep_to_surface(&At { points: from, ..state.at(index) }, &step, &mut points);
        }
        for (node, (point, from)) in points.iter_mut().zip(from).enumerate() {
            for axis in (0..3).filter(|&axis| !self.assembly.is_free(node, axis)) {
                point[axis] = from[axis];
            }
        }
        points
    }

    /// Moves the state down along a direction and returns the new energy and the length of the
    /// step, or what was in the way. A whole step is doubled as long as that goes down and it is
    /// not longer than `longest`: where the energy is not convex a single one may lead a
    /// negligible way along the direction in which it falls.
    fn search(
        &mut self,
        model: &Model,
        state: &mut State,
        energy: f64,
        direction: &[Vec3],
        longest: f64,
    ) -> Result<(f64, f64), Option<EnergyError>> {
        let (slope, slack) = (self.slope(direction), self.rounding(energy, direction));
        let from = state.points.clone();
        let mut cause = None;
        let first = f64::min(1.0, longest);
        let mut length = first;
        let mut pressure = Vec::new();
        let mut lowest = loop {
            let points = self.along(model, state, &from, direction, length);
            match self.assembly.energy(model, state, &points, &mut pressure) {
                Ok(trial) if trial <= energy + ARMIJO * length * slope + slack => {
                    state.points = points;
                    std::mem::swap(&mut state.pressure, &mut pressure);
                    break trial;
                }
                Ok(_) => {}
                Err(error) => cause = Some(error),
            }
            length *= 0.5;
            if length <= SHORTEST * first {
                return Err(cause);
            }
        };
        while length >= first && 2.0 * length <= longest {
            let points = self.along(model, state, &from, direction, 2.0 * length);
            match self.assembly.energy(model, state, &points, &mut pressure) {
                Ok(trial) if trial < lowest => {
                    (lowest, length) = (trial, 2.0 * length);
                    state.points = points;
                    std::mem::swap(&mut state.pressure, &mut pressure);
                }
                _ => break,
            }
        }
        Ok((lowest, length))
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
