//! `report.html`: what was found, to look at; one file that needs no other.
//!
//! A [`ReportInput`] holds what there is; parts that a study does not have are left out. Cuts and
//! mammograms go in as finished pictures ([`slice`](slice::slice), [`overlay`](slice::overlay),
//! [`mammogram`]), so that no volume must be kept for the report.

pub mod chart;
pub mod discovery;
pub mod group;
pub mod heat;
mod html;
pub mod mammogram;
pub mod palette;
pub mod raster;
pub mod scatter;
pub mod scene;
pub mod slice;
pub mod surface;

pub use html::{escaped, render};

use crate::results::Provenance;
use chart::{Chart, Histogram};
use mammotwin_data::{metric::Metric, surface::TriMesh};
use palette::Palette;
use raster::Raster;
use scene::Scene;
use slice::{OverlayPicture, SlicePicture};
use surface::Camera;

/// All that the report shows.
#[derive(Debug, Clone, Default)]
pub struct ReportInput {
    /// Pseudonym of the person.
    pub subject: String,
    /// What was done and found, in a few sentences.
    pub summary: String,
    /// The most telling numbers, four to eight.
    pub facts: Vec<Fact>,
    /// What limits the results; shown first.
    pub warnings: Vec<String>,
    /// Images and what became of them, the reference pose first.
    pub poses: Vec<PoseReport>,
    /// The mesh.
    pub mesh: Option<MeshReport>,
    /// The fit; none with literature moduli.
    pub calibration: Option<FitReport>,
    /// The poses that the fit did not see, by name.
    pub validations: Vec<(String, FitReport)>,
    /// The compression.
    pub compression: Option<CompressionReport>,
    /// What can be turned about.
    pub scenes: Vec<Scene>,
    /// Pictures of the compressed breast.
    pub mammograms: Vec<MammogramReport>,
    /// Numbers beside those of the thesis.
    pub metrics: Vec<Metric>,
    /// Sentences of the stages, in order, with their citations.
    pub methods: Vec<String>,
    /// Program, stages and hashes.
    pub provenance: Provenance,
}

/// A name and a value with its unit.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Fact {
    /// "Compression force".
    pub name: String,
    /// "22.4 N".
    pub value: String,
}

impl Fact {
    /// A fact from its parts.
    pub fn new(name: &str, value: impl Into<String>) -> Self {
        Self { name: name.into(), value: value.into() }
    }
}

/// One image.
#[derive(Debug, Clone, Default)]
pub struct PoseReport {
    /// Name of the pose: `supine`.
    pub name: String,
    /// Direction of gravity, volumes of the tissues.
    pub facts: Vec<Fact>,
    /// Cuts with outlines of the segmentation.
    pub outlines: Vec<SlicePicture>,
    /// Thickness of the skin, where the image shows it.
    pub skin: Option<SurfaceMap>,
    /// How it was brought into the frame of the reference pose.
    pub registration: Option<RegistrationReport>,
}

/// A registration.
#[derive(Debug, Clone, Default)]
pub struct RegistrationReport {
    /// Rotation, translation, residuals.
    pub facts: Vec<Fact>,
    /// Reference pose and this pose at the same place.
    pub overlays: Vec<OverlayPicture>,
    /// Distance of the chest walls.
    pub chest_wall: Option<SurfaceMap>,
}

/// A number on a surface.
#[derive(Debug, Clone)]
pub struct SurfaceMap {
    /// Heading.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// The surface; vertices without triangles are not drawn.
    pub surface: TriMesh,
    /// One number a vertex; NaN, drawn grey, where there is none: no contact, not measured.
    pub values: Vec<f64>,
    /// Quantity with its unit, beside the scale: "distance (mm)".
    pub label: String,
    /// Colours.
    pub palette: Palette,
    /// Ends of the scale; chosen from the values when absent.
    pub range: Option<[f64; 2]>,
    /// Views.
    pub cameras: Vec<Camera>,
}

/// The mesh.
#[derive(Debug, Clone, Default)]
pub struct MeshReport {
    /// Nodes, tetrahedra, worst elements.
    pub facts: Vec<Fact>,
    /// Skewness, aspect ratio, angles.
    pub histograms: Vec<Histogram>,
}

/// Measured and simulated shapes.
#[derive(Debug, Clone, Default)]
pub struct FitReport {
    /// Parameters, distances.
    pub facts: Vec<Fact>,
    /// Error against parameter.
    pub charts: Vec<Chart>,
    /// Distances of the skin.
    pub maps: Vec<SurfaceMap>,
    /// What the data cannot tell, a paragraph each.
    pub notes: Vec<String>,
}

/// The compression.
#[derive(Debug, Clone, Default)]
pub struct CompressionReport {
    /// Side, paddle, law, thickness, force.
    pub facts: Vec<Fact>,
    /// Force against thickness.
    pub curves: Vec<Chart>,
    /// Pressure on the skin, stretch.
    pub maps: Vec<SurfaceMap>,
}

/// One mammogram.
#[derive(Debug, Clone)]
pub struct MammogramReport {
    /// Heading: "Right CC, 0.2 mm calcifications".
    pub title: String,
    /// Energy, exposure, noise.
    pub caption: String,
    /// View and side, written in the corner: "R CC".
    pub mark: String,
    /// The whole picture.
    pub picture: Raster,
    /// A part of it at full size.
    pub detail: Option<Raster>,
}
