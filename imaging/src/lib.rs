//! Pictures in, pictures out: magnetic resonance and X-ray.
//!
//! Values in, values out: nothing here reads a file or a clock.

pub mod mri;
pub mod xray;
