//! `mammotwin study force-curve`: effects of the compression, from a record of force and thickness.

mod bench;
mod page;
mod tally;

use super::{Opened, beside, open, write};
use crate::{
    cli::{ForceCurveArguments, StudyArguments},
    display::Display,
    force_curve::{Band, band, csv, read_record},
    graph,
    page::begin,
    plausible::findings,
};
use mammotwin_data::{
    Failure,
    store::{self, Drive, Options, Run},
    study::{CompressPlan, Elements, MeshPlan, StopPlan, Study},
};
use mammotwin_stages::{
    discover::VerdictName,
    force_curve::{
        course::Pressed,
        evidence::{Evidence, Ladder},
        library::{CURVE_EFFECTS, CurveEffect},
        record::{Record, RecordError},
        trial::{gathered, switched},
        verdict::{CurveVerdict, judge},
    },
    report::escaped,
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// How much farther (mm) than the record the model is pressed.
const FARTHER_MM: f64 = 1.0;
/// The model stops at so many times the largest force of the record, and not below (N).
const MOST_FORCE: f64 = 4.0;
const LEAST_FORCE_N: f64 = 50.0;
/// What these are rounded to.
const ROUND_MM: f64 = 2.0;
const ROUND_N: f64 = 50.0;
/// Edges of other meshes, over the study's.
const OTHER_MESHES: [f64; 4] = [0.85, 0.92, 1.1, 1.2];
/// Times that a whole solution is made at the fitted amplitude.
const ROUNDS: usize = 2;

/// Analyses a record, or counts how often the answer is right.
pub fn force_curve(arguments: &ForceCurveArguments) -> Result<(), Failure> {
    let error = errors(arguments)?;
    match (&arguments.study, &arguments.record) {
        (Some(study), Some(record)) => analyse(arguments, study, record, error),
        _ => bench::benchmark(arguments, error),
    }
}

fn errors(arguments: &ForceCurveArguments) -> Result<RecordError, Failure> {
    let error = RecordError {
        force_part: arguments.force_error_percent / 100.0,
        force_n: arguments.force_error_n,
        thickness_mm: arguments.thickness_error_mm,
        stiffness: arguments.stiffness_error_percent / 100.0,
        ..RecordError::default()
    };
    let sizes = [error.force_part, error.force_n, error.thickness_mm, error.stiffness];
    let usable = sizes.iter().all(|size| *size >= 0.0 && size.is_finite());
    if !usable || error.force_n <= 0.0 || error.thickness_mm <= 0.0 || error.stiffness <= 0.0 {
        return Err(Failure::Usage(
            "errors of a record: give numbers above 0 (the one in proportion may be 0)".into(),
        ));
    }
    Ok(error)
}

fn analyse(
    arguments: &ForceCurveArguments,
    path: &Path,
    record: &Path,
    error: RecordError,
) -> Result<(), Failure> {
    let arguments_of = StudyArguments { study: path.into(), out: arguments.out.clone() };
    let mut opened = open(&arguments_of)?;
    opened.study.mammogram = None;
    // Curves are read alone: deviations of comfort would cost as much again, and more.
    opened.study.comfort = opened.study.comfort.without_uncertainty();
    let Some(plan) = opened.study.compress.clone() else {
        return Err(Failure::BadInput(format!("{}: has no table [compress]", path.display())));
    };
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let record = read_record(record)?;
    let another = arguments.held_out.as_deref().map(read_record).transpose()?;
    let mut both = record.clone();
    both.0.extend(another.iter().flat_map(|another| &another.0));
    let pressed = pressing(&plan, &both);
    let mut evidence = gather(&opened, &pressed, &both, error)?;
    let no_covariance = || Failure::Numerics("study force-curve: errors without covariance".into());
    let mut verdict = judge(&evidence, &record, another.as_ref()).ok_or_else(no_covariance)?;
    // Once more with whole solutions where the best effect was fitted.
    for _ in 0..ROUNDS {
        let Some(best) = verdict.candidates.first() else { break };
        let Some(effect) = CurveEffect::named(best.effect) else { break };
        let amplitude = best.amplitude[0];
        if !refine(&opened, &pressed, &mut evidence, effect, amplitude, &both)? {
            break;
        }
        verdict = judge(&evidence, &record, another.as_ref()).ok_or_else(no_covariance)?;
    }
    let folder = opened.store.out.join("studies").join("force-curve");
    fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
    let added = add(&opened, &plan, &verdict)?;
    let text = serde_json::to_string_pretty(&verdict)
        .map_err(|cause| Failure::Numerics(format!("study force-curve: {cause}")))?;
    write(&folder.join("verdict.json"), format!("{text}\n"))?;
    let title = "Force over thickness, measured and simulated".to_owned();
    let figure = Band::of(title, &evidence, (&record, another.as_ref()), &verdict);
    write(&folder.join("curves.csv"), csv(&figure))?;
    write(&folder.join("curves.svg"), band(&figure))?;
    let sentences = page::said(&verdict, &record, added.as_deref());
    let html = html(&opened.study.subject.id, &sentences, &band(&figure));
    write(&folder.join("force-curve.html"), html)?;
    if arguments.json {
        tell!("{text}");
    } else {
        sentences.iter().for_each(|sentence| tell!("{sentence}"));
        tell!("{}", folder.join("force-curve.html").display());
    }
    Ok(())
}

/// The compression of a study, to the smallest thickness of a record, in round numbers: like records share its results.
fn pressing(plan: &CompressPlan, record: &Record) -> CompressPlan {
    let thinnest_mm = record.thinnest_mm() - FARTHER_MM;
    let most_n = MOST_FORCE * record.largest_force_n();
    let stop = StopPlan {
        thickness_mm: Some((ROUND_MM * (thinnest_mm / ROUND_MM).floor()).max(ROUND_MM)),
        force_n: Some((ROUND_N * (most_n / ROUND_N).ceil()).clamp(LEAST_FORCE_N, 500.0)),
        ..StopPlan::default()
    };
    CompressPlan { stop, ..plan.clone() }
}

/// Runs a graph of the study with results that are there.
fn driven<R>(
    opened: &Opened,
    graph: impl Fn(&Run<'_>) -> Result<R, Failure>,
) -> Result<R, Failure> {
    let (display, options) = (Display::new(), Options::default());
    let drive =
        Drive { store: &opened.store, base: &opened.base, options: &options, listener: &display };
    Ok(store::execute(&drive, graph)?.outcome)
}

/// Presses the breast of the study in several ways; `None` where there is no equilibrium.
fn press(
    opened: &Opened,
    ways: &[(String, CompressPlan)],
) -> Result<Vec<Option<Pressed>>, Failure> {
    let made = driven(opened, |run| graph::squeezes(&opened.study, ways, run))?;
    let course = |made: Result<graph::Squeezed, String>| match made {
        Ok(made) => Ok(Some(Pressed::of(&made.compression.load()?))),
        Err(_) => Ok(None),
    };
    made.into_iter().map(course).collect()
}

/// Presses as the study says, with each effect, and on other meshes.
fn gather(
    opened: &Opened,
    plan: &CompressPlan,
    record: &Record,
    error: RecordError,
) -> Result<Evidence, Failure> {
    let mut ways = vec![("curve_plain".to_owned(), plan.clone())];
    for (effect, amplitude) in switched(plan, &CURVE_EFFECTS) {
        ways.push((label(effect, amplitude), effect.switched(plan, amplitude)));
    }
    let mut pressed = press(opened, &ways)?;
    // Other meshes with the moduli that were found: what they differ by is the mesh's.
    let base = driven(opened, |run| graph::squeezes(&opened.study, &ways[..1], run))?;
    if let Some(Ok(first)) = base.first() {
        let moduli = first.calibration.load()?.after.moduli;
        let mut study: Study = opened.study.clone();
        study.calibrate.parameters.clear();
        study.model = moduli.applied(&study.model);
        let meshing = |part: &f64| {
            let size_mm = part * study.mesh.size_mm;
            let meshing = MeshPlan { size_mm, elements: Elements::Linear };
            (format!("curve_mesh_{part}").replace('.', "-"), meshing)
        };
        let meshings: Vec<_> = OTHER_MESHES.iter().map(meshing).collect();
        for made in driven(opened, |run| graph::remeshed(&study, plan, &meshings, run))? {
            pressed.push(match made {
                Ok(made) => Some(Pressed::of(&made.load()?)),
                Err(_) => None,
            });
        }
    }
    gathered(plan, &CURVE_EFFECTS, pressed, record.thinnest_mm(), error)
}

/// Adds a whole solution at an amplitude to the ladder of an effect; `false` when it is there already or
/// there is none.
fn refine(
    opened: &Opened,
    plan: &CompressPlan,
    evidence: &mut Evidence,
    effect: &'static CurveEffect,
    amplitude: f64,
    record: &Record,
) -> Result<bool, Failure> {
    let Some(place) = evidence.ladders.iter().position(|l| l.effect.name == effect.name) else {
        return Ok(false);
    };
    let ladder = &evidence.ladders[place];
    let [least, greatest] = ladder.range();
    let near = |rung: &(f64, Pressed)| (rung.0 - amplitude).abs() < 0.01 * (greatest - least);
    if ladder.rungs.iter().any(near) {
        return Ok(false);
    }
    let way = (label(effect, amplitude), effect.switched(plan, amplitude));
    let Some(course) = press(opened, &[way])?.pop().flatten() else { return Ok(false) };
    let known = ladder.rungs.iter().filter(|rung| rung.0 != 0.0).cloned();
    let all: Vec<_> = known.chain([(amplitude, course)]).collect();
    evidence.ladders[place] = Ladder::new(effect, &evidence.plain, all, record.thinnest_mm());
    Ok(true)
}

fn label(effect: &CurveEffect, amplitude: f64) -> String {
    format!("curve_{}_{amplitude:.4}", effect.name).replace('.', "-").replace("_-", "_minus_")
}

/// Writes a new study with the named effect, or the best of an ambiguous set, switched on.
fn add(
    opened: &Opened,
    plan: &CompressPlan,
    verdict: &CurveVerdict,
) -> Result<Option<PathBuf>, Failure> {
    if !matches!(verdict.verdict, VerdictName::Named | VerdictName::Ambiguous) {
        return Ok(None);
    }
    let Some(best) = verdict.candidates.first() else { return Ok(None) };
    let Some(effect) = CurveEffect::named(best.effect) else { return Ok(None) };
    let with = effect.switched(plan, best.amplitude[0]);
    let refuse = |cause: &dyn std::fmt::Display| {
        Failure::BadInput(format!(
            "{}: cannot take {}: {cause}",
            opened.file.display(),
            best.effect
        ))
    };
    let mut table: toml::Table = opened.text.parse().map_err(|cause| refuse(&cause))?;
    let value = toml::Value::try_from(&with).map_err(|cause| refuse(&cause))?;
    table.insert("compress".into(), value);
    let text = toml::to_string_pretty(&table).map_err(|cause| refuse(&cause))?;
    let text = format!(
        "# Found by `mammotwin study force-curve`: {} = {:.4} ({}).\n{text}",
        best.effect, best.amplitude[0], effect.keys
    );
    let study = mammotwin_data::study::parse(&text).map_err(|cause| refuse(&cause))?;
    if study.compress.as_ref() != Some(&with) {
        return Err(refuse(&"its compression is not read as it is written"));
    }
    let path = beside(&opened.file, "force-curve", &text);
    write(&path, text)?;
    Ok(Some(path))
}

fn html(subject: &str, sentences: &[String], svg: &str) -> String {
    let title = "What a record of force and thickness has and the model lacks";
    let style = "figure{margin:1em 0}figure svg{max-width:100%;height:auto}";
    let mut html = begin(title, subject, style);
    let items = sentences.iter().map(|s| format!("<li>{}</li>\n", escaped(s)));
    html += &format!("<ul>\n{}</ul>\n<figure>{svg}</figure>\n", items.collect::<String>());
    html + "</body></html>\n"
}
