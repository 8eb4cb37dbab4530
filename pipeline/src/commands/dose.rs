//! `mammotwin study dose`: Dance's dose against Monte Carlo under a tilted paddle.

use super::write;
use crate::cli::DoseArguments;
use mammotwin_data::Failure;
use mammotwin_imaging::xray::transport::{
    photon::Histories,
    study::{Case, Outline, Shield, Study, StudyPlan, study},
};
use mammotwin_stages::report::chart::{Axis, Chart, Line, lines};
use std::{fmt::Write, fs};

/// Computes the study and writes `dose.csv`, `dose.svg` and `correction.csv`.
pub fn dose(arguments: &DoseArguments) -> Result<(), Failure> {
    if !(1000..=10_000_000_000).contains(&arguments.photons) {
        return Err(Failure::Usage("--photons: give 1000 to 10000000000".into()));
    }
    let folder = &arguments.out;
    if folder.join("dose.csv").exists() {
        let text = format!("{}: holds a study already; give another folder", folder.display());
        return Err(Failure::BadInput(text));
    }
    fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
    let histories = Histories { photons: arguments.photons, seed: arguments.seed };
    let plan = StudyPlan { histories, ..StudyPlan::default() };
    let told = std::cell::Cell::new(0);
    let progress = |done: f64| {
        let percent = (10.0 * done) as u32 * 10;
        if percent > told.get() {
            told.set(percent);
            eprintln!("{percent} %");
        }
    };
    let found = study(&plan, &progress)
        .map_err(|cause| Failure::BadInput(format!("study dose: {cause}")))?;
    write(&folder.join("dose.csv"), table(&found))?;
    write(&folder.join("correction.csv"), corrections(&found))?;
    write(&folder.join("dose.svg"), lines(&chart(&found)))?;
    print!("{}", corrections(&found));
    println!("{}: dose.csv, dose.svg, correction.csv", folder.display());
    Ok(())
}

fn table(study: &Study) -> String {
    let mut text = String::from(
        "# Average glandular dose over incident air kerma: Monte Carlo in the shape itself, and g c s \
         (Dance) at the nominal thickness, the mean of the largest and the smallest. 34 kV Rh/Ag \
         behind 2.5 mm PMMA.\n\
         outline,shield,thickness_mm,tilt_deg,glandularity,wedge,monte_carlo,monte_carlo_error,\
         dance,monte_carlo_over_dance,tilted_over_flat,tilted_over_flat_error\n",
    );
    for case in &study.cases {
        let Case { thickness_mm, tilt_deg, glandularity, wedge, dance, .. } = case;
        let (mc, tilted) = (case.monte_carlo, case.tilted_over_flat);
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{},{},{thickness_mm},{tilt_deg},{glandularity},{wedge:.4},{:.5},{:.5},{dance:.5},\
             {:.4},{:.4},{:.4}",
            case.outline.name(),
            case.shield.name(),
            mc.mean,
            mc.error,
            mc.mean / dance,
            tilted.mean,
            tilted.error
        );
    }
    text
}

fn corrections(study: &Study) -> String {
    let mut text = String::from(
        "# AGD = K g c s (1 + a w + b w^2), w: largest less smallest thickness over their mean\n\
         outline,a,b,residual_rms,residual_largest\n",
    );
    for (outline, found) in &study.corrections {
        let [rms, largest] = found.residual;
        let _ = writeln!(
            text,
            "{},{:.4},{:.4},{rms:.4},{largest:.4}",
            outline.name(),
            found.linear,
            found.quadratic
        );
    }
    text
}

/// What a tilt does to the dose, one line for each outline and thickness.
fn chart(study: &Study) -> Chart {
    let mut curves: Vec<Line> = Vec::new();
    let gland = study.cases.first().map_or(0.0, |case| case.glandularity);
    let shown = |case: &&Case| case.shield == Shield::Skin && case.glandularity == gland;
    for case in study.cases.iter().filter(shown) {
        let rounded = if case.outline == Outline::Rounded { "rounded" } else { "cylinder" };
        let name = format!("{rounded}, {} mm", case.thickness_mm);
        let point = (case.wedge, 100.0 * (case.tilted_over_flat.mean - 1.0));
        match curves.iter_mut().find(|line| line.name == name) {
            Some(line) => line.points.push(point),
            None => curves.push(Line { name, points: vec![point] }),
        }
    }
    Chart {
        title: "Dose under a tilted paddle against a flat one of the same nominal thickness".into(),
        caption: "Monte Carlo, Rh/Ag 34 kV, skin of 1.45 mm".into(),
        x_label: "largest less smallest thickness, over their mean".into(),
        y_label: "change of AGD / K (%)".into(),
        lines: curves,
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}
