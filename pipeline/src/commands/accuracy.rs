//! `mammotwin study calibration`: digital volunteers through images, fit and held-out poses.

use super::{open, run::execute, synth::voxels, volunteer::made, write};
use crate::{
    accuracy::{Fitted, Hypothesis, chart, markdown, measure, table},
    cli::{CalibrationArguments, StudyArguments},
    display::Task,
};
use mammotwin_data::{Failure, progress::Progress, store::Options, study::Elements};
use mammotwin_stages::{
    effects::Effect,
    volunteer::{PoseName, Settings},
};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// The effect by which tissue stiffens.
const STIFFENING: &str = "limit_chain";

/// Makes and fits what is not there; writes `calibration.csv`, `calibration.md` and `held_out.svg` after each volunteer.
pub fn calibration(arguments: &CalibrationArguments) -> Result<(), Failure> {
    voxels(&arguments.voxel_mm)?;
    let range = Effect::named(STIFFENING).map_or([0.0; 2], |effect| effect.amplitude.range);
    if !(arguments.stiffening > range[0] && arguments.stiffening <= range[1]) {
        return Err(Failure::Usage(format!("--stiffening: give more than 0, up to {}", range[1])));
    }
    if arguments.seeds.is_empty() {
        return Err(Failure::Usage("--seeds: give at least one".into()));
    }
    let out = &arguments.out;
    fs::create_dir_all(out).map_err(|cause| Failure::io(out, cause))?;
    let task = Task::new("calibration");
    let mut all: Vec<Fitted> = Vec::new();
    let mut failed = Vec::new();
    let steps = (arguments.seeds.len() * Hypothesis::ALL.len()) as f64;
    for &seed in &arguments.seeds {
        for hypothesis in Hypothesis::ALL {
            let name = hypothesis.name();
            task.report((all.len() + failed.len()) as f64 / steps, &format!("seed {seed}: {name}"));
            match fitted(arguments, seed, hypothesis) {
                Ok(fit) => all.push(fit),
                Err(Failure::Numerics(why)) => {
                    failed.push(format!("- seed {seed}, {name}: {why}\n"));
                }
                Err(other) => return Err(other),
            }
        }
        write(&out.join("calibration.csv"), table(&all))?;
        let mut text = markdown(&all);
        if !failed.is_empty() {
            text += &format!("\nWithout a fit:\n\n{}", failed.concat());
        }
        write(&out.join("calibration.md"), text)?;
        write(&out.join("held_out.svg"), chart(&all, PoseName::Tilted.name()))?;
    }
    drop(task);
    tell!("{}", markdown(&all));
    failed.iter().for_each(|line| tell!("{}", line.trim_end()));
    tell!("{}: calibration.csv, calibration.md, held_out.svg", out.display());
    Ok(())
}

fn fitted(
    arguments: &CalibrationArguments,
    seed: u64,
    hypothesis: Hypothesis,
) -> Result<Fitted, Failure> {
    let preset = &arguments.preset;
    let (tissue, hidden) = match hypothesis.tissue_stiffens() {
        false => ("neo_hookean", BTreeMap::new()),
        true => ("gent", BTreeMap::from([(STIFFENING.into(), arguments.stiffening)])),
    };
    let folder = arguments.out.join(format!("{preset}-{seed}-{tissue}"));
    let study = made(&Settings {
        preset: preset.clone(),
        seed,
        voxel_mm: voxels(&arguments.voxel_mm)?,
        poses: PoseName::ALL.to_vec(),
        hidden,
        still: false,
        elements: Some(Elements::Quadratic),
        truth_mm: None,
        out_dir: folder.clone(),
    })?;
    let study = match hypothesis {
        Hypothesis::Stiffening => stiffened(&study, arguments.stiffening)?,
        _ => study,
    };
    let opened = open(&StudyArguments { study, out: Some(folder.join("out")) })?;
    let options = Options { until: vec!["validate".into()], ..Options::default() };
    let pass = execute(&opened, &options)?;
    measure(&pass.outcome, &folder.join("truth"), seed, hypothesis)
}

/// The study of a volunteer with a model that stiffens.
fn stiffened(study: &Path, amplitude: f64) -> Result<PathBuf, Failure> {
    let text = fs::read_to_string(study).map_err(|cause| Failure::io(study, cause))?;
    let with = study.with_file_name("study_gent.toml");
    write(&with, format!("{text}\n[model.effects]\n{STIFFENING} = {amplitude}\n"))?;
    Ok(with)
}
