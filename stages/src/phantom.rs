//! The compressed breast as an object to be X-rayed.

use crate::compress::Compression;
use mammotwin_data::{
    Failure,
    io::hdf5,
    progress::Progress,
    store::{Artifact, Stage},
    study::MammogramPlan,
    surface::TriMesh,
};
use mammotwin_imaging::xray::{
    phantom::{self, PhantomError},
    raster::RasterError,
    transport::{bodies::Closed, exam::MEDIA, scene::Bounds},
};
use serde::Serialize;
use std::path::Path;

/// Cells (mm) of the distances from the skin.
const STEP_MM: f64 = 2.0;
/// Skin (mm): Huang et al. (2008), mean of 51 breasts.
const SKIN_MM: f64 = 1.45;
/// Body behind the detector's edge that may scatter (mm).
const BEHIND_MM: f64 = 40.0;
/// The skin may lie this far (mm) beyond the plates.
const BEYOND_MM: f64 = 1.0;

/// Fills the compressed surface with tissue and microcalcifications.
#[derive(Debug, Clone, Serialize)]
pub struct Phantom {
    /// Tissue and microcalcifications.
    pub plan: MammogramPlan,
    /// Seed of the shapes of the microcalcifications.
    pub seed: u64,
}

/// A compressed breast and what is put into it.
#[derive(Debug, Clone)]
pub struct CompressedPhantom {
    /// Closed outer surface in the detector's frame (mm), see [`Compression`].
    pub surface: TriMesh,
    /// Nominal distance of the plates (mm), see [`Compression`].
    pub thickness_mm: f64,
    /// Tissue and microcalcifications.
    pub plan: MammogramPlan,
    /// Seed of the shapes of the microcalcifications.
    pub seed: u64,
}

impl CompressedPhantom {
    /// The phantom with microcalcifications of one diameter (mm).
    pub fn with_diameter(&self, diameter_mm: f64) -> Result<phantom::Phantom, PhantomError> {
        let surface = self.surface.clone();
        phantom::Phantom::new(surface, self.thickness_mm, &self.plan, diameter_mm, self.seed)
    }

    /// Air, skin and tissue by place, without microcalcifications, up to the plates and a little
    /// behind the detector's edge.
    pub fn body(&self) -> Result<Closed, RasterError> {
        let (far, top) = (f64::MAX, self.thickness_mm + BEYOND_MM);
        let part = Bounds::of([-far, far], [-BEHIND_MM, far], [-BEYOND_MM, top]);
        Closed::part(&self.surface, part, STEP_MM, SKIN_MM, MEDIA)
    }
}

impl Artifact for CompressedPhantom {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Detector)?;
        file.put_surface("surface", &self.surface)?;
        file.put_scalar("thickness", self.thickness_mm, "mm", "distance of the plates")?;
        file.put_json("plan", &self.plan, "tissue and microcalcifications")?;
        file.put_json("seed", &self.seed, "seed of the microcalcifications")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        Ok(Self {
            surface: file.surface("surface")?,
            thickness_mm: file.scalar("thickness")?,
            plan: file.json("plan")?,
            seed: file.json("seed")?,
        })
    }
}

impl Stage for Phantom {
    const NAME: &'static str = "phantom";
    const VERSION: u32 = 3;
    const METHODS: &'static str = "The compressed breast was filled with uniform breast tissue and a matrix of irregular \
         aluminium-equivalent microcalcifications at half of its thickness (Mîra 2018, § 5.2.2).";
    type Input = Compression;
    type Output = CompressedPhantom;

    fn run(
        &self,
        compression: &Compression,
        _: &dyn Progress,
    ) -> Result<CompressedPhantom, Failure> {
        let (surface, _) = compression.outer_surface().compacted();
        Ok(CompressedPhantom {
            surface,
            thickness_mm: compression.nominal_thickness_mm,
            plan: self.plan.clone(),
            seed: self.seed,
        })
    }
}
