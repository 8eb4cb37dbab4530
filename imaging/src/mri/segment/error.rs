//! Why a volume cannot be segmented, and what to look at when it was.

use mammotwin_data::labels::Side;

/// A border of the image, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Border {
    /// Towards the head.
    Superior,
    /// Towards the feet.
    Inferior,
    /// Away from the back.
    Anterior,
    /// Away from the mid-line.
    Lateral,
}

impl std::fmt::Display for Border {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Superior => "superior",
            Self::Inferior => "inferior",
            Self::Anterior => "anterior",
            Self::Lateral => "lateral",
        })
    }
}

/// Why there is no segmentation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SegmentError {
    /// The grid is too small or has no volume.
    #[error(
        "image has {shape:?} voxels: a volume needs at least 8 along each axis and axes that span space; give the whole scan"
    )]
    Grid {
        /// Number of voxels along i, j, k.
        shape: [usize; 3],
    },
    /// A voxel is NaN or infinite.
    #[error(
        "voxel {voxel:?} is {value}: replace values that are not finite, or convert the scan anew"
    )]
    NotFinite {
        /// The first such voxel.
        voxel: [usize; 3],
        /// Its value.
        value: f32,
    },
    /// Nothing stands out from the background.
    #[error(
        "no body in the image: all voxels have about the same brightness; check that this is the scan and not a mask or a localiser"
    )]
    Empty,
    /// There is a body, but neither bright fat in front of darker muscle nor suppressed fat in front of brighter
    /// muscle.
    #[error(
        "no chest wall found: expected bright fat in front of dark muscle, or dark (suppressed) fat in front of brighter muscle; give an image without fat suppression, a `body_frame` if the body is turned, scribbles or finished labels"
    )]
    NoChestWall,
    /// There is a body and a chest wall, but nothing in front of it.
    #[error(
        "no breast protrudes from the chest wall; check the orientation of the image or give finished labels"
    )]
    NoBreast,
    /// Scribbles are not of this image.
    #[error("scribbles lie on another grid than the image; draw them on the image itself")]
    ScribblesElsewhere,
    /// Nothing is marked.
    #[error("no voxel of the scribbles is marked; mark some of each tissue, or leave the key out")]
    ScribblesEmpty,
    /// Another contrast cannot be learnt from what is marked.
    #[error(
        "scribbles: fat is not brighter than muscle and gland in this image; to learn its contrast five \
         voxels and more of each class must be marked; missing: {missing}"
    )]
    ScribblesMissing {
        /// Classes with their labels.
        missing: String,
    },
    /// A breast continues beyond the image.
    #[error("the {} breast is cut by the {border} border of the image; give a scan that holds all of it, or finished labels", side.name())]
    BreastCut {
        /// Whose.
        side: Side,
        /// Where.
        border: Border,
    },
}

/// What somebody should look at, though there is a result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Warning {
    /// Tissue in front of the wall is still thick at a border.
    #[error("the {} breast still has {percent:.0} % of its largest cross-section at the {border} border of the image: its volume ends there", side.name())]
    EndsAtBorder {
        /// Whose.
        side: Side,
        /// Where.
        border: Border,
        /// Cross-section at the border, relative to the largest (%).
        percent: f64,
    },
    /// Fat is suppressed.
    #[error(
        "fat is suppressed in this image: the chest wall is less sure than without, and bright fat near a coil or \
         where the suppression fails counts as gland; look at the labels"
    )]
    SuppressedFat,
    /// The wall is interpolated over much of the breast.
    #[error(
        "the chest wall is visible behind only {percent:.0} % of the breasts; between, it is interpolated"
    )]
    FaintWall {
        /// Part of the columns in which fat and muscle were told apart (%).
        percent: f64,
    },
    /// The rear of the muscle is a guess.
    #[error(
        "the rear of the muscle is visible in only {percent:.0} % of the columns; elsewhere its belly is taken for {belly_mm:.0} mm thick"
    )]
    NominalMuscle {
        /// Part of the columns in which it was seen (%).
        percent: f64,
        /// Thickness assumed elsewhere half-way between sternum and side (mm).
        belly_mm: f64,
    },
    /// The skin is thinner than a voxel.
    #[error(
        "voxels of {voxel_mm:.1} mm do not resolve skin: one layer of voxels or {skin_mm:.1} mm carries its label"
    )]
    CoarseSkin {
        /// Largest voxel spacing (mm).
        voxel_mm: f64,
        /// Nominal thickness (mm).
        skin_mm: f64,
    },
}
