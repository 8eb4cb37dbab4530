//! `mammotwin map`: a place of tissue in all poses, between the plates and on the mammogram.

use super::{Opened, open, run::plan};
use crate::{
    cli::MapArguments,
    display::Display,
    map::{Body, Mapped, Row, stiffer},
};
use mammotwin_data::{
    Failure, Vec3,
    io::landmarks,
    labels::Side,
    store::{self, Drive, Options},
};
use mammotwin_stages::place::Shapes;
use serde_json::json;

/// Prints where a place is.
pub fn map(arguments: &MapArguments) -> Result<(), Failure> {
    if !(arguments.step_mm >= 0.1 && arguments.step_mm <= 100.0) {
        return Err(Failure::Usage("--step-mm: give 0.1 to 100".into()));
    }
    let opened = open(&arguments.study)?;
    let command = format!("mammotwin run {}", arguments.study.study.display());
    let options = Options::default();
    let outcome = plan(&opened, &options)?.outcome;
    let mut body = Body::load(&opened.study, &opened.base, &command, &outcome)?;
    let from = body.shape(&arguments.from)?;
    let asked = asked(arguments, &opened, &body)?;
    let points: Vec<Vec3> = asked.iter().map(|(_, point)| *point).collect();
    // Whether the point is in the breast at all is known at once; the spread may take minutes.
    let found = body.map(&from, &points);
    if let ([Err(error)], [(name, _)]) = (&found[..], &asked[..]) {
        let name = name.as_deref().unwrap_or("the point");
        return Err(Failure::BadInput(format!("{name} of {}: {error}", arguments.from)));
    }
    let precision = outcome.calibration.load()?.precision;
    let unknown = [Side::Right, Side::Left].iter().all(|side| precision.of_side(*side).is_none());
    let found = if arguments.quick || unknown {
        found
    } else {
        let display = Display::new();
        let drive = Drive {
            store: &opened.store,
            base: &opened.base,
            options: &options,
            listener: &display,
        };
        let pass = store::execute(&drive, |run| stiffer(&opened.study, run))?;
        let (fit, pressed) = pass.outcome;
        let pressed = pressed.map(|pressed| pressed.load()).transpose()?;
        body.stiffer = Some(Shapes::of(&fit.load()?.after, pressed.as_ref()));
        body.map(&from, &points)
    };
    let (mut placed, mut unplaced) = (Vec::new(), Vec::new());
    for ((name, given), found) in asked.into_iter().zip(found) {
        match (found, name) {
            (Ok(mapped), name) => placed.push((name, given, mapped)),
            (Err(error), Some(name)) => unplaced.push((name, error.to_string())),
            // A point of a line that leaves the breast.
            (Err(_), None) => {}
        }
    }
    if arguments.json {
        let places = placed.iter().map(
            |(name, given, mapped)| json!({ "name": name, "given_mm": given, "places": mapped }),
        );
        let unplaced = unplaced.iter().map(|(name, why)| json!({ "name": name, "why": why }));
        let answer = json!({
            "from": arguments.from,
            "reference": body.reference,
            "points": places.collect::<Vec<_>>(),
            "unplaced": unplaced.collect::<Vec<_>>(),
            "sources": body.sources(),
        });
        tell!("{answer:#}");
    } else {
        for (name, given, mapped) in &placed {
            print(&arguments.from, name.as_deref(), given, mapped);
        }
        unplaced.iter().for_each(|(name, why)| tell!("{name}: {why}"));
        body.sources().iter().for_each(|source| tell!("{source}"));
    }
    Ok(())
}

/// The places that are asked for: with their names, but for those of a line.
fn asked(
    arguments: &MapArguments,
    opened: &Opened,
    body: &Body,
) -> Result<Vec<(Option<String>, Vec3)>, Failure> {
    let is_picture = arguments.from == "mammogram";
    if let Some(file) = arguments.points.as_ref().filter(|_| !is_picture) {
        let marks = landmarks::read(file)?.0.into_iter();
        return Ok(marks.map(|(name, point)| (Some(name), point)).collect());
    }
    let pose = opened.study.poses.get(&arguments.from);
    match (&arguments.point, &arguments.landmark, &arguments.pixel) {
        (Some(text), _, _) if !is_picture => {
            Ok(vec![(Some(text.clone()), Vec3::from(numbers("--point", text)?))])
        }
        (_, Some(name), _) if pose.is_some() => {
            let path = pose.and_then(|pose| pose.landmarks.as_ref()).ok_or_else(|| {
                Failure::BadInput(format!("--landmark: poses.{} has none", arguments.from))
            })?;
            let marks = landmarks::read(&opened.base.join(path))?;
            let point = marks.0.get(name).ok_or_else(|| {
                let known = marks.0.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                Failure::Usage(format!("--landmark {name}: no such one; there are: {known}"))
            })?;
            Ok(vec![(Some(name.clone()), *point)])
        }
        (_, _, Some(text)) if is_picture => {
            let line = body.line(numbers("--pixel", text)?, arguments.step_mm)?;
            Ok(line.into_iter().map(|point| (None, point)).collect())
        }
        _ => {
            let text = "give --point, --points or --landmark with a pose, --point or --points with \
                        compressed, --pixel with mammogram";
            Err(Failure::Usage(text.into()))
        }
    }
}

/// So many numbers between commas.
fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N], Failure> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let finite = parsed.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    finite.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        Failure::Usage(format!("{option} {text}: give {N} numbers with commas between them"))
    })
}

fn print(from: &str, name: Option<&str>, given: &Vec3, mapped: &Mapped) {
    let Mapped { side, outside_mm, rows, mammogram } = mapped;
    let near = if *outside_mm > 0.0 {
        format!(", {outside_mm:.1} mm outside of the tissue: its surface is taken")
    } else {
        String::new()
    };
    tell!(
        "{}({:.1}, {:.1}, {:.1}) mm of {from}: {side} breast{near}",
        name.map_or_else(String::new, |name| format!("{name}: ")),
        given.x,
        given.y,
        given.z,
    );
    tell!(
        "{:14}{:>10}{:>10}{:>10}  {:>8}{:>8}{:>8}{:>14}  frame",
        "shape",
        "x (mm)",
        "y (mm)",
        "z (mm)",
        "sd (mm)",
        "moduli",
        "model",
        "registration"
    );
    for Row { shape, frame, mm, spread, .. } in rows {
        let moduli = spread.moduli_mm.map_or("-".into(), |mm| format!("{mm:.2}"));
        tell!(
            "{shape:14}{:>10.2}{:>10.2}{:>10.2}  {:>8.2}{moduli:>8}{:>8.2}{:>14.2}  {frame}",
            mm.x,
            mm.y,
            mm.z,
            spread.total_mm,
            spread.model_mm,
            spread.registration_mm
        );
    }
    match mammogram {
        Some(shadow) => tell!(
            "mammogram     column {:.1}, row {:.1}; {:.2}, {:.2} mm on the detector; sd {:.2} mm{}",
            shadow.pixel[0],
            shadow.pixel[1],
            shadow.detector_mm[0],
            shadow.detector_mm[1],
            shadow.spread_mm,
            if shadow.on_detector { "" } else { "; beside the detector" }
        ),
        None => tell!("mammogram     none"),
    }
    tell!();
}
