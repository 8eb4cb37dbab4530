//! Effects hidden in digital volunteers, and how often the answer is right.

use super::{
    page::{self, Shown},
    tally::{Tier, Trial},
};
use crate::{
    cli::ForceCurveArguments,
    commands::write,
    display::Task,
    force_curve::{Band, band, record_table},
};
use mammotwin_data::{Failure, progress::Progress, store::Stage, study::CompressPlan};
use mammotwin_stages::{
    compress::Compress,
    force_curve::{
        course::Pressed,
        evidence::{Evidence, Ladder, Parameters},
        library::{CURVE_EFFECTS, CurveEffect},
        record::{Channel, Record, RecordError},
        search::{amplitude_of, screen, size_of},
        trial::{
            Measuring, Meshed, Person, Way, drawn_stiffness, gathered, measured, press_all, ways,
        },
        verdict::judge,
    },
    volunteer::Preset,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// What may be measured: forces alone, with a picture at the end, with tilts besides.
pub const DATA: [(&str, &[Channel]); 3] = [
    ("force", &[Channel::Force]),
    ("force, picture", &[Channel::Force, Channel::Area, Channel::Extent]),
    ("force, picture, tilt", &Channel::ALL),
];
/// Severities (standard deviations of all that may be measured).
pub const SIGMAS: [f64; 2] = [5.0, 10.0];
/// No more than this part of the range that the model reaches is hidden.
const WITHIN: f64 = 0.8;
/// Distance of the paddle (mm), thicknesses of the record (mm) and their number.
const DISTANCE_MM: f64 = 25.0;
const THICKEST_MM: f64 = 115.0;
const THINNEST_MM: f64 = 46.0;
/// A truth that ends by so much (mm) before is tried with a record that ends there.
const EARLY_MM: f64 = 10.0;
const POINTS: usize = 16;
/// Times the draws where nothing is hidden.
const NULLS: usize = 5;
/// Measurements that are off.
const DECOYS: [(&str, Measuring); 5] = [
    ("thickness +3 mm", Measuring { offset_mm: 3.0, ..Measuring::USUAL }),
    ("thickness -3 mm", Measuring { offset_mm: -3.0, ..Measuring::USUAL }),
    ("force +10 %", Measuring { gain: 1.1, ..Measuring::USUAL }),
    ("force -10 %", Measuring { gain: 0.9, ..Measuring::USUAL }),
    ("noise x1.5", Measuring { noise: 1.5, ..Measuring::USUAL }),
];

/// A compression that is done, as it is kept.
#[derive(Serialize, Deserialize)]
struct Done {
    version: String,
    person: Person,
    way: Way,
    course: Option<Pressed>,
}

/// What made a compression: those of another version of its stage are made anew.
fn version() -> String {
    format!("{}, compress {}", env!("CARGO_PKG_VERSION"), Compress::VERSION)
}

/// Compressions of a person that are kept in a folder.
struct Kept {
    person: Person,
    folder: PathBuf,
    end: Option<Instant>,
}

impl Kept {
    fn file(&self, way: &Way) -> PathBuf {
        self.folder.join(format!("{}.json", way.label))
    }

    fn read(&self, way: &Way) -> Option<Option<Pressed>> {
        let done: Done = serde_json::from_slice(&fs::read(self.file(way)).ok()?).ok()?;
        let same = done.version == version() && done.person == self.person && done.way == *way;
        same.then_some(done.course)
    }

    /// Presses what is missing; what has no equilibrium is `None`.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the time does not last: missing compressions would read as physics.
    fn press(&self, ways: &[Way], task: &Task, from: f64) -> Result<Vec<Option<Pressed>>, Failure> {
        let missing: Vec<Way> = ways.iter().filter(|w| self.read(w).is_none()).cloned().collect();
        let begins = || self.end.is_none_or(|end| Instant::now() < end);
        if !missing.is_empty() && begins() {
            let keep = |way: &Way, course: &Option<Pressed>| -> Result<(), Failure> {
                let path = self.file(way);
                let done = Done {
                    version: version(),
                    person: self.person.clone(),
                    way: way.clone(),
                    course: course.clone(),
                };
                let text = serde_json::to_vec(&done).map_err(|cause| Failure::io(&path, cause))?;
                // A file that was cut short is never taken for a whole one.
                let aside = path.with_extension("part");
                write(&aside, text)?;
                fs::rename(&aside, &path).map_err(|cause| Failure::io(&path, cause))?;
                task.report(from, &way.label);
                Ok(())
            };
            press_all(&self.person, &missing, &begins, &keep)?;
        }
        let left = ways.iter().filter(|way| self.read(way).is_none()).count();
        if left > 0 {
            let all = ways.len();
            return Err(Failure::Numerics(format!(
                "study force-curve: no time for {left} of {all} compressions; the same command goes on there"
            )));
        }
        Ok(ways.iter().map(|way| self.read(way).flatten()).collect())
    }
}

/// Presses what is missing, draws records and judges them; writes `trials.csv`, `force-curve.md`, `curves.svg`
/// and a record of each hidden effect.
pub fn benchmark(arguments: &ForceCurveArguments, error: RecordError) -> Result<(), Failure> {
    if arguments.seeds.is_empty() || arguments.draws == 0 {
        return Err(Failure::Usage(
            "give at least one of --seeds, and --draws of 1 or more".into(),
        ));
    }
    if !(10.0..=40.0).contains(&arguments.size_mm) {
        return Err(Failure::Usage("--size-mm: give 10 to 40 mm".into()));
    }
    if !(0.1..=20.0).contains(&arguments.stiffer) {
        return Err(Failure::Usage("--stiffer: give 0.1 to 20".into()));
    }
    Preset::named(&arguments.preset)?;
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from("runs/force-curve"));
    let end = arguments.minutes.map(|minutes| Instant::now() + Duration::from_secs(60 * minutes));
    let task = Task::new("force curves");
    let (mut trials, mut shown) = (Vec::new(), Shown::default());
    for &seed in &arguments.seeds {
        let person = Person { preset: arguments.preset.clone(), seed, stiffer: arguments.stiffer };
        let folder = out.join("curves").join(format!("{}-{seed}", arguments.preset));
        fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
        let kept = Kept { person, folder, end };
        let subject = Subject::new(kept, arguments.size_mm, error, &task)?;
        trials.extend(subject.trials(arguments.draws)?);
        subject.show(&out, &mut shown)?;
    }
    drop(task);
    let text = page::markdown(&trials, &shown, arguments);
    write(&out.join("trials.csv"), page::csv(&trials))?;
    write(&out.join("force-curve.md"), &text)?;
    tell!("{text}");
    tell!("{}: force-curve.md, trials.csv, record_*.csv, curves_*.svg", out.display());
    Ok(())
}

/// A truth: what is hidden, how much, at which severity.
struct Truth {
    effect: &'static CurveEffect,
    amplitude: f64,
    sigma: f64,
    course: Option<Pressed>,
}

/// Trials to be made: kind, model, what is hidden, its truth, errors, first draw, number of draws.
type Planned<'a> = (Tier, Evidence, &'a str, Option<&'a Truth>, Measuring, u64, usize);

/// A person, her model and her truths.
struct Subject {
    seed: u64,
    evidence: Evidence,
    /// Places of a record, as the model has it.
    places: Record,
    nothing: Pressed,
    truths: Vec<Truth>,
}

impl Subject {
    fn new(kept: Kept, size_mm: f64, error: RecordError, task: &Task) -> Result<Self, Failure> {
        let plan = kept.person.plan(DISTANCE_MM, THINNEST_MM)?;
        let (mesh, others, truth) = Meshed::set(size_mm);
        let all = ways(&plan, &CURVE_EFFECTS, mesh, &others);
        let pressed = kept.press(&all, task, 0.1)?;
        let evidence = gathered(&plan, &CURVE_EFFECTS, pressed, THINNEST_MM, error)?;
        let (places, _) = measured(
            &evidence.plain,
            (POINTS, THICKEST_MM, THINNEST_MM),
            &error,
            Measuring { noise: 0.0, ..Measuring::USUAL },
            (1.0, 0),
        );
        let none = || Failure::Numerics("study force-curve: errors without covariance".into());
        let places =
            evidence.as_measured(&places, None, &Parameters::default()).ok_or_else(none)?;
        let mut truths = severities(&evidence, &places);
        let way = |label: String, plan: CompressPlan| Way { label, mesh: truth, plan };
        let mut hidden = vec![way("truth_nothing".into(), plan.clone())];
        for Truth { effect, amplitude, sigma, .. } in &truths {
            let label = format!("truth_{}_{sigma}", effect.name);
            hidden.push(way(label, effect.switched(&plan, *amplitude)));
        }
        let mut courses = kept.press(&hidden, task, 0.6)?.into_iter();
        let reaches = |mm: f64| move |course: &Pressed| course.thinnest_mm() <= mm + 1e-6;
        let nothing = courses.next().flatten().filter(reaches(THINNEST_MM)).ok_or_else(|| {
            let why = "has no equilibrium or leaps to another one";
            Failure::Numerics(format!("study force-curve: above {THINNEST_MM} mm the truth {why}"))
        })?;
        for (truth, course) in truths.iter_mut().zip(courses) {
            // Tissue at its limiting stretch ends a compression early: the record ends there.
            truth.course = course.filter(reaches(THINNEST_MM + EARLY_MM));
        }
        Ok(Self { seed: kept.person.seed, evidence, places, nothing, truths })
    }

    /// Two records of one compression, and the factor of all forces of the first.
    fn records(&self, course: &Pressed, how: Measuring, draw: u64) -> ([Record; 2], f64) {
        let error = &self.evidence.error;
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(draw);
        let stiffness = drawn_stiffness(error, seed);
        let places = (POINTS, THICKEST_MM, course.thinnest_mm().max(THINNEST_MM));
        let one = |n: u64| {
            let own = seed.wrapping_mul(2).wrapping_add(n);
            measured(course, places, error, how, (stiffness, own))
        };
        let ((first, factor), (second, _)) = (one(0), one(1));
        ([first, second], factor)
    }

    /// All trials, each with every kind of data.
    fn trials(&self, draws: usize) -> Result<Vec<Trial>, Failure> {
        let usual = Measuring::USUAL;
        let mut plans: Vec<Planned<'_>> =
            vec![(Tier::Null, self.evidence.clone(), "nothing", None, usual, 0, NULLS * draws)];
        for (n, (word, how)) in DECOYS.iter().enumerate() {
            let first = 10_000 * (n as u64 + 1);
            plans.push((Tier::Decoy, self.evidence.clone(), word, None, *how, first, draws));
        }
        for (n, truth) in self.truths.iter().enumerate().filter(|(_, t)| t.course.is_some()) {
            let first = 100_000 * (n as u64 + 1);
            let name = truth.effect.name;
            let whole = self.evidence.clone();
            plans.push((Tier::Single, whole, name, Some(truth), usual, first, draws));
            if truth.sigma == SIGMAS[SIGMAS.len() - 1] {
                let less = self.evidence.without(name);
                plans.push((Tier::Outside, less, name, Some(truth), usual, first, draws));
            }
        }
        let mut all = Vec::new();
        for (tier, evidence, word, truth, how, first, count) in &plans {
            let course = truth.and_then(|t| t.course.as_ref()).unwrap_or(&self.nothing);
            let (amplitude, sigma) = truth.map_or((0.0, 0.0), |t| (t.amplitude, t.sigma));
            let scaling = truth.map_or(0, |t| t.effect.scaling);
            let one = |draw: u64| -> Vec<Trial> {
                let (records, factor) = self.records(course, *how, first + draw);
                let judged = |(data, channels): &(&'static str, &[Channel])| {
                    let [record, another] = records.each_ref().map(|r| r.only(channels));
                    let found = judge(evidence, &record, Some(&another))?;
                    let here = amplitude * factor.powi(-scaling);
                    let of = (*tier, self.seed, *data);
                    Some(Trial::new(of, (word, amplitude, sigma), here, &found))
                };
                DATA.iter().filter_map(judged).collect()
            };
            let drawn: Vec<Vec<Trial>> = (0..*count as u64).into_par_iter().map(one).collect();
            all.extend(drawn.into_iter().flatten());
        }
        Ok(all)
    }

    /// What the data can show, and a figure and a record of each strong effect.
    fn show(&self, out: &Path, shown: &mut Shown) -> Result<(), Failure> {
        for (data, channels) in &DATA {
            let seen = self.places.only(channels);
            let Some(weighed) = self.evidence.weigh(&seen) else { continue };
            let screening = screen(&weighed);
            let names = self.evidence.ladders.iter().map(|l| l.effect.name).collect();
            shown.screens.push((self.seed, *data, screening, names));
        }
        for truth in &self.truths {
            let own = |l: &Ladder| l.effect.name == truth.effect.name;
            let ladder = self.evidence.ladders.iter().position(own);
            let sizes = DATA.map(|(_, channels)| {
                let seen = self.places.only(channels);
                ladder.and_then(|n| size_of(&self.evidence, &seen, n, truth.amplitude))
            });
            let name = truth.effect.name;
            let ended_mm = truth.course.as_ref().map(Pressed::thinnest_mm);
            shown.truths.push((self.seed, name, truth.sigma, truth.amplitude, sizes, ended_mm));
            let Some(course) = truth.course.as_ref().filter(|_| truth.sigma > SIGMAS[0]) else {
                continue;
            };
            let ([record, another], _) = self.records(course, Measuring::USUAL, 0);
            let stem = format!("{name}_{}", self.seed);
            write(&out.join(format!("record_{stem}.csv")), record_table(&record))?;
            write(&out.join(format!("record_{stem}_again.csv")), record_table(&another))?;
            let Some(found) = judge(&self.evidence, &record, Some(&another)) else { continue };
            let unit = if truth.effect.unit == "1" { "" } else { truth.effect.unit };
            let title = format!("Hidden: {name} {:.3} {unit}", truth.amplitude);
            let records = (&record, Some(&another));
            let figure = Band::of(title, &self.evidence, records, &found);
            write(&out.join(format!("curves_{stem}.svg")), band(&figure))?;
        }
        let ([record, _], _) = self.records(&self.nothing, Measuring::USUAL, 0);
        write(&out.join(format!("record_nothing_{}.csv", self.seed)), record_table(&record))
    }
}

/// The amplitude of each effect at each severity, with all that may be measured, and no more than most of what
/// the model reaches.
fn severities(evidence: &Evidence, places: &Record) -> Vec<Truth> {
    let mut all = Vec::new();
    for (n, ladder) in evidence.ladders.iter().enumerate() {
        let most = WITHIN * ladder.range()[1];
        let mut before = 0.0;
        for sigma in SIGMAS {
            let amplitude = amplitude_of(evidence, places, n, sigma).unwrap_or(most).min(most);
            // An effect that cannot become stronger is hidden once.
            if amplitude > 1.01 * before {
                all.push(Truth { effect: ladder.effect, amplitude, sigma, course: None });
            } else if let Some(last) = all.last_mut() {
                last.sigma = sigma;
            }
            before = amplitude;
        }
    }
    all
}
