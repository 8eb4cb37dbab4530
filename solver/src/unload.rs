//! The stress-free shape of a body that is known under load.
//!
//! The rest positions X are moved against the miss of the loaded body, X + loaded - x(X)
//! (Sellier, *Comput. Mech.* 48 (2011) 503, <https://doi.org/10.1007/s00466-011-0593-0>), sped up
//! by Anderson mixing over the last iterations (Walker & Ni, *SIAM J. Numer. Anal.* 49 (2011)
//! 1715). A step to a rest shape that misses by more, or cannot carry its load, is halved.

use crate::model::Model;
use crate::solve::{self, SolveError, solve};
use mammotwin_data::{
    Vec3,
    progress::{Progress, Silent},
    solution::Solution,
};
use nalgebra::{DMatrix, DVector};

/// How the stress-free shape is sought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Root mean square distance (mm) of the loaded nodes from where they are known to be, below
    /// which the search ends.
    pub tolerance_mm: f64,
    /// The same, above which a search that no longer gains is a failure.
    pub acceptable_mm: f64,
    /// Equilibria that may be computed.
    pub max_iterations: usize,
    /// Past iterations that the mixing looks at.
    pub memory: usize,
    /// Of each equilibrium.
    pub solve: solve::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance_mm: 0.05,
            acceptable_mm: 1.0,
            max_iterations: 20,
            memory: 4,
            solve: solve::Options::default(),
        }
    }
}

/// A stress-free shape, and the equilibrium it takes under load.
#[derive(Debug, Clone)]
pub struct StressFree {
    /// Rest positions (mm).
    pub rest: Vec<Vec3>,
    /// The body under load, from those rest positions.
    pub loaded: Solution,
    /// Root mean square distance (mm) of the nodes under load from where they are known to be.
    pub rms_mm: f64,
    /// The largest such distance (mm).
    pub miss_mm: f64,
    /// Equilibria that were computed.
    pub iterations: usize,
}

/// Why no stress-free shape was found.
#[derive(Debug, thiserror::Error)]
pub enum UnloadError {
    /// No model on the first rest shape.
    #[error("no model on the first rest shape: {0}")]
    Model(String),
    /// The first rest shape carries no load.
    #[error("the first rest shape carries no load: {0}")]
    Solve(#[source] Box<SolveError>),
    /// Not close enough.
    #[error(
        "stress-free shape still {:.2} mm (rms) off after {} equilibria; \
         stiffen the tissue or hold the body better",
        best.rms_mm, best.iterations
    )]
    Slow {
        /// The best shape found.
        best: Box<StressFree>,
    },
}

/// Rounds without a gain of a tenth after which the search ends.
const IDLE_ROUNDS: usize = 3;
/// Shortest part of a step that is tried.
const SHORTEST: f64 = 0.05;

/// Finds the rest positions from which the model of `build` takes the shape `loaded` (mm),
/// beginning the search at `guess` (`loaded` itself when nothing better is known).
///
/// The search ends below the tolerance, or when it gains no more; the caller reads from
/// [`StressFree::rms_mm`] how close it came.
///
/// # Errors
/// A model that cannot be built or loaded on the first guess, or a shape that stays farther off
/// than is acceptable; the error then keeps the best shape.
pub fn stress_free<E: std::fmt::Display>(
    loaded: &[Vec3],
    guess: &[Vec3],
    build: impl Fn(&[Vec3]) -> Result<Model, E>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<StressFree, UnloadError> {
    let first = build(guess).map_err(|error| UnloadError::Model(error.to_string()))?;
    let start = solve(&first, loaded, &options.solve, &Silent);
    let mut best =
        Iterate::new(guess.to_vec(), start.map_err(|e| UnloadError::Solve(e.into()))?, loaded);
    let first_rms = best.rms_mm;
    let mut past: Vec<Iterate> = Vec::new();
    let (mut iterations, mut idle, mut damping) = (1, 0, 1.0);
    while best.rms_mm > options.tolerance_mm
        && iterations < options.max_iterations
        && idle < IDLE_ROUNDS
    {
        let step = mixed_step(&past, &best);
        let rest: Vec<Vec3> = best.rest.iter().zip(&step).map(|(x, dx)| x + damping * dx).collect();
        iterations += 1;
        let solved = build(&rest)
            .ok()
            .and_then(|model| solve(&model, &best.solution.points, &options.solve, &Silent).ok());
        match solved.map(|solution| Iterate::new(rest, solution, loaded)) {
            Some(next) if next.rms_mm < best.rms_mm => {
                idle = if next.rms_mm < 0.9 * best.rms_mm { 0 } else { idle + 1 };
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
        let gained = (first_rms / best.rms_mm).ln() / (first_rms / options.tolerance_mm).ln();
        progress.report(gained.clamp(0.0, 1.0), &format!("{:.2} mm off", best.rms_mm));
    }
    let acceptable = best.rms_mm <= options.acceptable_mm;
    let found = best.stress_free(iterations);
    if acceptable { Ok(found) } else { Err(UnloadError::Slow { best: found.into() }) }
}

/// One rest shape with its equilibrium.
struct Iterate {
    rest: Vec<Vec3>,
    solution: Solution,
    /// Known minus computed position of each node (mm).
    miss: Vec<Vec3>,
    miss_mm: f64,
    rms_mm: f64,
}

impl Iterate {
    fn new(rest: Vec<Vec3>, solution: Solution, loaded: &[Vec3]) -> Self {
        let miss: Vec<Vec3> =
            loaded.iter().zip(&solution.points).map(|(want, got)| want - got).collect();
        let miss_mm = miss.iter().map(|m| m.norm()).fold(0.0, f64::max);
        let squares: f64 = miss.iter().map(|m| m.norm_squared()).sum();
        let rms_mm = (squares / miss.len().max(1) as f64).sqrt();
        Self { rest, solution, miss, miss_mm, rms_mm }
    }

    fn stress_free(&self, iterations: usize) -> StressFree {
        StressFree {
            rest: self.rest.clone(),
            loaded: self.solution.clone(),
            rms_mm: self.rms_mm,
            miss_mm: self.miss_mm,
            iterations,
        }
    }
}

/// Anderson's step: the fixed-point step of the combination of past iterates that misses least.
fn mixed_step(past: &[Iterate], now: &Iterate) -> Vec<Vec3> {
    if past.is_empty() {
        return now.miss.clone();
    }
    let changes: Vec<(Vec<Vec3>, Vec<Vec3>)> = past
        .iter()
        .map(|old| {
            let miss = now.miss.iter().zip(&old.miss).map(|(a, b)| a - b).collect();
            let rest = now.rest.iter().zip(&old.rest).map(|(a, b)| a - b).collect();
            (miss, rest)
        })
        .collect();
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let n = changes.len();
    let mut normal = DMatrix::from_fn(n, n, |r, c| dot(&changes[r].0, &changes[c].0));
    // Nearly equal iterates must not blow up the weights.
    for r in 0..n {
        normal[(r, r)] *= 1.0 + 1e-8;
    }
    let right = DVector::from_fn(n, |r, _| dot(&changes[r].0, &now.miss));
    let Some(weights) = normal.cholesky().map(|c| c.solve(&right)) else {
        return now.miss.clone();
    };
    let mut step = now.miss.clone();
    for (weight, (miss, rest)) in weights.iter().zip(&changes) {
        for (out, (m, x)) in step.iter_mut().zip(miss.iter().zip(rest)) {
            *out -= *weight * (m + x);
        }
    }
    step
}
