//! How bright a substance is in a T2-weighted turbo spin echo without fat suppression.

/// What a point of the body is made of, as magnetic resonance sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Substance {
    /// Air, outside of the body or in the trachea.
    Air,
    /// Adipose tissue.
    Fat,
    /// Fibroglandular tissue.
    Gland,
    /// Skin, nipple and areola.
    Skin,
    /// Skeletal muscle.
    Muscle,
    /// Compact bone.
    CorticalBone,
    /// Marrow of ribs and sternum.
    Marrow,
    /// Costal cartilage.
    Cartilage,
    /// Aerated lung.
    Lung,
    /// Wall of the heart.
    Myocardium,
    /// Flowing blood (flow void).
    Blood,
    /// Liver and spleen.
    Liver,
    /// Marrow of vertebrae.
    VertebralMarrow,
    /// Intervertebral disc.
    Disc,
    /// Cerebrospinal fluid.
    Fluid,
}

impl Substance {
    /// Signal relative to fat, before the coil.
    pub fn signal(self) -> f64 {
        match self {
            Self::Air => 0.0,
            Self::Fat => 1.0,
            Self::Gland => 0.42,
            Self::Skin => 0.36,
            Self::Muscle => 0.17,
            Self::CorticalBone => 0.05,
            Self::Marrow => 0.70,
            Self::Cartilage => 0.28,
            Self::Lung => 0.04,
            Self::Myocardium => 0.26,
            Self::Blood => 0.09,
            Self::Liver => 0.22,
            Self::VertebralMarrow => 0.50,
            Self::Disc => 0.38,
            Self::Fluid => 1.05,
        }
    }

    /// Standard deviation of the texture over the signal.
    pub(super) fn texture(self) -> f64 {
        match self {
            Self::Air => 0.0,
            Self::Fat => 0.06,
            Self::Gland => 0.22,
            Self::Muscle => 0.16,
            Self::Lung => 0.5,
            Self::Marrow | Self::VertebralMarrow | Self::Liver => 0.12,
            _ => 0.10,
        }
    }
}
