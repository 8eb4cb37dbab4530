//! `mammotwin study paddles`, `positions` and `compare`: one breast compressed in several ways, or the
//! compressions of several studies, beside each other.

use super::{Opened, open, write};
use crate::{
    cli::{CompareArguments, PaddlesArguments, PositionsArguments, StudyArguments},
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
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

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

/// Puts the compressions of several studies beside the first one's.
pub fn compare(arguments: &CompareArguments) -> Result<(), Failure> {
    if arguments.studies.len() < 2 {
        return Err(Failure::Usage("study compare: name at least two studies".into()));
    }
    // Nothing is computed before all is found sound.
    let mut juxtathoracic_mm = None;
    let mut studies = Vec::new();
    for (file, label) in arguments.studies.iter().zip(labels(&arguments.studies)?) {
        let one = StudyArguments { study: file.clone(), out: None };
        let (opened, plan) = read(&one, arguments.no_picture)?;
        let rim_mm = opened.study.comfort.juxtathoracic_mm;
        if *juxtathoracic_mm.get_or_insert(rim_mm) != rim_mm {
            let text = format!(
                "{}: comfort.juxtathoracic_mm differs from the first study's; give the same",
                file.display()
            );
            return Err(Failure::Usage(text));
        }
        opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
        studies.push((opened, plan, label));
    }
    let (mut all, mut entries, mut told) = (Vec::new(), [0, 0], Vec::new());
    for (opened, plan, label) in studies {
        told.push(format!("{label}: {}", stated(&opened.study.mesh, &plan.law)));
        // As in a run: its results are used.
        let (ways, counts) = pressed(&opened, &[(String::new(), plan)])?;
        all.extend(ways.into_iter().map(|way| Way { label: label.clone(), ..way }));
        entries = [entries[0] + counts[0], entries[1] + counts[1]];
    }
    let subject = all.iter().map(|way| way.label.as_str()).collect::<Vec<_>>().join(", ");
    let sheet = Sheet {
        name: "compare",
        subject,
        study: None,
        stated: told.join("\n"),
        juxtathoracic_mm: juxtathoracic_mm.unwrap_or_default(),
    };
    written(&arguments.out, &sheet, &all, entries)
}

/// What to call studies, in tables and names of files: by their files, by their folders where files have one name, by both
/// otherwise.
fn labels(files: &[PathBuf]) -> Result<Vec<String>, Failure> {
    let text = |part: Option<&std::ffi::OsStr>| -> String {
        let plain = |c: char| if c.is_alphanumeric() || c == '_' { c } else { '-' };
        part.map_or("study".into(), |part| part.to_string_lossy().chars().map(plain).collect())
    };
    let folder = |file: &PathBuf| {
        let whole = fs::canonicalize(file).unwrap_or_else(|_| file.clone());
        text(whole.parent().and_then(Path::file_name))
    };
    let stem = |file: &PathBuf| text(file.file_stem());
    let ways: [&dyn Fn(&PathBuf) -> String; 3] =
        [&stem, &folder, &|file| format!("{}_{}", folder(file), stem(file))];
    for name in ways {
        let all: Vec<String> = files.iter().map(name).collect();
        if all.iter().collect::<BTreeSet<_>>().len() == all.len() {
            return Ok(all);
        }
    }
    let text = "study compare: two studies have the same file and folder name; rename a folder";
    Err(Failure::Usage(text.into()))
}

/// A metric, and its standard deviation where it has one.
fn told(found: &Found, name: &str) -> String {
    let (value, sd) = (found.metric(name), found.sd(name));
    if sd.is_finite() { format!("{value:.3} ± {sd:.3}") } else { format!("{value:.3}") }
}

/// One breast in several ways.
fn go(
    opened: &Opened,
    study: ThesisStudy,
    name: &'static str,
    plans: &[(String, CompressPlan)],
) -> Result<(), Failure> {
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let (ways, counts) = pressed(opened, plans)?;
    let read = &opened.study;
    let sheet = Sheet {
        name,
        subject: read.subject.id.clone(),
        study: Some(study),
        // All ways share law and mesh.
        stated: plans.first().map_or(String::new(), |(_, plan)| stated(&read.mesh, &plan.law)),
        juxtathoracic_mm: read.comfort.juxtathoracic_mm,
    };
    written(&opened.store.out.join("studies").join(name), &sheet, &ways, counts)
}

/// Computes what is not there, of a study without wrong findings; stages that were computed, and all.
fn pressed(
    opened: &Opened,
    plans: &[(String, CompressPlan)],
) -> Result<(Vec<Way>, [usize; 2]), Failure> {
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
        let mesh_mm = read.mesh.size_mm;
        ways.push(Way { label: label.clone(), plan: plan.clone(), mesh_mm, found });
    }
    let computed = pass.entries.iter().filter(|entry| entry.computed).count();
    Ok((ways, [computed, pass.entries.len()]))
}

/// What heads the tables.
struct Sheet {
    /// Name of page and table.
    name: &'static str,
    /// Whose breasts.
    subject: String,
    /// What the thesis has of it.
    study: Option<ThesisStudy>,
    /// What the numbers depend on.
    stated: String,
    /// Depth of the rim at the chest wall.
    juxtathoracic_mm: f64,
}

/// Writes tables, figures and page, and tells the ends.
fn written(
    folder: &Path,
    sheet: &Sheet,
    ways: &[Way],
    [computed, all]: [usize; 2],
) -> Result<(), Failure> {
    fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
    let Sheet { name, juxtathoracic_mm, stated, .. } = sheet;
    let (html, figures) = page(&sheet.subject, sheet.study, ways, stated, *juxtathoracic_mm);
    for figure in &figures {
        write(&folder.join(&figure.name), &figure.bytes)?;
    }
    write(&folder.join(format!("{name}.csv")), summary(ways))?;
    write(&folder.join("curves.csv"), curves(ways))?;
    if ways.iter().flat_map(|way| &way.found).any(|found| found.course.is_some()) {
        write(&folder.join("time_courses.csv"), time_courses(ways))?;
    }
    write(&folder.join("trends.csv"), trends_csv(ways, *juxtathoracic_mm))?;
    write(&folder.join("comparisons.csv"), comparisons(ways))?;
    write(&folder.join(format!("{name}.html")), html)?;
    tell!("{computed} of {all} stages computed");
    for way in ways {
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
