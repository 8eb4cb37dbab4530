//! Why an equilibrium has no derivatives.

use crate::assemble::TermRefusal;
use crate::linear::LinearError;
use crate::solve::SolveError;

/// Why there is no derivative.
#[derive(Debug, thiserror::Error)]
pub enum SensitivityError {
    /// There is no equilibrium to begin with.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// A term that remembers its way, or whose surface moves on to other elements.
    #[error(
        "{0}: its forces lag behind the state; derivatives want contacts without friction and foam, on surfaces that do not give way"
    )]
    Lags(String),
    /// The state is no minimum, or nearly none.
    #[error(
        "the equilibrium is not stable: the tangent has {negative} negative pivots, {pressures} of pressures"
    )]
    Unstable {
        /// Negative pivots of the tangent.
        negative: usize,
        /// Number of nodal pressures, which have one each.
        pressures: usize,
    },
    /// The tangent cannot be solved with.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// Multipliers that do not settle.
    #[error(
        "the contacts of the linearised model do not close: off by {0:.1e} of the displacement"
    )]
    Contact(f64),
    /// A model beside this one that has other elements.
    #[error("the models differ in the elements of {0}; change numbers alone")]
    Other(String),
    /// A state that a model beside this one cannot be in.
    #[error("term {term}, element {element}: {cause}; take a smaller step")]
    Refused {
        /// Index of the term.
        term: usize,
        /// Its element.
        element: usize,
        /// Why.
        cause: String,
    },
    /// An observable of a term that is not there.
    #[error("the model has no term named {0}")]
    NoTerm(String),
}

impl From<TermRefusal> for SensitivityError {
    fn from(at: TermRefusal) -> Self {
        let (term, element) = (at.term, at.refusal.element);
        Self::Refused { term, element, cause: at.refusal.cause.to_string() }
    }
}
