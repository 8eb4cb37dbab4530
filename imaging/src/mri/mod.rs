//! Magnetic resonance images, and the labels, surfaces and fields made from them.

pub mod blur;
pub mod breast;
pub mod distance_field;
pub mod lattice;
mod nearest_seed;
pub mod register;
pub mod segment;
pub mod skin;
pub mod smooth;
pub mod surface;
pub mod synthesize;
