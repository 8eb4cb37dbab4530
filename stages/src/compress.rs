//! One breast between paddle and receptor.

use crate::{
    calibrate::Calibration,
    mesh::BreastMesh,
    model::{Body, LawOverride},
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::Side,
    mesh::{Patch, TetMesh},
    progress::Progress,
    solution::Solution,
    store::{Artifact, Stage},
    study::{CompressPlan, ModelPlan, Stop},
    surface::TriMesh,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Compresses one breast, from its stress-free shape and without gravity.
#[derive(Debug, Clone, Serialize)]
pub struct Compress {
    /// Tissues and supports.
    pub model: ModelPlan,
    /// Side, paddle, position, stop and law.
    pub plan: CompressPlan,
}

/// Where the plates are in the end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plates {
    /// y (mm) of the chest-wall edge of both plates.
    pub edge_y_mm: f64,
    /// z (mm) of the receptor's surface.
    pub receptor_z_mm: f64,
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
}

/// The course of a compression.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// Distance of the plates (mm).
    pub thickness_mm: Vec<f64>,
    /// Force of the paddle (N).
    pub force_n: Vec<f64>,
    /// Force of the receptor (N).
    pub receptor_force_n: Vec<f64>,
    /// Contact area of the paddle (mm²).
    pub contact_area_mm2: Vec<f64>,
    /// Mean pressure under the paddle (kPa).
    pub mean_pressure_kpa: Vec<f64>,
    /// Largest pressure under either plate (kPa).
    pub peak_pressure_kpa: Vec<f64>,
}

/// A compressed breast.
#[derive(Debug, Clone)]
pub struct Compression {
    /// Which breast.
    pub side: Side,
    /// The breast's part of the mesh, in its stress-free shape.
    pub mesh: TetMesh,
    /// The breast between the plates.
    pub solution: Solution,
    /// Contact pressure (kPa) at the nodes.
    pub contact_pressure_kpa: Vec<f64>,
    /// Where the plates ended.
    pub plates: Plates,
    /// How they got there.
    pub curve: Course,
    /// Node that is the nipple.
    pub nipple_node: u32,
    /// Why the compression ended before its stop rule; `None` when it was met.
    pub stopped_early: Option<String>,
}

impl Compression {
    /// Place of the nipple between the plates (mm).
    pub fn nipple(&self) -> Vec3 {
        self.solution.points[self.nipple_node as usize]
    }

    /// The closed surface of the compressed part (mm).
    pub fn outer_surface(&self) -> TriMesh {
        let triangles = self.mesh.outer_surface().triangles;
        TriMesh { points: self.solution.points.clone(), triangles }
    }

    /// Contact pressure (kPa) with its area (mm²), node by node, where there is any.
    pub fn contact_pressures(&self) -> Vec<(f64, f64)> {
        let skin = TriMesh {
            points: self.solution.points.clone(),
            triangles: self.mesh.patch(Patch::Skin).to_vec(),
        };
        let mut area = vec![0.0; skin.points.len()];
        for t in 0..skin.triangles.len() {
            let third = skin.area_vector(t).norm() / 3.0;
            for n in skin.triangles[t] {
                area[n as usize] += third;
            }
        }
        let both = self.contact_pressure_kpa.iter().copied().zip(area);
        both.filter(|&(pressure, area)| pressure > 0.0 && area > 0.0).collect()
    }

    /// Volume (mm³) of each compressed tetrahedron.
    pub fn volumes_mm3(&self) -> Vec<f64> {
        let volume = |tet| TetMesh::tet_volume(&self.solution.points, tet);
        self.mesh.tets.iter().map(volume).collect()
    }
}

impl Stage for Compress {
    const NAME: &'static str = "compress";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "The breast was compressed between two frictionless rigid plates with rounded edges, \
         from its stress-free shape and without gravity (the thesis neglects its prestress, too).";
    type Input = (BreastMesh, Calibration);
    type Output = Compression;

    fn run(
        &self,
        (_mesh, _calibration): &Self::Input,
        _progress: &dyn Progress,
    ) -> Result<Compression, Failure> {
        Err(Failure::Numerics("compress: not wired".into()))
    }
}

impl Artifact for Compression {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_mesh("mesh", &self.mesh)?;
        file.put_solution("solution", &self.solution)?;
        let pressure = &self.contact_pressure_kpa;
        file.put("contact_pressure", pressure, "kPa", "contact pressure at the nodes")?;
        file.put_json("side", &self.side, "which breast")?;
        file.put_json("plates", &self.plates, "where the plates are (mm)")?;
        file.put_json("course", &self.curve, "the course of the compression")?;
        file.put_json("nipple_node", &self.nipple_node, "node that is the nipple")?;
        file.put_json("stopped_early", &self.stopped_early, "why it ended before its stop rule")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        Ok(Self {
            side: file.json("side")?,
            mesh: file.mesh("mesh")?,
            solution: file.solution("solution")?,
            contact_pressure_kpa: file.get("contact_pressure")?,
            plates: file.json("plates")?,
            curve: file.json("course")?,
            nipple_node: file.json("nipple_node")?,
            stopped_early: file.json("stopped_early")?,
        })
    }
}
