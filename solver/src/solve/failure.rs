//! What is told of a load that cannot be carried: what gave way, where, and what to try.

use super::{Place, SolveError};
use crate::assemble::{EnergyError, State, TermRefusal};
use crate::materials::MaterialError;
use crate::model::Model;
use crate::newton::NewtonError;
use crate::terms::ContactCheck;
use mammotwin_data::{Vec3, solution::Solution};

/// Why there is no equilibrium at a load.
#[derive(Debug, Clone, Copy)]
pub(super) enum Failure {
    /// The search for a minimum ended without one.
    Newton(NewtonError),
    /// A contact stays open or penetrated.
    Contact,
    /// Friction does not settle.
    Friction,
    /// A contact goes to and fro between elements of the other surface.
    Restless,
}

/// The error of a failure at `state`, from which the energy falls in so many directions, beyond a fraction of the
/// load that was carried with the nodes at `good` (mm): a body that runs away is told where it was.
pub(super) fn stopped(
    model: &Model,
    state: &State,
    good: &[Vec3],
    failure: Failure,
    falling: usize,
    load_fraction: f64,
    last: Option<Box<Solution>>,
) -> SolveError {
    let refused = |error: EnergyError| match error {
        EnergyError::Refused(at) => Some(at),
        _ => None,
    };
    let (place, refusal) = match failure {
        Failure::Newton(NewtonError::Start(error)) => match refused(error) {
            Some(at) => (of_refusal(model, state, &at), Some(at)),
            None => (of_node(model, good, farthest(model, state)), None),
        },
        Failure::Newton(NewtonError::Stuck { node, ran_into }) => {
            match ran_into.and_then(refused) {
                Some(at) => (of_refusal(model, state, &at), Some(at)),
                None => (of_node(model, good, node), None),
            }
        }
        Failure::Newton(NewtonError::Slow { node }) => (of_node(model, good, node), None),
        Failure::Contact | Failure::Restless => {
            (of_contact(model, state, ContactCheck::open_mm, |c| c.worst_open), None)
        }
        Failure::Friction => (of_contact(model, state, |c| c.friction_lag, |c| c.worst_lag), None),
    };
    let place = Box::new(place);
    if falling > 0 && refusal.is_none() {
        return SolveError::NoStableState { falling, place, load_fraction, last };
    }
    let (why, remedy) = match (&failure, refusal.map(|at| at.refusal.cause)) {
        (Failure::Contact, _) => (
            "a contact stays open or penetrated".to_owned(),
            "check that the contact surfaces reach as far as the body",
        ),
        (Failure::Friction, _) => (
            "friction does not settle with the normal pressure".to_owned(),
            "lower the friction coefficient, or hold the body better",
        ),
        (Failure::Restless, _) => (
            "a contact goes to and fro between elements of the other surface".to_owned(),
            "mesh the two surfaces alike, or load less",
        ),
        (_, Some(cause @ MaterialError::Locked { .. })) => {
            (cause.to_string(), "raise Jm of the law, or load less")
        }
        (_, Some(cause)) => {
            (cause.to_string(), "improve the mesh there, stiffen the tissue, or load less")
        }
        (_, None) => (
            "the search for a minimum stalled".to_owned(),
            "hold the body better, stiffen the tissue, or load less",
        ),
    };
    SolveError::Stopped { why, place, load_fraction, remedy, last }
}

/// The element that refused a state.
fn of_refusal(model: &Model, state: &State, at: &TermRefusal) -> Place {
    let (term, element) = (state.terms(model)[at.term], at.refusal.element);
    let nodes = term.nodes(element);
    let mm = nodes.iter().map(|&n| state.points[n as usize]).sum::<Vec3>() / nodes.len() as f64;
    Place { term: term.name().into(), element, node: None, mm }
}

/// A node, with the first element that has it.
fn of_node(model: &Model, points: &[Vec3], node: usize) -> Place {
    let element = |term: usize| {
        let term = &model.terms()[term];
        let has = |e: &usize| term.nodes(*e).contains(&(node as u32));
        (0..term.elements()).find(has).map(|element| (term.name().to_owned(), element))
    };
    let (term, element) = (0..model.terms().len()).find_map(element).unwrap_or_default();
    Place { term, element, node: Some(node), mm: points[node] }
}

/// The worst node of the contact that is worst by `size`.
fn of_contact(
    model: &Model,
    state: &State,
    size: impl Fn(&ContactCheck) -> f64,
    element: impl Fn(&ContactCheck) -> usize,
) -> Place {
    let checks = state.terms(model).into_iter().enumerate();
    let checks = checks.filter_map(|(n, term)| Some((term, term.contact(&state.at(n))?)));
    let worst = checks.max_by(|a, b| size(&a.1).total_cmp(&size(&b.1)));
    let Some((term, check)) = worst else { return of_node(model, &state.points, 0) };
    let element = element(&check);
    let node = term.nodes(element)[0] as usize;
    Place { term: term.name().into(), element, node: Some(node), mm: state.points[node] }
}

/// The node that has gone farthest from its rest position: an energy that overflows has one that fled.
fn farthest(model: &Model, state: &State) -> usize {
    let ways = state.points.iter().zip(&model.rest).map(|(p, rest)| (p - rest).norm());
    let far = ways.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    far.map_or(0, |(node, _)| node)
}
