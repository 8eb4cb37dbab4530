//! From a volunteer's MRI to mammography metrics: the graph of stages and the command line.
//!
//! [`graph`] is the pipeline: one function whose calls are the graph. [`commands`] holds one
//! function for each command; [`cli`] reads the arguments, and `main` only reports how it ended.

/// Prints a line on standard output. That nobody reads it any more (`mammotwin ... | head`) is no error:
/// what was asked for is still done.
macro_rules! tell {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        writeln!(std::io::stdout(), $($text)*).ok();
    }};
}

pub mod accuracy;
pub mod bids;
pub mod cli;
pub mod commands;
pub mod comparison;
pub mod designs;
pub mod display;
pub mod estimates;
pub mod force_curve;
pub mod graph;
pub mod map;
mod page;
pub mod plausible;
pub mod score;
pub mod segmentation;
pub mod sensitivity;
pub mod stiffening;
