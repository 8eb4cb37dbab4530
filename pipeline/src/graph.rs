//! The pipeline: one function whose calls are the graph.

use mammotwin_data::{Failure, store::Run, study::Study};

/// What a run leaves.
#[derive(Debug, Clone, Default)]
pub struct Outcome {}

/// Calls the stages of a study.
pub fn run(_study: &Study, _run: &Run<'_>) -> Result<Outcome, Failure> {
    Ok(Outcome::default())
}
