//! `mammotwin study designs`: paddles, volunteers and positions, and what nothing beats.

use super::{
    Opened,
    compare::{named, under},
    open,
    synth::voxels,
    volunteer::made,
    write,
};
use crate::{
    cli::{DesignsArguments, StudyArguments},
    comparison::Found,
    designs::{
        COMPARED, Objective, Person, Trial, Way, designs_csv, objectives, overall, page, pairs,
        summary_csv,
    },
    display::Display,
    graph::{self, Squeezed},
    plausible::findings,
};
use mammotwin_data::{
    Failure,
    store::{self, Drive, Options},
    study::{self, CompressPlan, StopPlan},
};
use mammotwin_imaging::xray::{calibration::Unit, geometry::Geometry};
use mammotwin_stages::{
    in_view::in_view,
    volunteer::{PoseName, Settings},
};
use std::{collections::BTreeMap, fs, path::PathBuf};

/// Pixels (mm) of the detector where no picture is asked for; they decide nothing here.
const PIXEL_MM: f64 = 0.1;

/// Computes what is not there; writes tables, figures and page after each volunteer.
pub fn designs(arguments: &DesignsArguments) -> Result<(), Failure> {
    let limits = [
        ("--force-n", arguments.force_n, 500.0),
        ("--thickness-mm", arguments.thickness_mm, 200.0),
    ];
    for (option, limit, most) in limits {
        if limit.is_some_and(|limit| !(limit > 0.0 && limit <= most)) {
            return Err(Failure::Usage(format!("{option}: give more than 0, up to {most}")));
        }
    }
    if let Some(mm) = arguments.distances.iter().find(|mm| !(0.0..=200.0).contains(*mm)) {
        return Err(Failure::Usage(format!("--distances: {mm} mm; give 0 to 200")));
    }
    if let Some(mm) = arguments.size_mm {
        if arguments.seeds.is_empty() {
            let text = "--size-mm: is for volunteers of --seeds; a study has its own [mesh]";
            return Err(Failure::Usage(text.into()));
        }
        if !(2.0..=50.0).contains(&mm) {
            return Err(Failure::Usage(format!("--size-mm: {mm} mm; give 2 to 50")));
        }
    }
    let files = volunteers(arguments)?;
    let mut opened = Vec::new();
    for (n, study) in files.into_iter().enumerate() {
        let mut one = open(&StudyArguments { study, out: None })?;
        if let Some(mm) = arguments.size_mm.filter(|_| n >= arguments.studies.len()) {
            one.study.mesh.size_mm = mm;
        }
        if arguments.no_picture {
            one.study.mammogram = None;
        }
        opened.push(one);
    }
    let (wanted, plans) = judged(arguments, &opened)?;
    fs::create_dir_all(&arguments.out).map_err(|cause| Failure::io(&arguments.out, cause))?;
    let (mut persons, mut computed, mut stages) = (Vec::new(), 0, 0);
    for (one, ways) in opened.iter().zip(&plans) {
        one.refuse_wrong(&findings(&one.study, &one.base))?;
        let (trials, counts) = tried(one, ways, &wanted)?;
        (computed, stages) = (computed + counts[0], stages + counts[1]);
        let (id, mesh_mm) = (one.study.subject.id.clone(), one.study.mesh.size_mm);
        persons.push(Person::of(id, mesh_mm, trials, &wanted));
        written(arguments, &plans[0], &persons, &wanted)?;
    }
    tell!("{computed} of {stages} stages computed");
    told(&plans[0], &persons, &wanted);
    tell!("{}", arguments.out.join("designs.html").display());
    if persons.iter().flat_map(|person| &person.trials).all(|trial| trial.why_not.is_some()) {
        return Err(Failure::Numerics("study designs: no compression reached its limit".into()));
    }
    Ok(())
}

/// Study files: those that were given, and those of volunteers, who are made.
fn volunteers(arguments: &DesignsArguments) -> Result<Vec<PathBuf>, Failure> {
    let mut files = arguments.studies.clone();
    for &seed in &arguments.seeds {
        files.push(made(&Settings {
            preset: arguments.preset.clone(),
            seed,
            voxel_mm: voxels(&arguments.voxel_mm)?,
            poses: vec![PoseName::Supine, PoseName::Prone],
            hidden: BTreeMap::new(),
            still: false,
            elements: None,
            truth_mm: None,
            out_dir: arguments.out.join(format!("{}-{seed}", arguments.preset)),
        })?);
    }
    if files.is_empty() {
        return Err(Failure::Usage("study designs: name a study, or --seeds of volunteers".into()));
    }
    Ok(files)
}

/// What is judged, and the ways of each volunteer.
fn judged(
    arguments: &DesignsArguments,
    opened: &[Opened],
) -> Result<(Vec<Objective>, Vec<Vec<Way>>), Failure> {
    let mut wanted: Option<Vec<Objective>> = None;
    let mut plans: Vec<Vec<Way>> = Vec::new();
    for (n, one) in opened.iter().enumerate() {
        let (file, id) = (one.file.display(), &one.study.subject.id);
        if opened[..n].iter().any(|other| other.study.subject.id == *id) {
            let text = format!("{file}: subject {id} is in another of the studies, too");
            return Err(Failure::Usage(text));
        }
        let Some(plan) = &one.study.compress else {
            return Err(Failure::BadInput(format!("{file}: has no table [compress]")));
        };
        let stop = match (arguments.force_n, arguments.thickness_mm) {
            (None, None) => plan.stop,
            (force_n, thickness_mm) => StopPlan { force_n, thickness_mm, ..StopPlan::default() },
        };
        let here = objectives(&stop, one.study.mammogram.is_some());
        if *wanted.get_or_insert_with(|| here.clone()) != here {
            let text = format!(
                "{file}: cannot be judged by what the studies before it are; give --force-n or \
                 --thickness-mm, or --no-picture"
            );
            return Err(Failure::Usage(text));
        }
        plans.push(ways(arguments, &CompressPlan { stop, ..plan.clone() })?);
    }
    Ok((wanted.unwrap_or_default(), plans))
}

/// Every design at every distance.
fn ways(arguments: &DesignsArguments, plan: &CompressPlan) -> Result<Vec<Way>, Failure> {
    let mut designs: Vec<(String, CompressPlan)> = Vec::new();
    for name in named(&arguments.paddles)? {
        designs.push((name.name().into(), under(plan, name)?));
    }
    if let Some(path) = &arguments.designs {
        let text = fs::read_to_string(path).map_err(|cause| Failure::io(path, cause))?;
        let read = study::designs(&text, plan)
            .map_err(|error| Failure::Study { path: path.clone(), error })?;
        for (name, design) in read {
            if designs.iter().any(|(known, _)| *known == name) {
                let text = format!("{}: {name}: is one of --paddles", path.display());
                return Err(Failure::Usage(text));
            }
            designs.push((name, design));
        }
    }
    let own = [plan.chest_wall_distance_mm];
    let distances = if arguments.distances.is_empty() { &own[..] } else { &arguments.distances };
    let mut ways: Vec<Way> = Vec::new();
    for (design, under) in designs {
        for &distance in distances {
            let label = match arguments.distances.len() {
                0 | 1 => design.clone(),
                _ => format!("{design}_{distance}mm").replace('.', "-"),
            };
            let plan = CompressPlan { chest_wall_distance_mm: distance, ..under.clone() };
            if ways.iter().all(|known| known.label != label) {
                ways.push(Way { label, design: design.clone(), plan });
            }
        }
    }
    Ok(ways)
}

/// All ways on one volunteer; stages that were computed, and all.
fn tried(
    opened: &Opened,
    ways: &[Way],
    wanted: &[Objective],
) -> Result<(Vec<Trial>, [usize; 2]), Failure> {
    let display = Display::new();
    let Opened { study, base, store, .. } = opened;
    let options = Options::default();
    let drive = Drive { store, base, options: &options, listener: &display };
    let plans: Vec<_> = ways.iter().map(|way| (way.label.clone(), way.plan.clone())).collect();
    let pass = match store::execute(&drive, |run| graph::squeezes(study, &plans, run)) {
        Ok(pass) => pass,
        // Nothing can be said of her; the others are gone on with.
        Err(Failure::Numerics(why)) => {
            let failed = ways.iter().map(|way| Trial::failed(way, why.clone(), wanted)).collect();
            return Ok((failed, [0, 0]));
        }
        Err(other) => return Err(other),
    };
    let geometry = match &study.mammogram {
        Some(plan) => {
            let unit = Unit::of(plan).map_err(|cause| Failure::BadInput(cause.to_string()))?;
            unit.geometry
        }
        None => Geometry::pristina(PIXEL_MM),
    };
    let trial = |(way, made): (&Way, Result<Squeezed, String>)| match made {
        Ok(made) => {
            let found = Found::load(&made, study.mammogram.as_ref())?;
            let view = in_view(&made.mesh.load()?, &found.compression, &geometry);
            Ok(Trial::of(way, &found, view, wanted))
        }
        Err(why) => Ok(Trial::failed(way, why, wanted)),
    };
    let trials = ways.iter().zip(pass.outcome).map(trial).collect::<Result<_, Failure>>()?;
    let computed = pass.entries.iter().filter(|entry| entry.computed).count();
    Ok((trials, [computed, pass.entries.len()]))
}

fn written(
    arguments: &DesignsArguments,
    ways: &[Way],
    persons: &[Person],
    wanted: &[Objective],
) -> Result<(), Failure> {
    let out = &arguments.out;
    let all = overall(ways.len(), persons, wanted);
    let paired = pairs(ways, persons);
    let (html, figures) = page(ways, persons, &all, &paired, wanted);
    for figure in &figures {
        write(&out.join(&figure.name), &figure.svg)?;
    }
    write(&out.join("designs.csv"), designs_csv(ways, persons, wanted))?;
    write(&out.join("summary.csv"), summary_csv(ways, &all, &paired, wanted))?;
    write(&out.join("designs.html"), html)
}

/// What is said of pairs; the rest is in tables and page.
const TOLD: [&str; 4] =
    ["paddle_peak_pressure_kpa", "paddle_pressure_p95_kpa", "force_n", "nominal_thickness_mm"];

/// The answer: a line for each way, and for each pair of paddles over all volunteers.
fn told(ways: &[Way], persons: &[Person], wanted: &[Objective]) {
    let names: Vec<&str> = wanted.iter().map(|one| one.name).collect();
    let what = if persons.len() > 1 { "medians over the first way" } else { "values" };
    tell!("{what}: {}; * on the Pareto front", names.join(", "));
    let all = overall(ways.len(), persons, wanted);
    for (n, (way, one)) in ways.iter().zip(&all).enumerate() {
        let single = persons.first().filter(|_| persons.len() == 1);
        let (values, on_front) = match single {
            Some(person) => (&person.trials[n].values, person.on_front[n]),
            None => (&one.over_first, one.on_front),
        };
        let values: Vec<String> = values.iter().map(|value| format!("{value:>9.3}")).collect();
        let mark = if on_front { "*" } else { " " };
        let failed: Vec<String> = persons
            .iter()
            .filter_map(|p| Some(format!("{}: {}", p.id, p.trials[n].why_not.as_ref()?)))
            .collect();
        tell!("{mark} {:<20}{}  {}", way.label, values.concat(), failed.join("; "));
    }
    if persons.len() < 2 {
        return;
    }
    for pair in pairs(ways, persons) {
        let (way, against) = (&ways[pair.way].label, &ways[pair.against].label);
        for (what, ratio) in COMPARED.iter().zip(&pair.ratios) {
            let (Some(ratio), true) = (ratio, TOLD.contains(&what.name)) else { continue };
            let [low, high] = ratio.interval.unwrap_or([f64::NAN; 2]);
            tell!(
                "  {way} / {against}: {:<24} {:.3} ({low:.3} to {high:.3}), lower on {} of {}",
                what.name,
                ratio.mean,
                ratio.lower,
                ratio.persons
            );
        }
    }
}
