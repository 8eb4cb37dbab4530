//! The cushion: a rigid plate under a layer of foam that gives way where it is pressed on.
//!
//! The foam is a Winkler layer: springs beside each other that do not feel their neighbours, so that
//! the pressure is E/t times the indentation (Johnson, *Contact mechanics* (1985), § 4.3). For foam,
//! whose Poisson ratio is near zero, E is Young's modulus; a layer that cannot give way sideways
//! would have E (1 - ν) / ((1 + ν) (1 - 2 ν)) in its place.

/// A layer of foam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cushion {
    /// Thickness t (mm) when nothing presses.
    pub thickness_mm: f64,
    /// Modulus E (kPa).
    pub young_kpa: f64,
}

impl Cushion {
    /// Pressure by indentation, E/t (kPa/mm).
    pub fn stiffness_kpa_per_mm(&self) -> f64 {
        self.young_kpa / self.thickness_mm
    }
}
