//! The store under the use and misuse that it meets, on a toy graph.

mod reuse;
mod toy;
