//! Studies: many runs for one question.

use super::curves::{FORCE_CURVE_HELP, ForceCurveArguments};
use super::models::IMAGE_CHAIN_HELP;
use super::{
    BenchmarkArguments, DoseArguments, ImageChainArguments, ProjectionArguments, StudyArguments,
};
use crate::accuracy::Layers;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// A study of a model.
#[derive(Debug, Subcommand)]
pub enum StudyCommand {
    /// Dance's dose against Monte Carlo under a tilted paddle: table, chart, fitted correction
    #[command(after_help = "Example:\n  mammotwin study dose --out runs/dose --photons 1000000")]
    Dose(DoseArguments),
    /// The projection of bodies with known path lengths: pictures, and how far off they are
    #[command(
        after_help = "Examples:\n  mammotwin study projection --out runs/projection\n  mammotwin study projection --surface breast.stl --out runs/projection"
    )]
    Projection(ProjectionArguments),
    /// Image-chain effects hidden in simulated measured mammograms: found, named, added
    #[command(after_help = IMAGE_CHAIN_HELP)]
    ImageChain(ImageChainArguments),
    /// How often `discover` names what was hidden: volunteers with hidden effects, scored
    #[command(after_help = BENCHMARK_HELP)]
    Discovery(BenchmarkArguments),
    /// Paddles, volunteers and positions: what each costs and gives, and what nothing beats
    #[command(after_help = DESIGNS_HELP)]
    Designs(DesignsArguments),
    /// Fit, held-out poses and moduli of digital volunteers, with the right and with too simple a law
    #[command(after_help = CALIBRATION_HELP)]
    Calibration(CalibrationArguments),
    /// Effects of the compression that a record of force and thickness has and the model lacks
    #[command(after_help = FORCE_CURVE_HELP)]
    ForceCurve(ForceCurveArguments),
    /// One breast under several paddles: comfort, image, dose; table, charts, page
    #[command(after_help = PADDLES_EXAMPLES)]
    Paddles(PaddlesArguments),
    /// Compressions of several studies beside the first one's: differences, effect sizes, overlaps
    #[command(after_help = COMPARE_EXAMPLES)]
    Compare(CompareArguments),
    /// What the size of the elements does to way, strain, force, time and memory: orders of convergence
    #[command(after_help = MESH_HELP)]
    Mesh(MeshArguments),
    /// One breast with the paddle at several distances from the chest wall
    #[command(after_help = POSITIONS_EXAMPLES)]
    Positions(PositionsArguments),
    /// Whether the solver finds an equilibrium wherever a calibration may go: a designed sample, checked
    #[command(after_help = SEARCH_BOX_HELP)]
    SearchBox(SearchBoxArguments),
    /// Segmentation against the truth of digital volunteers: Dice and distances, structure by structure
    #[command(after_help = SEGMENTATION_HELP)]
    Segmentation(SegmentationArguments),
    /// What each tissue does under gravity, and the error of the model over all moduli
    #[command(after_help = SENSITIVITY_HELP)]
    Sensitivity(SensitivityArguments),
    /// Jₘ and the place of the paddle from a record of force and thickness: posterior of both
    #[command(after_help = STIFFENING_HELP)]
    Stiffening(StiffeningArguments),
}

const CALIBRATION_HELP: &str = "\
Makes each person twice, of neo-Hookean tissue and of tissue that stiffens as it stretches (Gent), with all errors
of images, segmentation and registration. Fits the first, and the second with both laws. The fit is told the true
thickness of skin and fascia, density, Poisson's ratio, ligaments, chest wall and 1/Jm; their true moduli too, unless
--layers literature. What is there already is used again; tables and figure are written after each person.

Examples:
  mammotwin study calibration --seeds 11,12,13 --out runs/calibration
  mammotwin study calibration --voxel-mm 1.25 --stiffening 0.5
  mammotwin study calibration --voxel-mm 1.25 --layers literature";

/// The study of the calibration.
#[derive(Debug, Clone, Args)]
pub struct CalibrationArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/calibration")]
    pub out: PathBuf,
    /// Kind of volunteers
    #[arg(long, value_name = "PRESET", default_value = "tiny")]
    pub preset: String,
    /// Which persons of that kind
    #[arg(
        long,
        value_name = "N",
        value_delimiter = ',',
        default_value = "11,12,13,14,15,16,17,18,19,20"
    )]
    pub seeds: Vec<u64>,
    /// Edge of the voxels (mm), one number or three [default: the preset's]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub voxel_mm: Vec<f64>,
    /// 1/Jₘ of tissue that stiffens
    #[arg(long, value_name = "X", default_value_t = 0.8)]
    pub stiffening: f64,
    /// What the fit is told of skin and fascia; breasts always begin at the literature's 0.5 kPa
    #[arg(long, value_enum, default_value_t = Layers::Known)]
    pub layers: Layers,
}

const DESIGNS_HELP: &str = "\
Presses every breast with every paddle at every distance from the chest wall, until a force or a
thickness that is the same for all, and judges: largest pressure of the paddle's face, compressed
thickness (at a given thickness: force), average glandular dose, share of the breast in the picture.
What nothing beats in all of them is the Pareto front, of each volunteer and of the medians over all,
each over the first paddle at the first distance. Several volunteers: each paddle over the first one
in pairs, with 95 % intervals. Results that are there are used again: a study that was cut
short goes on where it ended. A file of designs has a table [NAME] each, with paddle and its own
table as in [compress]:

  [soft]
  paddle = \"cushion\"
  cushion = { thickness_mm = 10.0, young_kpa = 20.0 }

Examples:
  mammotwin study designs study.toml --paddles rigid,flex,curved --force-n 2
  mammotwin study designs --seeds 7,8 --designs designs.toml --distances 15,12
  mammotwin study designs --preset large --seeds 1,2,3,4 --size-mm 10 --paddles rigid,flex --force-n 5";

/// The study of designs.
#[derive(Debug, Clone, Args)]
pub struct DesignsArguments {
    /// Studies of volunteers, each with its results in `out` beside it
    #[arg(value_name = "STUDY.toml")]
    pub studies: Vec<PathBuf>,
    /// Digital volunteers besides, made in the output folder: which persons
    #[arg(long, value_name = "N", value_delimiter = ',')]
    pub seeds: Vec<u64>,
    /// Kind of these volunteers
    #[arg(long, value_name = "PRESET", default_value = "tiny")]
    pub preset: String,
    /// Edge of their voxels (mm), one number or three [default: the preset's]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub voxel_mm: Vec<f64>,
    /// Edge of the elements of their meshes (mm) [default: the preset's]
    #[arg(long, value_name = "MM")]
    pub size_mm: Option<f64>,
    /// Paddles; the first one is what the others are compared with
    #[arg(
        long,
        value_name = "PADDLE",
        value_delimiter = ',',
        default_value = "rigid,flex,elastic,tilting,curved,cushion"
    )]
    pub paddles: Vec<String>,
    /// File with further designs
    #[arg(long, value_name = "DESIGNS.toml")]
    pub designs: Option<PathBuf>,
    /// Distances (mm) from the chest wall to the paddle's edge [default: that of each study]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub distances: Vec<f64>,
    /// Press to this force (N) [default: the stop rule of each study]
    #[arg(long, value_name = "N", conflicts_with = "thickness_mm")]
    pub force_n: Option<f64>,
    /// Press to this thickness (mm)
    #[arg(long, value_name = "MM")]
    pub thickness_mm: Option<f64>,
    /// Forces, pressures and tissue in view only; no mammogram, no dose
    #[arg(long)]
    pub no_picture: bool,
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/designs")]
    pub out: PathBuf,
}

const STIFFENING_HELP: &str = "\
Compresses the breast of the study for every Jₘ and every distance of the paddle from the chest wall, and
weighs them by the record: a CSV table thickness_mm,force_n, or the one point of [records.SIDE]. Results
that are there are used again; files go to studies/stiffening in the output folder.

Examples:
  mammotwin study stiffening study.toml --record curve.csv
  mammotwin study stiffening study.toml --jm 0.7,1,1.4,2,3 --distances 10,15,20
  mammotwin study stiffening study.toml --record right.csv --other    # what will the other breast show?
  mammotwin study stiffening study.toml --record curve.csv --poses    # one material for both loads?";

/// The study of stiffening.
#[derive(Debug, Clone, Args)]
pub struct StiffeningArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Record: CSV table thickness_mm,force_n [default: records of the study]
    #[arg(long, value_name = "CURVE.csv")]
    pub record: Option<PathBuf>,
    /// Jₘ of the breast (Gent)
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "0.7,1,1.4,2,3,5")]
    pub jm: Vec<f64>,
    /// Distances (mm) from the chest wall to the paddle's edge
    #[arg(long, value_name = "MM", value_delimiter = ',', default_value = "10,15,20,30")]
    pub distances: Vec<f64>,
    /// Ask the poses too: fit the moduli to all of them for every Jₘ of breast, skin and fascia, and say
    /// whether one material explains poses and record
    #[arg(long)]
    pub poses: bool,
    /// Foretell the force of the other breast, with its interval: compresses it on the same grid
    #[arg(long)]
    pub other: bool,
    /// Error of a force in proportion (%)
    #[arg(long, value_name = "PERCENT", default_value_t = 3.0)]
    pub force_error_percent: f64,
    /// Error of a force (N)
    #[arg(long, value_name = "N", default_value_t = 0.5)]
    pub force_error_n: f64,
    /// Error of a thickness (mm)
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    pub thickness_error_mm: f64,
    /// Error of all forces of the model alike (%): mesh, moduli, friction
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0)]
    pub model_error_percent: f64,
    /// Error of the model's forces, alike over 5 mm of thickness (%): what elements do to the curve
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0)]
    pub mesh_error_percent: f64,
}

const MESH_HELP: &str = "\
Hangs one digital volunteer and presses her right breast on coarse to fine linear tetrahedra, and fits the limit
and the order of each answer. The table is written after each mesh.

Examples:
  mammotwin study mesh --out runs/mesh
  mammotwin study mesh --preset large --sizes 20,17,15,13,10 --distance-mm 33 --thickness-mm 60
  mammotwin study mesh --sizes 20,15,10,7,5 --gravity-only";

/// The study of meshes.
#[derive(Debug, Clone, Args)]
pub struct MeshArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/mesh")]
    pub out: PathBuf,
    /// Kind of volunteer
    #[arg(long, value_name = "PRESET", default_value = "tiny")]
    pub preset: String,
    /// Which person of that kind
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub seed: u64,
    /// Edges of the elements (mm)
    #[arg(long, value_name = "MM", value_delimiter = ',', default_value = "20,17,15,13,10,7")]
    pub sizes: Vec<f64>,
    /// Distance of the plates from the chest wall (mm)
    #[arg(long, value_name = "MM", default_value_t = 15.0)]
    pub distance_mm: f64,
    /// Compressed thickness (mm)
    #[arg(long, value_name = "MM", default_value_t = 46.0)]
    pub thickness_mm: f64,
    /// No compression
    #[arg(long)]
    pub gravity_only: bool,
}

const SEARCH_BOX_HELP: &str = "\
Draws sets of tissues (breast 0.2 - 4, skin 2 - 20, fascia 50 - 250 kPa, Poisson's ratio 0.45 - 0.499,
Jm from 1 to none), puts two volunteers under gravity in four poses, bonded and sliding, and checks each
equilibrium. Each run is kept when it is done: a study that was cut short goes on where it ended.

Examples:
  mammotwin study search-box --out runs/search-box
  mammotwin study search-box --runs 40 --size-mm 15 --minutes 10";

/// The study of the search box.
#[derive(Debug, Clone, Args)]
pub struct SearchBoxArguments {
    /// Folder with the runs and the results
    #[arg(long, value_name = "DIR", default_value = "runs/search-box")]
    pub out: PathBuf,
    /// Number of runs; a multiple of 40 has all combinations equally often
    #[arg(long, value_name = "N", default_value_t = 216)]
    pub runs: usize,
    /// Seed of the design
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Edges of the meshes (mm)
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    pub size_mm: f64,
    /// Of so many runs of a combination, one is also loaded in three parts; 0 for none
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub stepped_every: usize,
    /// Begin no run after so many minutes
    #[arg(long, value_name = "N")]
    pub minutes: Option<u64>,
}

const SEGMENTATION_HELP: &str = "\
Makes digital volunteers (supine, prone, tilted), segments each image without help and compares
labels and surfaces with the truth. Volunteers that are there already are used again, and the table is
written after each person.

Examples:
  mammotwin study segmentation --out runs/segmentation --presets tiny
  mammotwin study segmentation --presets small --voxel-mm 1 --seeds 21,22,23
  mammotwin study segmentation --presets tiny --without-landmarks
  mammotwin study segmentation --presets small,large --voxel-mm 0.5,0.5,0.6 --poses prone";

/// The study of the segmentation.
#[derive(Debug, Clone, Args)]
pub struct SegmentationArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/segmentation")]
    pub out: PathBuf,
    /// Kinds of volunteers
    #[arg(long, value_name = "PRESET", value_delimiter = ',', default_value = "tiny")]
    pub presets: Vec<String>,
    /// Which persons of each kind
    #[arg(
        long,
        value_name = "N",
        value_delimiter = ',',
        default_value = "11,12,13,14,15,16,17,18,19,20"
    )]
    pub seeds: Vec<u64>,
    /// Edge of the voxels (mm), one number or three [default: the preset's]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub voxel_mm: Vec<f64>,
    /// How the persons lie
    #[arg(long, value_name = "POSE", value_delimiter = ',', default_value = "supine,prone,tilted")]
    pub poses: Vec<String>,
    /// Find the axes of the body from the images, as for people without marks on the chest
    #[arg(long)]
    pub without_landmarks: bool,
}

const SENSITIVITY_HELP: &str = "\
Puts gravity from behind on the reference pose over Poisson's ratio and the moduli of breast, skin and
fascia, then finds the stress-free shape and all fitted poses for every set of moduli. Each row of sets is
kept when it is done: a study that was cut short goes on where it ended. Files go to
studies/sensitivity in the output folder.

Examples:
  mammotwin study sensitivity study.toml
  mammotwin study sensitivity study.toml --breast 0.2,0.3,0.4 --skin 2,4,8 --fascia 120";

/// The study of sensitivities.
#[derive(Debug, Clone, Args)]
pub struct SensitivityArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Young's moduli of both breasts (kPa)
    #[arg(
        long,
        value_name = "KPA",
        value_delimiter = ',',
        default_value = "0.15,0.2,0.25,0.3,0.4,0.5,0.6,0.8,1"
    )]
    pub breast: Vec<f64>,
    /// Young's moduli of the skin (kPa)
    #[arg(long, value_name = "KPA", value_delimiter = ',', default_value = "2,3,4,6,8,12,20")]
    pub skin: Vec<f64>,
    /// Young's moduli of the fascia (kPa)
    #[arg(long, value_name = "KPA", value_delimiter = ',', default_value = "50,80,120,160,250")]
    pub fascia: Vec<f64>,
    /// Gravity from behind only
    #[arg(long)]
    pub no_map: bool,
    /// The error of the model only
    #[arg(long)]
    pub no_sweeps: bool,
}

const BENCHMARK_HELP: &str = "\
Makes volunteers with nothing and with each effect hidden at 2, 5 and 10 standard deviations, gathers
the evidence of each, and tries the verdict on drawn errors. With --images also whole runs from noisy
images. What is there already is kept: a study that was cut short goes on where it ended.

Examples:
  mammotwin study discovery --out runs/discovery --seeds 7 --draws 20
  mammotwin study discovery --out runs/discovery --seeds 7,11,13 --images 8 --minutes 120";

/// The study of paddles.
#[derive(Debug, Clone, Args)]
pub struct PaddlesArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Paddles to compare; the first one is what the others are compared with
    #[arg(
        long,
        value_name = "PADDLE",
        value_delimiter = ',',
        default_value = "rigid,flex,elastic,tilting,curved,spot,biopsy,cushion"
    )]
    pub paddles: Vec<String>,
    /// Forces, pressures and stresses only; no mammogram, no dose
    #[arg(long)]
    pub no_picture: bool,
}

/// The study of positions.
#[derive(Debug, Clone, Args)]
pub struct PositionsArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Distances (mm) from the chest wall to the paddle's edge, the farthest first
    #[arg(long, value_name = "MM", value_delimiter = ',', default_value = "48,40,33")]
    pub distances: Vec<f64>,
    /// Paddles, each at every distance
    #[arg(
        long,
        value_name = "PADDLE",
        value_delimiter = ',',
        default_value = "elastic,rigid,flex"
    )]
    pub paddles: Vec<String>,
    /// Forces, pressures and stresses only; no mammogram, no dose
    #[arg(long)]
    pub no_picture: bool,
}

const PADDLES_EXAMPLES: &str = "\
Every paddle presses the breast of the study until the study's stop rule: rigid, flex, elastic,
tilting, curved, spot, biopsy, cushion, and cad when it is the study's own. Results that are there are
used again; files go to studies/paddles in the output folder.

Examples:
  mammotwin study paddles study.toml
  mammotwin study paddles study.toml --paddles rigid,flex --no-picture";

const POSITIONS_EXAMPLES: &str = "\
Results that are there are used again; files go to studies/positions in the output folder.

Examples:
  mammotwin study positions study.toml
  mammotwin study positions study.toml --distances 20,15,10 --paddles elastic";

/// Studies beside each other.
#[derive(Debug, Clone, Args)]
pub struct CompareArguments {
    /// Studies, each with its results in `out` beside it; the first one is what the others are compared with
    #[arg(value_name = "STUDY.toml", required = true)]
    pub studies: Vec<PathBuf>,
    /// Forces, pressures and stresses only; no mammogram, no dose
    #[arg(long)]
    pub no_picture: bool,
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/compare")]
    pub out: PathBuf,
}

const COMPARE_EXAMPLES: &str = "\
Presses each breast as its study says (results of a run are used again) and compares: contact pressure by
area, stress and stretch by volume, SNR and SDNR by region of interest; of one mesh also how tissue shifts.

Examples:
  mammotwin study compare rigid.toml flex.toml
  mammotwin study compare before/study.toml after/study.toml --no-picture --out runs/compare";
