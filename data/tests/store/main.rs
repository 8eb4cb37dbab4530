//! The store under the use and misuse that it meets, on a toy graph.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod damage;
mod edit;
mod options;
mod process;
mod questions;
mod reuse;
mod toy;
