//! How wrong Dance's dose is for a breast that is no half cylinder under a flat paddle.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    dose::{DoseBeam, DoseError, average_glandular_dose},
    geometry::Geometry,
    phantom::SKIN_MM,
    raster::RasterError,
    shapes::Rounded,
    spectrum::{Spectrum, UnknownBeam},
    transport::{
        bodies::{Closed, HalfCylinder},
        exam::{Exam, ExamError, MEDIA, Setup, examine},
        photon::Histories,
        tally::Estimate,
    },
};
use mammotwin_data::{Mat3, Vec3};

/// Radius (mm) of Dance's half cylinder.
const RADIUS_MM: f64 = 80.0;
/// Extent (mm) of the drawn breast, rim included: half its width, and away from the chest wall.
const EXTENT_MM: [f64; 2] = [75.0, 90.0];
/// Cells (mm) of the distances from its surface.
const STEP_MM: f64 = 2.0;
/// A wedge must not be thinner than this (mm) at its front.
const THINNEST_MM: f64 = 10.0;

/// Outline of a breast.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outline {
    /// Dance's half cylinder, upright sides.
    HalfCylinder,
    /// Half an ellipse with round sides, as a compressed breast has.
    Rounded,
}

impl Outline {
    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::HalfCylinder => "half cylinder",
            Self::Rounded => "rounded",
        }
    }
}

/// What lies around the gland.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shield {
    /// 5 mm of fat (Dance 1990).
    Fat5,
    /// Skin of 1.45 mm (Huang et al. 2008, mean of 51 breasts).
    Skin,
}

impl Shield {
    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fat5 => "5 mm fat",
            Self::Skin => "1.45 mm skin",
        }
    }

    fn thickness_mm(self) -> f64 {
        match self {
            Self::Fat5 => 5.0,
            Self::Skin => SKIN_MM,
        }
    }

    fn material(self) -> Result<Material, AttenuationError> {
        match self {
            Self::Fat5 => Material::breast(0.0),
            Self::Skin => Material::named("skin_hammerstein"),
        }
    }
}

/// What is computed: all combinations.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyPlan {
    /// Outlines.
    pub outlines: Vec<Outline>,
    /// Shields.
    pub shields: Vec<Shield>,
    /// Nominal thicknesses (mm): mean of the largest and the smallest under the paddle.
    pub thickness_mm: Vec<f64>,
    /// Tilts (°) of the paddle about an axis along the chest wall; the front sinks. 0 must be among
    /// them: the others are compared with it.
    pub tilt_deg: Vec<f64>,
    /// Mass fractions of gland.
    pub glandularity: Vec<f64>,
    /// Photons for each.
    pub histories: Histories,
}

impl Default for StudyPlan {
    /// 30 to 80 mm, up to 6°, 20 and 50 % of gland.
    fn default() -> Self {
        Self {
            outlines: vec![Outline::HalfCylinder, Outline::Rounded],
            shields: vec![Shield::Fat5, Shield::Skin],
            thickness_mm: vec![30.0, 45.0, 60.0, 80.0],
            tilt_deg: vec![0.0, 2.0, 4.0, 6.0],
            glandularity: vec![0.2, 0.5],
            histories: Histories { photons: 1_000_000, seed: 1 },
        }
    }
}

/// Why there is no study.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// No such beam.
    #[error(transparent)]
    Beam(#[from] UnknownBeam),
    /// Beyond Dance's tables.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// No transport.
    #[error(transparent)]
    Exam(#[from] ExamError),
    /// No surface.
    #[error(transparent)]
    Surface(#[from] RasterError),
    /// Nothing to compare with.
    #[error("tilts must hold 0: it is what the others are compared with")]
    NoFlat,
}

/// One breast.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Outline.
    pub outline: Outline,
    /// Shield.
    pub shield: Shield,
    /// Nominal thickness (mm).
    pub thickness_mm: f64,
    /// Tilt (°).
    pub tilt_deg: f64,
    /// Mass fraction of gland.
    pub glandularity: f64,
    /// Largest less smallest thickness under the paddle, over the nominal one.
    pub wedge: f64,
    /// AGD over incident air kerma by Monte Carlo.
    pub monte_carlo: Estimate,
    /// g c s at the nominal thickness.
    pub dance: f64,
    /// Dose of this case over that of the flat paddle, by Monte Carlo.
    pub tilted_over_flat: Estimate,
}

/// Correction of a wedge: AGD = K g c s (1 + a w + b w²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// a.
    pub linear: f64,
    /// b.
    pub quadratic: f64,
    /// Root mean square of what is left, and the largest of it.
    pub residual: [f64; 2],
}

/// Dose under a flat paddle by Monte Carlo over Dance's: 1 + a + b (thickness / 50 mm - 1) + c (gland - 20 %).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlatCorrection {
    /// a, b, c.
    pub terms: [f64; 3],
    /// Root mean square of what is left, and the largest of it.
    pub residual: [f64; 2],
}

/// All cases, and the correction of each outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// In the order of the plan.
    pub cases: Vec<Case>,
    /// Of the wedge, by outline.
    pub corrections: Vec<(Outline, Correction)>,
    /// Of outline and shield under a flat paddle.
    pub flat: Vec<(Outline, Shield, FlatCorrection)>,
}

/// Computes all cases with the beam of 34 kV Rh/Ag behind 2.5 mm PMMA, whose scatter is left out
/// as in Dance's model. `progress` gets the share that is done.
pub fn study(plan: &StudyPlan, progress: &dyn Fn(f64)) -> Result<Study, StudyError> {
    if !plan.tilt_deg.contains(&0.0) {
        return Err(StudyError::NoFlat);
    }
    let paddle = Material::named("pmma")?;
    let beam = Spectrum::of_tube("Rh/Ag", 34)?.behind(&paddle, 2.5)?.of_all();
    let mut order = Vec::new();
    for &outline in &plan.outlines {
        for &shield in &plan.shields {
            for &thickness_mm in &plan.thickness_mm {
                for &glandularity in &plan.glandularity {
                    order.push((outline, shield, thickness_mm, glandularity));
                }
            }
        }
    }
    let mut tilts = plan.tilt_deg.clone();
    tilts.sort_by(f64::total_cmp);
    tilts.sort_by_key(|&tilt| tilt != 0.0);
    let mut cases = Vec::new();
    for (n, &(outline, shield, thickness_mm, glandularity)) in order.iter().enumerate() {
        progress(n as f64 / order.len() as f64);
        let dance_beam = DoseBeam::rhodium_silver_34_kvp();
        let dance = average_glandular_dose(1.0, thickness_mm, glandularity, &dance_beam)?.agd_mgy;
        let mut flat = Estimate::default();
        for &tilt_deg in &tilts {
            let wedge = Wedge::of(outline, thickness_mm, tilt_deg);
            if wedge.thinnest() < THINNEST_MM {
                continue;
            }
            let setup = Setup {
                paddle_mm: 0.0,
                kerma_height_mm: Some(thickness_mm),
                skin: shield.material()?,
                grid: false,
                cells: None,
                ..Setup::usual(glandularity)?
            };
            let monte_carlo =
                wedge.examine(shield.thickness_mm(), &setup, &beam, plan.histories)?.dose_per_kerma;
            if tilt_deg == 0.0 {
                flat = monte_carlo;
            }
            let mean = monte_carlo.mean / flat.mean;
            let error = if tilt_deg == 0.0 {
                0.0
            } else {
                mean * monte_carlo.relative_error().hypot(flat.relative_error())
            };
            cases.push(Case {
                outline,
                shield,
                thickness_mm,
                tilt_deg,
                glandularity,
                wedge: wedge.relative(),
                monte_carlo,
                dance,
                tilted_over_flat: Estimate { mean, error },
            });
        }
    }
    progress(1.0);
    let of = |&outline: &Outline| correction(&cases, outline).map(|found| (outline, found));
    let corrections = plan.outlines.iter().filter_map(of).collect();
    let mut flat = Vec::new();
    for &outline in &plan.outlines {
        for &shield in &plan.shields {
            flat.extend(flat_correction(&cases, outline, shield).map(|f| (outline, shield, f)));
        }
    }
    Ok(Study { cases, corrections, flat })
}

/// Least squares over the flat cases of one outline and shield; `None` without two thicknesses and two
/// glandularities.
fn flat_correction(cases: &[Case], outline: Outline, shield: Shield) -> Option<FlatCorrection> {
    let flat: Vec<(Vec3, f64)> = cases
        .iter()
        .filter(|case| case.outline == outline && case.shield == shield && case.tilt_deg == 0.0)
        .map(|case| {
            let basis = Vec3::new(1.0, case.thickness_mm / 50.0 - 1.0, case.glandularity - 0.2);
            (basis, case.monte_carlo.mean / case.dance - 1.0)
        })
        .collect();
    let normal: Mat3 = flat.iter().map(|(basis, _)| basis * basis.transpose()).sum();
    let right: Vec3 = flat.iter().map(|(basis, off)| basis * *off).sum();
    if normal.determinant() < 1e-9 {
        return None;
    }
    let terms = normal.try_inverse()? * right;
    let rest: Vec<f64> = flat.iter().map(|(basis, off)| (off - basis.dot(&terms)).abs()).collect();
    let mean = rest.iter().map(|r| r * r).sum::<f64>() / rest.len() as f64;
    let largest = rest.iter().copied().fold(0.0, f64::max);
    Some(FlatCorrection { terms: terms.into(), residual: [mean.sqrt(), largest] })
}

/// Least squares of what the tilt does; `None` without two tilts.
fn correction(cases: &[Case], outline: Outline) -> Option<Correction> {
    let tilted: Vec<[f64; 2]> = cases
        .iter()
        .filter(|case| case.outline == outline && case.wedge > 0.0)
        .map(|case| [case.wedge, case.tilted_over_flat.mean - 1.0])
        .collect();
    let sum = |f: &dyn Fn(f64, f64) -> f64| tilted.iter().map(|&[w, y]| f(w, y)).sum::<f64>();
    let [s2, s3, s4] = [2, 3, 4].map(|n| sum(&|w, _| w.powi(n)));
    let [t1, t2] = [sum(&|w, y| w * y), sum(&|w, y| w * w * y)];
    let determinant = s2 * s4 - s3 * s3;
    if !(determinant > 1e-12) {
        return None;
    }
    let linear = (t1 * s4 - t2 * s3) / determinant;
    let quadratic = (t2 * s2 - t1 * s3) / determinant;
    let rest = |&[w, y]: &[f64; 2]| (y - linear * w - quadratic * w * w).abs();
    let mean = tilted.iter().map(|p| rest(p).powi(2)).sum::<f64>() / tilted.len() as f64;
    let largest = tilted.iter().map(rest).fold(0.0, f64::max);
    Some(Correction { linear, quadratic, residual: [mean.sqrt(), largest] })
}

/// A breast under a tilted paddle.
struct Wedge {
    outline: Outline,
    thickness: f64,
    slope: f64,
    /// How far (mm) from the chest wall the paddle touches.
    contact: f64,
}

impl Wedge {
    fn of(outline: Outline, thickness: f64, tilt_deg: f64) -> Self {
        let contact = match outline {
            Outline::HalfCylinder => RADIUS_MM,
            Outline::Rounded => EXTENT_MM[1] - 0.5 * thickness,
        };
        Self { outline, thickness, slope: tilt_deg.to_radians().tan(), contact }
    }

    /// Largest less smallest thickness over the nominal one.
    fn relative(&self) -> f64 {
        self.slope * self.contact / self.thickness
    }

    fn thinnest(&self) -> f64 {
        self.thickness - 0.5 * self.slope * self.contact
    }

    fn examine(
        &self,
        shield_mm: f64,
        setup: &Setup,
        beam: &Spectrum,
        histories: Histories,
    ) -> Result<Exam, StudyError> {
        let geometry = Geometry::pristina(0.1);
        let top = self.thickness + 0.5 * self.slope * self.contact;
        Ok(match self.outline {
            Outline::HalfCylinder => {
                let body = HalfCylinder {
                    radius: RADIUS_MM,
                    bottom: 0.0,
                    top,
                    slope: self.slope,
                    skin: shield_mm,
                    media: MEDIA,
                };
                examine(body, setup, &geometry, beam, histories)?
            }
            Outline::Rounded => {
                let shape = Rounded {
                    extent_mm: EXTENT_MM,
                    thickness_mm: self.thickness,
                    top_mm: top,
                    slope: self.slope,
                    behind_mm: shield_mm,
                };
                let surface = shape.surface(72, 16);
                let body = Closed::new(&surface, STEP_MM, shield_mm, MEDIA)?;
                examine(body, setup, &geometry, beam, histories)?
            }
        })
    }
}
