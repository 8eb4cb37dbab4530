//! Digital volunteers that studies make once.

use super::write;
use crate::display::Task;
use mammotwin_data::Failure;
use mammotwin_stages::volunteer::{Settings, synthesize};
use std::{fs, path::PathBuf};

/// The study file of a volunteer, who is made unless she is there with these settings.
pub fn made(settings: &Settings) -> Result<PathBuf, Failure> {
    let folder = &settings.out_dir;
    let note = folder.join("made.txt");
    let Settings { preset, seed, voxel_mm, poses, hidden, still, elements, truth_mm, out_dir: _ } =
        settings;
    let version = env!("CARGO_PKG_VERSION");
    let text = format!(
        "mammotwin {version}: {preset} {seed} {voxel_mm:?} {poses:?} {hidden:?} {still} {elements:?} \
         {truth_mm:?}\n"
    );
    if fs::read_to_string(&note).ok().as_ref() != Some(&text) {
        synthesize(settings, &Task::new("synth"))?;
        // Written last.
        write(&note, text)?;
    }
    Ok(folder.join("study.toml"))
}
