//! The program from outside: one program, so that its tests share the cores.

#![allow(clippy::unwrap_used)] // a test may fail at once

// Tests begin in the order of their names: the longest first leaves no core idle at the end.
mod all_stages;
mod bad_input;
mod bids;
mod command_line;
mod comparison;
mod deviations;
mod discover;
mod force_curve;
mod inputs;
mod scans;
mod search_box;
mod segmentation;
