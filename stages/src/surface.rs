//! Labels of a pose to the smooth surfaces of body and chest wall.

use mammotwin_data::{
    Failure,
    io::hdf5,
    labels::{LabelMap, Tissue},
    progress::Progress,
    store::{Artifact, Stage},
    surface::TriMesh,
    volume::Volume,
};
use mammotwin_imaging::mri::{
    distance_field::{FieldPlan, level_field},
    surface,
};
use mammotwin_solver::distance::{DistanceError, SurfaceIndex};
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
        file.frame(hdf5::Frame::Ras)?;
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
    const VERSION: u32 = 5;
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

/// Voxels next to the image's border whose faces [`from_border`] leaves out: the blur there sees a
/// body that goes on beyond the picture, and a surface is cut where the picture ends.
const RIM: usize = 6;

/// Distances (mm), sorted, of a mask's border from its surface: of the middles of all voxel faces that
/// have inside on one side only, but those next to the border of the image.
///
/// # Errors
/// When the surface has no triangle.
pub fn from_border(mask: &Volume<bool>, surface: &TriMesh) -> Result<Vec<f64>, DistanceError> {
    let shape = mask.grid.shape;
    let mut faces = Vec::new();
    for n in 0..mask.values.len() {
        let voxel = mask.grid.voxel(n);
        if (0..3).any(|axis| voxel[axis] < RIM || voxel[axis] + RIM + 1 >= shape[axis]) {
            continue;
        }
        for axis in 0..3 {
            let mut next = voxel;
            next[axis] += 1;
            if mask.values[n] != mask.at(next) {
                faces.push(mask.grid.center(voxel).lerp(&mask.grid.center(next), 0.5));
            }
        }
    }
    let found = SurfaceIndex::new(surface)?.closest_of(&faces)?;
    let mut distances: Vec<f64> = found.iter().map(|closest| closest.distance_mm).collect();
    distances.sort_by(f64::total_cmp);
    Ok(distances)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volunteer::{Preset, Torso};
    use mammotwin_data::{Vec3, progress::Silent, volume::Grid};

    /// A breast with its nipple on voxels of 1 mm: 95 % of the border of the labels within 0.5 mm of
    /// the surface, which is nearer still to the shape that the labels were taken from.
    #[test]
    fn surfaces_keep_to_the_border_of_the_labels() {
        let torso = Torso::new(Preset::named("small").unwrap(), 1);
        let low = torso.breasts[0].base - Vec3::new(75.0, 50.0, 75.0);
        let grid = Grid::aligned([150, 120, 150], [1.0; 3], low);
        let tissue = |n| {
            let p = grid.center(grid.voxel(n));
            match (torso.skin(&p) < 0.0, torso.chest_wall(&p) < 0.0) {
                (_, true) => Tissue::PectoralMuscle,
                (true, _) => Tissue::AdiposeRight,
                _ => Tissue::Background,
            }
        };
        let labels = Volume { values: (0..grid.len()).map(tissue).collect(), grid: grid.clone() };
        let surfaces = Surface::default().run(&labels, &Silent).unwrap();
        let skin = from_border(&labels.map(|t| t != Tissue::Background), &surfaces.skin).unwrap();
        let wall = from_border(&labels.map(Tissue::is_chest_wall), &surfaces.chest_wall).unwrap();
        for distances in [skin, wall] {
            assert!(distances.len() > 10_000);
            let at = |share: f64| distances[(share * distances.len() as f64) as usize];
            println!("median {:.3}, 95 % {:.3}, 99 % {:.3} mm", at(0.5), at(0.95), at(0.99));
            assert!(at(0.95) < 0.5);
        }
    }
}
