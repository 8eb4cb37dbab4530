//! Bodies and forces: meshes, materials, energy terms and equilibrium.
//!
//! A [`model::Model`] is a list of [`terms`] on the nodes of a mesh. Its equilibrium is the
//! minimum of their summed energy, which [`solve::solve`] finds and checks. The solver knows no
//! breast: what is skin, muscle or a ligament is said by the caller.
//!
//! No input or output, no clock: values in, values out.

pub mod assemble;
pub mod compress;
pub mod distance;
mod eigen;
mod held;
pub mod linear;
pub mod materials;
pub mod mesh;
pub mod model;
pub mod newton;
pub mod ordering;
pub mod paddles;
pub mod sensitivity;
pub mod solve;
pub mod terms;
pub mod unload;
pub mod viscoelastic;

pub use model::{Model, ModelError};
pub use solve::{Options, SolveError, solve, solve_near};
