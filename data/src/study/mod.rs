//! The study: one TOML file that a person writes, with units in its key names.
//!
//! Unknown keys are refused by serde; `validate` refuses implausible values. Paths are relative
//! to the folder of the study file.

mod arm;
mod clamp;
mod compression;
mod design;
mod interface;
mod label_map;
mod law;
mod locate;
mod mammogram;
mod paddles;
mod scan;
mod validate;
mod validate_calibrate;
mod validate_clamp;
mod validate_mammogram;
mod validate_paddles;
mod wording;

pub use arm::ArmPlan;
pub use clamp::{ClampPlan, HeldName, MeasuredIn};
pub use compression::{
    ComfortPlan, CompressLaw, CompressPlan, CurvePlan, GimbalPlan, HingePlan, MLO_ANGLE_DEG,
    PaddleName, PlatePlan, PlateSupport, ReceptorName, StopPlan, View,
};
pub use design::{DesignPlan, designs};
pub use interface::{InterfaceKind, InterfacePlan, InterfaceRegion, RegionPlan};
pub use label_map::LabelName;
pub use law::{BadConstant, LawConstants, LawName, OgdenTerms};
pub use mammogram::{
    AbsorberPlan, BeamPlan, CalcificationPlan, Exposure, FocalSpotPlan, Gland, MammogramPlan,
    MassPlan, MonteCarloPlan, QuantumNoise, SpotShape, UnitPlan,
};
pub use paddles::{
    BiopsyPlan, CadPlan, CushionPlan, EDGE_RADIUS_MM, OutlinePlan, SpotName, SpotPlan,
};
pub use scan::{Scan, ScanUnit};
pub use validate::{CALIBRATED, EFFECTS, LIGAMENTS, StudyError, parse};

use crate::{Vec3, labels::Side};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::PathBuf};

/// Everything a run needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Version of this format: 1.
    pub schema: u32,
    /// Whose pictures these are.
    pub subject: Subject,
    /// Images by pose name (`supine`, `prone`, `tilted`, ... ).
    pub poses: BTreeMap<String, Pose>,
    /// Poses that were measured as surfaces, by pose name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub scans: BTreeMap<String, Scan>,
    /// Mammography records by side.
    #[serde(default)]
    pub records: BTreeMap<Side, Record>,
    /// Tissues and supports.
    #[serde(default)]
    pub model: ModelPlan,
    /// Element size.
    #[serde(default)]
    pub mesh: MeshPlan,
    /// What is fitted, and how.
    #[serde(default)]
    pub calibrate: CalibratePlan,
    /// The compression; none when absent.
    pub compress: Option<CompressPlan>,
    /// How its comfort is measured.
    #[serde(default)]
    pub comfort: ComfortPlan,
    /// The picture; none when absent.
    pub mammogram: Option<MammogramPlan>,
}

impl Study {
    /// Name of the pose that the mesh is made of: as stated, or `supine`, or the only pose.
    pub fn reference_pose(&self) -> &str {
        let stated = self.model.reference_pose.as_deref();
        let supine = self.poses.contains_key("supine").then_some("supine");
        let first = self.poses.keys().next().map_or("", String::as_str);
        stated.or(supine).unwrap_or(first)
    }

    /// Names of all poses, images before scans, and what they are for.
    pub fn uses(&self) -> impl Iterator<Item = (&String, Use)> {
        let images = self.poses.iter().map(|(name, pose)| (name, pose.usage));
        images.chain(self.scans.iter().map(|(name, scan)| (name, scan.usage)))
    }

    /// What a pose is for; `None` when there is no such pose.
    pub fn usage(&self, pose: &str) -> Option<Use> {
        self.uses().find(|(name, _)| *name == pose).map(|(_, usage)| usage)
    }

    /// The same study without the names of its files, which may name people.
    pub fn without_files(&self) -> Self {
        let mut study = self.clone();
        for pose in study.poses.values_mut() {
            (pose.image, pose.landmarks) = (PathBuf::new(), None);
            (pose.labels, pose.scribbles) = (None, None);
        }
        for scan in study.scans.values_mut() {
            (scan.surface, scan.landmarks) = (PathBuf::new(), PathBuf::new());
        }
        study.compress = study.compress.map(CompressPlan::without_files);
        study
    }
}

/// Whose pictures these are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// A pseudonym: letters, digits, `-` and `_`.
    pub id: String,
}

/// How the body lies or stands; gives the direction of gravity in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Posture {
    /// On the back: gravity is (0, -1, 0).
    Supine,
    /// On the belly: gravity is (0, 1, 0).
    Prone,
    /// Standing or sitting: gravity is (0, 0, -1).
    Upright,
}

impl Posture {
    /// Unit vector of gravity in the image's RAS frame.
    pub fn gravity(self) -> Vec3 {
        match self {
            Self::Supine => Vec3::new(0.0, -1.0, 0.0),
            Self::Prone => Vec3::new(0.0, 1.0, 0.0),
            Self::Upright => Vec3::new(0.0, 0.0, -1.0),
        }
    }
}

/// Unit vector of gravity: a vector that is given goes before a name.
fn falling(posture: Option<Posture>, given: Option<[f64; 3]>) -> Option<Vec3> {
    match (posture, given) {
        (_, Some(v)) => Vec3::from(v).try_normalize(1e-9),
        (posture, None) => posture.map(Posture::gravity),
    }
}

/// Whether a pose calibrates or proves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    /// The calibration reads it.
    #[default]
    Fit,
    /// Only the validation reads it.
    Validate,
}

/// One image and what is known about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// NIfTI file.
    pub image: PathBuf,
    /// Direction of gravity by name; or give `gravity_in_image`.
    pub posture: Option<Posture>,
    /// Direction of gravity in the image's RAS frame; any length.
    pub gravity_in_image: Option<[f64; 3]>,
    /// Landmarks: CSV `name,x_mm,y_mm,z_mm`, Slicer `.fcsv` or `.mrk.json`.
    pub landmarks: Option<PathBuf>,
    /// Finished labels; the segmentation is skipped.
    pub labels: Option<PathBuf>,
    /// What the numbers of `labels` mean, by number; those of [`crate::labels::Tissue`] when absent.
    pub label_map: Option<BTreeMap<String, LabelName>>,
    /// A few marked voxels that teach the segmentation, as [`crate::labels::Scribbles`] says.
    pub scribbles: Option<PathBuf>,
    /// Whether it calibrates or proves.
    #[serde(default, rename = "use")]
    pub usage: Use,
    /// What a reader of the report must know about this image.
    pub warning: Option<String>,
}

impl Pose {
    /// Unit vector of gravity in the image's RAS frame; `None` when the study gives neither key.
    pub fn gravity(&self) -> Option<Vec3> {
        falling(self.posture, self.gravity_in_image)
    }
}

/// What the mammography unit showed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Compression force (N).
    pub force_n: f64,
    /// Compressed thickness (mm).
    pub thickness_mm: f64,
}

/// Tissues, supports and the effects that are switched on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelPlan {
    /// Pose that the mesh is made of; default: supine, or the only pose.
    pub reference_pose: Option<String>,
    /// Fat and gland as one tissue for each side.
    pub breast: BreastPlan,
    /// Skin.
    pub skin: LayerPlan,
    /// Deep layer of the superficial fascia, on the rear of the breast.
    pub fascia: LayerPlan,
    /// Pectoral muscle.
    pub muscle: MusclePlan,
    /// Suspensory ligaments.
    pub ligaments: LigamentPlan,
    /// What happens between breast and muscle.
    pub interface: InterfacePlan,
    /// Whether skin keeps off skin, as in the fold under a breast that hangs on the abdomen.
    pub skin_contact: bool,
    /// Arms that the skin keeps off, by pose.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub arms: BTreeMap<String, Vec<ArmPlan>>,
    /// Mass density of all tissues (g/cm³).
    pub density_g_per_cm3: f64,
    /// Effects that are switched on: amplitude by machine name.
    pub effects: BTreeMap<String, f64>,
}

impl Default for ModelPlan {
    /// Literature moduli (Mîra 2018, § 5.1.2): breast 0.5, muscle 10, skin 10, fascia 160 kPa.
    fn default() -> Self {
        Self {
            reference_pose: None,
            breast: BreastPlan::default(),
            skin: LayerPlan::neo_hookean(10.0, 2.0),
            fascia: LayerPlan::neo_hookean(160.0, 0.1),
            muscle: MusclePlan::default(),
            ligaments: LigamentPlan::default(),
            interface: InterfacePlan::default(),
            skin_contact: false,
            arms: BTreeMap::new(),
            density_g_per_cm3: 0.981,
            effects: BTreeMap::new(),
        }
    }
}

/// Fat and gland as one tissue for each side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BreastPlan {
    /// Constitutive law.
    pub law: LawName,
    /// Young's modulus of the right breast (kPa).
    pub young_right_kpa: f64,
    /// Young's modulus of the left breast (kPa).
    pub young_left_kpa: f64,
    /// Poisson's ratio under gravity.
    pub poisson: f64,
    /// Jₘ of the Gent law.
    pub jm: Option<f64>,
    /// Constants of the other laws.
    pub constants: LawConstants,
}

impl Default for BreastPlan {
    fn default() -> Self {
        let (law, constants) = (LawName::NeoHookean, LawConstants::default());
        Self { law, young_right_kpa: 0.5, young_left_kpa: 0.5, poisson: 0.49, jm: None, constants }
    }
}

/// A membrane that shares nodes with the breast.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerPlan {
    /// Constitutive law.
    #[serde(default)]
    pub law: LawName,
    /// Young's modulus (kPa).
    pub young_kpa: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Jₘ of the Gent law.
    pub jm: Option<f64>,
    /// Constants of the other laws.
    #[serde(default)]
    pub constants: LawConstants,
}

impl LayerPlan {
    /// A neo-Hookean layer.
    pub fn neo_hookean(young_kpa: f64, thickness_mm: f64) -> Self {
        let (law, constants) = (LawName::NeoHookean, LawConstants::default());
        Self { law, young_kpa, thickness_mm, jm: None, constants }
    }
}

/// Pectoral muscle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MusclePlan {
    /// A rigid support; otherwise a body of its own, linear elements from the chest wall to the ribs.
    pub rigid: bool,
    /// Young's modulus (kPa); noted, not used, where the muscle is rigid.
    pub young_kpa: f64,
}

impl Default for MusclePlan {
    fn default() -> Self {
        Self { rigid: true, young_kpa: 10.0 }
    }
}

/// Suspensory ligaments, tension only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LigamentPlan {
    /// Young's modulus (kPa).
    pub young_kpa: f64,
    /// Which: `inframammary`, `deep_medial`, `cranial`, `lateral`.
    pub names: Vec<String>,
}

impl Default for LigamentPlan {
    fn default() -> Self {
        let names = ["inframammary", "deep_medial", "cranial", "lateral"];
        Self { young_kpa: 500.0, names: names.map(String::from).to_vec() }
    }
}

/// Elements of the breasts under gravity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Elements {
    /// Four nodes, mixed displacement and pressure.
    #[default]
    Linear,
    /// Ten nodes with curved edges, displacement alone: at the same edge length about ten times as
    /// slow, and as accurate as linear ones of a third of it.
    Quadratic,
}

impl Elements {
    /// Word in study files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Quadratic => "quadratic",
        }
    }
}

/// Size and kind of the elements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeshPlan {
    /// Edge length of the tetrahedra (mm).
    pub size_mm: f64,
    /// Elements of the poses; a compression has linear ones on their corners.
    pub elements: Elements,
}

impl Default for MeshPlan {
    fn default() -> Self {
        Self { size_mm: 8.0, elements: Elements::Linear }
    }
}

/// How the stress-free shape is found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StressFree {
    /// Newton on the rest positions (Govindjee & Mihalic 1996).
    #[default]
    Inverse,
    /// Damped, accelerated fixed point on the reference shape (Sellier 2011).
    FixedPoint,
    /// The same as published: whole steps, neither damped nor accelerated.
    PlainFixedPoint,
    /// Prediction and correction towards another pose, as published (Mîra 2018, § 3.3).
    PredictionCorrection,
    /// The same with steps that are halved where they lead nowhere, until they gain nothing.
    DampedPredictionCorrection,
}

impl StressFree {
    /// Whether it is corrected towards another pose than the reference.
    pub fn takes_another_pose(self) -> bool {
        matches!(self, Self::PredictionCorrection | Self::DampedPredictionCorrection)
    }
}

/// What is fitted, and how.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibratePlan {
    /// Study keys of the parameters to fit: `breast.young_right_kpa`, `breast.young_left_kpa`.
    pub parameters: Vec<String>,
    /// How the stress-free shape is found.
    pub stress_free: StressFree,
    /// Whether the search for the moduli is repeated from stiffer ones, to see whether both end alike.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub second_start: bool,
}
