//! Plates of a study that end somewhere, and what lies on them: outline, spot, window, foam, CAD.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Radius (mm) of the rounded edges of all plates where none is given: an assumption.
pub const EDGE_RADIUS_MM: f64 = 6.0;

/// Where a plate ends: a rectangle with round corners; the chest-wall edge is one of its sides.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutlinePlan {
    /// Length of the chest-wall edge (mm).
    pub width_mm: f64,
    /// Length of the sides (mm).
    pub depth_mm: f64,
    /// Radius of the corners (mm).
    pub corner_mm: f64,
}

impl Default for OutlinePlan {
    /// The large plate, 24 x 29 cm; the corners are an assumption.
    fn default() -> Self {
        Self { width_mm: 290.0, depth_mm: 240.0, corner_mm: 20.0 }
    }
}

impl OutlinePlan {
    /// The small plate, 18 x 24 cm.
    pub const SMALL: Self = Self { width_mm: 240.0, depth_mm: 180.0, corner_mm: 20.0 };
}

/// Shape of a spot paddle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpotName {
    /// A disc.
    #[default]
    Round,
    /// A square with round corners.
    Square,
}

/// A spot paddle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SpotPlan {
    /// Round or square.
    pub shape: SpotName,
    /// Diameter, or length of a side (mm).
    pub size_mm: f64,
    /// Radius of the corners of a square one (mm).
    pub corner_mm: f64,
    /// How far its middle lies beside that of the breast, along +x of the detector (mm).
    pub along_mm: f64,
    /// How far it begins from the chest-wall edge of the receptor (mm).
    pub away_mm: f64,
}

impl Default for SpotPlan {
    /// Round, 9 cm, at the chest-wall edge.
    fn default() -> Self {
        let shape = SpotName::Round;
        Self { shape, size_mm: 90.0, corner_mm: 15.0, along_mm: 0.0, away_mm: 0.0 }
    }
}

/// The window of a biopsy paddle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BiopsyPlan {
    /// Length of the window along the chest-wall edge (mm).
    pub window_width_mm: f64,
    /// Length of the window away from it (mm).
    pub window_depth_mm: f64,
    /// Radius of its corners (mm).
    pub corner_mm: f64,
    /// How far its middle lies beside that of the breast, along +x of the detector (mm).
    pub along_mm: f64,
    /// How far it begins from the paddle's chest-wall edge (mm).
    pub away_mm: f64,
}

impl Default for BiopsyPlan {
    /// 5 x 5 cm; corners and place are assumptions.
    fn default() -> Self {
        Self {
            window_width_mm: 50.0,
            window_depth_mm: 50.0,
            corner_mm: 5.0,
            along_mm: 0.0,
            away_mm: 25.0,
        }
    }
}

/// The foam of a cushion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CushionPlan {
    /// Thickness when nothing presses (mm).
    pub thickness_mm: f64,
    /// Modulus (kPa): pressure over the share of the thickness by which the foam is pressed in.
    pub young_kpa: f64,
}

impl Default for CushionPlan {
    /// An assumption: 5 mm of a soft foam.
    fn default() -> Self {
        Self { thickness_mm: 5.0, young_kpa: 50.0 }
    }
}

/// A paddle from CAD.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CadPlan {
    /// STL file in millimetres: x along the chest-wall edge, y away from the chest wall, z from the
    /// breast into the paddle.
    pub file: PathBuf,
}
