//! `mammotwin study stiffening`: Jₘ and the place of the paddle from a record of force and thickness.

use super::{Opened, open, rising, write};
use crate::{
    cli::StiffeningArguments,
    display::Display,
    graph,
    plausible::findings,
    stiffening::{
        Both, Course, Grid, Hanging, Measured, Posterior, RecordError, course_table, gravity_table,
        page, posterior_table, read_record, said, way,
    },
};
use mammotwin_data::{
    Failure,
    labels::Side,
    store::{self, Drive, Options},
    study::{CompressPlan, Study, Use},
};
use mammotwin_stages::calibrate::Calibration;
use std::fs;

/// Compresses on the grid, weighs the record and writes tables, figures and page.
pub fn stiffening(arguments: &StiffeningArguments) -> Result<(), Failure> {
    let jm = rising("--jm", &arguments.jm, [0.05, 1e4])?;
    let distance_mm = rising("--distances", &arguments.distances, [0.0, 200.0])?;
    let error = RecordError {
        force_part: arguments.force_error_percent / 100.0,
        force_n: arguments.force_error_n,
        thickness_mm: arguments.thickness_error_mm,
        model_part: arguments.model_error_percent / 100.0,
    };
    let sizes = [error.force_part, error.force_n, error.thickness_mm, error.model_part];
    if sizes.iter().any(|size| !(*size >= 0.0 && size.is_finite()))
        || sizes[..3].iter().sum::<f64>() <= 0.0
    {
        return Err(Failure::Usage(
            "errors of a record: give numbers of 0 or more, one of the record's above 0".into(),
        ));
    }
    let mut opened = open(&arguments.study)?;
    opened.study.mammogram = None;
    let Some(plan) = opened.study.compress.clone() else {
        let text = format!("{}: has no table [compress]", arguments.study.study.display());
        return Err(Failure::BadInput(text));
    };
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let record = match &arguments.record {
        Some(path) => read_record(path)?,
        None => vec![of_study(&opened.study, plan.side)?],
    };
    let every = |&jm: &f64| distance_mm.iter().map(move |&distance| (jm, distance));
    let ways: Vec<(String, CompressPlan)> =
        jm.iter().flat_map(every).map(|(jm, distance)| way(&plan, jm, distance, &record)).collect();
    let display = Display::new();
    let options = Options::default();
    let drive =
        Drive { store: &opened.store, base: &opened.base, options: &options, listener: &display };
    let pass = store::execute(&drive, |run| graph::squeezes(&opened.study, &ways, run))?;
    drop(display);
    let mut courses = Vec::new();
    for ((label, _), made) in ways.iter().zip(pass.outcome) {
        courses.push(match made {
            Ok(made) => {
                let found = made.compression.load()?;
                if let Some(why) = &found.stopped_early {
                    tell!("{label} ended early: {why}");
                }
                let (thickness_mm, force_n) = (found.curve.thickness_mm, found.curve.force_n);
                Some(Course { thickness_mm, force_n })
            }
            Err(why) => {
                tell!("{label} failed: {why}");
                None
            }
        });
    }
    let grid = Grid { jm, distance_mm, courses };
    let folder = opened.store.out.join("studies").join("stiffening");
    fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
    write(&folder.join("curves.csv"), course_table(&grid))?;
    let posterior = grid.posterior(&record, &error).ok_or_else(|| {
        Failure::Numerics(format!(
            "study stiffening: the model reaches the thicknesses of the record with none of these; its \
             curves are in {}",
            folder.join("curves.csv").display()
        ))
    })?;
    let mut sentences = said(&posterior, &record, &error);
    sentences.extend(other(&opened.study, &plan, &posterior));
    let hanging = if arguments.poses { hanging(&opened, &grid.jm)? } else { Vec::new() };
    let both = Both::new(&hanging, &posterior);
    sentences.extend(both.iter().flat_map(Both::said));
    if arguments.poses {
        write(&folder.join("gravity.csv"), gravity_table(&hanging))?;
    }
    let subject = &opened.study.subject.id;
    let (html, figures) = page(subject, &grid, &posterior, both.as_ref(), &record, &sentences);
    for (name, svg) in &figures {
        write(&folder.join(name), svg)?;
    }
    write(&folder.join("posterior.csv"), posterior_table(&posterior))?;
    write(&folder.join("stiffening.html"), html)?;
    let computed = pass.entries.iter().filter(|entry| entry.computed).count();
    tell!("{computed} of {} stages computed", pass.entries.len());
    for sentence in &sentences {
        tell!("{sentence}");
    }
    tell!("{}", folder.join("stiffening.html").display());
    Ok(())
}

/// What is left of all poses with each Jₘ that they stand.
fn hanging(opened: &Opened, jm: &[f64]) -> Result<Vec<Hanging>, Failure> {
    let mut study = opened.study.clone();
    let reference = study.reference_pose().to_owned();
    for (name, pose) in &mut study.poses {
        if *name != reference {
            pose.usage = Use::Fit;
        }
    }
    let display = Display::new();
    let options = Options::default();
    let drive =
        Drive { store: &opened.store, base: &opened.base, options: &options, listener: &display };
    let pass = store::execute(&drive, |run| graph::stiffened(&study, jm, run))?;
    drop(display);
    let mut found = Vec::new();
    for (jm, made) in jm.iter().zip(pass.outcome) {
        match made {
            Ok(calibration) => {
                let Calibration { trials, after, precision, .. } = calibration.load()?;
                let least =
                    trials.iter().map(|trial| trial.misfit_mm).fold(f64::INFINITY, f64::min);
                found.push(Hanging {
                    jm: *jm,
                    moduli_kpa: [after.moduli.right_kpa, after.moduli.left_kpa],
                    misfit_mm: least,
                    independent: precision.independent,
                });
            }
            Err(why) => tell!("poses with Jₘ {jm} failed: {why}"),
        }
    }
    Ok(found)
}

/// The record of a side in the study itself.
fn of_study(study: &Study, side: Side) -> Result<Measured, Failure> {
    let record = study.records.get(&side).ok_or_else(|| {
        Failure::Usage(format!(
            "give --record CURVE.csv (thickness_mm,force_n), or [records.{}] in the study",
            side.name()
        ))
    })?;
    Ok(Measured { thickness_mm: record.thickness_mm, force_n: record.force_n })
}

/// What to do with the record of the other breast, if there is one.
fn other(study: &Study, plan: &CompressPlan, posterior: &Posterior) -> Option<String> {
    let side = match plan.side {
        Side::Right => Side::Left,
        Side::Left => Side::Right,
    };
    let record = study.records.get(&side)?;
    let (jm, distance) = (posterior.jm().best, posterior.distance().best);
    Some(format!(
        "The {} breast took no part; its record is {} N at {} mm. Foretell it: side = \"{}\", jm = {jm:.2}, \
         chest_wall_distance_mm = {distance:.1}.",
        side.name(),
        record.force_n,
        record.thickness_mm,
        side.name()
    ))
}
