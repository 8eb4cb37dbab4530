//! Equilibrium from a start that is near to it.

use super::failure::Failure;
use super::{Options, SolveError, balance, finish, prepare, solve};
use crate::assemble::State;
use crate::model::Model;
use crate::newton::NewtonError;
use crate::terms::{Curvature, Load};
use mammotwin_data::{
    Vec3,
    progress::Progress,
    solution::{Checks, Solution},
};

/// Parts of the way from rest to the start at which a search begins that is said to be near.
const WAYS: [f64; 6] = [1.0, 0.85, 0.7, 0.5, 0.25, 0.0];

/// [`solve`] where `start` is near to the equilibrium: the load is there from the beginning, and comes in parts only where
/// the search fails. A start in which an element cannot be, since other tissue was stretched to it, is taken back
/// towards rest until it can.
///
/// # Errors
/// As [`solve`].
pub fn solve_near(
    model: &Model,
    start: &[Vec3],
    options: &Options,
    progress: &dyn Progress,
) -> Result<Solution, SolveError> {
    let (mut newton, first) = prepare(model, start, Load::GRAVITY)?;
    let mut points = Vec::new();
    for way in WAYS {
        points = toward(model, &first.points, way);
        let mut state = State::new(model, points.clone(), Load::GRAVITY);
        let mut counts = Checks { steps: 1, ..Checks::default() };
        match balance(&mut newton, model, &mut state, options, Curvature::Exact, &mut counts) {
            Ok(()) => {
                state.accept(model);
                return finish(&newton, model, &state, counts);
            }
            Err(Failure::Newton(NewtonError::Start(cause))) => {
                tracing::debug!(?cause, way, "no element can be there");
            }
            Err(error) => {
                tracing::debug!(?error, way, "not near");
                break;
            }
        }
    }
    solve(model, &points, options, progress)
}

/// Part of the way from rest to `start` (mm); what is fixed stays at the start.
fn toward(model: &Model, start: &[Vec3], part: f64) -> Vec<Vec3> {
    let place = |((rest, start), fixed): ((&Vec3, &Vec3), &[bool; 3])| {
        let there = rest.lerp(start, part);
        Vec3::from_fn(|axis, _| if fixed[axis] { start[axis] } else { there[axis] })
    };
    model.rest.iter().zip(start).zip(model.fixed()).map(place).collect()
}
