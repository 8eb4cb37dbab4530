//! Tables, figures and one page of a sensitivity study.

use super::{
    ErrorMap,
    profiles::{self, profiles},
};
use crate::page::begin;
use mammotwin_data::study::Study;
use mammotwin_solver::unload;
use mammotwin_stages::{
    report::{
        chart::{Axis, Chart, Line, lines},
        heat::{HeatMap, HeatPanel, heat},
    },
    sensitivity::{ErrorPoint, Errors, Moved, Parameter, Swept},
};
use std::fmt::Write;

/// What the thesis says of its figures 3.15 - 3.17.
const THESIS: &str = "The thesis: Poisson's ratio hardly matters (0.49 was kept); where more stiffness \
    changes the displacements by less than 20 % (about 5 mm) in all, 10 % (2.5 mm) for the fascia, the \
    intervals were cut: breast 0.3 - 4, skin 2 - 20, fascia 50 - 250 kPa. Its map has its least distances at \
    0.3 (right), 0.2 (left), 4 and 120 kPa (supine 1.72, prone 2.17 mm); many of its points failed.";

fn cell(value: Option<f64>) -> String {
    value.map(|v| format!("{v:.4}")).unwrap_or_default()
}

/// Displacements over each parameter as CSV.
pub fn sweeps(all: &[Swept]) -> String {
    let mut text = String::from(
        "parameter,value,mean_displacement_mm,max_displacement_mm,change_mm,total_change_mm,failed\n",
    );
    for swept in all {
        for step in &swept.steps {
            let of = |pick: fn(&Moved) -> Option<f64>| cell(step.moved.as_ref().and_then(pick));
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{}",
                swept.parameter.name(),
                step.value,
                of(|m| Some(m.mean_mm)),
                of(|m| Some(m.max_mm)),
                of(|m| m.change_mm),
                of(|m| Some(m.total_change_mm)),
                words(step.failed.as_ref())
            );
        }
    }
    text
}

/// Errors of all points as CSV, a line for each pose of each point.
pub fn errors(map: &ErrorMap, rows: &[Errors]) -> String {
    let mut text = String::from(
        "skin_kpa,fascia_kpa,breast_kpa,pose,modified_hausdorff_mm,max_mm,mean_right_mm,mean_left_mm,\
         round_trip_mm,failed\n",
    );
    for ([skin, fascia], Errors(points)) in map.rows.iter().zip(rows) {
        for point in points {
            let place = format!("{skin},{fascia},{}", point.breast_kpa);
            if point.poses.is_empty() {
                let _ = writeln!(text, "{place},,,,,,,{}", words(point.failed.as_ref()));
            }
            for pose in &point.poses {
                let _ = writeln!(
                    text,
                    "{place},{},{:.4},{:.4},{},{},{},",
                    pose.pose,
                    pose.modified_hausdorff_mm,
                    pose.max_mm,
                    cell(pose.mean_mm[0]),
                    cell(pose.mean_mm[1]),
                    cell(point.round_trip_mm)
                );
            }
        }
    }
    text
}

/// A reason in one cell of a table.
fn words(text: Option<&String>) -> String {
    text.map(|text| text.replace([',', '\n'], ";")).unwrap_or_default()
}

/// The page, and its figures by their file names.
pub fn page(
    study: &Study,
    swept: &[Swept],
    map: &ErrorMap,
    rows: &[Errors],
) -> (String, Vec<(String, String)>) {
    let title = "How much depends on the tissues";
    let style = "figure{display:inline-block;margin:.5em;vertical-align:top}\
                 figure.half svg{width:500px;height:auto}figure svg{max-width:100%;height:auto}\
                 figcaption{font-size:14px;color:#444}";
    let mut html = begin(title, &study.subject.id, style);
    if study.model.interface.is_bonded() {
        html += "<p>The breast is bonded to the chest wall here: its fascia moves nothing.</p>\n";
    }
    let mut figures = Vec::new();
    html += "<h2>Gravity from behind on the reference pose</h2>\n<p>The reference pose is taken for \
             stress-free. Change: largest change of a node of the skin from one value to the next, and \
             against the value at which the skin moves least, over the largest displacement of all.</p>\n";
    for one in swept {
        for (kind, chart) in [("displacement", displacement(one)), ("change", change(one))] {
            let svg = lines(&chart);
            let caption = &chart.title;
            let _ = writeln!(
                html,
                "<figure class=\"half\">{svg}<figcaption>{caption}</figcaption></figure>"
            );
            figures.push((format!("{}_{kind}.svg", one.parameter.name()), svg));
        }
    }
    if !rows.is_empty() {
        html += "<h2>Error of the model</h2>\n";
        let _ = writeln!(html, "<p>{}</p>", said(map, rows));
        for (name, caption, picture) in maps(map, rows) {
            let svg = heat(&picture);
            let _ = writeln!(html, "<figure>{svg}<figcaption>{caption}</figcaption></figure>");
            figures.push((format!("{name}.svg"), svg));
        }
        let profiles = profiles(map, rows);
        let _ =
            writeln!(html, "<h2>What the poses tell</h2>\n<p>{}</p>", profiles::said(&profiles));
        for (name, svg) in profiles::figures(&profiles) {
            let _ = writeln!(html, "<figure class=\"half\">{svg}</figure>");
            figures.push((name, svg));
        }
    }
    let _ = writeln!(html, "<p>{THESIS}</p></body></html>");
    (html, figures)
}

fn displacement(swept: &Swept) -> Chart {
    let line = |name: &str, of: fn(&Moved) -> f64| Line {
        name: name.into(),
        points: swept.steps.iter().filter_map(|s| Some((s.value, of(s.moved.as_ref()?)))).collect(),
    };
    Chart {
        title: format!("Displacement of the skin over {}", swept.parameter.label()),
        caption: String::new(),
        x_label: swept.parameter.label().into(),
        y_label: "displacement (mm)".into(),
        lines: vec![line("largest", |m| m.max_mm), line("mean", |m| m.mean_mm)],
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}

fn change(swept: &Swept) -> Chart {
    let moved = || swept.steps.iter().filter_map(|step| Some((step.value, step.moved.as_ref()?)));
    let largest = moved().map(|(_, m)| m.max_mm).fold(f64::MIN_POSITIVE, f64::max);
    let percent = |mm: f64| 100.0 * mm / largest;
    let line = |name: &str, of: fn(&Moved) -> Option<f64>| Line {
        name: name.into(),
        points: moved().filter_map(|(value, m)| Some((value, percent(of(m)?)))).collect(),
    };
    Chart {
        title: format!("Change of the displacement over {}", swept.parameter.label()),
        caption: String::new(),
        x_label: swept.parameter.label().into(),
        y_label: "change (%)".into(),
        lines: vec![
            line("from one value to the next", |m| m.change_mm),
            line("in all", |m| Some(m.total_change_mm)),
        ],
        marks: Vec::new(),
        x_axis: Axis::Rising,
    }
}

/// All points with their skin and fascia.
fn points<'a>(
    map: &'a ErrorMap,
    rows: &'a [Errors],
) -> impl Iterator<Item = ([f64; 2], &'a ErrorPoint)> {
    map.rows.iter().zip(rows).flat_map(|(row, errors)| errors.0.iter().map(|p| (*row, p)))
}

/// How many points failed, and where each pose is met best.
fn said(map: &ErrorMap, rows: &[Errors]) -> String {
    let count = points(map, rows).count();
    let failed = points(map, rows).filter(|(_, p)| p.failed.is_some()).count();
    let mut text = format!(
        "{count} sets of moduli; the model has no equilibrium with {failed} of them. Both breasts have one \
         modulus at each point; as each moves its own skin, the distances of a side are those of its own \
         modulus. Framed: the least."
    );
    let limits = unload::Options::default();
    let loose = points(map, rows)
        .filter_map(|(_, point)| point.round_trip_mm)
        .filter(|&mm| mm > limits.tolerance_mm);
    let (loose, worst_mm) = loose.fold((0, 0.0), |(n, worst), mm| (n + 1, f64::max(worst, mm)));
    if loose > 0 {
        let _ = write!(
            text,
            " Of {loose} the stress-free shape does not come back to the reference pose within {} mm (rms; at \
             worst {worst_mm:.2} mm): their distances are as uncertain.",
            limits.tolerance_mm
        );
    }
    let mut best: Vec<(&str, [f64; 3], f64)> = Vec::new();
    for ([skin, fascia], point) in points(map, rows) {
        for pose in &point.poses {
            let here =
                (pose.pose.as_str(), [point.breast_kpa, skin, fascia], pose.modified_hausdorff_mm);
            match best.iter_mut().find(|known| known.0 == here.0) {
                Some(known) if here.2 < known.2 => *known = here,
                Some(_) => {}
                None => best.push(here),
            }
        }
    }
    for (pose, [breast, skin, fascia], mm) in best {
        let _ = write!(
            text,
            " Least modified Hausdorff distance, {pose}: {mm:.2} mm at {breast} (breast), {skin} (skin), \
             {fascia} kPa (fascia)."
        );
    }
    text
}

/// Mean distances of each side in each pose, a panel for each fascia: file name, caption, picture.
fn maps(map: &ErrorMap, rows: &[Errors]) -> Vec<(String, String, HeatMap)> {
    let sorted = |of: usize| {
        let mut all: Vec<f64> = map.rows.iter().map(|row| row[of]).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    };
    let (skins, fascias) = (sorted(0), sorted(1));
    let mut poses: Vec<&str> = Vec::new();
    for (_, point) in points(map, rows) {
        for pose in &point.poses {
            if !poses.contains(&pose.pose.as_str()) {
                poses.push(&pose.pose);
            }
        }
    }
    let mut all = Vec::new();
    // The reference pose is met wherever there is a stress-free shape.
    for pose in poses.into_iter().skip(1) {
        for (side, name) in ["right", "left"].into_iter().enumerate() {
            let value = |skin: f64, fascia: f64, breast: f64| {
                let here = points(map, rows)
                    .find(|(row, p)| *row == [skin, fascia] && p.breast_kpa == breast);
                let pose = here.and_then(|(_, p)| p.poses.iter().find(|p| p.pose == pose));
                pose.and_then(|pose| pose.mean_mm[side]).unwrap_or(f64::NAN)
            };
            let panel = |&fascia: &f64| {
                let values = skins
                    .iter()
                    .flat_map(|&skin| map.breast_kpa.iter().map(move |&b| (skin, b)))
                    .map(|(skin, breast)| value(skin, fascia, breast))
                    .collect();
                HeatPanel::least(format!("fascia {fascia} kPa"), values)
            };
            let mut panels: Vec<HeatPanel> = fascias.iter().map(panel).collect();
            let alike = panels.windows(2).all(|pair| same(&pair[0].values, &pair[1].values));
            if let (true, [first, .., last]) = (alike, &fascias[..]) {
                panels.truncate(1);
                panels[0].title = format!("fascia {first} to {last} kPa: all alike");
            }
            let picture = HeatMap {
                x_label: "Young's modulus of the breast (kPa)".into(),
                y_label: "skin (kPa)".into(),
                x: map.breast_kpa.clone(),
                y: skins.clone(),
                panels,
                across: 2,
            };
            let caption =
                format!("{pose}, {name} breast: mean distance (mm) of simulated to measured skin");
            all.push((format!("errors_{pose}_{name}"), caption, picture));
        }
    }
    all
}

/// Whether numbers are the same as far as they are shown.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a.is_nan() && b.is_nan()) || (a - b).abs() < 0.005)
}

/// Parameters that are swept, with the values of the thesis.
pub fn thesis_sweeps() -> Vec<(Parameter, Vec<f64>)> {
    Parameter::ALL.map(|parameter| (parameter, parameter.thesis_values())).to_vec()
}
