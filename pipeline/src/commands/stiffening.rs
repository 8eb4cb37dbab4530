//! `mammotwin study stiffening`: Jₘ and the place of the paddle from a record of force and thickness.

use super::{Opened, open, rising, write};
use crate::{
    cli::StiffeningArguments,
    display::Display,
    graph,
    plausible::findings,
    stiffening::{
        Both, Course, Grid, Hanging, Measured, Posterior, RecordError, course_table, foretell,
        foretold_chart, foretold_said, foretold_table, gravity_table, page, posterior_table,
        read_record, said, way,
    },
};
use mammotwin_data::{
    Failure,
    labels::Side,
    store::{self, Drive, Options},
    study::{CompressPlan, LawName, Study, Use},
};
use mammotwin_stages::{calibrate::Calibration, report::chart::lines};
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
        bent_part: arguments.mesh_error_percent / 100.0,
    };
    let RecordError { force_part, force_n, thickness_mm, model_part, bent_part } = error;
    let sizes = [force_part, force_n, thickness_mm, model_part, bent_part];
    if sizes.iter().any(|size| !(*size >= 0.0 && size.is_finite()))
        || sizes[..3].iter().sum::<f64>() <= 0.0
    {
        return Err(Failure::Usage(
            "errors of a record: give numbers of 0 or more, one of the record's above 0".into(),
        ));
    }
    let mut opened = open(&arguments.study)?;
    opened.study.mammogram = None;
    // Curves are read alone: deviations of comfort would cost as much again, and more.
    opened.study.comfort = opened.study.comfort.without_uncertainty();
    let Some(plan) = opened.study.compress.clone() else {
        let text = format!("{}: has no table [compress]", arguments.study.study.display());
        return Err(Failure::BadInput(text));
    };
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let record = match &arguments.record {
        Some(path) => read_record(path)?,
        None => vec![of_study(&opened.study, plan.side)?],
    };
    let asked = Asked { jm: &jm, distance_mm: &distance_mm, poses: arguments.poses };
    let Tried { courses, hanging, fell, mut computed } = asked.press(&opened, &plan, &record)?;
    let grid = Grid { jm: jm.clone(), distance_mm: distance_mm.clone(), courses };
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
    let mut foretold = None;
    if arguments.other {
        let found = foretell_other(&opened, &asked, &plan, &record, (&posterior, &error))?;
        (0..2).for_each(|n| computed[n] += found.computed[n]);
        sentences.extend(found.said);
        foretold = Some(found.files);
    } else {
        sentences.extend(other(&opened.study, &plan));
    }
    let both = Both::new(&hanging, &fell, &posterior).filter(|_| arguments.poses);
    sentences.extend(both.iter().flat_map(Both::said));
    if arguments.poses {
        write(&folder.join("gravity.csv"), gravity_table(&hanging))?;
    }
    let subject = &opened.study.subject.id;
    let (html, figures) = page(subject, &grid, &posterior, both.as_ref(), &record, &sentences);
    for (name, svg) in &figures {
        write(&folder.join(name), svg)?;
    }
    for (name, text) in foretold.iter().flatten() {
        write(&folder.join(name), text)?;
    }
    write(&folder.join("posterior.csv"), posterior_table(&posterior))?;
    write(&folder.join("stiffening.html"), html)?;
    tell!("{} of {} stages computed", computed[0], computed[1]);
    for sentence in &sentences {
        tell!("{sentence}");
    }
    tell!("{}", folder.join("stiffening.html").display());
    Ok(())
}

/// What is compressed on: the grid, and whether poses are asked for each Jₘ.
struct Asked<'a> {
    jm: &'a [f64],
    distance_mm: &'a [f64],
    poses: bool,
}

impl Asked<'_> {
    /// Compresses in all ways to the smallest thickness of a record.
    fn press(
        &self,
        opened: &Opened,
        plan: &CompressPlan,
        record: &[Measured],
    ) -> Result<Tried, Failure> {
        let ways = |jm: &[f64]| -> Vec<(f64, (String, CompressPlan))> {
            let one = |jm: f64, distance: f64| (jm, way(plan, jm, distance, record));
            jm.iter().flat_map(|&jm| self.distance_mm.iter().map(move |&d| one(jm, d))).collect()
        };
        let mut tried = Tried::default();
        if !self.poses {
            tried.press(opened, &opened.study, &ways(self.jm))?;
            return Ok(tried);
        }
        for &jm in self.jm {
            let ways = ways(&[jm]);
            match tried.press(opened, &of_one_material(&opened.study, jm), &ways) {
                // The poses do not stand such a material.
                Err(Failure::Numerics(why)) => {
                    tell!("Jₘ {jm} failed: {why}");
                    tried.fell.push(jm);
                    tried.courses.extend(ways.iter().map(|_| None));
                }
                pressed => pressed?,
            }
        }
        Ok(tried)
    }
}

/// The other breast, foretold.
struct Other {
    files: Vec<(&'static str, String)>,
    said: Vec<String>,
    computed: [usize; 2],
}

/// Compresses the other breast on the same grid and weighs its courses by the posterior of the first one.
fn foretell_other(
    opened: &Opened,
    asked: &Asked<'_>,
    plan: &CompressPlan,
    record: &[Measured],
    (posterior, error): (&Posterior, &RecordError),
) -> Result<Other, Failure> {
    let side = plan.side.other();
    let own = opened.study.records.get(&side);
    let own = own.map(|r| Measured { thickness_mm: r.thickness_mm, force_n: r.force_n });
    let to: Vec<Measured> = record.iter().copied().chain(own).collect();
    let tried = asked.press(opened, &CompressPlan { side, ..plan.clone() }, &to)?;
    let grid = Grid {
        jm: asked.jm.to_vec(),
        distance_mm: asked.distance_mm.to_vec(),
        courses: tried.courses,
    };
    // Each millimetre of the courses, and the record's own thickness.
    let ends = to.iter().map(|m| m.thickness_mm).fold(f64::INFINITY, f64::min);
    let thickest = grid.courses.iter().flatten().filter_map(|c| c.thickness_mm.first());
    let thickest = thickest.copied().fold(ends, f64::max);
    let mut at: Vec<f64> = (0..=(thickest - ends) as usize).map(|n| ends + n as f64).collect();
    at.extend(own.map(|record| record.thickness_mm));
    at.sort_by(|a, b| b.total_cmp(a));
    at.dedup();
    let foretold = foretell(&grid, posterior, error, &at);
    let here = |record: &Measured| foretold.iter().find(|f| f.thickness_mm == record.thickness_mm);
    let said = match own {
        Some(record) => foretold_said(side.name(), here(&record), record),
        None => format!(
            "The {} breast is foretold at {} thicknesses (foretold.csv); the study has no [records.{}] to compare it with.",
            side.name(),
            foretold.len(),
            side.name()
        ),
    };
    let chart = lines(&foretold_chart(side.name(), &foretold, own));
    let files = vec![("foretold.csv", foretold_table(&foretold)), ("foretold.svg", chart)];
    Ok(Other { files, said: vec![said], computed: tried.computed })
}

/// A study whose breast, skin and fascia stiffen alike under gravity, all its poses being fitted.
fn of_one_material(study: &Study, jm: f64) -> Study {
    let mut study = study.clone();
    let reference = study.reference_pose().to_owned();
    let others = study.poses.iter_mut().filter(|(name, _)| **name != reference);
    others.for_each(|(_, pose)| pose.usage = Use::Fit);
    let model = &mut study.model;
    (model.breast.law, model.breast.jm) = (LawName::Gent, Some(jm));
    for layer in [&mut model.skin, &mut model.fascia] {
        (layer.law, layer.jm) = (LawName::Gent, Some(jm));
    }
    // It is given here: a fitted one would take its place.
    study.calibrate.parameters.retain(|key| !key.ends_with(".jm"));
    study
}

/// What was found so far.
#[derive(Default)]
struct Tried {
    courses: Vec<Option<Course>>,
    /// What is left of the poses with each Jₘ that they stand.
    hanging: Vec<Hanging>,
    /// Those with which no breast stood.
    fell: Vec<f64>,
    /// Stages that were computed, and all.
    computed: [usize; 2],
}

impl Tried {
    /// Compresses the breast of a study in several ways, each with its Jₘ.
    fn press(
        &mut self,
        opened: &Opened,
        study: &Study,
        ways: &[(f64, (String, CompressPlan))],
    ) -> Result<(), Failure> {
        let plans: Vec<(String, CompressPlan)> = ways.iter().map(|(_, way)| way.clone()).collect();
        let (display, options) = (Display::new(), Options::default());
        let Opened { store, base, .. } = opened;
        let drive = Drive { store, base, options: &options, listener: &display };
        let pass = store::execute(&drive, |run| graph::squeezes(study, &plans, run))?;
        drop(display);
        self.computed[0] += pass.entries.iter().filter(|entry| entry.computed).count();
        self.computed[1] += pass.entries.len();
        for ((jm, (label, _)), made) in ways.iter().zip(pass.outcome) {
            let made = match made {
                Ok(made) => made,
                Err(why) => {
                    tell!("{label} failed: {why}");
                    self.courses.push(None);
                    continue;
                }
            };
            let found = made.compression.load()?;
            if let Some(why) = &found.stopped_early {
                tell!("{label} ended early: {why}");
            }
            let (thickness_mm, force_n) = (found.curve.thickness_mm, found.curve.force_n);
            self.courses.push(Some(Course { thickness_mm, force_n }));
            if self.hanging.last().is_none_or(|last| last.jm != *jm) {
                let Calibration { trials, after, precision, .. } = made.calibration.load()?;
                let least =
                    trials.iter().map(|trial| trial.misfit_mm).fold(f64::INFINITY, f64::min);
                self.hanging.push(Hanging {
                    jm: *jm,
                    moduli_kpa: [after.moduli.right_kpa, after.moduli.left_kpa],
                    misfit_mm: least,
                    independent: precision.independent,
                });
            }
        }
        Ok(())
    }
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

/// How the record of the other breast is foretold, if there is one.
fn other(study: &Study, plan: &CompressPlan) -> Option<String> {
    let side = plan.side.other();
    let record = study.records.get(&side)?;
    Some(format!(
        "The {} breast took no part; its record is {} N at {} mm. Foretell it: --other.",
        side.name(),
        record.force_n,
        record.thickness_mm
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::study;

    #[test]
    fn a_limiting_stretch_that_is_given_is_not_fitted() {
        let tissue = "law = \"gent\", jm = 3.0";
        let text = format!(
            "schema = 1\n[subject]\nid = \"a\"\n\
             [poses.supine]\nimage = \"s.nii.gz\"\nposture = \"supine\"\nuse = \"fit\"\n\
             [poses.prone]\nimage = \"p.nii.gz\"\nposture = \"prone\"\nuse = \"fit\"\n\
             [model]\nbreast = {{ {tissue}, young_right_kpa = 0.3, young_left_kpa = 0.3 }}\n\
             [calibrate]\nparameters = [\"breast.young_right_kpa\", \"skin.young_kpa\", \"breast.jm\"]\n"
        );
        let given = of_one_material(&study::parse(&text).unwrap(), 2.0);
        assert_eq!(given.model.breast.jm, Some(2.0));
        assert_eq!(given.calibrate.parameters, ["breast.young_right_kpa", "skin.young_kpa"]);
    }
}
