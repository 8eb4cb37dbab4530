//! The numerical phantom: a compressed breast with microcalcifications.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    calcification,
    placement::{Site, sites},
    raster::RasterError,
};
use mammotwin_data::{study::MammogramPlan, surface::TriMesh};

/// Why there is no phantom.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// The compressed surface has no inside.
    #[error("compressed breast: {0}")]
    Surface(#[from] RasterError),
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// Nothing of the matrix lies in tissue.
    #[error(
        "no microcalcification lies in tissue: the breast is nowhere about {thickness_mm} mm thick \
         in front of the detector's edge; check thickness and frame"
    )]
    Misplaced {
        /// Nominal thickness (mm).
        thickness_mm: f64,
    },
}

/// One microcalcification.
#[derive(Debug, Clone, PartialEq)]
pub struct Calcification {
    /// Place in the matrix.
    pub site: Site,
    /// Diameter (mm) of the sphere of its volume.
    pub diameter_mm: f64,
    /// Closed surface.
    pub surface: TriMesh,
}

/// Homogeneous tissue in a closed surface, and microcalcifications that replace some of it
/// (Mîra 2018, § 5.2.2).
#[derive(Debug, Clone, PartialEq)]
pub struct Phantom {
    /// Closed surface, in the frame of the detector (mm).
    pub surface: TriMesh,
    /// Nominal thickness (mm): distance of the plates.
    pub thickness_mm: f64,
    /// Breast tissue.
    pub tissue: Material,
    /// What the calcifications are made of.
    pub calcium: Material,
    /// By row, then column; those in tissue only.
    pub calcifications: Vec<Calcification>,
}

impl Phantom {
    /// Fills a compressed breast as the plan says, with calcifications of one diameter. Shapes
    /// depend on the seed and the place in the matrix alone, so phantoms of one seed compare
    /// diameters or paddles on the same shapes.
    pub fn new(
        surface: TriMesh,
        thickness_mm: f64,
        plan: &MammogramPlan,
        diameter_mm: f64,
        seed: u64,
    ) -> Result<Self, PhantomError> {
        let matrix = &plan.calcifications;
        let sites = sites(&surface, thickness_mm, matrix)?;
        if sites.is_empty() && matrix.rows * matrix.columns > 0 {
            return Err(PhantomError::Misplaced { thickness_mm });
        }
        let calcify = |site: Site| {
            let shape = seed.wrapping_add((site.row * matrix.columns + site.column) as u64);
            let surface = calcification::irregular(&site.center, diameter_mm, shape);
            Calcification { site, diameter_mm, surface }
        };
        Ok(Self {
            surface,
            thickness_mm,
            tissue: Material::breast(plan.glandularity)?,
            calcium: Material::calcification()?,
            calcifications: sites.into_iter().map(calcify).collect(),
        })
    }
}
