//! A pose that was measured as a surface: no image, the skin alone.

use super::{Posture, Use, falling};
use crate::Vec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Units of lengths in a file of a scanner.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScanUnit {
    /// Millimetres.
    #[default]
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
}

impl ScanUnit {
    /// Millimetres in one.
    pub fn in_mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
        }
    }
}

/// A pose that a body scanner measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scan {
    /// STL or PLY file of the skin. It may end beside the breasts, but has no hole over them.
    pub surface: PathBuf,
    /// Units of that file.
    #[serde(default)]
    pub unit: ScanUnit,
    /// Landmarks in the frame of the scan, in millimetres whatever its units: at least three of the chest
    /// wall (`chest_...`) that the reference pose has, too. They alone say how the scan lies.
    pub landmarks: PathBuf,
    /// Direction of gravity by name, where the scan's axes point right, forwards and up (RAS); or give
    /// `gravity_in_scan`.
    pub posture: Option<Posture>,
    /// Direction of gravity in the frame of the scan; any length.
    pub gravity_in_scan: Option<[f64; 3]>,
    /// Whether it calibrates or proves.
    #[serde(default, rename = "use")]
    pub usage: Use,
    /// What a reader of the report must know about this scan.
    pub warning: Option<String>,
}

impl Scan {
    /// Unit vector of gravity in the frame of the scan; `None` when the study gives neither key.
    pub fn gravity(&self) -> Option<Vec3> {
        falling(self.posture, self.gravity_in_scan)
    }
}
