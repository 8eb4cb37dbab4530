//! The store under the use and misuse that it meets, on a toy graph.

mod damage;
mod edit;
mod options;
mod process;
mod questions;
mod reuse;
mod toy;
