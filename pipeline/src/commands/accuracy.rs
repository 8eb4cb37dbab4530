//! `mammotwin study calibration`: digital volunteers through images, fit and held-out poses.

use super::{open, run::execute, synth::voxels, volunteer::made, write};
use crate::{
    accuracy::{Fitted, Hypothesis, Layers, chart, markdown, measure, table},
    cli::{CalibrationArguments, StudyArguments},
    display::Task,
};
use mammotwin_data::{
    Failure,
    progress::Progress,
    store::Options,
    study::{Elements, LayerPlan, ModelPlan},
};
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

/// Ending of the names of what is written where the fit does not know skin and fascia.
fn ending(layers: Layers) -> &'static str {
    match layers {
        Layers::Known => "",
        Layers::Literature => "_literature",
    }
}

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
        let file =
            |name: &str, kind: &str| out.join(format!("{name}{}.{kind}", ending(arguments.layers)));
        write(&file("calibration", "csv"), table(&all))?;
        let mut text = markdown(&all);
        if !failed.is_empty() {
            text += &format!("\nWithout a fit:\n\n{}", failed.concat());
        }
        write(&file("calibration", "md"), text)?;
        write(&file("held_out", "svg"), chart(&all, PoseName::Tilted.name()))?;
    }
    drop(task);
    tell!("{}", markdown(&all));
    failed.iter().for_each(|line| tell!("{}", line.trim_end()));
    let end = ending(arguments.layers);
    tell!("{}: calibration{end}.csv, calibration{end}.md, held_out{end}.svg", out.display());
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
    let stiffening = (hypothesis == Hypothesis::Stiffening).then_some(arguments.stiffening);
    let study = fitting(&study, stiffening, arguments.layers)?;
    let opened = open(&StudyArguments { study, out: Some(folder.join("out")) })?;
    let until = vec!["validate".into(), "fiducials".into()];
    let options = Options { until, ..Options::default() };
    let pass = execute(&opened, &options)?;
    measure(&pass.outcome, &folder.join("truth"), seed, hypothesis)
}

/// The study of a volunteer with the model that is fitted, beside the one that states the truth's.
fn fitting(study: &Path, stiffening: Option<f64>, layers: Layers) -> Result<PathBuf, Failure> {
    if stiffening.is_none() && layers == Layers::Known {
        return Ok(study.to_owned());
    }
    let mut text = fs::read_to_string(study).map_err(|cause| Failure::io(study, cause))?;
    if layers == Layers::Literature {
        text = from_literature(&text);
    }
    let mut name = String::from("study");
    if let Some(amplitude) = stiffening {
        text += &format!("\n[model.effects]\n{STIFFENING} = {amplitude}\n");
        name += "_gent";
    }
    let with = study.with_file_name(format!("{name}{}.toml", ending(layers)));
    write(&with, text)?;
    Ok(with)
}

/// A volunteer's study with skin and fascia of the literature.
fn from_literature(study: &str) -> String {
    let ModelPlan { skin, fascia, .. } = ModelPlan::default();
    let line = |name: &str, LayerPlan { law, young_kpa, thickness_mm, .. }: &LayerPlan| {
        let law = law.name();
        format!(
            "{name} = {{ law = \"{law}\", young_kpa = {young_kpa:?}, thickness_mm = {thickness_mm:?} }}"
        )
    };
    let layers = [("skin", line("skin", &skin)), ("fascia", line("fascia", &fascia))];
    let replaced = |old: &str| {
        let own = layers.iter().find(|(name, _)| old.starts_with(&format!("{name} = ")));
        own.map_or(old, |(_, new)| new).to_owned() + "\n"
    };
    study.lines().map(replaced).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::study::parse;

    #[test]
    fn skin_and_fascia_come_from_the_literature_and_nothing_else_changes() {
        let text = "schema = 1\nsubject = { id = \"dv\" }\n[poses.supine]\nimage = \"a.nii.gz\"\nposture = \"supine\"\n\
                    [model]\nbreast = { poisson = 0.48 }\nskin = { young_kpa = 3.7, thickness_mm = 1.5 }\n\
                    fascia = { young_kpa = 129.1, thickness_mm = 0.2 }\n";
        let (own, other) = (parse(text).unwrap(), parse(&from_literature(text)).unwrap());
        let known = ModelPlan::default();
        assert_ne!(own.model.skin, known.skin);
        assert_eq!((&other.model.skin, &other.model.fascia), (&known.skin, &known.fascia));
        let mut back = other.clone();
        (back.model.skin, back.model.fascia) = (own.model.skin.clone(), own.model.fascia.clone());
        assert_eq!(back, own);
    }
}
