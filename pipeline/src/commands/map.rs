//! `mammotwin map`: a place of tissue in all poses, between the plates and on the mammogram.

use super::{open, run::plan};
use crate::{
    cli::MapArguments,
    display::Display,
    map::{Body, Mapped, Row, stiffer},
};
use mammotwin_data::{
    Failure, Vec3,
    io::landmarks,
    store::{self, Drive, Options},
};
use mammotwin_stages::place::Unplaced;
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
    let is_pose = opened.study.poses.get(&arguments.from);
    let is_picture = arguments.from == "mammogram";
    let points = match (&arguments.point, &arguments.landmark, &arguments.pixel) {
        (Some(text), _, _) if !is_picture => vec![Vec3::from(numbers("--point", text)?)],
        (_, Some(name), _) if is_pose.is_some() => {
            let path = is_pose.and_then(|pose| pose.landmarks.as_ref()).ok_or_else(|| {
                Failure::BadInput(format!("--landmark: poses.{} has none", arguments.from))
            })?;
            let marks = landmarks::read(&opened.base.join(path))?;
            let point = marks.0.get(name).ok_or_else(|| {
                let known = marks.0.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                Failure::Usage(format!("--landmark {name}: no such one; there are: {known}"))
            })?;
            vec![*point]
        }
        (_, _, Some(text)) if is_picture => {
            body.line(numbers("--pixel", text)?, arguments.step_mm)?
        }
        _ => {
            let text = "give --point or --landmark with a pose, --point with compressed, --pixel with mammogram";
            return Err(Failure::Usage(text.into()));
        }
    };
    // Whether the point is in the breast at all is known at once; the spread may take minutes.
    let found = body.map(&from, &points);
    if let [Err(error)] = &found[..] {
        return Err(refused(arguments, error));
    }
    let precision = outcome.calibration.load()?.precision;
    let found = if arguments.quick || precision.right.or(precision.left).is_none() {
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
        body.stiffer = Some(pass.outcome.load()?);
        body.map(&from, &points)
    };
    let found: Vec<(Vec3, Mapped)> =
        points.into_iter().zip(found).filter_map(|(p, found)| Some((p, found.ok()?))).collect();
    if arguments.json {
        let places: Vec<_> = found
            .iter()
            .map(|(given, mapped)| json!({ "given_mm": given, "places": mapped }))
            .collect();
        let answer = json!({ "from": arguments.from, "reference": body.reference, "points": places, "sources": body.sources() });
        tell!("{answer:#}");
    } else {
        found.iter().for_each(|(given, mapped)| print(arguments, given, mapped));
        body.sources().iter().for_each(|source| tell!("{source}"));
    }
    Ok(())
}

fn refused(arguments: &MapArguments, error: &Unplaced) -> Failure {
    let what = arguments.landmark.as_ref().or(arguments.point.as_ref());
    let what = what.map_or("the point", String::as_str);
    Failure::BadInput(format!("{what} of {}: {error}", arguments.from))
}

/// So many numbers between commas.
fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N], Failure> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let finite = parsed.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    finite.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        Failure::Usage(format!("{option} {text}: give {N} numbers with commas between them"))
    })
}

fn print(arguments: &MapArguments, given: &Vec3, mapped: &Mapped) {
    let Mapped { side, outside_mm, rows, mammogram } = mapped;
    let near = if *outside_mm > 0.0 {
        format!(", {outside_mm:.1} mm outside of the tissue: its surface is taken")
    } else {
        String::new()
    };
    tell!(
        "({:.1}, {:.1}, {:.1}) mm of {}: {side} breast{near}",
        given.x,
        given.y,
        given.z,
        arguments.from
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
