//! Magnetic resonance images.

pub mod register;
pub mod segment;
pub mod synthesize;
