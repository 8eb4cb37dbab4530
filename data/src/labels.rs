//! What a voxel or an element is made of.

use crate::volume::Volume;

/// A tissue; the numbers are the label values in NIfTI files.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Tissue {
    /// Air around the body, and anything outside of it.
    Background = 0,
    /// Fat of the right breast (the person's right, +x).
    AdiposeRight = 1,
    /// Fat of the left breast.
    AdiposeLeft = 2,
    /// Fibroglandular tissue of the right breast.
    FibroglandularRight = 3,
    /// Fibroglandular tissue of the left breast.
    FibroglandularLeft = 4,
    /// Skin.
    Skin = 5,
    /// Pectoral muscle.
    PectoralMuscle = 6,
    /// Everything behind the muscle: ribs, lungs, heart.
    Thorax = 7,
    /// Nipple and areola.
    NippleAreola = 8,
    /// Soft tissue outside of the breast limits.
    Other = 9,
}

impl Tissue {
    /// All tissues, by label value.
    pub const ALL: [Self; 10] = [
        Self::Background,
        Self::AdiposeRight,
        Self::AdiposeLeft,
        Self::FibroglandularRight,
        Self::FibroglandularLeft,
        Self::Skin,
        Self::PectoralMuscle,
        Self::Thorax,
        Self::NippleAreola,
        Self::Other,
    ];

    /// Tissue of a label value; `None` for a value that no tissue has.
    pub fn from_label(label: u8) -> Option<Self> {
        Self::ALL.get(usize::from(label)).copied()
    }

    /// Label value in NIfTI files.
    pub fn label(self) -> u8 {
        self as u8
    }

    /// The breast that fat and gland are named after; `None` of all else.
    pub fn side(self) -> Option<Side> {
        match self {
            Self::AdiposeRight | Self::FibroglandularRight => Some(Side::Right),
            Self::AdiposeLeft | Self::FibroglandularLeft => Some(Side::Left),
            _ => None,
        }
    }

    /// Whether it belongs to the deformable breasts (skin and nipple included).
    pub fn is_breast(self) -> bool {
        use Tissue::*;
        matches!(
            self,
            AdiposeRight
                | AdiposeLeft
                | FibroglandularRight
                | FibroglandularLeft
                | Skin
                | NippleAreola
        )
    }

    /// Whether it is fibroglandular.
    pub fn is_gland(self) -> bool {
        matches!(self, Self::FibroglandularRight | Self::FibroglandularLeft)
    }

    /// Whether it is soft tissue in front of the chest wall, in a breast or not.
    pub fn is_soft(self) -> bool {
        self.is_breast() || self == Self::Other
    }

    /// Whether it is behind the breast: muscle or thorax.
    pub fn is_chest_wall(self) -> bool {
        matches!(self, Self::PectoralMuscle | Self::Thorax)
    }
}

/// A volume of tissues.
pub type LabelMap = Volume<Tissue>;

/// What a person marked in an image: the tissue of a few voxels, [`Tissue::Background`] being air;
/// `None` where nothing is said.
#[derive(Debug, Clone, PartialEq)]
pub struct Scribbles(pub Volume<Option<Tissue>>);

impl Scribbles {
    /// Value of marked air in files, in which 0 is what is not marked.
    pub const AIR: u8 = 10;

    /// What a value in a file marks; the outer `None` for a value that marks nothing known.
    pub fn from_label(label: u8) -> Option<Option<Tissue>> {
        match label {
            0 => Some(None),
            Self::AIR => Some(Some(Tissue::Background)),
            tissue => Tissue::from_label(tissue).map(Some),
        }
    }

    /// The value in a file.
    pub fn label(mark: Option<Tissue>) -> u8 {
        match mark {
            None => 0,
            Some(Tissue::Background) => Self::AIR,
            Some(tissue) => tissue.label(),
        }
    }
}

/// Label values as another program numbers them, before [`LabelMap`] is made of them.
#[derive(Debug, Clone, PartialEq)]
pub struct RawLabels(pub Volume<u16>);

/// The person's side; right is +x.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The person's right, +x.
    Right,
    /// The person's left, -x.
    Left,
}

impl Side {
    /// Sign of x on this side.
    pub fn sign(self) -> f64 {
        match self {
            Self::Right => 1.0,
            Self::Left => -1.0,
        }
    }

    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::Right => Self::Left,
            Self::Left => Self::Right,
        }
    }

    /// Word in study files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Left => "left",
        }
    }
}
