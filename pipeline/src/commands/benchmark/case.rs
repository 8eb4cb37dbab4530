//! A volunteer of the benchmark, and what `discover` is told of her.

use super::HELD_OUT;
use crate::{
    cli::StudyArguments,
    commands::{Opened, open, volunteer::made, write},
    display::Display,
    graph,
};
use mammotwin_data::{
    Failure,
    store::{self, Artifact, Drive, Options, Stored},
    study::Elements,
};
use mammotwin_stages::{
    discover::{Discovery, Evidence},
    effects::Effect,
    volunteer::{PoseName, Settings},
};
use std::{fs, path::PathBuf};

/// How a volunteer is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Her true labels; chest wall and arms stay as they are. Errors are drawn afterwards.
    Exact,
    /// Images, segmentation, a chest wall that changes.
    Imaged,
}

/// A volunteer.
pub struct Case {
    /// Folder of the benchmark.
    pub out: PathBuf,
    /// Kind of volunteer.
    pub preset: String,
    /// Which person of that kind.
    pub seed: u64,
    /// What is hidden, and how much.
    pub hidden: Option<(&'static Effect, f64)>,
    /// Its severity (standard deviations).
    pub sigma: f64,
    /// How she is measured.
    pub kind: Kind,
    /// The effects that are asked for.
    pub asked: Vec<&'static Effect>,
    /// Edges of her voxels (mm); `None` for the preset's.
    pub voxel_mm: Option<[f64; 3]>,
    /// Edges of the elements of the truth (mm); `None` for the preset's.
    pub truth_mm: Option<f64>,
}

impl Case {
    fn folder(&self) -> PathBuf {
        let kind = if self.kind == Kind::Exact { "exact" } else { "imaged" };
        let name = match self.hidden {
            None => "nothing".into(),
            // With the amplitude: other evidence asks for another volunteer.
            Some((effect, amplitude)) => format!("{}_{}_{amplitude:.6}", effect.name, self.sigma),
        };
        let voxel = self.voxel_mm.map_or(String::new(), |[x, y, z]| format!("-{x}x{y}x{z}mm"));
        let truth = self.truth_mm.map_or(String::new(), |mm| format!("-truth-{mm}mm"));
        let person = format!("{}-{}{voxel}{truth}", self.preset, self.seed);
        self.out.join(kind).join(person).join(name)
    }

    /// Whether a stage has been computed already.
    pub fn has(&self, stage: &str) -> bool {
        self.folder().join("out/cache").join(stage).is_dir()
    }

    /// Makes the volunteer, unless she is there.
    fn study(&self) -> Result<Opened, Failure> {
        let folder = self.folder();
        let settings = Settings {
            preset: self.preset.clone(),
            seed: self.seed,
            voxel_mm: self.voxel_mm,
            poses: PoseName::ALL.to_vec(),
            hidden: self.hidden.iter().map(|(e, a)| (e.name.to_string(), *a)).collect(),
            still: self.kind == Kind::Exact,
            elements: Some(Elements::Quadratic),
            truth_mm: self.truth_mm,
            out_dir: folder.clone(),
        };
        let mut study = made(&settings)?;
        if self.kind == Kind::Exact {
            let text = fs::read_to_string(&study).map_err(|c| Failure::io(&study, c))?;
            study = folder.join("labels.toml");
            write(&study, with_labels(&text))?;
        }
        open(&StudyArguments { study, out: None })
    }

    fn run<T: Artifact>(
        &self,
        stage: &str,
        pick: impl Fn(graph::Found) -> Stored<T>,
    ) -> Result<T, Failure> {
        let Opened { study, base, store, .. } = &self.study()?;
        let options = Options { until: vec![stage.into()], ..Options::default() };
        let display = Display::new();
        let drive = Drive { store, base, options: &options, listener: &display };
        let pass = store::execute(&drive, |run| {
            graph::discover(study, HELD_OUT.name(), &self.asked, run)
        })?;
        pick(pass.outcome).load()
    }

    /// Residuals of the calibrated model.
    pub fn evidence(&self) -> Result<Evidence, Failure> {
        self.run("evidence", |found| found.evidence)
    }

    /// The verdict after nonlinear fits.
    pub fn discovery(&self) -> Result<Discovery, Failure> {
        self.run("discover", |found| found.discovery)
    }
}

/// A study whose poses have their true labels.
fn with_labels(study: &str) -> String {
    let mut text = String::new();
    for line in study.lines() {
        if let Some(rest) = line.strip_prefix("image = \"")
            && let Some(pose) = rest.strip_suffix(".nii.gz\"")
        {
            text += &format!("labels = \"truth/{pose}_labels.nii.gz\"\n");
        }
        text += line;
        text.push('\n');
    }
    text
}
