//! A rigid paddle whose surface rises towards the chest wall and falls to both sides: it spreads
//! the pressure that a flat one puts on the tissue at its edge.
//!
//! The rise is a cubic that ends with curvature zero, so that contact sees no jump of curvature.

use super::{AT_REST, Bend, Lift, Place, Pose};

/// A rigid curved surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvedPlate {
    /// How far the chest-wall edge lies above the flat part (mm).
    pub rise_mm: f64,
    /// From how far away from the edge it rises (mm).
    pub reach_mm: f64,
    /// Radius (mm) of the arch along the edge, its middle highest; infinite when there is none.
    pub arch_radius_mm: f64,
}

impl Lift for CurvedPlate {
    fn coordinates(&self) -> usize {
        0
    }

    fn bend(&self, [along, away]: Place, _: &Pose) -> Bend {
        let left = (1.0 - away / self.reach_mm).max(0.0);
        let (rise, reach) = (self.rise_mm, self.reach_mm);
        Bend {
            value: rise * left.powi(3) - 0.5 * along * along / self.arch_radius_mm,
            slope: [-along / self.arch_radius_mm, -3.0 * rise * left * left / reach],
            curvature: [-1.0 / self.arch_radius_mm, 0.0, 6.0 * rise * left / (reach * reach)],
        }
    }

    fn weights(&self, _: Place) -> Pose {
        AT_REST
    }

    fn resistance(&self, _: &Pose) -> (Pose, Pose) {
        (AT_REST, AT_REST)
    }
}
