//! Arguments of the studies of the models themselves.

use clap::Args;
use std::path::PathBuf;

/// The study of dose.
#[derive(Debug, Clone, Args)]
pub struct DoseArguments {
    /// Folder to write to; must not hold an earlier study
    #[arg(long, value_name = "DIR", default_value = "runs/dose")]
    pub out: PathBuf,
    /// Photons for each breast; standard error of its dose: 0.2 % with 1000000
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    pub photons: u64,
    /// Seed of the photons
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// The study of the projection.
#[derive(Debug, Clone, Args)]
pub struct ProjectionArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/projection")]
    pub out: PathBuf,
    /// Pixel pitch (mm)
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    pub pixel_mm: f64,
    /// Project this closed surface instead (STL): mm, x along the chest wall, y away from it, z up from the detector
    #[arg(long, value_name = "FILE")]
    pub surface: Option<PathBuf>,
}

pub(super) const IMAGE_CHAIN_HELP: &str = "\
Simulates the acceptance of a unit: a breast, a uniform slab, a test object with grains and doses under a
tilted paddle, with one effect in them that the image model lacks, quantum noise and an uneven gain of
the detector. The search sees one set; another decides. Effects: scatter, heel, beam_spectrum, blur, agd_wedge;
gain_gradient is in none of the library, none hides nothing.

Examples:
  mammotwin study image-chain --hide heel --out runs/heel
  mammotwin study image-chain --hide none --seed 3 --json";

/// The study of the image chain.
#[derive(Debug, Clone, Args)]
pub struct ImageChainArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/image-chain")]
    pub out: PathBuf,
    /// Effect to hide
    #[arg(long, value_name = "EFFECT", default_value = "scatter")]
    pub hide: String,
    /// Seed of noise and gain
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// The benchmark of `discover`.
#[derive(Debug, Clone, Args)]
pub struct BenchmarkArguments {
    /// Folder with the volunteers and the results
    #[arg(long, value_name = "DIR", default_value = "runs/discovery")]
    pub out: PathBuf,
    /// Kind of volunteer
    #[arg(long, value_name = "PRESET", default_value = "tiny")]
    pub preset: String,
    /// Edge of the voxels of her labels and images (mm), one number or three [default: the preset's]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub voxel_mm: Vec<f64>,
    /// Edges of the elements of the truth (mm) [default: those of the preset]
    #[arg(long, value_name = "MM")]
    pub truth_mm: Option<f64>,
    /// Which persons of that kind
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "7")]
    pub seeds: Vec<u64>,
    /// Draws of errors for each case
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub draws: usize,
    /// Cases of each person that go through images, segmentation and registration
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub images: usize,
    /// Hide only these effects
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    pub effects: Vec<String>,
    /// Ask for these effects only [default: all of `mammotwin effects`]; what is hidden is among them
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    pub asked: Vec<String>,
    /// Severities (standard deviations), in the order in which they are tried
    #[arg(long, value_name = "SIGMA", value_delimiter = ',', default_value = "5,10,2")]
    pub sigmas: Vec<f64>,
    /// Begin no case after so many minutes
    #[arg(long, value_name = "N")]
    pub minutes: Option<u64>,
}
