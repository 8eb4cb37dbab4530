//! A compression in time, for `results.h5` and for the report.

use crate::{
    clamp::ClampCourse,
    quality::Metrics,
    report::{
        Fact,
        chart::{Axis, Chart, Line, Mark},
    },
};
use mammotwin_data::io::hdf5::{Column, Curve};

/// The course among the numbers of a study; `None` when it follows no time.
pub fn of(metrics: &[Metrics]) -> Option<&ClampCourse> {
    metrics.iter().find_map(|part| part.course.as_ref())
}

/// `/curves/time_course`.
pub fn curve(course: &ClampCourse) -> Curve {
    let column = |name: &str, units: &str, long: &str, values: &[f64]| {
        Column::new(name, units, long, values.to_vec())
    };
    Curve {
        name: "time_course".into(),
        long_name: "Closing, clamping and opening in time".into(),
        along: column("time_s", "s", "Time since the first touch", &course.time_s),
        columns: vec![
            column("thickness_mm", "mm", "Distance of the plates", &course.thickness_mm),
            column("breast_mm", "mm", "Thickness of the breast", &course.breast_mm),
            column("force_n", "N", "Force of the paddle", &course.force_n),
            column(
                "elastic_force_n",
                "N",
                "Force after endless time at this thickness",
                &course.elastic_force_n,
            ),
            column(
                "mean_pressure_kpa",
                "kPa",
                "Force over the contact area at this thickness",
                &course.mean_pressure_kpa,
            ),
        ],
    }
}

/// What clamping does, in a line.
pub fn fact(course: &ClampCourse) -> Fact {
    let [from, to] = course.clamp.map(|n| course.force_n[n]);
    let [start, end] = course.clamp.map(|n| course.time_s[n]);
    Fact::new("Clamped", format!("{:.1} s, {from:.2} N to {to:.2} N", end - start))
}

/// Force and thickness in time, and the loop of both.
pub fn charts(course: &ClampCourse) -> Vec<Chart> {
    let [begin, end] = course.clamp;
    let points = |x: &[f64], y: &[f64]| -> Vec<(f64, f64)> {
        x.iter().copied().zip(y.iter().copied()).collect()
    };
    let marks = |y: &[f64]| -> Vec<Mark> {
        [("clamping begins", begin), ("release begins", end)]
            .map(|(name, n)| Mark { name: name.into(), point: (course.time_s[n], y[n]) })
            .into()
    };
    let line = |name: &str, points| Line { name: name.into(), points };
    let chart = |title: &str, caption: &str, x: &str, y: &str, lines, marks, x_axis| Chart {
        title: title.into(),
        caption: caption.into(),
        x_label: x.into(),
        y_label: y.into(),
        lines,
        marks,
        x_axis,
    };
    // Every second moment: dots would touch.
    let thinned = |points: Vec<(f64, f64)>| points.into_iter().step_by(2).collect::<Vec<_>>();
    let time = &course.time_s;
    let last = course.force_n.len() - 1;
    // From there on the plates are off the breast, and nothing presses.
    let left = (end..=last).find(|n| course.force_n[*n] <= 0.0).unwrap_or(last);
    let caption = "One relaxation function for all tissues. Elastic: what the force would come to at this thickness.";
    let mut all = vec![chart(
        "Force in time",
        caption,
        "time (s)",
        "force (N)",
        vec![
            line("force", thinned(points(time, &course.force_n))),
            line("elastic", thinned(points(&time[..=left], &course.elastic_force_n[..=left]))),
        ],
        marks(&course.force_n),
        Axis::Rising,
    )];
    let mut thickness = vec![line("plates", thinned(points(time, &course.thickness_mm)))];
    if left < last {
        thickness.push(line("breast", points(&time[left..], &course.breast_mm[left..])));
    }
    all.push(chart(
        "Thickness in time",
        "A breast that recovers more slowly than the plates open is left behind.",
        "time (s)",
        "thickness (mm)",
        thickness,
        marks(&course.thickness_mm),
        Axis::Rising,
    ));
    let part =
        |from: usize, to: usize| points(&course.breast_mm[from..=to], &course.force_n[from..=to]);
    all.push(chart(
        "Closing, clamping and opening",
        "The area between the lines is the work that the breast does not give back.",
        "thickness (mm)",
        "force (N)",
        vec![
            line("closing", part(0, begin)),
            line("clamped", part(begin, end)),
            line("opening", part(end, left)),
        ],
        Vec::new(),
        Axis::Falling,
    ));
    all
}
