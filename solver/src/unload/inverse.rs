//! The inverse motion: rest positions for which the known shape is in balance.
//!
//! The loaded positions x are known, the rest positions X are the unknowns of r(x; X) = 0, the
//! out-of-balance forces (Govindjee & Mihalic, *Comput. Methods Appl. Mech. Eng.* 136 (1996) 47).
//! The supports are known too: fixed nodes rest where they are held, gliding nodes rest on their
//! surface, which takes up any normal force.
//!
//! Friction depends on the path, and the path is not known: it is taken for the one of a single load
//! step from rest. Slip then is x - X, and with the normal force known from x it is a force that
//! depends on X alone.
//!
//! With F from `transport`, ∂r/∂X ≈ -K F with the stiffness K of the loaded body. Newton's
//! equations are therefore solved by GMRES on K⁻¹ (∂r/∂X) (-F⁻¹), which is near the identity, with
//! ∂r/∂X by differences. Unknowns and residuals are then nodal displacements: K⁻¹ r foretells by
//! how far the loaded body misses its known shape. A step must lower this miss with the K of its
//! start (Deuflhard, *Newton methods for nonlinear problems* (2004), ch. 3). When no step does,
//! part of the gravity comes first. Rest shapes from which the known shape would be an unstable
//! equilibrium solve the equations too; they are refused.

use super::dot;
use super::supports::{Normals, normals, onto_surfaces, tangential};
use super::transport::pull_back;
use crate::assemble::{Assembly, State};
use crate::linear::{Ldlt, Precision, gmres};
use crate::model::Model;
use crate::terms::{Block, Curvature, Load, Order};
use mammotwin_data::{Mat3, Vec3};

/// Newton steps at one load.
const MAX_STEPS: usize = 12;
/// Applications of the linearised forces in one Newton step, and where it ends.
const MAX_PRODUCTS: usize = 40;
const LINEAR_RESIDUAL: f64 = 0.05;
/// Largest displacement (mm) of the differences.
const DIFFERENCE_MM: f64 = 1e-5;
/// Line search: part of the foretold decrease that must be reached, and the shortest step.
const DECREASE: f64 = 0.25;
const SHORTEST: f64 = 1.0 / 8.0;
/// Shortest steps at one load that are taken although they do not lower the miss.
const MAX_FORCED: usize = 4;
/// Foretold miss (mm) from which a stalled search is left to the fixed point, the one that is
/// aimed at under part of the load, and the smallest part that is tried.
const NEAR_MM: f64 = 0.5;
const ON_THE_WAY_MM: f64 = 0.1;
const SMALLEST_PART: f64 = 1.0 / 16.0;
/// Shares of the convex stiffness that are tried: the first where the loaded body is stable, the
/// others with the stiffness made convex element by element.
const SHIFTS: [f64; 6] = [0.0, 0.0, 0.01, 0.1, 1.0, 10.0];

/// What the search did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effort {
    /// Newton steps.
    pub steps: usize,
    /// Evaluations of the forces, each on a model of its own.
    pub evaluations: usize,
}

/// Rest positions, as far as the search came.
pub(super) struct Found {
    pub rest: Vec<Vec3>,
    /// Fraction of gravity that they balance.
    pub carried: f64,
    pub effort: Effort,
}

/// Finds rest positions (mm) that put the model of `build` in balance at `known`, to a foretold
/// miss of `tolerance_mm`; Newton begins at `guess`.
pub(super) fn inverse<E: std::fmt::Display>(
    known: &[Vec3],
    guess: &[Vec3],
    build: &impl Fn(&[Vec3]) -> Result<Model, E>,
    tolerance_mm: f64,
    report: &dyn Fn(f64),
) -> Result<Found, String> {
    let first = build(known).map_err(|cause| cause.to_string())?;
    let mut search = Search::new(&first, known, build)?;
    let mut rest = guess.to_vec();
    search.keep_supports(&first, &mut rest);
    let off_mm = search.balance(&mut rest, 1.0, tolerance_mm);
    if off_mm <= NEAR_MM {
        return Ok(Found { rest, carried: 1.0, effort: search.effort });
    }
    let mut rest = known.to_vec();
    let (mut done, mut part) = (0.0, 0.5);
    while done < 1.0 && part >= SMALLEST_PART {
        let to = f64::min(1.0, done + part);
        let mut trial = rest.clone();
        let wanted = if to < 1.0 { ON_THE_WAY_MM } else { tolerance_mm };
        if search.balance(&mut trial, to, wanted) <= NEAR_MM {
            (rest, done) = (trial, to);
            report(done);
        } else {
            part *= 0.5;
        }
    }
    Ok(Found { rest, carried: done, effort: search.effort })
}

/// The body held at its known shape.
struct Search<'a, B> {
    known: &'a [Vec3],
    known_normals: Normals,
    build: &'a B,
    assembly: Assembly,
    system: Ldlt,
    values: Vec<f64>,
    shift: Vec<f64>,
    state: State,
    /// Elements of each term.
    elements: Vec<usize>,
    effort: Effort,
}

/// The forces with the known shape at one rest shape.
struct Forces {
    model: Model,
    /// Out-of-balance forces (mN) along what is free.
    unbalanced: Vec<Vec3>,
}

/// The linearisation at one rest shape.
struct Linear {
    /// F⁻¹ at each node.
    pull: Vec<Mat3>,
    /// Whether the loaded body is stable.
    stable: bool,
    rest_normals: Normals,
}

impl<'a, E: std::fmt::Display, B: Fn(&[Vec3]) -> Result<Model, E>> Search<'a, B> {
    fn new(first: &Model, known: &'a [Vec3], build: &'a B) -> Result<Self, String> {
        let assembly = Assembly::new(first).map_err(|cause| cause.to_string())?;
        let system = assembly.system(Precision::Double).map_err(|cause| cause.to_string())?;
        Ok(Self {
            known,
            known_normals: normals(first, known),
            build,
            assembly,
            system,
            values: Vec::new(),
            shift: Vec::new(),
            state: State::new(first, known.to_vec(), Load::GRAVITY),
            elements: first.terms().iter().map(|t| t.elements()).collect(),
            effort: Effort::default(),
        })
    }

    /// Fixed nodes rest where they are held, gliding nodes on their surface.
    fn keep_supports(&self, model: &Model, rest: &mut [Vec3]) {
        for (node, place) in rest.iter_mut().enumerate() {
            for axis in 0..3 {
                if model.fixed()[node][axis] {
                    place[axis] = self.known[node][axis];
                }
            }
        }
        onto_surfaces(model, rest);
    }

    /// The forces on the known shape when the body rests at `rest`; `None` when it cannot.
    fn forces(&mut self, rest: &[Vec3]) -> Option<Forces> {
        self.effort.evaluations += 1;
        let model = (self.build)(rest).ok()?;
        if !model.terms().iter().map(|t| t.elements()).eq(self.elements.iter().copied()) {
            return None;
        }
        self.assembly.renew(&model).ok()?;
        for (term, memory) in model.terms().iter().zip(&mut self.state.memory) {
            *memory = term.first_memory(self.known, self.state.load);
        }
        let mut pressure = Vec::new();
        self.assembly.energy(&model, &self.state, self.known, &mut pressure).ok()?;
        self.state.pressure = pressure;
        let mut applied = vec![Vec3::zeros(); rest.len()];
        let gradients = self.assembly.term_gradients(&model, &self.state).ok()?;
        for (term, gradient) in model.terms().iter().zip(&gradients) {
            // Surfaces react to what all others do.
            if term.surface().is_none() {
                applied.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
            }
        }
        let mut unbalanced = applied.clone();
        self.add_reactions(&model, &applied, &mut unbalanced)?;
        tangential(&model, &self.known_normals, &mut unbalanced);
        let finite = unbalanced.iter().flatten().all(|f| f.is_finite());
        finite.then_some(Forces { model, unbalanced })
    }

    /// Adds the forces of surfaces, which react to those that are applied.
    fn add_reactions(&mut self, model: &Model, applied: &[Vec3], sum: &mut [Vec3]) -> Option<()> {
        let mut block = Block::ZERO;
        for (index, term) in model.terms().iter().enumerate() {
            if term.surface().is_none() {
                continue;
            }
            term.react(self.known, applied, &mut self.state.memory[index]);
            for element in 0..term.elements() {
                let nodes = term.nodes(element);
                block.clear(nodes.len());
                term.block(element, &self.state.at(index), Order::Gradient, &mut block).ok()?;
                for (&node, gradient) in nodes.iter().zip(&block.gradient) {
                    sum[node as usize] += gradient;
                }
            }
        }
        Some(())
    }

    /// Factorises the stiffness of the loaded body that rests at `rest`, right after its
    /// [`Search::forces`]; `None` when it is unstable beyond help.
    fn linearise(&mut self, rest: &[Vec3], forces: &Forces) -> Option<Linear> {
        let model = &forces.model;
        let mut gradient = Vec::new();
        let (mut factored, mut stable) = (false, false);
        for (round, shift) in SHIFTS.into_iter().enumerate() {
            let curvature = if round == 0 { Curvature::Exact } else { Curvature::Projected };
            self.assembly
                .newton_system(model, &self.state, curvature, &mut gradient, &mut self.values)
                .ok()?;
            if shift > 0.0 {
                self.assembly.shift(model, &self.state, &mut self.shift);
            }
            factored = self.system.factor_sum(&self.values, shift, &self.shift).is_ok()
                && self.system.negative_pivots() == self.assembly.pressures();
            if factored {
                stable = round == 0;
                break;
            }
            tracing::debug!(round, "the loaded body is unstable");
        }
        factored.then(|| Linear {
            pull: pull_back(model, rest, self.known),
            stable,
            rest_normals: normals(model, rest),
        })
    }

    /// The displacement (mm) by which the loaded body gives way to out-of-balance forces.
    fn miss(&mut self, model: &Model, unbalanced: &[Vec3]) -> Option<Vec<Vec3>> {
        let mut solved = Vec::new();
        self.system.solve(&self.assembly.right_hand_side(unbalanced), &mut solved).ok()?;
        let mut miss = self.assembly.displacement(&solved);
        tangential(model, &self.known_normals, &mut miss);
        Some(miss)
    }

    /// Balances the known shape under a fraction of gravity, from `rest`, and returns the foretold
    /// miss (mm) of the rest shape reached; infinite when the loaded body would be unstable.
    fn balance(&mut self, rest: &mut Vec<Vec3>, gravity: f64, tolerance_mm: f64) -> f64 {
        self.state.load.gravity = gravity;
        let mut reached = f64::INFINITY;
        let Some(mut forces) = self.forces(rest) else { return reached };
        let mut forced = 0;
        for step in 0..=MAX_STEPS {
            let Some(linear) = self.linearise(rest, &forces) else { break };
            let Some(miss) = self.miss(&forces.model, &forces.unbalanced) else { break };
            let off = rms(&miss);
            reached = if linear.stable { off } else { f64::INFINITY };
            if off <= tolerance_mm || step == MAX_STEPS {
                break;
            }
            self.effort.steps += 1;
            let toward = |z: &[Vec3]| -> Vec<Vec3> {
                let mut step: Vec<Vec3> =
                    z.iter().zip(&linear.pull).map(|(z, f)| -(f * z)).collect();
                tangential(&forces.model, &linear.rest_normals, &mut step);
                step
            };
            let product = |z: &[f64]| {
                let step = toward(&fields(z));
                let longest = step.iter().map(|s| s.norm()).fold(0.0, f64::max);
                let scale = DIFFERENCE_MM / longest;
                let moved: Vec<Vec3> = rest.iter().zip(&step).map(|(x, s)| x + scale * s).collect();
                let there = self.forces(&moved)?.unbalanced;
                let slope: Vec<Vec3> =
                    forces.unbalanced.iter().zip(&there).map(|(a, b)| (a - b) / scale).collect();
                self.miss(&forces.model, &slope).map(|miss| numbers(&miss))
            };
            let rhs = numbers(&miss);
            let solved = gmres(<[f64]>::to_vec, product, &rhs, LINEAR_RESIDUAL, MAX_PRODUCTS);
            let line = self.walk(rest, &toward(&fields(&solved.solution)), &forces, off);
            tracing::debug!(
                gravity,
                step,
                off,
                solved.products,
                solved.residual,
                line.lowers,
                left = line.left_mm,
                "inverse step"
            );
            // A slack cable or sheet that tautens: the linearisation beyond the kink knows it.
            forced += usize::from(!line.lowers);
            let Some((there, balance)) = line.end.filter(|_| forced <= MAX_FORCED) else { break };
            *rest = there;
            forces = balance;
        }
        reached
    }

    /// Goes along `direction`, halving it until the foretold miss is well below `off` mm.
    fn walk(&mut self, rest: &[Vec3], direction: &[Vec3], forces: &Forces, off: f64) -> Line {
        let mut line = Line { end: None, left_mm: f64::INFINITY, lowers: false };
        let mut length = 1.0;
        while !line.lowers && length >= SHORTEST {
            let mut trial: Vec<Vec3> =
                rest.iter().zip(direction).map(|(x, d)| x + length * d).collect();
            onto_surfaces(&forces.model, &mut trial);
            if let Some(there) = self.forces(&trial) {
                let miss = self.miss(&there.model, &there.unbalanced);
                line.left_mm = miss.map_or(f64::INFINITY, |miss| rms(&miss));
                line.lowers = line.left_mm <= (1.0 - DECREASE * length) * off;
                line.end = Some((trial, there));
            }
            length *= 0.5;
        }
        line
    }
}

/// Where a line search ended.
struct Line {
    /// The rest shape and its forces; the shortest admissible step when none lowered the miss.
    end: Option<(Vec<Vec3>, Forces)>,
    /// Miss (mm) that the stiffness of the start foretells there.
    left_mm: f64,
    lowers: bool,
}

/// The components of a nodal field.
fn numbers(field: &[Vec3]) -> Vec<f64> {
    field.iter().flatten().copied().collect()
}

/// The nodal field of these components.
fn fields(numbers: &[f64]) -> Vec<Vec3> {
    numbers.chunks_exact(3).map(Vec3::from_row_slice).collect()
}

/// Root mean square length (mm) of a nodal field.
fn rms(field: &[Vec3]) -> f64 {
    (dot(field, field) / field.len().max(1) as f64).sqrt()
}
