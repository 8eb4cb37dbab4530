//! Labels of a pose to the smooth surfaces of body and chest wall.

use mammotwin_data::{
    Failure,
    io::hdf5,
    labels::{LabelMap, Tissue},
    progress::Progress,
    store::{Artifact, Stage},
    surface::TriMesh,
};
use mammotwin_imaging::mri::{
    distance_field::{FieldPlan, level_field},
    surface,
};
use serde::Serialize;
use std::path::Path;

/// Extracts the surfaces of one pose.
#[derive(Debug, Clone, Serialize)]
pub struct Surface {
    /// Spacing (mm) of the surface's vertices.
    pub spacing_mm: f64,
}

impl Default for Surface {
    fn default() -> Self {
        Self { spacing_mm: 1.5 }
    }
}

/// The surfaces of one pose, in the frame of its image.
#[derive(Debug, Clone)]
pub struct PoseSurfaces {
    /// Outer surface of the body.
    pub skin: TriMesh,
    /// Outer surface of muscle and thorax.
    pub chest_wall: TriMesh,
}

impl Artifact for PoseSurfaces {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_surface("skin", &self.skin)?;
        file.put_surface("chest_wall", &self.chest_wall)?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        Ok(Self { skin: file.surface("skin")?, chest_wall: file.surface("chest_wall")? })
    }
}

impl Stage for Surface {
    const NAME: &'static str = "surface";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "Surfaces are the zero level of smooth signed distance fields of the labels, \
         placed between voxels.";
    type Input = LabelMap;
    type Output = PoseSurfaces;

    fn run(&self, labels: &LabelMap, progress: &dyn Progress) -> Result<PoseSurfaces, Failure> {
        let extract = |inside: &dyn Fn(Tissue) -> bool| {
            let plan = FieldPlan::of_spacing(self.spacing_mm);
            let field = level_field(&labels.map(inside), &plan)
                .map_err(|cause| Failure::BadInput(format!("labels: {cause}")))?;
            Ok::<_, Failure>(surface::surface(&field))
        };
        progress.report(0.0, "skin");
        let skin = extract(&|t| t != Tissue::Background)?;
        progress.report(0.5, "chest wall");
        let chest_wall = extract(&Tissue::is_chest_wall)?;
        Ok(PoseSurfaces { skin, chest_wall })
    }
}
