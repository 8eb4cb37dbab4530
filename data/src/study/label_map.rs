//! Names that a study gives to the numbers of finished labels.

use crate::labels::Tissue;
use serde::{Deserialize, Serialize};

/// A tissue, or one that is told from its other side only by where it lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LabelName {
    /// Air, and whatever is to be ignored.
    Background,
    /// Fat of the right breast.
    AdiposeRight,
    /// Fat of the left breast.
    AdiposeLeft,
    /// Fat of both breasts: right and left of the middle of the chest.
    Adipose,
    /// Fibroglandular tissue of the right breast.
    FibroglandularRight,
    /// Fibroglandular tissue of the left breast.
    FibroglandularLeft,
    /// Fibroglandular tissue of both breasts.
    Fibroglandular,
    /// Skin.
    Skin,
    /// Pectoral muscle.
    PectoralMuscle,
    /// Everything behind the muscle.
    Thorax,
    /// Nipple and areola.
    NippleAreola,
    /// Soft tissue outside of the breast limits.
    Other,
}

impl LabelName {
    /// The tissue, on the person's right or left.
    pub fn tissue(self, right: bool) -> Tissue {
        match self {
            Self::Background => Tissue::Background,
            Self::AdiposeRight => Tissue::AdiposeRight,
            Self::AdiposeLeft => Tissue::AdiposeLeft,
            Self::Adipose if right => Tissue::AdiposeRight,
            Self::Adipose => Tissue::AdiposeLeft,
            Self::FibroglandularRight => Tissue::FibroglandularRight,
            Self::FibroglandularLeft => Tissue::FibroglandularLeft,
            Self::Fibroglandular if right => Tissue::FibroglandularRight,
            Self::Fibroglandular => Tissue::FibroglandularLeft,
            Self::Skin => Tissue::Skin,
            Self::PectoralMuscle => Tissue::PectoralMuscle,
            Self::Thorax => Tissue::Thorax,
            Self::NippleAreola => Tissue::NippleAreola,
            Self::Other => Tissue::Other,
        }
    }
}
