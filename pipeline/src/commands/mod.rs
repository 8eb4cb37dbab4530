//! One function for each command.

pub mod accuracy;
pub mod benchmark;
pub mod bids;
pub mod check;
pub mod compare;
pub mod designs;
pub mod discover;
pub mod dose;
pub mod effects;
pub mod explain;
pub mod force_curve;
pub mod image_chain;
pub mod inspect;
pub mod keep;
pub mod manual;
pub mod map;
mod mesh;
pub mod projection;
pub mod run;
pub mod score;
pub mod search_box;
pub mod segment;
pub mod segmentation;
pub mod sensitivity;
pub mod status;
pub mod stiffening;
pub mod synth;
mod volunteer;

use crate::{
    cli::{Arguments, Command, StudyArguments, StudyCommand},
    display,
    plausible::{Finding, Weight},
};
use mammotwin_data::{
    Failure,
    io::torque,
    store::Store,
    study::{self, Study, StudyError},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Does what the command line asks for.
pub fn dispatch(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1));
        pool.build_global().map_err(|cause| Failure::Usage(format!("--threads: {cause}")))?;
    }
    if arguments.quiet {
        display::be_quiet();
    }
    match &arguments.command {
        Command::Demo(arguments) => synth::demo(arguments),
        Command::Synth(arguments) => synth::synth(arguments),
        Command::Run(arguments) => run::run(arguments),
        Command::Report(arguments) => run::report(arguments),
        Command::Map(arguments) => map::map(arguments),
        Command::Score(arguments) => score::score(arguments),
        Command::Status(arguments) => status::status(arguments),
        Command::Explain(arguments) => explain::explain(arguments),
        Command::Effects(arguments) => effects::effects(arguments),
        Command::Discover(arguments) => discover::discover(arguments),
        Command::Check(arguments) => check::check(arguments),
        Command::Verify(arguments) => keep::verify(arguments),
        Command::Gc(arguments) => keep::gc(arguments),
        Command::Inspect(arguments) => inspect::inspect(arguments),
        Command::Segment(arguments) => segment::segment(arguments),
        Command::Study(StudyCommand::Dose(arguments)) => dose::dose(arguments),
        Command::Study(StudyCommand::Projection(arguments)) => projection::projection(arguments),
        Command::Study(StudyCommand::ImageChain(arguments)) => image_chain::image_chain(arguments),
        Command::Study(StudyCommand::ForceCurve(arguments)) => force_curve::force_curve(arguments),
        Command::Study(StudyCommand::Discovery(arguments)) => benchmark::benchmark(arguments),
        Command::Study(StudyCommand::Calibration(arguments)) => accuracy::calibration(arguments),
        Command::Study(StudyCommand::Paddles(arguments)) => compare::paddles(arguments),
        Command::Study(StudyCommand::Compare(arguments)) => compare::compare(arguments),
        Command::Study(StudyCommand::Positions(arguments)) => compare::positions(arguments),
        Command::Study(StudyCommand::Designs(arguments)) => designs::designs(arguments),
        Command::Study(StudyCommand::Mesh(arguments)) => mesh::mesh(arguments),
        Command::Study(StudyCommand::SearchBox(arguments)) => search_box::search_box(arguments),
        Command::Study(StudyCommand::Segmentation(arguments)) => {
            segmentation::segmentation(arguments)
        }
        Command::Study(StudyCommand::Sensitivity(arguments)) => sensitivity::sensitivity(arguments),
        Command::Study(StudyCommand::Stiffening(arguments)) => stiffening::stiffening(arguments),
        Command::Bids(arguments) => bids::bids(arguments),
        Command::Completions(arguments) => manual::completions(arguments),
        Command::Man(arguments) => manual::pages(arguments),
    }
}

/// A study that was read, and its store.
#[derive(Debug)]
pub struct Opened {
    /// The study.
    pub study: Study,
    /// Its file.
    pub file: PathBuf,
    /// What is written in it.
    pub text: String,
    /// Its folder.
    pub base: PathBuf,
    /// Its results.
    pub store: Store,
}

impl Opened {
    /// Fails with the first finding that no run can be sound with, at its line of the study.
    pub fn refuse_wrong(&self, found: &[Finding]) -> Result<(), Failure> {
        let wrong: Vec<_> = found.iter().filter(|f| f.weight == Weight::Wrong).collect();
        let Some(first) = wrong.first() else { return Ok(()) };
        let more = match wrong.len() - 1 {
            0 => String::new(),
            more => format!(" (and {more} more)"),
        };
        let error = StudyError::at_key(&self.text, &first.key, &format!("{}{more}", first.text));
        Err(Failure::Study { path: self.file.clone(), error })
    }
}

/// Writes a file of the user's folder.
///
/// # Errors
/// [`Failure::Io`] with its name.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    fs::write(path, bytes).map_err(|cause| Failure::io(path, cause))
}

/// Where a study with something added goes, beside the first (`STUDY.KIND.toml`): a file that is there already, with
/// something else in it, may have been edited and stays.
pub fn beside(study: &Path, kind: &str, text: &str) -> PathBuf {
    let named = |n: u32| match n {
        1 => study.with_extension(format!("{kind}.toml")),
        _ => study.with_extension(format!("{kind}-{n}.toml")),
    };
    let free =
        |path: &PathBuf| !path.exists() || fs::read_to_string(path).is_ok_and(|held| held == text);
    (1..).map(named).find(free).unwrap_or_else(|| named(1))
}

/// Reads a study file and finds its store; writes nothing.
pub fn open(arguments: &StudyArguments) -> Result<Opened, Failure> {
    let path = &arguments.study;
    let text = fs::read_to_string(path).map_err(|cause| match cause.kind() {
        std::io::ErrorKind::NotFound => {
            Failure::BadInput(format!("{}: no such study file", path.display()))
        }
        std::io::ErrorKind::InvalidData => {
            Failure::BadInput(format!("{}: not UTF-8 text; save it as UTF-8", path.display()))
        }
        _ => Failure::io(path, cause),
    })?;
    let mut study =
        study::parse(&text).map_err(|error| Failure::Study { path: path.clone(), error })?;
    let base = match path.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    measured_hinge(&mut study, &base).map_err(|failure| {
        let error = StudyError::at_key(&text, HINGE_FILE, &failure.to_string());
        Failure::Study { path: path.clone(), error }
    })?;
    let out = arguments.out.clone().unwrap_or_else(|| base.join("out"));
    Ok(Opened { study, file: path.clone(), text, base, store: Store::open(&out) })
}

const HINGE_FILE: &str = "compress.hinge.file";

/// Fits the torques of a measured hinge: what follows knows numbers only.
fn measured_hinge(study: &mut Study, base: &Path) -> Result<(), Failure> {
    let hinge = study.compress.as_mut().and_then(|plan| plan.hinge.as_mut());
    let Some((hinge, file)) = hinge.and_then(|h| h.file.clone().map(|file| (h, file))) else {
        return Ok(());
    };
    let law = torque::read(&base.join(file))?.law().map_err(Failure::BadInput)?;
    hinge.linear_n_mm_per_rad = law.linear_n_mm_per_rad;
    hinge.quadratic_n_mm_per_rad2 = law.quadratic_n_mm_per_rad2;
    Ok(())
}

/// Values within bounds, rising, each once.
fn rising(option: &str, given: &[f64], [least, most]: [f64; 2]) -> Result<Vec<f64>, Failure> {
    if given.is_empty() || given.iter().any(|value| !(least..=most).contains(value)) {
        return Err(Failure::Usage(format!("{option}: give numbers from {least} to {most}")));
    }
    let mut sorted = given.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    Ok(sorted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What follows the reading of a study knows the torques of the table, not those that are assumed.
    #[test]
    fn a_measured_hinge_is_read_with_its_study() {
        let folder = tempfile::tempdir().unwrap();
        let torques = [(2, 10.0f64), (4, 30.0), (6, 60.0)];
        // 10 mm from the axis: 1, 3 and 6 N.
        let rows: String =
            torques.map(|(deg, n_mm)| format!("{deg},{},10\n", n_mm / 10.0)).concat();
        fs::write(folder.path().join("hinge.csv"), format!("{}\n{rows}", torque::HEADER)).unwrap();
        let text = "schema = 1\nsubject = { id = \"x\" }\n[poses.prone]\nimage = \"x.nii\"\nposture = \"prone\"\n\
             [compress]\nside = \"right\"\nchest_wall_distance_mm = 20.0\nstop = { force_n = 20.0 }\n\
             law = { name = \"neo_hookean\" }\npaddle = \"flex\"\nhinge = { file = \"hinge.csv\" }\n";
        let study = folder.path().join("study.toml");
        fs::write(&study, text).unwrap();
        let opened = open(&StudyArguments { study, out: None }).unwrap();
        let hinge = opened.study.compress.unwrap().hinge.unwrap();
        for (deg, n_mm) in torques {
            let tilt = f64::from(deg).to_radians();
            let found = tilt * (hinge.linear_n_mm_per_rad + tilt * hinge.quadratic_n_mm_per_rad2);
            assert!((found / n_mm - 1.0).abs() < 1e-9, "{deg}°: {found} N mm");
        }
        assert_ne!(hinge.linear_n_mm_per_rad, study::HingePlan::default().linear_n_mm_per_rad);
    }
}
