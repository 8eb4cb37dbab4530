//! Bodies and forces: meshes, materials, energy terms and equilibrium.
//!
//! No input or output, no clock: values in, values out.

pub mod distance;
pub mod mesh;
