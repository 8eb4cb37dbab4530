//! Magnetic resonance images.

pub mod register;
