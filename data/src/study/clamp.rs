//! Clamping and release in a study: how long, what is held, how the tissue relaxes.

use serde::{Deserialize, Serialize};

/// What is held while the breast is clamped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldName {
    /// The distance of the plates: the force relaxes.
    #[default]
    Thickness,
    /// The force: the breast creeps.
    Force,
}

/// Experiment that times and shares of the tissue come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MeasuredIn {
    /// Creep under a constant force: retardation times, strain over the elastic strain.
    #[default]
    Creep,
    /// Relaxation at a constant strain: relaxation times, stress over the long-term stress.
    Relaxation,
}

/// Clamping and release after a compression.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClampPlan {
    /// How long the plates close (s).
    pub ramp_s: f64,
    /// How long the breast is clamped (s).
    pub clamp_s: f64,
    /// How long the plates open (s).
    pub release_s: f64,
    /// What is held.
    pub held: HeldName,
    /// Where `times_s` and `shares` come from.
    pub measured_in: MeasuredIn,
    /// Time constants (s), rising.
    pub times_s: Vec<f64>,
    /// Share of each, over the elastic strain (creep) or the long-term stress (relaxation).
    pub shares: Vec<f64>,
}

impl Default for ClampPlan {
    /// Durations of 117 women (de Groot et al. 2015, BMC Womens Health 15:26); retardation times of
    /// breast in vivo (Sridhar and Insana 2007), whose viscoelastic strain is about the elastic one: shares of one in
    /// all. That both terms have the same share, and a release of two seconds, are assumptions.
    fn default() -> Self {
        Self {
            ramp_s: 7.5,
            clamp_s: 12.8,
            release_s: 2.0,
            held: HeldName::Thickness,
            measured_in: MeasuredIn::Creep,
            times_s: vec![3.2, 42.0],
            shares: vec![0.5, 0.5],
        }
    }
}
