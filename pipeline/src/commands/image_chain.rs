//! `mammotwin study image-chain`: an effect hidden in a measured unit is found, named and added.

use super::write;
use crate::cli::ImageChainArguments;
use mammotwin_data::{Failure, io::picture::write_float_tiff, radiograph::Radiograph};
use mammotwin_stages::image_chain::{
    field::{CELL_MM, CELLS},
    library::{IMAGE_EFFECTS, ImageEffect},
    search::{ChainVerdict, Search},
    trial::{Hidden, Residuals, Truth, residuals, search},
};
use std::{fmt::Write, fs, path::Path};

/// Photons of each scatter image.
const PHOTONS: u64 = 3_000_000;

/// Hides, measures, searches; writes `verdict.json`, `residuals.csv` and pictures of the residuals.
pub fn image_chain(arguments: &ImageChainArguments) -> Result<(), Failure> {
    let hidden = Hidden::named(&arguments.hide).ok_or_else(|| {
        let known: Vec<&str> = IMAGE_EFFECTS.iter().map(|effect| effect.name).collect();
        let known = known.join(", ");
        Failure::Usage(format!("--hide {}: give {known}, gain_gradient or none", arguments.hide))
    })?;
    let folder = &arguments.out;
    fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
    let refuse = |cause: &dyn std::fmt::Display| Failure::Numerics(format!("image chain: {cause}"));
    let model = search(PHOTONS).map_err(|c| refuse(&c))?;
    let truth = Truth::new(&model, PHOTONS).map_err(|c| refuse(&c))?;
    let [seen, held_out] = truth.measure(hidden, arguments.seed).map_err(|c| refuse(&c))?;
    let verdict = model.judge(&seen, &held_out).map_err(|c| refuse(&c))?;
    let text = serde_json::to_string_pretty(&verdict).map_err(|c| refuse(&c))?;
    write(&folder.join("verdict.json"), format!("{text}\n"))?;
    let both = added(&model, &verdict, &seen, &held_out).map_err(|c| refuse(&c))?;
    let mut table = String::from(
        "# Held-out breast: measured less simulated signal (relative), exposure fitted\n\
         x_mm,y_mm,without,with\n",
    );
    for [x, y, before, after] in &both {
        // Writing to a string does not fail.
        let _ = writeln!(table, "{x},{y},{before:.6},{after:.6}");
    }
    write(&folder.join("residuals.csv"), table)?;
    for (name, column) in [("residual_without.tiff", 2), ("residual_with.tiff", 3)] {
        picture(&folder.join(name), &both, column)?;
    }
    if arguments.json {
        tell!("{text}");
    } else {
        tell(&verdict);
        tell!("{}: verdict.json, residuals.csv, residual_*.tiff", folder.display());
    }
    Ok(())
}

/// Residuals of the held-out breast without an effect, and with the one that explains most.
fn added(
    model: &Search,
    verdict: &ChainVerdict,
    seen: &[Vec<f64>],
    held_out: &[Vec<f64>],
) -> Result<Residuals, mammotwin_stages::image_chain::field::ChainError> {
    let (plain, ..) = model.seen.fit(seen, &model.seen.start(), &model.seen.nuisances())?;
    let mut with = plain.clone();
    if let Some(best) = verdict.candidates.first() {
        with = model.with(best, seen)?;
    }
    residuals(&model.held_out, held_out, [&plain, &with])
}

/// Cells that were compared, as a picture.
fn picture(path: &Path, residuals: &Residuals, column: usize) -> Result<(), Failure> {
    let [columns, rows] = CELLS;
    let left_mm = -0.5 * CELL_MM * (columns as f64 - 1.0);
    let mut pixels = vec![0f32; rows * columns];
    for one in residuals {
        let at = |value: f64, first: f64| ((value - first) / CELL_MM).round() as usize;
        pixels[at(one[1], 0.5 * CELL_MM) * columns + at(one[0], left_mm)] = one[column] as f32;
    }
    let picture = Radiograph {
        columns,
        rows,
        pitch_mm: CELL_MM,
        left_mm,
        first_row_mm: 0.5 * CELL_MM,
        pixels,
        quantity: "measured less simulated signal (relative)".into(),
    };
    write_float_tiff(path, &picture).map_err(|cause| Failure::io(path, cause))
}

fn tell(verdict: &ChainVerdict) {
    let kind = serde_json::to_value(verdict.verdict).ok();
    let kind = kind.as_ref().and_then(|kind| kind.as_str()).unwrap_or_default().replace('_', " ");
    let name = verdict.effect.map(|name| format!(": {name}")).unwrap_or_default();
    tell!("{kind}{name}\n{}\n", verdict.reason);
    tell!("score of each effect (by chance up to {:.1})", verdict.limit);
    for score in &verdict.scores {
        let note = if score.testable { "" } else { "   not testable with these data" };
        tell!(
            "  {:14} {:7.2}   amplitude {:8.4}, {:3.0} % of the signature survives{note}",
            score.effect,
            score.z,
            score.amplitude,
            100.0 * score.surviving
        );
    }
    for fitted in &verdict.candidates {
        let unit = ImageEffect::named(fitted.effect).map_or("", |effect| effect.unit);
        let ([amplitude, error], [before, after]) = (fitted.amplitude, fitted.held_out);
        tell!(
            "fitted {:14} {amplitude:.4} ± {error:.4} {unit}: held-out misfit {before:.2} -> {after:.2} (errors \
             leave 1), {:.1} standard errors",
            fitted.effect,
            fitted.held_out_z
        );
    }
}
