//! Equilibrium under the full load, from any admissible start.
//!
//! One load step is the normal case. When it fails, the load is applied in parts: a failed part
//! is halved, and parts grow again after success. Each part ends with the multipliers of all
//! contacts adjusted until gaps and penetrations are below tolerance, so that no result depends
//! on a penalty, and friction settled with the normal pressure.

mod failure;
mod near;

use crate::assemble::{AssemblyError, State};
use crate::held;
use crate::model::{Model, ModelError};
use crate::newton::{End, Newton, NewtonError, NewtonOptions};
use crate::terms::{Curvature, Load};
use failure::{Failure, stopped};
use mammotwin_data::{
    Vec3,
    progress::{Progress, Silent},
    solution::{Checks, Solution},
};

pub use near::solve_near;

/// How an equilibrium is sought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Of each minimisation.
    pub newton: NewtonOptions,
    /// Largest gap or penetration of a contact (mm).
    pub contact_mm: f64,
    /// Change of all friction forces by one more round over the normal forces of their contact,
    /// below which friction is settled.
    pub friction: f64,
    /// Smallest part of the load that is tried.
    pub smallest_step: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            newton: NewtonOptions::default(),
            contact_mm: 0.05,
            friction: 1e-4,
            smallest_step: 1.0 / 256.0,
        }
    }
}

/// Why there is no equilibrium.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// The model cannot be solved at all.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// Wrong number of start positions.
    #[error("{got} start positions for {wanted} nodes; give one for each")]
    Start {
        /// Number of nodes.
        wanted: usize,
        /// Number of start positions.
        got: usize,
    },
    /// A node that starts nowhere.
    #[error("node {node} starts at {place:?} mm; give it finite coordinates")]
    NotFinite {
        /// The node.
        node: usize,
        /// Where it starts (mm).
        place: [f64; 3],
    },
    /// A paddle that turns or bends without end.
    #[error(
        "the paddle finds no place at {thickness_mm:.1} mm at which it and the breast are in balance; \
         stiffen its hinge or plate"
    )]
    Paddle {
        /// Distance of the plates (mm).
        thickness_mm: f64,
    },
    /// A foam that is pressed flat.
    #[error(
        "the foam of the paddle is pressed flat at {thickness_mm:.1} mm: the skin would lie deeper in it than \
         its {foam_mm} mm; make it thicker or stiffer, or press less"
    )]
    Cushion {
        /// Distance of the plates (mm).
        thickness_mm: f64,
        /// Thickness of the foam (mm).
        foam_mm: f64,
    },
    /// The load could not be carried.
    #[error("no equilibrium beyond {:.1} % of the load: {why} in {place}; {remedy}", 100.0 * load_fraction)]
    Stopped {
        /// What happened.
        why: String,
        /// Where the body gives way.
        place: Box<Place>,
        /// Fraction of the load that was carried.
        load_fraction: f64,
        /// What to try.
        remedy: &'static str,
        /// The last state in equilibrium, if any.
        last: Option<Box<Solution>>,
    },
    /// The search ran away from the last equilibrium in directions in which the energy falls, and met nothing
    /// that stops it: the body is too soft for the load.
    #[error(
        "no stable state beyond {:.1} % of the load: the energy falls in {falling} directions where the search ended, in \
         {place}; stiffen the tissue, hold the body better, or load less",
        100.0 * load_fraction
    )]
    NoStableState {
        /// Negative eigenvalues of the second derivatives of the energy where the search ended.
        falling: usize,
        /// Where forces are farthest from balance.
        place: Box<Place>,
        /// Fraction of the load that was carried.
        load_fraction: f64,
        /// The last state in equilibrium, if any.
        last: Option<Box<Solution>>,
    },
}

/// Where a body gives way.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Name of the term.
    pub term: String,
    /// Element of the term.
    pub element: usize,
    /// The node that is worst; `None` where it is the element as a whole.
    pub node: Option<usize>,
    /// Where that node is, of a body that runs away at the last load that it carried, or the middle of the element (mm).
    pub mm: Vec3,
}

impl std::fmt::Display for Place {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}, element {}", self.term, self.element)?;
        if let Some(node) = self.node {
            write!(out, ", node {node}")?;
        }
        write!(out, ", at ({:.1}, {:.1}, {:.1}) mm", self.mm.x, self.mm.y, self.mm.z)
    }
}

impl SolveError {
    /// Fraction of the load that was carried.
    pub fn load_fraction(&self) -> f64 {
        match self {
            Self::Stopped { load_fraction, .. } | Self::NoStableState { load_fraction, .. } => {
                *load_fraction
            }
            _ => 0.0,
        }
    }
}

/// Finds the equilibrium under the full load of gravity, with the nodes first at `start` (mm);
/// fixed nodes stay there.
///
/// # Errors
/// An incomplete model, or a load that it cannot carry; the error says where it gave way and
/// keeps the last good state.
pub fn solve(
    model: &Model,
    start: &[Vec3],
    options: &Options,
    progress: &dyn Progress,
) -> Result<Solution, SolveError> {
    let (mut newton, mut state) = prepare(model, start, Load { gravity: 0.0, ..Load::GRAVITY })?;
    let mut counts = Checks::default();
    walk(&mut newton, model, &mut state, Load::GRAVITY, options, &mut counts, progress)?;
    finish(&newton, model, &state, counts)
}

/// Follows the equilibrium from load to load, beginning at the first one of `path` with the nodes
/// near `start` (mm), and returns it at each: friction remembers the way.
///
/// # Errors
/// As [`solve`].
pub fn follow(
    model: &Model,
    start: &[Vec3],
    path: &[Load],
    options: &Options,
) -> Result<Vec<Solution>, SolveError> {
    let Some(first) = path.first() else { return Ok(Vec::new()) };
    let (mut newton, mut state) = prepare(model, start, *first)?;
    let mut counts = Checks::default();
    let mut found = Vec::new();
    for load in path {
        walk(&mut newton, model, &mut state, *load, options, &mut counts, &Silent)?;
        found.push(finish(&newton, model, &state, counts)?);
    }
    Ok(found)
}

/// Analyses a model, and puts its nodes at `start`, held ones at their places.
pub(crate) fn prepare(
    model: &Model,
    start: &[Vec3],
    load: Load,
) -> Result<(Newton, State), SolveError> {
    if start.len() != model.rest.len() {
        return Err(SolveError::Start { wanted: model.rest.len(), got: start.len() });
    }
    if let Some((node, place)) = nowhere(&model.rest) {
        return Err(AssemblyError::from(ModelError::NotFinite { node, place }).into());
    }
    let mut points = start.to_vec();
    for (&node, place) in model.held() {
        points[node as usize] = *place;
    }
    if let Some((node, place)) = nowhere(&points) {
        return Err(SolveError::NotFinite { node, place });
    }
    let newton = Newton::new(model)?;
    let state = State::new(model, points, load);
    held::check(model, &state).map_err(AssemblyError::from)?;
    Ok((newton, state))
}

/// The first node without finite coordinates.
fn nowhere(points: &[Vec3]) -> Option<(usize, [f64; 3])> {
    let node = points.iter().position(|p| !p.iter().all(|x| x.is_finite()))?;
    Some((node, points[node].into()))
}

/// Follows the equilibrium from the state's load to `target`.
pub(crate) fn walk(
    newton: &mut Newton,
    model: &Model,
    state: &mut State,
    target: Load,
    options: &Options,
    counts: &mut Checks,
    progress: &dyn Progress,
) -> Result<(), SolveError> {
    let (first, mut done, mut part) = (state.load, 0.0, 1.0);
    let leash_mm = model.terms().iter().filter_map(|term| term.leash_mm()).reduce(f64::min);
    let mut last: Option<State> = None;
    let mut patience = PATIENCE;
    if leash_mm.is_some() {
        // From a start that is no equilibrium the way would not be that of the load.
        let mut settled = state.clone();
        if balance(newton, model, &mut settled, options, Curvature::Exact, counts).is_ok() {
            settled.accept(model);
            *state = settled;
        }
    }
    loop {
        let to = f64::min(1.0, done + part);
        let to = if to > 1.0 - 1e-9 { 1.0 } else { to };
        let mut trial = state.clone();
        let load = Load::between(first, target, to);
        // Where plates alone have moved, the first step of Newton's method foretells more than the
        // path does: it knows of the nodes that they have come to. These lie so deep in them that
        // the curvature of the plates under their pressure means nothing yet.
        let first = if load.gravity == trial.load.gravity {
            trial.load = load;
            Curvature::Convex
        } else {
            newton.predict(model, &mut trial, load);
            Curvature::Exact
        };
        counts.steps += 1;
        let mut found = balance(newton, model, &mut trial, options, first, counts);
        let is_last = 0.5 * part < options.smallest_step;
        if is_last && matches!(found, Err(Failure::Newton(NewtonError::Slow { .. }))) {
            found = go_on(newton, model, state, &mut trial, options, &mut patience, counts)
                .map_or(found, Ok);
        }
        let room = leash_mm.map_or(f64::INFINITY, |leash| {
            leash / farthest(&state.points, &trial.points).max(f64::MIN_POSITIVE)
        });
        match found {
            Ok(()) if room < 1.0 && !is_last => {
                tracing::debug!(room, part, "too far for one load step");
                part = (part * (ROOM * room).clamp(0.1, 0.5)).max(options.smallest_step);
            }
            Ok(()) => {
                trial.accept(model);
                *state = trial.clone();
                last = Some(trial);
                done = to;
                progress.report(done, &format!("{:.0} % of the load", 100.0 * done));
                if done >= 1.0 {
                    return Ok(());
                }
                part = (part * (ROOM * room).min(2.0)).max(options.smallest_step);
            }
            Err(error) => {
                tracing::debug!(?error, done, part, "load step failed");
                part *= 0.5;
                if part < options.smallest_step {
                    let good = last.map(|good| finish(newton, model, &good, *counts));
                    let good = good.and_then(Result::ok).map(Box::new);
                    let falling = match error {
                        Failure::Newton(_) => newton.falling(model, &trial),
                        _ => 0,
                    };
                    return Err(stopped(model, &trial, &state.points, error, falling, done, good));
                }
            }
        }
    }
}

/// Part of the way that nodes may go in one load step for which the next one is chosen.
const ROOM: f64 = 0.8;

/// How far (mm) the node goes that goes farthest.
fn farthest(from: &[Vec3], to: &[Vec3]) -> f64 {
    from.iter().zip(to).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max)
}

/// How often a search at the smallest load step may go on, over the whole way.
const PATIENCE: usize = 10;
/// A body that has gone so many times farther than its own size is falling.
const FALL: f64 = 3.0;

/// Goes on with a search that ended for the number of its iterations alone: a slow descent past a point of buckling is
/// no fall. A body that has gone several times farther than its own size from `state` is falling. `None` without an equilibrium;
/// the trial then is as it was.
fn go_on(
    newton: &mut Newton,
    model: &Model,
    state: &State,
    trial: &mut State,
    options: &Options,
    patience: &mut usize,
    counts: &mut Checks,
) -> Option<()> {
    let [low, high] = [Vec3::inf, Vec3::sup]
        .map(|of| model.rest.iter().copied().reduce(|a, b| of(&a, &b)).unwrap_or_default());
    let fell = |now: &State| farthest(&state.points, &now.points) > FALL * (high - low).norm();
    let mut further = trial.clone();
    while *patience > 0 && !fell(&further) {
        *patience -= 1;
        match balance(newton, model, &mut further, options, Curvature::Exact, counts) {
            Ok(()) => {
                *trial = further;
                return Some(());
            }
            Err(Failure::Newton(NewtonError::Slow { .. })) => {}
            Err(_) => return None,
        }
    }
    None
}

/// Most rounds of multipliers at one load, and most more that friction may take.
const ROUNDS: usize = 20;
const FRICTION_ROUNDS: usize = 40;

/// Most times that contacts may move on to other elements at one load.
const MOVES: usize = 80;

/// A round of multipliers that leaves more than this part of the gap wants stiffer penalties.
const SHRINKING: f64 = 0.25;
/// How much stiffer.
const STIFFENING: f64 = 4.0;
/// Most such changes at one load.
const STIFFENINGS: usize = 4;

/// Minimum of the energy at the state's load, with all contacts tight.
fn balance(
    newton: &mut Newton,
    model: &Model,
    state: &mut State,
    options: &Options,
    mut first: Curvature,
    counts: &mut Checks,
) -> Result<(), Failure> {
    let (mut before, mut stiffened) = (f64::INFINITY, 0);
    let (mut rounds, mut tight, mut moves) = (0, 0, 0);
    while rounds < ROUNDS && tight < FRICTION_ROUNDS && moves < MOVES {
        let found = newton.minimise(model, state, &options.newton, first);
        first = Curvature::Exact;
        counts.iterations += newton.iterations();
        if found.map_err(Failure::Newton)? == End::Away {
            moves += 1;
            state.moves_on(model);
            continue;
        }
        let contact = state.contact(model);
        tracing::debug!(?contact, load = ?state.load, "contact after a minimum");
        let open = contact.open_mm();
        let is_tight = open <= options.contact_mm;
        let settled = is_tight && contact.friction_lag <= options.friction;
        let moved = state.moves_on(model);
        if settled && !moved {
            return Ok(());
        }
        moves += usize::from(moved);
        state.update_multipliers(model);
        if is_tight {
            tight += usize::from(!settled);
            continue;
        }
        rounds += 1;
        // Tissue near its limit is stiffer than its modulus says: the penalties must follow.
        if open > SHRINKING * before && stiffened < STIFFENINGS {
            state.stiffen_contacts(STIFFENING);
            stiffened += 1;
        }
        before = open;
    }
    Err(match (tight < FRICTION_ROUNDS, moves < MOVES) {
        (false, _) => Failure::Friction,
        (true, false) => Failure::Restless,
        (true, true) => Failure::Contact,
    })
}

/// The solution of a state, with everything checked anew.
pub(crate) fn finish(
    newton: &Newton,
    model: &Model,
    state: &State,
    counts: Checks,
) -> Result<Solution, SolveError> {
    let gradients = newton.assembly.term_gradients(model, state).map_err(|refusal| {
        let error = Failure::Newton(NewtonError::Start(refusal.into()));
        stopped(model, state, &state.points, error, 0, 0.0, None)
    })?;
    let mut solution = state.report(model);
    let mut scale: f64 = 0.0;
    let mut total = vec![Vec3::zeros(); model.rest.len()];
    let middle = state.points.iter().sum::<Vec3>() / state.points.len().max(1) as f64;
    let arms: Vec<Vec3> = state.points.iter().map(|p| p - middle).collect();
    let (mut turned, mut most) = (Vec3::zeros(), f64::MIN_POSITIVE);
    let (mut own_force, mut own_moment): (f64, f64) = (0.0, 0.0);
    for (term, gradient) in state.terms(model).iter().zip(&gradients) {
        let force = -gradient.iter().sum::<Vec3>();
        scale = scale.max(gradient.iter().map(|g| g.norm()).sum());
        total.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
        solution.forces.insert(term.name().to_owned(), force);
        let moments = || arms.iter().zip(gradient).map(|(arm, g)| g.cross(arm));
        let moment = moments().sum::<Vec3>();
        turned += moment;
        if term.is_internal() {
            (own_force, own_moment) = (own_force.max(force.norm()), own_moment.max(moment.norm()));
        }
        most = most.max(moments().map(|m| m.norm()).sum());
    }
    let mut unbalanced: f64 = 0.0;
    let mut reaction = Vec3::zeros();
    for (node, force) in total.iter().enumerate() {
        let free = [0, 1, 2].map(|axis| newton.assembly.is_free(node, axis));
        let part = |wanted: bool| {
            let pick = |axis: usize| if free[axis] == wanted { force[axis] } else { 0.0 };
            Vec3::new(pick(0), pick(1), pick(2))
        };
        unbalanced = unbalanced.max(part(true).norm());
        reaction += part(false);
        turned += arms[node].cross(&part(false));
    }
    if reaction != Vec3::zeros() {
        solution.forces.insert("fixed".to_owned(), reaction);
    }
    let sum: Vec3 = solution.forces.values().sum();
    let largest = solution.forces.values().map(|f| f.norm()).fold(f64::MIN_POSITIVE, f64::max);
    let contact = state.contact(model);
    solution.checks = Checks {
        residual: unbalanced / scale.max(f64::MIN_POSITIVE),
        min_det_f: solution
            .deformation_gradient
            .iter()
            .map(|f| f.determinant())
            .fold(f64::INFINITY, f64::min),
        max_penetration_mm: contact.penetration_mm,
        max_gap_mm: contact.gap_mm.max(contact.slip_mm),
        force_imbalance: sum.norm() / largest,
        moment_imbalance: turned.norm() / most,
        internal_imbalance: f64::max(own_force / scale.max(f64::MIN_POSITIVE), own_moment / most),
        friction_lag: contact.friction_lag,
        ..counts
    };
    Ok(solution)
}
