//! The compression in a study: paddle, view, position, law, and what ends it.

use super::{
    BiopsyPlan, CadPlan, ClampPlan, CushionPlan, EDGE_RADIUS_MM, LawConstants, LawName,
    OutlinePlan, SpotPlan,
};
use crate::labels::Side;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// When the paddle stops: at the first of these limits. At least one is given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StopPlan {
    /// Distance of the plates (mm), at the frame of a paddle that tilts or bends.
    pub thickness_mm: Option<f64>,
    /// Force of the paddle (N).
    pub force_n: Option<f64>,
    /// Force of the paddle over the area that it covers (kPa).
    pub mean_pressure_kpa: Option<f64>,
    /// Contact pressure anywhere (kPa).
    pub peak_pressure_kpa: Option<f64>,
    /// Thickness (mm) that a newton more must gain; less ends it: what follows hurts and gains little.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_gain_mm_per_n: Option<f64>,
}

/// Where the receptor is brought to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReceptorName {
    /// Both plates come alike to the height of the nipple.
    #[default]
    Nipple,
    /// It is brought to the height of the inframammary fold, the lower end of the breast's base, lifts what hangs lower
    /// and stays there; the paddle comes down.
    Fold,
}

impl ReceptorName {
    #[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
    fn is_nipple(&self) -> bool {
        *self == Self::Nipple
    }
}

/// Direction of the compression.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// Cranio-caudal: paddle from above.
    #[default]
    Cc,
    /// Medio-lateral oblique: paddle from above and the middle.
    Mlo,
}

/// Kind of paddle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PaddleName {
    /// Flat, does not bend or tilt.
    #[default]
    Rigid,
    /// Flat, tilts about an axis along the chest-wall edge.
    Flex,
    /// A plate that bends in its frame.
    Elastic,
    /// Rigid; its surface rises towards the chest wall.
    Curved,
    /// Flat, tilts along the chest-wall edge and rolls across it.
    Tilting,
    /// A small plate.
    Spot,
    /// A plate with a window.
    Biopsy,
    /// A rigid plate under a layer of foam.
    Cushion,
    /// Rigid; its surface and outline are those of an STL file.
    Cad,
}

impl PaddleName {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Rigid,
        Self::Flex,
        Self::Elastic,
        Self::Curved,
        Self::Tilting,
        Self::Spot,
        Self::Biopsy,
        Self::Cushion,
        Self::Cad,
    ];

    /// As written in a study.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rigid => "rigid",
            Self::Flex => "flex",
            Self::Elastic => "elastic",
            Self::Curved => "curved",
            Self::Tilting => "tilting",
            Self::Spot => "spot",
            Self::Biopsy => "biopsy",
            Self::Cushion => "cushion",
            Self::Cad => "cad",
        }
    }
}

/// The hinge of a flex paddle: its torque is a polynomial of second degree in the tilt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HingePlan {
    /// Measured forces and angles (CSV) that both torques are fitted to, in place of numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Distance of the axis from the paddle's chest-wall edge (mm).
    pub axis_mm: f64,
    /// Torque by tilt (N mm/rad).
    pub linear_n_mm_per_rad: f64,
    /// Torque by tilt squared (N mm/rad²).
    pub quadratic_n_mm_per_rad2: f64,
}

impl Default for HingePlan {
    /// An assumption, not a measurement: 100 N that act 50 mm from the axis tilt the paddle by 5
    /// degrees, and half of the torque is linear.
    fn default() -> Self {
        Self {
            file: None,
            axis_mm: 60.0,
            linear_n_mm_per_rad: 28_600.0,
            quadratic_n_mm_per_rad2: 328_000.0,
        }
    }
}

/// Where an elastic paddle is held.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlateSupport {
    /// Its sides and rear rest on the frame; the chest-wall edge is free.
    #[default]
    Frame,
    /// All four sides rest on a frame.
    AllSides,
    /// The rear is clamped.
    Rear,
}

/// An elastic paddle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlatePlan {
    /// Length of the chest-wall edge (mm).
    pub width_mm: f64,
    /// Length of the sides (mm).
    pub depth_mm: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Young's modulus (MPa).
    pub young_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Where it is held.
    pub support: PlateSupport,
    /// Height (mm) of the upright lip along the chest-wall edge; 0 for none.
    pub lip_mm: f64,
}

impl Default for PlatePlan {
    /// 24 x 29 cm, Lexan of 4 mm (Mîra 2018, § 5.1.1). The thesis says neither how its shell was held
    /// nor whether it had a lip: frame and lip of 20 mm are assumptions.
    fn default() -> Self {
        Self {
            width_mm: 290.0,
            depth_mm: 240.0,
            thickness_mm: 4.0,
            young_mpa: 2250.0,
            poisson: 0.4,
            support: PlateSupport::Frame,
            lip_mm: 20.0,
        }
    }
}

/// A curved paddle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CurvePlan {
    /// How far the chest-wall edge lies above the flat part (mm).
    pub rise_mm: f64,
    /// From how far away from that edge it rises (mm).
    pub reach_mm: f64,
    /// Radius (mm) of the arch along the edge; none when absent.
    pub arch_radius_mm: Option<f64>,
}

impl Default for CurvePlan {
    /// An assumption: no maker's drawing was found.
    fn default() -> Self {
        Self { rise_mm: 12.0, reach_mm: 60.0, arch_radius_mm: None }
    }
}

/// The gimbal of a tilting paddle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GimbalPlan {
    /// Distance of the tilt's axis from the paddle's chest-wall edge (mm).
    pub axis_mm: f64,
    /// Torque by tilt (N mm/rad).
    pub tilt_n_mm_per_rad: f64,
    /// Torque by roll (N mm/rad).
    pub roll_n_mm_per_rad: f64,
}

impl Default for GimbalPlan {
    /// An assumption: as soft as a flex paddle about both axes.
    fn default() -> Self {
        Self { axis_mm: 60.0, tilt_n_mm_per_rad: 57_200.0, roll_n_mm_per_rad: 57_200.0 }
    }
}

/// Law and its extras in compression, for breast, skin and fascia alike.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompressLaw {
    /// Constitutive law.
    pub name: LawName,
    /// Jₘ of the Gent law.
    pub jm: Option<f64>,
    /// Constants of the other laws.
    #[serde(default)]
    pub constants: LawConstants,
    /// Poisson's ratio.
    #[serde(default = "compression_poisson")]
    pub poisson: f64,
}

fn compression_poisson() -> f64 {
    0.499
}

/// The compression of one breast.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompressPlan {
    /// Which breast.
    pub side: Side,
    /// Direction.
    #[serde(default)]
    pub view: View,
    /// Angle (degrees) between the directions of an oblique and of a cranio-caudal compression.
    pub view_angle_deg: Option<f64>,
    /// Where the receptor is brought to.
    #[serde(default, skip_serializing_if = "ReceptorName::is_nipple")]
    pub receptor: ReceptorName,
    /// How far (mm) the middle between the plates is raised above the nipple, or the receptor above the fold: where
    /// skin lies lower than that, the receptor lifts it before the paddle comes.
    #[serde(default)]
    pub receptor_lift_mm: f64,
    /// Pose, simulated by the calibration, in which it begins: its shape is taken for free of stress, as the
    /// thesis takes the prone one, unless [`Self::prestress`] is set. The stress-free shape when absent.
    pub start_pose: Option<String>,
    /// Whether the stress and the weight of [`Self::start_pose`] are kept: the breast goes on hanging while it
    /// is compressed, as on a table for prone biopsies. Without it that shape is free of stress.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub prestress: bool,
    /// Paddle.
    #[serde(default)]
    pub paddle: PaddleName,
    /// Hinge of a flex paddle; an assumed one when absent.
    pub hinge: Option<HingePlan>,
    /// Plate of an elastic paddle; the thesis' one when absent.
    pub plate: Option<PlatePlan>,
    /// Shape of a curved paddle; an assumed one when absent.
    pub curve: Option<CurvePlan>,
    /// Gimbal of a tilting paddle; an assumed one when absent.
    pub gimbal: Option<GimbalPlan>,
    /// Where the plate of the paddle ends; it is endless when absent, but for a spot paddle and one
    /// from CAD, which have their own, and for a biopsy paddle, whose plate is the small one then.
    pub outline: Option<OutlinePlan>,
    /// A spot paddle; round and of 9 cm when absent.
    pub spot: Option<SpotPlan>,
    /// Window of a biopsy paddle; one of 5 x 5 cm when absent.
    pub biopsy: Option<BiopsyPlan>,
    /// Foam of a cushion; an assumed one when absent.
    pub cushion: Option<CushionPlan>,
    /// File of a paddle from CAD.
    pub cad: Option<CadPlan>,
    /// Radius (mm) of the rounded edges of both plates.
    #[serde(default = "edge_radius", skip_serializing_if = "is_edge_radius")]
    pub edge_radius_mm: f64,
    /// Distance (mm) from the chest wall to the paddle's edge.
    pub chest_wall_distance_mm: f64,
    /// When the paddle stops.
    pub stop: StopPlan,
    /// Law in compression.
    pub law: CompressLaw,
    /// Coulomb friction between skin and plates.
    #[serde(default)]
    pub friction: f64,
    /// Clamping and release in time; the compression ends at its stop rule when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clamp: Option<ClampPlan>,
    /// Share of the weight of an upright person's breast that acts while it is compressed.
    #[serde(default, skip_serializing_if = "none")]
    pub gravity_share: f64,
    /// How much stiffer all tissues are in a fast compression than under gravity, in proportion: 1
    /// doubles all moduli.
    #[serde(default, skip_serializing_if = "none")]
    pub rate_stiffening: f64,
}

impl CompressPlan {
    /// The pose whose shape is taken for free of stress.
    pub fn stress_free_pose(&self) -> Option<String> {
        self.start_pose.clone().filter(|_| !self.prestress)
    }
}

/// Numbers that change nothing are left out of what is written: keys of earlier results stay.
#[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
fn none(number: &f64) -> bool {
    *number == 0.0
}

fn edge_radius() -> f64 {
    EDGE_RADIUS_MM
}

#[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
fn is_edge_radius(number: &f64) -> bool {
    *number == EDGE_RADIUS_MM
}

/// Angle (degrees) of an oblique compression of which none is given.
pub const MLO_ANGLE_DEG: f64 = 45.0;

impl CompressPlan {
    /// The same compression under another paddle, without what belongs to its own one.
    pub fn under(&self, paddle: PaddleName) -> Self {
        let mut plan = Self { paddle, ..self.clone() };
        (plan.hinge, plan.plate, plan.curve, plan.gimbal) = (None, None, None, None);
        (plan.spot, plan.biopsy, plan.cushion, plan.cad) = (None, None, None, None);
        if matches!(paddle, PaddleName::Spot | PaddleName::Cad) {
            plan.outline = None;
        }
        plan
    }

    /// The same compression without the names of its files, which may name people and do not belong
    /// to what is computed.
    pub fn without_files(self) -> Self {
        let cad = self.cad.map(|_| CadPlan { file: PathBuf::new() });
        let hinge = self.hinge.map(|hinge| HingePlan { file: None, ..hinge });
        Self { cad, hinge, ..self }
    }

    /// The same compression without what comes after its stop.
    pub fn without_clamp(self) -> Self {
        Self { clamp: None, ..self }
    }

    /// Angle (degrees) between the direction of this compression and the cranio-caudal one.
    pub fn angle_deg(&self) -> f64 {
        match self.view {
            View::Cc => 0.0,
            View::Mlo => self.view_angle_deg.unwrap_or(MLO_ANGLE_DEG),
        }
    }
}

/// How comfort is measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ComfortPlan {
    /// Tissue within this distance (mm) of the plates' chest-wall edge counts as juxtathoracic.
    pub juxtathoracic_mm: f64,
    /// Pitch (mm) of the sensors of the virtual pressure mat under the paddle.
    pub mat_pitch_mm: f64,
    /// Least pressure (kPa) that a sensor of the mat shows.
    pub mat_threshold_kpa: f64,
    /// Whether the compression is computed once more for each number that is known to a standard deviation only, for
    /// that of the metrics: with stiffer breasts, and with the two that follow.
    pub uncertainty: bool,
    /// Standard deviation (% of it) of Jₘ in compression; 0: known.
    #[serde(skip_serializing_if = "is_jm_sd")]
    pub jm_sd_percent: f64,
    /// Standard deviation (mm) of the distance from the chest wall to the plates' edges; 0: known.
    #[serde(skip_serializing_if = "is_placement_sd")]
    pub placement_sd_mm: f64,
}

/// A guess: what poses alone leave of Jₘ is of this size (`docs/verification.md`, `study stiffening --poses`).
const JM_SD_PERCENT: f64 = 25.0;
/// A guess: what a technician does not see of the skin's way to the chest wall.
const PLACEMENT_SD_MM: f64 = 2.0;

#[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
fn is_jm_sd(number: &f64) -> bool {
    *number == JM_SD_PERCENT
}

#[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
fn is_placement_sd(number: &f64) -> bool {
    *number == PLACEMENT_SD_MM
}

impl Default for ComfortPlan {
    /// Assumptions; the thesis calls the region juxtathoracic without a measure.
    fn default() -> Self {
        Self {
            juxtathoracic_mm: 20.0,
            mat_pitch_mm: 10.0,
            mat_threshold_kpa: 0.5,
            uncertainty: false,
            jm_sd_percent: JM_SD_PERCENT,
            placement_sd_mm: PLACEMENT_SD_MM,
        }
    }
}

impl ComfortPlan {
    /// What is measured on a compression, without whether further ones give it a deviation: asking for that changes
    /// no measure.
    pub fn without_uncertainty(self) -> Self {
        let Self { uncertainty, jm_sd_percent, placement_sd_mm, .. } = Self::default();
        Self { uncertainty, jm_sd_percent, placement_sd_mm, ..self }
    }
}
