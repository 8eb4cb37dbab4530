//! Fibroglandular tissue of the labels, carried into the compressed breast.

use crate::{compress::Compression, mesh::BreastMesh};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::{LabelMap, Side, Tissue},
    mesh::TetMesh,
    progress::Progress,
    store::{Artifact, Stage},
    surface::TriMesh,
};
use mammotwin_imaging::mri::{
    distance_field::{FieldPlan, level_field},
    surface,
};
use mammotwin_solver::{
    distance::{DistanceError, SurfaceIndex},
    mesh::{
        crop::crop,
        locate::{Location, Locator},
    },
};
use serde::Serialize;
use std::path::Path;

/// Extracts the surface of the gland and moves it as the tissue moves.
#[derive(Debug, Clone, Serialize)]
pub struct Gland {
    /// Spacing (mm) of the surface's vertices.
    pub spacing_mm: f64,
}

impl Default for Gland {
    fn default() -> Self {
        Self { spacing_mm: 1.5 }
    }
}

/// The gland of a compressed breast.
#[derive(Debug, Clone)]
pub struct CarriedGland {
    /// Closed surface in the detector's frame (mm).
    pub surface: TriMesh,
    /// Volume (mm³) of its voxels in the labels.
    pub labelled_mm3: f64,
    /// Volume (mm³) of its surface before the compression.
    pub before_mm3: f64,
}

impl Artifact for CarriedGland {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Detector)?;
        file.put_surface("surface", &self.surface)?;
        file.put_scalar("labelled", self.labelled_mm3, "mm3", "volume of its voxels")?;
        file.put_scalar("before", self.before_mm3, "mm3", "volume before the compression")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        Ok(Self {
            surface: file.surface("surface")?,
            labelled_mm3: file.scalar("labelled")?,
            before_mm3: file.scalar("before")?,
        })
    }
}

impl Stage for Gland {
    const NAME: &'static str = "gland";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    /// Labels of the reference pose, its mesh, and what became of it.
    type Input = (LabelMap, BreastMesh, Compression);
    type Output = CarriedGland;

    fn run(
        &self,
        (labels, whole, compression): &Self::Input,
        _: &dyn Progress,
    ) -> Result<CarriedGland, Failure> {
        let side = compression.side;
        let wanted = match side {
            Side::Right => Tissue::FibroglandularRight,
            Side::Left => Tissue::FibroglandularLeft,
        };
        let refuse = |cause: &dyn std::fmt::Display| {
            Failure::BadInput(format!(
                "mammogram.gland: gland of the {} breast in the labels: {cause}; correct the labels, \
                 or write gland = \"uniform\"",
                side.name()
            ))
        };
        let count = labels.values.iter().filter(|&&tissue| tissue == wanted).count();
        if count == 0 {
            return Err(refuse(&"there is none"));
        }
        let plan = FieldPlan::of_spacing(self.spacing_mm);
        let field = level_field(&labels.map(|t| t == wanted), &plan).map_err(|c| refuse(&c))?;
        let found = surface::surface(&field);
        // The same part as in the compression: its nodes have the same numbers.
        let part = crop(&whole.corners(), side, whole.anatomy.sternum_x_mm, 0.0);
        let carried = carried(&found, &part.mesh, &compression.solution.points)
            .map_err(|cause| refuse(&cause))?;
        let [i, j, k] = labels.grid.spacing_mm();
        Ok(CarriedGland {
            labelled_mm3: count as f64 * i * j * k,
            before_mm3: found.volume_mm3(),
            surface: carried,
        })
    }
}

/// How far (mm) below the skin a vertex from outside of the mesh is put.
const BELOW_MM: [f64; 3] = [1e-6, 1e-3, 0.1];

/// A surface in a mesh, after the nodes of the mesh have moved to `after`: each vertex keeps its weights
/// in its tetrahedron. Stress-free, loaded and compressed shape have the same tetrahedra, so that the way
/// from one to the next is that from the first to the last.
///
/// A vertex outside of the mesh, which is smoother than the labels, is first put onto its surface.
pub fn carried(
    surface: &TriMesh,
    mesh: &TetMesh,
    after: &[Vec3],
) -> Result<TriMesh, DistanceError> {
    let locator = Locator::new(&mesh.points, &mesh.tets);
    let mut found: Vec<Option<Location>> = surface.points.iter().map(|p| locator.find(p)).collect();
    if found.contains(&None) {
        let skin = SurfaceIndex::new(&mesh.outer_surface())?;
        let feet = skin.closest_of(&surface.points)?;
        for (found, foot) in found.iter_mut().zip(&feet).filter(|(found, _)| found.is_none()) {
            let below = |depth: &f64| locator.find(&(foot.point - *depth * foot.normal));
            *found = BELOW_MM.iter().find_map(below);
        }
    }
    let moved = |(place, found): (&Vec3, &Option<Location>)| {
        found.map_or(*place, |location| location.interpolate(&mesh.tets, after))
    };
    let points = surface.points.iter().zip(&found).map(moved).collect();
    Ok(TriMesh { points, triangles: surface.triangles.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volunteer::carry::tests::block;
    use mammotwin_imaging::xray::{
        calcification::sphere,
        geometry::Geometry,
        raster::{Window, path_lengths},
    };

    /// A ball in a block that is sheared and stretched is an ellipsoid: the way of a ray through it is that of
    /// the ray, moved back, through the ball.
    #[test]
    fn a_ball_of_gland_in_a_deformed_block_is_its_closed_form() {
        let (tets, rest, deformed, gradient) = block();
        let mesh = TetMesh { points: rest, tets, ..TetMesh::default() };
        let (center, radius) = (Vec3::new(16.0, 15.0, 17.0), 10.0);
        let unit = sphere(6);
        let points = unit.points.iter().map(|p| center + radius * p).collect();
        let up = Vec3::new(0.0, 20.0, 8.0);
        let after: Vec<Vec3> = deformed.iter().map(|p| p + up).collect();
        let carried = carried(&TriMesh { points, ..unit }, &mesh, &after).unwrap();
        let ratio = carried.volume_mm3() / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
        assert!((ratio / gradient.determinant() - 1.0).abs() < 1e-3, "{ratio}");

        let geometry = Geometry { source_height_mm: 660.0, columns: 300, rows: 500, pitch_mm: 0.2 };
        let window = Window {
            left_mm: geometry.left_mm(),
            first_row_mm: geometry.first_row_mm(),
            pitch_mm: 0.2,
            columns: 300,
            rows: 500,
        };
        let paths = path_lengths(&carried, 660.0, &window).unwrap();
        let inverse = gradient.try_inverse().unwrap();
        let shift = Vec3::new(3.0, -2.0, 1.0) + up;
        let back = |p: Vec3| inverse * (p - shift) - center;
        let (mut sum, mut squares, mut met) = (0.0, 0.0, 0.0);
        for (n, &path) in paths.iter().enumerate() {
            let [x, y] = geometry.pixel_mm(n / 300, n % 300);
            let ray = Vec3::new(x, y, -660.0);
            let from = back(Vec3::new(0.0, 0.0, 660.0));
            let along = inverse * ray;
            let across = (from - along * (from.dot(&along) / along.norm_squared())).norm_squared();
            let half = (radius * radius - across).max(0.0).sqrt() / along.norm();
            let exact = 2.0 * half * ray.norm();
            sum += exact;
            squares += (f64::from(path) - exact).powi(2);
            met += f64::from(u8::from(exact > 0.0));
        }
        let (mean, rms) = (sum / met, (squares / met).sqrt());
        println!("mean path {mean:.3} mm over {met} pixels, rms error {rms:.4} mm");
        assert!(met > 5000.0 && rms < 2e-3 * mean, "{rms} {mean}");
    }
}
