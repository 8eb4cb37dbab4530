//! Plates that press: one file each.

pub mod hinge;
pub mod rigid;

pub use hinge::Hinge;
pub use rigid::RoundedPlate;
