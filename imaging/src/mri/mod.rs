//! Magnetic resonance images.

pub mod register;
pub mod synthesize;
