//! The stress-free shape of a body that is known under load.
//!
//! The inverse motion finds it without a single equilibrium; one equilibrium then shows how near
//! the body comes to its known shape. The fixed point, one equilibrium a step, polishes what the
//! inverse motion left, and takes over where it fails.
//!
//! No inverse motion exists with friction that depends on the path. Here the path is one load step
//! from rest, for which both ways work. A contact that may open, or whose surface
//! gives way, is left to the fixed point.

mod fixed_point;
mod inverse;
mod supports;
mod transport;

pub use inverse::Effort;

use crate::model::Model;
use crate::solve::{self, SolveError};
use fixed_point::{Iterate, fixed_point, plain};
use inverse::inverse;
use mammotwin_data::{Vec3, progress::Progress, solution::Solution};

/// How the rest positions are sought.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Method {
    /// Newton on the rest positions; a fixed point with F⁻¹ as polish and fall-back.
    #[default]
    Inverse,
    /// Sellier's fixed point, halved where it does not gain and mixed over its past.
    FixedPoint,
    /// Sellier's fixed point as published: whole steps, whatever they do.
    Plain,
}

/// How the stress-free shape is sought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How the rest positions are sought.
    pub method: Method,
    /// Root mean square distance (mm) of the loaded nodes from where they are known to be, below
    /// which the search ends.
    pub tolerance_mm: f64,
    /// The same, above which a search that no longer gains is a failure.
    pub acceptable_mm: f64,
    /// Equilibria that may be computed.
    pub max_iterations: usize,
    /// How many of the first nodes the distances are of: not those of a muscle behind the breast, whose small ones would
    /// hide the breast's.
    pub counted: usize,
    /// Past iterations that the mixing of the fixed point looks at.
    pub memory: usize,
    /// Of each equilibrium.
    pub solve: solve::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::Inverse,
            tolerance_mm: 0.05,
            acceptable_mm: 1.0,
            max_iterations: 20,
            counted: usize::MAX,
            memory: 4,
            solve: solve::Options::default(),
        }
    }
}

/// How far a loaded body is from where it is known to be.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Miss {
    /// Root mean square distance of the nodes (mm).
    pub rms_mm: f64,
    /// Largest distance of a node (mm).
    pub max_mm: f64,
}

impl Miss {
    /// Of loaded nodes from where they are known to be (mm).
    pub fn between(loaded: &[Vec3], known: &[Vec3]) -> Self {
        Self::of(&loaded.iter().zip(known).map(|(x, k)| x - k).collect::<Vec<_>>())
    }

    fn of(gap: &[Vec3]) -> Self {
        let squares: f64 = gap.iter().map(|g| g.norm_squared()).sum();
        let max_mm = gap.iter().map(|g| g.norm()).fold(0.0, f64::max);
        Self { rms_mm: (squares / gap.len().max(1) as f64).sqrt(), max_mm }
    }
}

/// A stress-free shape, and the equilibrium it takes under load.
#[derive(Debug, Clone)]
pub struct StressFree {
    /// Rest positions (mm).
    pub rest: Vec<Vec3>,
    /// The body under load, from those rest positions.
    pub loaded: Solution,
    /// How far that is from where the nodes are known to be.
    pub miss: Miss,
    /// How far (mm) known positions of gliding nodes had to be moved to lie on their surface; the
    /// miss is counted from there.
    pub off_surface_mm: f64,
    /// Equilibria that were computed.
    pub iterations: usize,
    /// What the inverse motion did.
    pub effort: Effort,
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
        best.miss.rms_mm, best.iterations
    )]
    Slow {
        /// The best shape found.
        best: Box<StressFree>,
    },
}

/// The inverse motion ends when its foretold miss is this part of the tolerance.
const INVERSE_PART: f64 = 0.02;

/// Finds the rest positions from which the model of `build` takes the shape `loaded` (mm),
/// beginning the search at `guess` (`loaded` itself when nothing better is known).
///
/// Nodes that the model fixes rest where they are held: no load tells where else. The search ends
/// below the tolerance, or when it gains no more; the caller reads from [`StressFree::miss`] how
/// close it came.
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
    let model = build(guess).map_err(|error| UnloadError::Model(error.to_string()))?;
    let mut known = loaded.to_vec();
    for (&node, place) in model.held() {
        known[node as usize] = *place;
    }
    let off_surface_mm = supports::onto_surfaces(&model, &mut known);
    let load = |rest: Vec<Vec3>, start: &[Vec3]| {
        Iterate::load(rest, &known, start, &build, options)
            .map_err(|cause| UnloadError::Solve(cause.into()))?
            .ok_or_else(|| UnloadError::Model("no model on the rest shape that was found".into()))
    };
    let mut effort = Effort::default();
    let mut found = None;
    let left = model.terms().iter().any(|term| term.may_open() || term.gives_way());
    if options.method == Method::Inverse && !left {
        let report = |done: f64| progress.report(0.8 * done, "inverse motion");
        let sought = inverse(&known, guess, &build, INVERSE_PART * options.tolerance_mm, &report);
        let sought = sought.map_err(UnloadError::Model)?;
        effort = sought.effort;
        tracing::debug!(sought.carried, ?effort, "inverse motion");
        found = load(sought.rest, &known).ok();
    }
    let (first, rounds) = match found {
        Some(found) => (found, options.max_iterations - 1),
        None => (load(guess.to_vec(), &known)?, options.max_iterations - 1),
    };
    let (best, iterations) = match options.method {
        Method::Plain => plain(&known, first, &build, rounds, options, progress),
        _ => fixed_point(&known, first, &build, rounds, options, progress),
    };
    let acceptable = best.miss.rms_mm <= options.acceptable_mm;
    let best = StressFree {
        rest: best.rest,
        loaded: best.solution,
        miss: best.miss,
        off_surface_mm,
        iterations: iterations + 1,
        effort,
    };
    if acceptable { Ok(best) } else { Err(UnloadError::Slow { best: best.into() }) }
}

/// Of nodal fields.
fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
