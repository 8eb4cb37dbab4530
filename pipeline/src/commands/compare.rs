//! `mammotwin study paddles` and `mammotwin study positions`: one breast, compressed in several ways.

use super::{Opened, open, write};
use crate::{
    cli::{PaddlesArguments, PositionsArguments, StudyArguments},
    comparison::{
        Found, ThesisStudy, Way, comparisons, curves, page, stated, summary, time_courses,
        trends_csv,
    },
    display::Display,
    graph,
    plausible::findings,
};
use mammotwin_data::{
    Failure,
    store::{self, Drive, Options},
    study::{CompressPlan, PaddleName},
};
use std::fs;

/// Compresses under several paddles.
pub fn paddles(arguments: &PaddlesArguments) -> Result<(), Failure> {
    let (opened, plan) = read(&arguments.study, arguments.no_picture)?;
    let names = named(&arguments.paddles)?;
    let way = |name: PaddleName| Ok((name.name().into(), under(&plan, name)?));
    let ways: Vec<_> = names.into_iter().map(way).collect::<Result<_, Failure>>()?;
    go(&opened, ThesisStudy::Paddles, "paddles", &ways)
}

/// Compresses at several distances from the chest wall.
pub fn positions(arguments: &PositionsArguments) -> Result<(), Failure> {
    let (opened, plan) = read(&arguments.study, arguments.no_picture)?;
    let names = named(&arguments.paddles)?;
    let mut ways = Vec::new();
    for name in names {
        for &distance in &arguments.distances {
            if !(0.0..=200.0).contains(&distance) {
                let text = format!("--distances: {distance} mm; give 0 to 200");
                return Err(Failure::Usage(text));
            }
            let label = format!("{}_{distance}mm", name.name()).replace('.', "-");
            let here = CompressPlan { chest_wall_distance_mm: distance, ..under(&plan, name)? };
            if ways.iter().all(|(known, _)| *known != label) {
                ways.push((label, here));
            }
        }
    }
    go(&opened, ThesisStudy::Positions, "positions", &ways)
}

/// The study and its compression.
fn read(arguments: &StudyArguments, no_picture: bool) -> Result<(Opened, CompressPlan), Failure> {
    let mut opened = open(arguments)?;
    if no_picture {
        opened.study.mammogram = None;
    }
    let Some(plan) = opened.study.compress.clone() else {
        let text = format!("{}: has no table [compress]", arguments.study.display());
        return Err(Failure::BadInput(text));
    };
    Ok((opened, plan))
}

pub(super) fn named(words: &[String]) -> Result<Vec<PaddleName>, Failure> {
    let mut names = Vec::new();
    for word in words {
        let known = PaddleName::ALL.into_iter().find(|name| name.name() == word);
        let Some(name) = known else {
            let all = PaddleName::ALL.map(PaddleName::name).join(", ");
            return Err(Failure::Usage(format!("--paddles {word}: not known; there are: {all}")));
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    Ok(names)
}

/// The same compression under another paddle, as the study describes it or with assumed numbers.
///
/// # Errors
/// A paddle from CAD, of which the study names no file.
pub(super) fn under(plan: &CompressPlan, paddle: PaddleName) -> Result<CompressPlan, Failure> {
    if plan.paddle == paddle {
        return Ok(plan.clone());
    }
    if paddle == PaddleName::Cad {
        let text = "--paddles cad: the study names no file; write paddle = \"cad\" and \
                    cad = { file = \"paddle.stl\" } in its [compress]";
        return Err(Failure::Usage(text.into()));
    }
    Ok(plan.under(paddle))
}

/// A metric, and its standard deviation where it has one.
fn told(found: &Found, name: &str) -> String {
    let (value, sd) = (found.metric(name), found.sd(name));
    if sd.is_finite() { format!("{value:.3} ± {sd:.3}") } else { format!("{value:.3}") }
}

/// Computes what is not there and writes tables, figures and page.
fn go(
    opened: &Opened,
    study: ThesisStudy,
    name: &str,
    plans: &[(String, CompressPlan)],
) -> Result<(), Failure> {
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let display = Display::new();
    let Opened { study: read, base, store, .. } = opened;
    let options = Options::default();
    let drive = Drive { store, base, options: &options, listener: &display };
    let pass = store::execute(&drive, |run| graph::squeezes(read, plans, run))?;
    drop(display);
    let mut ways = Vec::new();
    for ((label, plan), made) in plans.iter().zip(pass.outcome) {
        let found = match made {
            Ok(made) => Ok(Found::load(&made, read.mammogram.as_ref())?),
            Err(why) => Err(why),
        };
        ways.push(Way { label: label.clone(), plan: plan.clone(), found });
    }
    let folder = store.out.join("studies").join(name);
    fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
    // All ways share law and mesh.
    let stated = plans.first().map_or(String::new(), |(_, plan)| stated(&read.mesh, &plan.law));
    let juxtathoracic_mm = read.comfort.juxtathoracic_mm;
    let (html, figures) = page(&read.subject.id, study, &ways, &stated, juxtathoracic_mm);
    for figure in &figures {
        write(&folder.join(&figure.name), &figure.bytes)?;
    }
    write(&folder.join(format!("{name}.csv")), summary(&ways, read.mesh.size_mm))?;
    write(&folder.join("curves.csv"), curves(&ways))?;
    if ways.iter().flat_map(|way| &way.found).any(|found| found.course.is_some()) {
        write(&folder.join("time_courses.csv"), time_courses(&ways))?;
    }
    write(&folder.join("trends.csv"), trends_csv(&ways, juxtathoracic_mm))?;
    write(&folder.join("comparisons.csv"), comparisons(&ways))?;
    write(&folder.join(format!("{name}.html")), html)?;
    let computed = pass.entries.iter().filter(|entry| entry.computed).count();
    tell!("{computed} of {} stages computed", pass.entries.len());
    for way in &ways {
        match &way.found {
            Ok(found) => tell!(
                "{:<16} {:>6.1} mm {:>8} N  mean {:>7} kPa  largest {:>7} kPa on faces  {}",
                way.label,
                found.compression.thickness_mm,
                told(found, "force_n"),
                told(found, "mean_pressure_kpa"),
                told(found, "face_peak_pressure_kpa"),
                found.compression.stopped_early.as_deref().unwrap_or_default()
            ),
            Err(why) => tell!("{:<16} failed: {why}", way.label),
        }
    }
    tell!("{stated}");
    tell!("{}", folder.join(format!("{name}.html")).display());
    if ways.iter().all(|way| way.found.is_err()) {
        return Err(Failure::Numerics(format!("study {name}: no compression was found")));
    }
    Ok(())
}
