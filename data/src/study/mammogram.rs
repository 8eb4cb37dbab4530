//! The mammogram: beam, phantom, unit and Monte Carlo.

use serde::{Deserialize, Serialize};

/// How the exposure is set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Exposure {
    /// Constant detector signal.
    #[default]
    Automatic,
    /// The tube output of the 46 mm calibration phantom.
    Fixed,
}

/// Where gland is in the phantom.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gland {
    /// Everywhere, mixed with fat in one share.
    #[default]
    Uniform,
    /// Where the labels of the reference pose have it, carried along by the tissue; the rest is fat.
    Segmented,
}

/// The picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MammogramPlan {
    /// Photon energy (keV) without `beam`.
    pub energy_kev: f64,
    /// The spectrum of a tube instead of one energy.
    pub beam: Option<BeamPlan>,
    /// How the exposure is set.
    pub exposure: Exposure,
    /// Pixel pitch (mm).
    pub pixel_mm: f64,
    /// Where gland is.
    pub gland: Gland,
    /// Mass fraction of gland in the phantom (0..1) where it is uniform.
    pub glandularity: f64,
    /// The matrix of microcalcifications.
    pub calcifications: CalcificationPlan,
    /// Masses; none unless listed.
    pub masses: Vec<MassPlan>,
    /// What is around the breast.
    pub unit: UnitPlan,
    /// Dose and scatter by Monte Carlo; not computed when absent.
    pub monte_carlo: Option<MonteCarloPlan>,
}

impl Default for MammogramPlan {
    fn default() -> Self {
        Self {
            energy_kev: 24.0,
            beam: None,
            exposure: Exposure::Automatic,
            pixel_mm: 0.1,
            gland: Gland::Uniform,
            glandularity: 0.2,
            calcifications: CalcificationPlan::default(),
            masses: Vec::new(),
            unit: UnitPlan::default(),
            monte_carlo: None,
        }
    }
}

/// A tube with its filter, as the table of spectra has it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamPlan {
    /// Target and filter: `Rh/Ag`.
    pub target_filter: String,
    /// Tube voltage (kV).
    pub kv: u32,
}

/// Photon transport through the compressed breast.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MonteCarloPlan {
    /// Photons to follow.
    pub photons: u64,
}

impl Default for MonteCarloPlan {
    fn default() -> Self {
        Self { photons: 1_000_000 }
    }
}

/// A matrix of microcalcifications at mid-thickness; one picture for each diameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalcificationPlan {
    /// Away from the chest wall.
    pub rows: usize,
    /// Along x.
    pub columns: usize,
    /// Distance of neighbours (mm).
    pub pitch_mm: f64,
    /// Diameters (mm).
    pub diameter_mm: Vec<f64>,
    /// Middle of the matrix, x and y in the frame of the detector (mm); where it finds most tissue when
    /// absent.
    pub center_mm: Option<[f64; 2]>,
}

impl Default for CalcificationPlan {
    fn default() -> Self {
        let diameter_mm = vec![0.2, 0.3];
        Self { rows: 7, columns: 3, pitch_mm: 10.0, diameter_mm, center_mm: None }
    }
}

/// An ellipsoid of another material; its middle is given in one of two ways.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MassPlan {
    /// Row of the table of materials.
    #[serde(default = "gland")]
    pub material: String,
    /// Half axes (mm) along x, y and z of the detector's frame.
    pub radii_mm: [f64; 3],
    /// Middle (mm) in the frame of the detector.
    pub center_mm: Option<[f64; 3]>,
    /// Middle as shares (0..1) of the breast: from its left to its right side, from the detector's edge
    /// to its front, from the detector to the paddle.
    pub center_share: Option<[f64; 3]>,
}

/// Tumours attenuate as gland does, or a little more (Johns and Yaffe 1987).
fn gland() -> String {
    "glandular_hammerstein".into()
}

/// The mammography unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UnitPlan {
    /// Height (mm) of the focal spot above the detector.
    pub source_height_mm: f64,
    /// Extent (mm) of the detector along the chest wall and away from it.
    pub field_mm: [f64; 2],
    /// The paddle as an absorber; not in the beam when absent.
    pub paddle: Option<AbsorberPlan>,
    /// What lies between breast and detector as an absorber; not in the beam when absent.
    pub receptor: Option<AbsorberPlan>,
    /// Extent of the focal spot; a point when absent.
    pub focal_spot: Option<FocalSpotPlan>,
    /// Share of the photons that is missing for each 100 mm away from the chest wall.
    pub heel_per_100mm: f64,
    /// Where quantum noise arises; when absent after the spread of light for one energy, before it for a
    /// `beam`.
    pub noise: Option<QuantumNoise>,
    /// Electronic noise (quanta, root mean square) of a pixel.
    pub electronic_noise_quanta: f64,
    /// Share of the picture before that is left in a picture.
    pub lag: f64,
}

impl Default for UnitPlan {
    /// Senographe Pristina as simulators describe it.
    fn default() -> Self {
        Self {
            source_height_mm: 660.0,
            field_mm: [285.0, 239.4],
            paddle: None,
            receptor: None,
            focal_spot: None,
            heel_per_100mm: 0.0,
            noise: None,
            electronic_noise_quanta: 0.0,
            lag: 0.0,
        }
    }
}

/// Where quantum noise arises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QuantumNoise {
    /// After the spread of light: white, as in the thesis.
    AfterLight,
    /// When photons are absorbed: light spreads it as it spreads the signal.
    BeforeLight,
}

/// A flat absorber across the whole beam.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AbsorberPlan {
    /// Row of the table of materials.
    pub material: String,
    /// Thickness (mm).
    pub thickness_mm: f64,
}

/// Where photons leave the target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FocalSpotPlan {
    /// Side of the square, or full width at half maximum of the Gaussian (mm), both ways.
    pub width_mm: f64,
    /// Distribution.
    #[serde(default)]
    pub shape: SpotShape,
}

/// Distribution of photons over a focal spot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpotShape {
    /// Alike over a square.
    #[default]
    Square,
    /// A Gaussian.
    Gaussian,
}
