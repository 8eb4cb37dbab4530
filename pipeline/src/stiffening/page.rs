//! Tables, figures and one page.

use super::{Both, Course, Grid, Marginal, Measured, Posterior, RecordError};
use crate::page::begin;
use mammotwin_stages::report::{
    chart::{Axis, Chart, Line, lines},
    escaped,
    heat::{HeatMap, HeatPanel, heat},
};
use std::fmt::Write;

/// Cells of the posterior's picture along each axis.
const CELLS: usize = 12;

/// All courses of the grid as CSV.
pub fn course_table(grid: &Grid) -> String {
    let mut text = String::from("jm,chest_wall_distance_mm,thickness_mm,force_n\n");
    for (n, course) in grid.courses.iter().enumerate() {
        let jm = grid.jm[n / grid.distance_mm.len()];
        let distance = grid.distance_mm[n % grid.distance_mm.len()];
        for (h, f) in course.iter().flat_map(|c| c.thickness_mm.iter().zip(&c.force_n)) {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{jm},{distance},{h:.3},{f:.6}");
        }
    }
    text
}

/// The posterior as CSV.
pub fn posterior_table(posterior: &Posterior) -> String {
    let mut text = String::from("jm,chest_wall_distance_mm,weight\n");
    for (n, weight) in posterior.weights.iter().enumerate() {
        let jm = posterior.jm[n / posterior.distance_mm.len()];
        let distance = posterior.distance_mm[n % posterior.distance_mm.len()];
        let _ = writeln!(text, "{jm:.5},{distance:.4},{weight:.6e}");
    }
    text
}

fn interval(m: Marginal, unit: &str) -> String {
    let [low, high] = m.interval;
    format!("{:.2}{unit} (median; 90 % between {low:.2} and {high:.2}{unit})", m.median)
}

/// What the record tells, and what it does not, in sentences.
pub fn said(posterior: &Posterior, record: &[Measured], error: &RecordError) -> Vec<String> {
    let mut all = vec![
        format!("Jₘ: {}.", interval(posterior.jm(), "")),
        format!("Paddle's edge from the chest wall: {}.", interval(posterior.distance(), " mm")),
        format!(
            "Correlation of ln Jₘ and the distance: {:.2}; deviations of the best point: {:.1} standard \
             deviations (rms of {} points), the errors being {:.0} % and {} N of a force, {} mm of a \
             thickness, {:.0} % of all forces of the model alike and {:.0} % of those over 5 mm of thickness.",
            posterior.correlation(),
            posterior.misfit,
            record.len(),
            100.0 * error.force_part,
            error.force_n,
            error.thickness_mm,
            100.0 * error.model_part,
            100.0 * error.bent_part
        ),
    ];
    let [jm, distance] = posterior.limited();
    for (limited, what, option) in [(jm, "Jₘ", "--jm"), (distance, "the distance", "--distances")]
    {
        if limited {
            all.push(format!(
                "The record does not tell {what}: its interval ends where the values that were tried end \
                 ({option})."
            ));
        }
    }
    if posterior.correlation().abs() > 0.8 {
        all.push(
            "Record and model tell a combination of both only: a softer limit with a nearer paddle is as \
             good. A second thickness, or a measured distance, would part them."
                .into(),
        );
    }
    if posterior.misfit > 2.0 {
        all.push(
            "No point of the grid is near the record: something else than these two is wrong, and the \
             intervals mean nothing."
                .into(),
        );
    }
    all
}

/// The page, and its figures by their file names.
pub fn page(
    subject: &str,
    grid: &Grid,
    posterior: &Posterior,
    both: Option<&Both>,
    record: &[Measured],
    sentences: &[String],
) -> (String, Vec<(String, String)>) {
    let title = "Jₘ from a record of force and thickness";
    let style = "figure{margin:1em 0}figure svg{max-width:100%;height:auto}\
                 figcaption{font-size:14px;color:#444}";
    let mut html = begin(title, subject, style);
    html += "<ul>\n";
    for sentence in sentences {
        let _ = writeln!(html, "<li>{}</li>", escaped(sentence));
    }
    html += "</ul>\n";
    let mut figures = Vec::new();
    let mut add = |name: &str, caption: &str, svg: String| {
        let _ = writeln!(html, "<figure>{svg}<figcaption>{caption}</figcaption></figure>");
        figures.push((name.to_owned(), svg));
    };
    add(
        "curves.svg",
        "The best point of the posterior, the ends of the Jₘ that were tried at its distance, and the record",
        lines(&curves(grid, posterior, record)),
    );
    add(
        "posterior.svg",
        "Weight (%) of Jₘ and distance; framed: where it is largest",
        heat(&map(posterior)),
    );
    if let Some(both) = both {
        add(
            "both.svg",
            "Weight of Jₘ by the poses under gravity, by the record of the compression, and by both",
            lines(&weights(both)),
        );
    }
    html += "</body></html>\n";
    (html, figures)
}

fn curves(grid: &Grid, posterior: &Posterior, record: &[Measured]) -> Chart {
    let (jm, distance) = (posterior.jm().best, posterior.distance().best);
    let mut thicknesses: Vec<f64> =
        grid.courses.iter().flatten().flat_map(|c: &Course| c.thickness_mm.clone()).collect();
    thicknesses.sort_by(|a, b| b.total_cmp(a));
    let line = |name: String, jm: f64| {
        let at = |&h: &f64| Some((h, grid.force(jm, distance, h)?[0]));
        Line { name, points: thicknesses.iter().filter_map(at).collect() }
    };
    let mut all = vec![line(format!("Jₘ {jm:.2}, {distance:.1} mm"), jm)];
    let ends = [grid.jm.first(), grid.jm.last()];
    all.extend(ends.into_iter().flatten().map(|jm| line(format!("Jₘ {jm}"), *jm)));
    let points = record.iter().map(|m| (m.thickness_mm, m.force_n)).collect();
    all.push(Line { name: "record".into(), points });
    Chart {
        title: "Force over thickness".into(),
        caption: String::new(),
        x_label: "thickness (mm)".into(),
        y_label: "force (N)".into(),
        lines: all,
        marks: Vec::new(),
        x_axis: Axis::Falling,
    }
}

fn weights(both: &Both) -> Chart {
    let line = |name: &str, weights: &[f64]| {
        let most = weights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let points = both.jm.iter().zip(weights).map(|(jm, w)| (jm.recip(), w / most)).collect();
        Line { name: name.into(), points }
    };
    Chart {
        title: "Jₘ of one material".into(),
        caption: String::new(),
        x_label: "1/Jₘ (0: no limit of stretch)".into(),
        y_label: "weight over the largest".into(),
        lines: vec![
            line("poses", &both.poses),
            line("record", &both.record),
            line("both", &both.joint),
        ],
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}

/// The posterior in a few cells.
fn map(posterior: &Posterior) -> HeatMap {
    let coarse = |n: usize, count: usize| n * CELLS.min(count) / count;
    let (rows, columns) = (posterior.jm.len(), posterior.distance_mm.len());
    let (down, across) = (CELLS.min(rows), CELLS.min(columns));
    let mut values = vec![0.0; down * across];
    for (n, weight) in posterior.weights.iter().enumerate() {
        let (row, column) = (coarse(n / columns, rows), coarse(n % columns, columns));
        values[row * across + column] += 100.0 * weight;
    }
    let middle = |axis: &[f64], n: usize| {
        let own: Vec<f64> =
            (0..axis.len()).filter(|&k| coarse(k, axis.len()) == n).map(|k| axis[k]).collect();
        let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
        (100.0 * mean).round() / 100.0
    };
    HeatMap {
        x_label: "paddle's edge from the chest wall (mm)".into(),
        y_label: "Jₘ".into(),
        x: (0..across).map(|n| middle(&posterior.distance_mm, n)).collect(),
        y: (0..down).map(|n| middle(&posterior.jm, n)).collect(),
        panels: vec![HeatPanel::most("Weight (%)".into(), values)],
        across: 1,
    }
}
