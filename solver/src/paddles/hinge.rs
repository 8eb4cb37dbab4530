//! A paddle that tilts about an axis along the chest-wall edge: the flex paddle.
//!
//! The tilt is positive when the side of the nipple sinks. The hinge resists with a torque that is
//! a polynomial of second degree in the tilt (Mîra 2018, § 5.1.1), odd for tilts the other way.

use super::RoundedPlate;
use mammotwin_data::Vec3;

/// Where a paddle turns, and what resists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hinge {
    /// Distance of the axis from the chest-wall edge of the paddle (mm).
    pub axis_mm: f64,
    /// Torque by tilt (mN mm/rad).
    pub linear_mn_mm: f64,
    /// Torque by tilt squared (mN mm/rad²).
    pub quadratic_mn_mm: f64,
}

impl Hinge {
    /// Torque (mN mm) at a tilt (rad).
    pub fn torque(&self, tilt_rad: f64) -> f64 {
        tilt_rad * (self.linear_mn_mm + self.quadratic_mn_mm * tilt_rad.abs())
    }

    /// Its derivative (mN mm/rad).
    pub fn stiffness(&self, tilt_rad: f64) -> f64 {
        self.linear_mn_mm + 2.0 * self.quadratic_mn_mm * tilt_rad.abs()
    }
}

/// A plate turned about a line in its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tilted {
    pub shape: RoundedPlate,
    /// Where its surface is along `shape.into` (mm).
    pub level_mm: f64,
    /// Coordinate of the axis along `shape.away` (mm).
    axis_mm: f64,
}

impl Tilted {
    /// The plate whose surface is at `level_mm` when it is not tilted, turned about the line at
    /// `axis_mm` from its edge.
    pub fn new(flat: &RoundedPlate, level_mm: f64, axis_mm: f64, tilt_rad: f64) -> Self {
        let (sin, cos) = tilt_rad.sin_cos();
        let along = flat.edge_mm + axis_mm;
        let into = cos * flat.into + sin * flat.away;
        let away = cos * flat.away - sin * flat.into;
        let turned = cos * along - sin * level_mm;
        let shape = RoundedPlate { into, away, edge_mm: turned - axis_mm, ..*flat };
        Self { shape, level_mm: cos * level_mm + sin * along, axis_mm: turned }
    }

    /// By how much a point (mm) of the plate moves as its tilt grows (mm/rad).
    pub fn turning(&self, point: &Vec3) -> Vec3 {
        let RoundedPlate { into, away, .. } = self.shape;
        let out = away.dot(point) - self.axis_mm;
        let up = into.dot(point) - self.level_mm;
        up * away - out * into
    }
}
