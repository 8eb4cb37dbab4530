//! Arguments of the study of force curves.

use clap::Args;
use std::path::PathBuf;

pub(super) const FORCE_CURVE_HELP: &str = "\
With a study and a record: presses the breast of the study with each effect of the compression at several
amplitudes and on other meshes, and says which effect the record has and the model lacks. The record is a CSV
table thickness_mm,force_n with, if measured, contact_area_mm2, extent_mm and tilt_deg (cells may be empty);
another record of the same compression decides\n(--held-out), or the smallest thicknesses of the record. Files go to studies/force-curve in the output folder; for an effect that is
named or in an ambiguous set, a new study beside the first has it switched on.

Without a study: hides each effect in a digital volunteer who is pressed on a finer mesh of another pattern, draws
errors, and counts how often the answer is right. Compressions that are there already are used again.

Examples:
  mammotwin study force-curve study.toml --record curve.csv --held-out again.csv
  mammotwin study force-curve --out runs/force-curve --seeds 7 --draws 20";

/// The study of force curves.
#[derive(Debug, Clone, Args)]
pub struct ForceCurveArguments {
    /// Study file; digital volunteers when absent
    #[arg(value_name = "STUDY.toml", requires = "record")]
    pub study: Option<PathBuf>,
    /// Record: CSV table thickness_mm,force_n and further columns
    #[arg(long, value_name = "CURVE.csv", requires = "study")]
    pub record: Option<PathBuf>,
    /// Another record of the same compression, which decides [default: the smallest thicknesses of the record]
    #[arg(long, value_name = "CURVE.csv", requires = "record")]
    pub held_out: Option<PathBuf>,
    /// Folder to write to [default: `out` beside the study file, or runs/force-curve]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Answer in JSON (with a study)
    #[arg(long)]
    pub json: bool,
    /// Error of a force in proportion (%), point by point
    #[arg(long, value_name = "PERCENT", default_value_t = 3.0)]
    pub force_error_percent: f64,
    /// Error of a force (N), point by point
    #[arg(long, value_name = "N", default_value_t = 0.5)]
    pub force_error_n: f64,
    /// Error of all thicknesses alike (mm)
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    pub thickness_error_mm: f64,
    /// Error of the stiffness that was calibrated under gravity (%)
    #[arg(long, value_name = "PERCENT", default_value_t = 10.0)]
    pub stiffness_error_percent: f64,
    /// Kind of volunteer
    #[arg(long, value_name = "PRESET", default_value = "large")]
    pub preset: String,
    /// Which persons of that kind
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "7")]
    pub seeds: Vec<u64>,
    /// Draws of errors for each case
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub draws: usize,
    /// Edges of the volunteers' mesh (mm); the truth has 0.7 times that
    #[arg(long, value_name = "MM", default_value_t = 22.0)]
    pub size_mm: f64,
    /// Factor of all moduli of the volunteers, whose forces are a tenth of measured ones
    #[arg(long, value_name = "X", default_value_t = 3.0)]
    pub stiffer: f64,
    /// Begin no compression of the volunteers after so many minutes
    #[arg(long, value_name = "N")]
    pub minutes: Option<u64>,
}
