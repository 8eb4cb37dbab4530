//! Arguments of `mammotwin map`.

use super::StudyArguments;
use clap::{ArgGroup, Args};
use std::path::PathBuf;

/// A place of tissue.
#[derive(Debug, Clone, Args)]
#[command(group(ArgGroup::new("what").required(true).args(["point", "points", "landmark", "pixel"])))]
pub struct MapArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Where the place is given: a pose of the study, `compressed` (frame of the detector) or `mammogram`
    #[arg(long, value_name = "POSE")]
    pub from: String,
    /// Point in mm: right-anterior-superior in the image of a pose; in the frame of the detector for `compressed`
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub point: Option<String>,
    /// Landmark of the pose by its name
    #[arg(long, value_name = "NAME")]
    pub landmark: Option<String>,
    /// Places of a file, as landmark files are (`name,x,y,z` in mm): those outside of the breasts are named and left out
    #[arg(long, value_name = "FILE")]
    pub points: Option<PathBuf>,
    /// Pixel of the mammogram, column and row from 0, as in its TIFF: the line to the focal spot is followed
    #[arg(long, value_name = "COLUMN,ROW", allow_hyphen_values = true)]
    pub pixel: Option<String>,
    /// Distance (mm) of the points on that line
    #[arg(long, value_name = "MM", default_value_t = 5.0)]
    pub step_mm: f64,
    /// Leave out what the moduli leave open: nothing is computed then
    #[arg(long)]
    pub quick: bool,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

pub(super) const MAP_HELP: &str = "\
Carries a place of tissue - a lesion, a marker - from one pose to all others, to the stress-free shape, to the
compressed breast and onto the mammogram (CC or MLO, as the study compresses), with one standard deviation (mm)
and what makes it. The study must have been run. The first call computes the model once more with stiffer
breasts, one standard deviation of the fitted moduli, and keeps it; --quick leaves that out.

Examples:
  mammotwin map study.toml --from prone --point -62.5,88,-14
  mammotwin map study.toml --from supine --landmark breast_right_1 --json
  mammotwin map study.toml --from prone --points lesions.csv
  mammotwin map study.toml --from mammogram --pixel 1204,655 --step-mm 2";
