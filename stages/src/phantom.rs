//! The compressed breast as an object to be X-rayed.

use crate::{compress::Compression, gland::CarriedGland};
use mammotwin_data::{
    Failure,
    io::hdf5,
    progress::Progress,
    store::{Artifact, Stage},
    study::{self, MammogramPlan},
    surface::TriMesh,
};
use mammotwin_imaging::xray::{
    attenuation::{AttenuationError, Material},
    inside::Inside,
    phantom::{self, PhantomError, SKIN_MM},
    placement::Places,
    transport::{
        bodies::Closed,
        exam::{INCLUSIONS, MEDIA},
        scene::{Bounds, volumes_mm3},
    },
};
use serde::Serialize;
use std::path::Path;

/// Cells (mm) of the distances from the skin.
const STEP_MM: f64 = 2.0;
/// Cells (mm) of the distances from the gland, which is finer.
const GLAND_STEP_MM: f64 = 1.0;
/// Lattice (mm) that the volumes of gland and fat are counted on.
const LATTICE_MM: f64 = 0.5;
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
    /// Surface of the gland in the detector's frame (mm); absent where gland is uniform.
    pub gland: Option<TriMesh>,
    /// Mass fraction of gland in front of the detector's edge, skin and masses apart: stated where gland
    /// is uniform, else counted.
    pub glandularity: f64,
    /// The same by volume.
    pub gland_volume_share: f64,
}

impl CompressedPhantom {
    /// The phantom with microcalcifications of one diameter (mm).
    pub fn with_diameter(&self, diameter_mm: f64) -> Result<phantom::Phantom, PhantomError> {
        let (surface, gland) = (self.surface.clone(), self.gland.as_ref());
        let thickness = self.thickness_mm;
        phantom::Phantom::new(surface, gland, thickness, &self.plan, diameter_mm, self.seed)
    }

    /// What the tissue of [`Self::body`] is made of: fat where the gland has a surface.
    pub fn tissue(&self) -> Result<Material, AttenuationError> {
        Material::breast(if self.gland.is_some() { 0.0 } else { self.glandularity })
    }

    /// Air, skin, tissue, gland and masses by place, without microcalcifications, up to the plates and a
    /// little behind the detector's edge; and the materials of what has indices from [`INCLUSIONS`] on.
    pub fn body(&self) -> Result<(Closed, Vec<Material>), PhantomError> {
        let (far, top) = (f64::MAX, self.thickness_mm + BEYOND_MM);
        let part = Bounds::of([-far, far], [-BEHIND_MM, far], [-BEYOND_MM, top]);
        let mut body = Closed::part(&self.surface, part, STEP_MM, SKIN_MM, MEDIA)?;
        let mut materials = Vec::new();
        if let Some(gland) = &self.gland {
            body = body.with_gland(gland, GLAND_STEP_MM, INCLUSIONS)?;
            materials.push(Material::breast(1.0)?);
        }
        let places = Places::of(&self.surface, self.thickness_mm)?;
        let inside = Inside::of(&self.surface)?;
        for (form, material) in phantom::masses(&inside, &places, &self.plan)? {
            let known = materials.iter().position(|known: &Material| known.name == material.name);
            body = body.with_mass(form, INCLUSIONS + known.unwrap_or(materials.len()));
            if known.is_none() {
                materials.push(material);
            }
        }
        Ok((body, materials))
    }

    /// Mass fraction and volume share of a gland with a surface.
    fn count_gland(&mut self) -> Result<(), PhantomError> {
        let pure = [0.0, 1.0].map(Material::breast);
        let [fat, gland] = [pure[0].clone()?, pure[1].clone()?].map(|m| m.density_g_per_cm3);
        if self.gland.is_none() {
            let share = self.plan.glandularity / gland;
            self.gland_volume_share = share / (share + (1.0 - self.plan.glandularity) / fat);
            return Ok(());
        }
        let (body, _) = self.body()?;
        let volumes = volumes_mm3(&body, LATTICE_MM, |p| p.y >= 0.0);
        let [of_fat, of_gland] = [MEDIA[2], INCLUSIONS].map(|medium| volumes[medium]);
        self.gland_volume_share = of_gland / (of_gland + of_fat);
        self.glandularity = gland * of_gland / (gland * of_gland + fat * of_fat);
        Ok(())
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
        if let Some(gland) = &self.gland {
            file.put_surface("gland", gland)?;
        }
        let shares = [self.glandularity, self.gland_volume_share];
        file.put("gland_shares", &shares, "1", "share of gland by mass and by volume")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let plan: MammogramPlan = file.json("plan")?;
        let gland = match plan.gland {
            study::Gland::Segmented => Some(file.surface("gland")?),
            study::Gland::Uniform => None,
        };
        let shares: Vec<f64> = file.get("gland_shares")?;
        let [glandularity, gland_volume_share] = [0, 1].map(|n| shares.get(n).copied());
        Ok(Self {
            gland,
            glandularity: glandularity.unwrap_or_default(),
            gland_volume_share: gland_volume_share.unwrap_or_default(),
            surface: file.surface("surface")?,
            thickness_mm: file.scalar("thickness")?,
            plan,
            seed: file.json("seed")?,
        })
    }
}

impl Stage for Phantom {
    const NAME: &'static str = "phantom";
    const VERSION: u32 = 5;
    const METHODS: &'static str = "The compressed breast was filled with breast tissue (uniform, or gland where the labels have it, carried along by \
         the tissue) and a matrix of irregular aluminium-equivalent microcalcifications at half of its thickness (Mîra 2018, § 5.2.2).";
    type Input = (Compression, Option<CarriedGland>);
    type Output = CompressedPhantom;

    fn run(
        &self,
        (compression, gland): &Self::Input,
        _: &dyn Progress,
    ) -> Result<CompressedPhantom, Failure> {
        let (surface, _) = compression.outer_surface().compacted();
        let mut phantom = CompressedPhantom {
            surface,
            thickness_mm: compression.nominal_thickness_mm,
            plan: self.plan.clone(),
            seed: self.seed,
            gland: gland.as_ref().map(|gland| gland.surface.clone()),
            glandularity: self.plan.glandularity,
            gland_volume_share: 0.0,
        };
        phantom.count_gland().map_err(|cause| Failure::BadInput(format!("phantom: {cause}")))?;
        Ok(phantom)
    }
}
