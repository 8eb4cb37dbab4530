//! Pictures in, pictures out: magnetic resonance and X-ray.

pub mod xray;
