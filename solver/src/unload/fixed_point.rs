//! The fixed point: rest positions move against the miss of the loaded body.
//!
//! X + loaded - x(X) (Sellier, *Comput. Mech.* 48 (2011) 503,
//! <https://doi.org/10.1007/s00466-011-0593-0>), or X + F⁻¹ (loaded - x(X)), sped up by Anderson
//! mixing over the last iterations (Walker & Ni, *SIAM J. Numer. Anal.* 49 (2011) 1715). A step to
//! a rest shape that misses by more, or cannot carry its load, is halved.

use super::supports::{normals, onto_surfaces, tangential};
use super::transport::pull_back;
use super::{Method, Miss, Options, dot};
use crate::model::Model;
use crate::solve::{SolveError, solve, solve_near};
use mammotwin_data::{
    Vec3,
    progress::{Progress, Silent},
    solution::Solution,
};
use nalgebra::{DMatrix, DVector};

/// Rounds without a gain of a tenth after which the search ends.
const IDLE_ROUNDS: usize = 3;
/// Shortest part of a step that is tried.
const SHORTEST: f64 = 0.05;

/// Improves on `first` in at most `rounds` equilibria; returns the best shape, and how many were
/// computed.
pub(super) fn fixed_point<E>(
    known: &[Vec3],
    first: Iterate,
    build: &impl Fn(&[Vec3]) -> Result<Model, E>,
    rounds: usize,
    options: &Options,
    progress: &dyn Progress,
) -> (Iterate, usize) {
    let mut best = first;
    let first_rms = best.miss.rms_mm;
    let mut past: Vec<Iterate> = Vec::new();
    let (mut iterations, mut idle, mut damping) = (0, 0, 1.0);
    while best.miss.rms_mm > options.tolerance_mm && iterations < rounds && idle < IDLE_ROUNDS {
        let step = mixed_step(&past, &best);
        let mut rest: Vec<Vec3> =
            best.rest.iter().zip(&step).map(|(x, dx)| x + damping * dx).collect();
        if options.method == Method::Inverse {
            onto_surfaces(&best.model, &mut rest);
        }
        iterations += 1;
        let next = Iterate::load(rest, known, &best.solution.points, build, options);
        match next.ok().flatten() {
            Some(next) if next.miss.rms_mm < best.miss.rms_mm => {
                idle = if next.miss.rms_mm < 0.9 * best.miss.rms_mm { 0 } else { idle + 1 };
                past.push(std::mem::replace(&mut best, next));
                if past.len() > options.memory {
                    past.remove(0);
                }
                damping = f64::min(1.0, 2.0 * damping);
            }
            // Too far, or past iterates led astray: forget them and go half as far.
            _ => {
                past.clear();
                damping *= 0.5;
                if damping < SHORTEST {
                    break;
                }
            }
        }
        let rms_mm = best.miss.rms_mm;
        let gained = (first_rms / rms_mm).ln() / (first_rms / options.tolerance_mm).ln();
        progress.report(gained.clamp(0.0, 1.0), &format!("{rms_mm:.2} mm off"));
    }
    (best, iterations)
}

/// The same as published: X + loaded - x(X) in whole steps, until the miss is below the tolerance, a rest shape carries no
/// load, or `rounds` are over. Returns the best shape, and how many equilibria were computed.
///
/// To first order a step multiplies the miss by 1 - ∂x/∂X: where tissue is stretched to more than twice its length it grows.
pub(super) fn plain<E>(
    known: &[Vec3],
    first: Iterate,
    build: &impl Fn(&[Vec3]) -> Result<Model, E>,
    rounds: usize,
    options: &Options,
    progress: &dyn Progress,
) -> (Iterate, usize) {
    let mut best = first;
    let (mut rest, mut step, mut start) =
        (best.rest.clone(), best.step.clone(), best.solution.points.clone());
    let mut iterations = 0;
    while best.miss.rms_mm > options.tolerance_mm && iterations < rounds {
        rest.iter_mut().zip(&step).for_each(|(x, dx)| *x += dx);
        iterations += 1;
        let Ok(Some(next)) = Iterate::load(rest.clone(), known, &start, build, options) else {
            break;
        };
        (step, start) = (next.step.clone(), next.solution.points.clone());
        let done = iterations as f64 / rounds as f64;
        progress.report(done, &format!("{:.2} mm off", next.miss.rms_mm));
        if next.miss.rms_mm < best.miss.rms_mm {
            best = next;
        }
    }
    (best, iterations)
}

/// One rest shape with its equilibrium.
pub(super) struct Iterate {
    pub rest: Vec<Vec3>,
    pub solution: Solution,
    pub miss: Miss,
    /// The plain step to the next rest shape (mm).
    step: Vec<Vec3>,
    model: Model,
}

impl Iterate {
    /// Loads a rest shape, with Newton begun at `start`; `None` when there is no model on it.
    pub fn load<E>(
        rest: Vec<Vec3>,
        known: &[Vec3],
        start: &[Vec3],
        build: &impl Fn(&[Vec3]) -> Result<Model, E>,
        options: &Options,
    ) -> Result<Option<Self>, SolveError> {
        let Ok(model) = build(&rest) else { return Ok(None) };
        // The inverse motion puts the equilibrium where the body is known to be.
        let from = if options.method == Method::Inverse { solve_near } else { solve };
        let solution = from(&model, start, &options.solve, &Silent)?;
        let gap: Vec<Vec3> =
            known.iter().zip(&solution.points).map(|(want, got)| want - got).collect();
        let miss = Miss::of(&gap[..options.counted.min(gap.len())]);
        let mut step = gap;
        if options.method == Method::Inverse {
            let pulls = pull_back(&model, &rest, &solution.points);
            step.iter_mut().zip(&pulls).for_each(|(step, pull)| *step = pull * *step);
            tangential(&model, &normals(&model, &rest), &mut step);
        }
        Ok(Some(Self { rest, solution, miss, step, model }))
    }
}

/// Anderson's step: the fixed-point step of the combination of past iterates that misses least.
fn mixed_step(past: &[Iterate], now: &Iterate) -> Vec<Vec3> {
    if past.is_empty() {
        return now.step.clone();
    }
    let changes: Vec<(Vec<Vec3>, Vec<Vec3>)> = past
        .iter()
        .map(|old| {
            let miss = now.step.iter().zip(&old.step).map(|(a, b)| a - b).collect();
            let rest = now.rest.iter().zip(&old.rest).map(|(a, b)| a - b).collect();
            (miss, rest)
        })
        .collect();
    let n = changes.len();
    let mut normal = DMatrix::from_fn(n, n, |r, c| dot(&changes[r].0, &changes[c].0));
    // Nearly equal iterates must not blow up the weights.
    for r in 0..n {
        normal[(r, r)] *= 1.0 + 1e-8;
    }
    let right = DVector::from_fn(n, |r, _| dot(&changes[r].0, &now.step));
    let Some(weights) = normal.cholesky().map(|c| c.solve(&right)) else {
        return now.step.clone();
    };
    let mut step = now.step.clone();
    for (weight, (miss, rest)) in weights.iter().zip(&changes) {
        for (out, (m, x)) in step.iter_mut().zip(miss.iter().zip(rest)) {
            *out -= *weight * (m + x);
        }
    }
    step
}
