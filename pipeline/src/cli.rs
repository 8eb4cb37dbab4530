//! What the command line understands.

mod curves;
mod map;
mod models;
mod studies;

pub use curves::ForceCurveArguments;
pub use map::MapArguments;
pub use models::{BenchmarkArguments, DoseArguments, ImageChainArguments, ProjectionArguments};
pub use studies::{
    CalibrationArguments, CompareArguments, DesignsArguments, MeshArguments, PaddlesArguments,
    PositionsArguments, SearchBoxArguments, SegmentationArguments, SensitivityArguments,
    StiffeningArguments, StudyCommand,
};

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// From a volunteer's MRI to mammography metrics.
#[derive(Debug, Parser)]
#[command(name = "mammotwin", version, about, arg_required_else_help = true, after_help = EXIT_CODES)]
pub struct Arguments {
    /// Number of threads; the results do not depend on it [default: all cores]
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// Show failures and answers only
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Append what happens to a file; MAMMOTWIN_LOG=debug tells more
    #[arg(long, global = true, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "\
Examples:
  mammotwin demo                                 a digital volunteer, through all stages, to the report
  mammotwin run study.toml                       a study of your own
  mammotwin status study.toml                    how it stands

Exit codes: 0 done, 2 usage, 65 bad input, 70 physics or numerics \
    refused, 74 reading or writing failed, 75 another process is at work.";

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make the built-in digital volunteer and run the whole pipeline on her
    #[command(after_help = "Example:\n  mammotwin demo --out runs/demo")]
    Demo(DemoArguments),
    /// Make a digital volunteer: scans, landmarks, a ready study, and the truth about her
    #[command(after_help = SYNTH_EXAMPLES)]
    Synth(SynthArguments),
    /// Compute the study: all stages, or some
    #[command(after_help = RUN_EXAMPLES)]
    Run(RunArguments),
    /// Compute the report, and what it needs
    #[command(after_help = "Example:\n  mammotwin report study.toml")]
    Report(StudyArguments),
    /// Carry a point or lesion between poses, compressed breast and mammogram, with its uncertainty
    #[command(after_help = map::MAP_HELP)]
    Map(MapArguments),
    /// Compare a finished run with the truth of a digital volunteer
    #[command(after_help = "Example:\n  mammotwin score dv/study.toml --truth dv/truth --json")]
    Score(ScoreArguments),
    /// How each stage stands: fresh, stale, missing, running, failed, damaged, edited by hand
    #[command(
        after_help = "Examples:\n  mammotwin status study.toml\n  mammotwin status study.toml --json\n  mammotwin status */study.toml"
    )]
    Status(StatusArguments),
    /// Which field of a stage's key changed: old -> new
    #[command(after_help = "Example:\n  mammotwin explain study.toml segment:prone")]
    Explain(ExplainArguments),
    /// Which physical effects a model may lack, and what shows them
    #[command(after_help = "Example:\n  mammotwin effects --json")]
    Effects(EffectsArguments),
    /// Find where simulation and measurement disagree, name the missing effect, add it, show the gap
    #[command(after_help = DISCOVER_HELP)]
    Discover(DiscoverArguments),
    /// Look at the study and its images before any long work
    #[command(after_help = CHECK_HELP)]
    Check(ReadArguments),
    /// Read all results again and compare them with what was stored
    #[command(after_help = "Example:\n  mammotwin verify study.toml")]
    Verify(StudyArguments),
    /// Drop results that the study does not need any more
    #[command(after_help = GC_HELP)]
    Gc(GcArguments),
    /// What a file holds: NIfTI image or labels, landmarks, results
    #[command(after_help = "Example:\n  mammotwin inspect prone.nii.gz --json")]
    Inspect(InspectArguments),
    /// Label breasts, gland, muscle and chest wall in single images, with pictures to look at
    #[command(after_help = SEGMENT_HELP)]
    Segment(SegmentArguments),
    /// Compare paddles, positions and designs on your breast; test the models themselves
    #[command(subcommand, after_help = "Example:\n  mammotwin study dose --out runs/dose")]
    Study(StudyCommand),
    /// A BIDS App: all participants of a BIDS folder, then the table of the group
    #[command(after_help = BIDS_HELP)]
    Bids(BidsArguments),
    /// Completions of a shell, on standard output
    #[command(after_help = COMPLETIONS_EXAMPLES)]
    Completions(CompletionArguments),
    /// The manual page, on standard output; with --out the pages of all commands
    #[command(
        after_help = "Examples:\n  mammotwin man | man -l -\n  mammotwin man --out ~/.local/share/man/man1"
    )]
    Man(ManArguments),
}

const CHECK_HELP: &str = "\
Looked at: every file is there and readable, landmarks lie inside of the image and right and left are
not exchanged (a mirrored header), labels lie on the grid of the image, a paddle from CAD can be read.
Not looked at: the posture and the direction of gravity that the study states.
Exits with 65 when something is wrong.

Examples:
  mammotwin check study.toml
  mammotwin check study.toml --json";

const DISCOVER_HELP: &str = "\
Runs the study, then asks of each effect (see `mammotwin effects`) whether it explains what the
simulated poses leave of the measured ones, beyond what segmentation, registration, the chest wall
and the mesh leave anyway. The held-out pose takes no part in the search; it decides. When an effect
is named, study.discovered.toml is written with it, run beside the first, and discovery.html shows
both.

Examples:
  mammotwin discover study.toml
  mammotwin discover study.toml --held-out tilted --json
  mammotwin discover study.toml --effects limit_chain,skin_region    # quicker";

const GC_HELP: &str = "\
Kept are the results of the study as it is now, results whose need is not known before other
stages ran, and everything outside of the cache. One output folder serves one study.

Examples:
  mammotwin gc study.toml --dry-run
  mammotwin gc study.toml";

const SEGMENT_HELP: &str = "\
For a first look at scans, before there is a study. Each image becomes NAME_labels.nii.gz, which a study
takes as finished labels, and NAME.png: axial, coronal and sagittal cuts through the right breast and, below,
the left one, with outlines of right (orange) and left breast (blue), gland (yellow), muscle (pink) and what
lies behind it. volumes.csv has their volumes. An image that is refused does not stop the others; the exit code
tells of it.

Examples:
  mammotwin segment scans/*.nii.gz --out looks
  mammotwin segment fat-suppressed.nii.gz --scribbles marks.nii.gz --out looks";

const COMPLETIONS_EXAMPLES: &str = "\
Examples:
  mammotwin completions bash > ~/.local/share/bash-completion/completions/mammotwin
  mammotwin completions zsh  > ~/.zfunc/_mammotwin
  mammotwin completions fish > ~/.config/fish/completions/mammotwin.fish";

const BIDS_HELP: &str = "\
Read are sub-LABEL/[ses-*/]anat/sub-LABEL_..acq-POSE.._T1w.nii.gz (or T2w): one image for each pose. Poses
are called supine, prone and upright; another one needs the key GravityInImage (RAS) in its JSON sidecar.
Landmarks are the sidecar's AnatomicalLandmarkCoordinates (voxels) or a file .._landmarks.csv (mm, RAS) of
the same name. All else is in the template, a study without [subject] and [poses.*]; in it
[bids] validate = [\"tilted\"] names the poses that are held out.

participant  computes each participant: segmentations, results, metrics, report
group        gathers the metrics of all participants into one table and one page

Examples:
  mammotwin bids data derivatives participant --template template.toml
  mammotwin bids data derivatives participant --participant-label 01 02
  mammotwin bids data derivatives group";

const SYNTH_EXAMPLES: &str = "\
Examples:
  mammotwin synth --preset small --seed 7 --voxel-mm 1 --out dv
  mammotwin synth --preset large --seed 2 --poses prone,supine --out dv-large
  mammotwin synth --preset small --hide limit_chain=0.5 --out dv-gent
  mammotwin run dv/study.toml
  mammotwin score dv/study.toml --truth dv/truth";

const RUN_EXAMPLES: &str = "\
Examples:
  mammotwin run study.toml                       compute what is not there yet
  mammotwin run study.toml --dry-run             only say what would be computed
  mammotwin run study.toml --from mesh           the mesh and all that follows it, anew
  mammotwin run study.toml --until segment:prone one stage and what it needs
  mammotwin run study.toml --force report        the report anew, although it is fresh

A stage is named with its label (segment:prone) or without (segment: all of them).
--force S   computes S anew though it is fresh; what follows is computed if S changed
--from S    computes S and all that follows it anew
--until S   computes S and what it needs, nothing else
--only S    computes S anew and nothing else; what it needs must be there
Labels that were edited by hand are never computed anew.";

/// A study and where its results go.
#[derive(Debug, Clone, Args)]
pub struct StudyArguments {
    /// Study file
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Output folder [default: `out` beside the study file]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// The demonstration.
#[derive(Debug, Clone, Args)]
pub struct DemoArguments {
    /// Kind of volunteer: small; large; tiny, coarse and quick, shows only that all works
    #[arg(long, default_value = "small")]
    pub preset: String,
    /// Folder of the volunteer; the results go to `out` in it
    #[arg(long, value_name = "DIR", default_value = "runs/demo")]
    pub out: PathBuf,
}

/// A digital volunteer.
#[derive(Debug, Clone, Args)]
pub struct SynthArguments {
    /// Kind of volunteer: small; large; tiny, coarse and quick; sliding, tiny with a chest wall that slides
    #[arg(long, default_value = "small")]
    pub preset: String,
    /// Which person of that kind
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub seed: u64,
    /// Edges of the voxels (mm): one number or three [default: those of the preset]
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub voxel_mm: Vec<f64>,
    /// Poses to scan: supine, prone, tilted, upright; supine is always among them [default: all]. Without
    /// prone the study fits no moduli
    #[arg(long, value_name = "POSE", value_delimiter = ',')]
    pub poses: Vec<String>,
    /// Give the truth an effect that the study does not have; without a number half of the
    /// greatest plausible amplitude (see `mammotwin effects`)
    #[arg(long, value_name = "EFFECT[=AMPLITUDE]", value_delimiter = ',')]
    pub hide: Vec<String>,
    /// Leave chest wall and arms as they are between the poses, as no person's are: what is left is a
    /// rigid motion of the table
    #[arg(long)]
    pub still: bool,
    /// Edges of the elements of the truth (mm) [default: those of the preset]
    #[arg(long, value_name = "MM")]
    pub truth_mm: Option<f64>,
    /// Elements that the study asks for: linear, quadratic [default: those of the preset]
    #[arg(long, value_name = "KIND")]
    pub elements: Option<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// The library of effects.
#[derive(Debug, Clone, Args)]
pub struct EffectsArguments {
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// A discovery.
#[derive(Debug, Clone, Args)]
pub struct DiscoverArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Pose that the search does not see and that decides [default: the first with
    /// use = \"validate\", as the pose must have]
    #[arg(long, value_name = "POSE")]
    pub held_out: Option<String>,
    /// Effects to look for [default: all of `mammotwin effects`]
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    pub effects: Vec<String>,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// A run and the truth.
#[derive(Debug, Clone, Args)]
pub struct ScoreArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Folder of the truth that `synth` wrote
    #[arg(long, value_name = "DIR")]
    pub truth: PathBuf,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// A question about a study.
#[derive(Debug, Clone, Args)]
pub struct ReadArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// How studies stand.
#[derive(Debug, Clone, Args)]
pub struct StatusArguments {
    /// One study or more
    #[arg(value_name = "STUDY.toml", required = true)]
    pub studies: Vec<PathBuf>,
    /// Output folder of a single study [default: `out` beside the study file]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Answer in JSON: the stages of a single study, or those of each by its path
    #[arg(long)]
    pub json: bool,
}

/// A question about a stage.
#[derive(Debug, Clone, Args)]
pub struct ExplainArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Stage (`segment`) or one instance of it (`segment:prone`)
    #[arg(value_name = "STAGE")]
    pub stage: String,
}

/// What to drop.
#[derive(Debug, Clone, Args)]
pub struct GcArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Only say what would be dropped
    #[arg(long)]
    pub dry_run: bool,
}

/// A BIDS folder.
#[derive(Debug, Clone, Args)]
pub struct BidsArguments {
    /// Folder with the participants, sub-*
    #[arg(value_name = "BIDS_DIR")]
    pub bids_dir: PathBuf,
    /// Folder of the derivatives
    #[arg(value_name = "OUT_DIR")]
    pub out_dir: PathBuf,
    /// What to compute
    #[arg(value_name = "LEVEL")]
    pub level: BidsLevel,
    /// Only these participants, without sub- [default: all]
    #[arg(long, value_name = "LABEL", num_args = 1..)]
    pub participant_label: Vec<String>,
    /// Study without subject and poses [default: literature moduli, a compression to 50 mm]
    #[arg(long, value_name = "TEMPLATE.toml")]
    pub template: Option<PathBuf>,
    /// Folder of the cache [default: OUT_DIR/work]
    #[arg(long, short, value_name = "DIR")]
    pub work_dir: Option<PathBuf>,
}

/// Levels of a BIDS App.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BidsLevel {
    /// Each participant.
    Participant,
    /// All of them together.
    Group,
}

/// A shell.
#[derive(Debug, Clone, Args)]
pub struct CompletionArguments {
    /// Which shell
    #[arg(value_name = "SHELL")]
    pub shell: clap_complete::Shell,
}

/// Manual pages.
#[derive(Debug, Clone, Args)]
pub struct ManArguments {
    /// Folder to write the pages of all commands to
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// A file to look at.
#[derive(Debug, Clone, Args)]
pub struct InspectArguments {
    /// File
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// Images to label.
#[derive(Debug, Clone, Args)]
pub struct SegmentArguments {
    /// NIfTI images (.nii, .nii.gz)
    #[arg(value_name = "IMAGE", required = true)]
    pub images: Vec<PathBuf>,
    /// Write over labels that are there
    #[arg(long)]
    pub force: bool,
    /// Marks in the one image, as labels: what the brightness of tissues is learnt from
    #[arg(long, value_name = "LABELS")]
    pub scribbles: Option<PathBuf>,
    /// Folder to write to
    #[arg(long, value_name = "DIR", default_value = "runs/segment")]
    pub out: PathBuf,
    /// Answer in JSON
    #[arg(long)]
    pub json: bool,
}

/// A run.
#[derive(Debug, Clone, Args)]
pub struct RunArguments {
    /// The study
    #[command(flatten)]
    pub study: StudyArguments,
    /// Compute these stages and all that follow them anew
    #[arg(long, value_name = "STAGE")]
    pub from: Vec<String>,
    /// Compute these stages and what they need, nothing else
    #[arg(long, value_name = "STAGE")]
    pub until: Vec<String>,
    /// Compute these stages alone, anew
    #[arg(long, value_name = "STAGE", conflicts_with_all = ["from", "until"])]
    pub only: Vec<String>,
    /// Compute these stages anew, although they are fresh
    #[arg(long, value_name = "STAGE")]
    pub force: Vec<String>,
    /// Say what would be computed; write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Exit with 75 instead of waiting for another process
    #[arg(long)]
    pub no_wait: bool,
}

/// A message on one line, whatever it was made of.
pub fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
