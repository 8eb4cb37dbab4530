//! The program from outside: one program, so that its tests share the cores.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod bad_input;
mod bids;
mod command_line;
mod comparison;
mod deviations;
mod discover;
mod force_curve;
mod scans;
mod search_box;
mod segmentation;
mod whole_graph;
