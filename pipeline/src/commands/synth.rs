//! `mammotwin synth` and `mammotwin demo`: a digital volunteer, and the whole pipeline on her.

use super::{open, run, write};
use crate::{
    cli::{DemoArguments, StudyArguments, SynthArguments},
    display::{Task, say},
};
use mammotwin_data::{Failure, store::Options, study::Elements};
use mammotwin_stages::{
    effects::{EFFECTS, Effect},
    volunteer::{self, PoseName, Settings},
};
use std::{collections::BTreeMap, fs, path::Path};

/// Makes a digital volunteer.
pub fn synth(arguments: &SynthArguments) -> Result<(), Failure> {
    let settings = settings(arguments)?;
    let written = volunteer::synthesize(&settings, &Task::new("synth"))?;
    say(&format!("study: {}", written.study.display()));
    say(&format!("truth: {}", written.truth.display()));
    Ok(())
}

/// Makes the volunteer of the demonstration, unless she is there, and runs the whole pipeline.
pub fn demo(arguments: &DemoArguments) -> Result<(), Failure> {
    let settings = Settings::demo(&arguments.preset, &arguments.out);
    let study = arguments.out.join("study.toml");
    // Written last: with this note all files of the volunteer are there.
    let note = arguments.out.join("volunteer.txt");
    let Settings { preset, seed, voxel_mm, poses, .. } = &settings;
    let version = env!("CARGO_PKG_VERSION");
    let text = format!("mammotwin {version}: {preset} {seed} {voxel_mm:?} {poses:?}\n");
    if !study.exists() || fs::read_to_string(&note).ok().as_ref() != Some(&text) {
        volunteer::synthesize(&settings, &Task::new("synth"))?;
        write(&note, text)?;
    }
    let opened = open(&StudyArguments { study, out: None })?;
    let pass = run::execute(&opened, &Options::default())?;
    run::summarize(&opened, &pass.entries)
}

fn settings(arguments: &SynthArguments) -> Result<Settings, Failure> {
    let voxel_mm = voxels(&arguments.voxel_mm)?;
    let mut poses = named_poses(&arguments.poses)?;
    if poses.is_empty() {
        poses = PoseName::ALL.to_vec();
    }
    refuse_someone(&arguments.out)?;
    let (preset, seed) = (arguments.preset.clone(), arguments.seed);
    let hidden = hidden(&arguments.hide)?;
    let elements = arguments.elements.as_deref().map(elements).transpose()?;
    let (truth_mm, out_dir) = (truth_edge(arguments.truth_mm)?, arguments.out.clone());
    let still = arguments.still;
    Ok(Settings { preset, seed, voxel_mm, poses, hidden, still, elements, truth_mm, out_dir })
}

/// Poses by their names.
pub fn named_poses(names: &[String]) -> Result<Vec<PoseName>, Failure> {
    let of = |name: &String| {
        PoseName::ALL.into_iter().find(|pose| pose.name() == name).ok_or_else(|| {
            let known = PoseName::ALL.map(PoseName::name).join(", ");
            Failure::Usage(format!("--poses: no pose {name:?}; there are: {known}"))
        })
    };
    names.iter().map(of).collect()
}

/// Edges of voxels (mm) from one number or three; none means the preset's.
pub fn voxels(given: &[f64]) -> Result<Option<[f64; 3]>, Failure> {
    let voxel_mm = match *given {
        [] => None,
        [mm] => Some([mm; 3]),
        [x, y, z] => Some([x, y, z]),
        _ => {
            return Err(Failure::Usage(
                "--voxel-mm: give one number, or three: 0.5,0.5,0.6".into(),
            ));
        }
    };
    if voxel_mm.iter().flatten().any(|mm| !(0.2..=10.0).contains(mm)) {
        return Err(Failure::Usage("--voxel-mm: give 0.2 to 10 mm".into()));
    }
    Ok(voxel_mm)
}

/// Edges of the truth's elements (mm), if given.
pub fn truth_edge(given: Option<f64>) -> Result<Option<f64>, Failure> {
    match given {
        Some(mm) if !(5.0..=30.0).contains(&mm) => {
            Err(Failure::Usage("--truth-mm: give 5 to 30 mm".into()))
        }
        _ => Ok(given),
    }
}

fn elements(word: &str) -> Result<Elements, Failure> {
    let known = [Elements::Linear, Elements::Quadratic];
    known.into_iter().find(|elements| elements.name() == word).ok_or_else(|| {
        Failure::Usage(format!("--elements: no kind {word:?}; there are: linear, quadratic"))
    })
}

/// `EFFECT` or `EFFECT=AMPLITUDE`; without a number it is half of the greatest plausible one.
fn hidden(wishes: &[String]) -> Result<BTreeMap<String, f64>, Failure> {
    let mut hidden = BTreeMap::new();
    for wish in wishes {
        let refuse = |why: String| Failure::Usage(format!("--hide {wish}: {why}"));
        let (name, number) = match wish.split_once('=') {
            Some((name, number)) => (name, Some(number)),
            None => (wish.as_str(), None),
        };
        let effect = Effect::named(name).ok_or_else(|| {
            let known = EFFECTS.map(|effect| effect.name).join(", ");
            refuse(format!("no such effect; there are: {known}"))
        })?;
        let [least, greatest] = effect.amplitude.range;
        let amplitude = match number {
            None => 0.5 * greatest,
            Some(text) => text
                .parse()
                .ok()
                .filter(|a| (least..=greatest).contains(a))
                .ok_or_else(|| refuse(format!("give a number from {least} to {greatest}")))?,
        };
        hidden.insert(name.to_owned(), amplitude);
    }
    Ok(hidden)
}

/// A study that is there may have been edited: it is not overwritten.
fn refuse_someone(out: &Path) -> Result<(), Failure> {
    if out.join("study.toml").exists() {
        let text = format!("{}: has a study already; give another folder", out.display());
        return Err(Failure::Usage(format!("--out: {text}")));
    }
    Ok(())
}
