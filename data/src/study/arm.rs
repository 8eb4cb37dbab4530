//! An arm beside the breast.

use serde::{Deserialize, Serialize};

/// An upper arm that rests beside the breast: round, rigid, in the frame of its pose's image (RAS mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmPlan {
    /// One end of its axis (mm).
    pub from_mm: [f64; 3],
    /// The other end (mm).
    pub to_mm: [f64; 3],
    /// Radius (mm).
    pub radius_mm: f64,
}
