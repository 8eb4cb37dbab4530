//! Plates that press: one file each.

pub mod rigid;

pub use rigid::RoundedPlate;
