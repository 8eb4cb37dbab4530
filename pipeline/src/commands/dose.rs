//! `mammotwin study dose`: Dance's dose against Monte Carlo under a tilted paddle.

use super::write;
use crate::cli::DoseArguments;
use mammotwin_data::Failure;
use mammotwin_imaging::xray::transport::{
    photon::Histories,
    study::{Case, Study, StudyPlan, study},
};
use mammotwin_stages::report::chart::{Axis, Chart, Line, lines};
use std::{fmt::Write, fs};

/// Computes the study and writes `dose.csv`, `flat.svg`, `tilt.svg` and `correction.csv`.
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
    write(&folder.join("flat.svg"), lines(&flat(&found)))?;
    write(&folder.join("tilt.svg"), lines(&tilt(&found)))?;
    print!("{}", corrections(&found));
    tell!("{}: dose.csv, flat.svg, tilt.svg, correction.csv", folder.display());
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
        "# AGD = K g c s (1 + a + b (t / 50 mm - 1) + c (gland - 0.2)) (1 + d w + e w^2)\n\
         # t: nominal thickness, w: largest less smallest thickness over their mean, gland: mass fraction\n\
         outline,shield,a,b,c,residual_rms,residual_largest\n",
    );
    for (outline, shield, found) in &study.flat {
        let ([a, b, c], [rms, largest]) = (found.terms, found.residual);
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{},{},{a:.4},{b:.4},{c:.4},{rms:.4},{largest:.4}",
            outline.name(),
            shield.name()
        );
    }
    text.push_str("outline,d,e,residual_rms,residual_largest\n");
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

/// Points of one curve for each name, means of what has the same name and place.
fn curves(points: impl Iterator<Item = (String, f64, f64)>) -> Vec<Line> {
    // Of each curve: place, sum and number of its values.
    let mut found: Vec<(String, Vec<[f64; 3]>)> = Vec::new();
    for (name, x, y) in points {
        let curve = match found.iter().position(|(known, _)| *known == name) {
            Some(n) => &mut found[n].1,
            None => {
                found.push((name, Vec::new()));
                let last = found.len() - 1;
                &mut found[last].1
            }
        };
        match curve.iter_mut().find(|[at, ..]| (*at - x).abs() < 1e-9) {
            Some([_, sum, count]) => (*sum, *count) = (*sum + y, *count + 1.0),
            None => curve.push([x, y, 1.0]),
        }
    }
    let mean = |[x, sum, count]: [f64; 3]| (x, sum / count);
    found
        .into_iter()
        .map(|(name, points)| Line { name, points: points.into_iter().map(mean).collect() })
        .collect()
}

/// Monte Carlo over Dance under a flat paddle, by outline and shield, mean over glandularities.
fn flat(study: &Study) -> Chart {
    let flat = study.cases.iter().filter(|case| case.tilt_deg == 0.0);
    Chart {
        title: "Dose of a breast's own outline and skin against Dance's".into(),
        caption: "Monte Carlo, Rh/Ag 34 kV, flat paddle, mean of all glandularities".into(),
        x_label: "thickness (mm)".into(),
        y_label: "Monte Carlo over K g c s".into(),
        lines: curves(flat.map(|case| {
            let name = format!("{}, {}", case.outline.name(), case.shield.name());
            (name, case.thickness_mm, case.monte_carlo.mean / case.dance)
        })),
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}

/// What a tilt does to the dose of the thinnest and of the third thickness, mean over shields and
/// glandularities.
fn tilt(study: &Study) -> Chart {
    let mut thickness: Vec<f64> = study.cases.iter().map(|case| case.thickness_mm).collect();
    thickness.sort_by(f64::total_cmp);
    thickness.dedup();
    let shown = [thickness.first(), thickness.get(2)];
    let tilted = study.cases.iter().filter(|case| shown.contains(&Some(&case.thickness_mm)));
    Chart {
        title: "Dose under a tilted paddle against a flat one of the same nominal thickness".into(),
        caption: "Monte Carlo, Rh/Ag 34 kV, mean of shields and glandularities".into(),
        x_label: "largest less smallest thickness, over their mean".into(),
        y_label: "change of AGD / K (%)".into(),
        lines: curves(tilted.map(|case| {
            let name = format!("{}, {} mm", case.outline.name(), case.thickness_mm);
            (name, case.wedge, 100.0 * (case.tilted_over_flat.mean - 1.0))
        })),
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}
