//! Comparisons as one page that needs no other file.

use super::{
    Agreement, Difference, Found, ThesisStudy, Way, deviations_of_each, deviations_stated,
    differences, shift_to_wall, trends,
};
use crate::page::{FIGURES_AND_TABLES, begin, give_or_take, number, table};
use mammotwin_data::{mesh::Patch, surface::TriMesh};
use mammotwin_stages::{
    comfort::PressureMat,
    report::{
        chart::{Axis, Chart, Line, lines},
        escaped,
        palette::Palette,
        raster::Raster,
        surface::{Camera, draw},
    },
};
use std::fmt::Write;

/// Size of a pixel (mm) in maps of the skin.
const MAP_MM: f64 = 0.5;
/// Pixels of a sensor's edge, and of a length bar (mm).
const SENSOR_PIXELS: usize = 12;
const BAR_MM: f64 = 50.0;

/// Metrics of the table, with their headings.
const SHOWN: [(&str, &str); 31] = [
    ("thickness_mm", "thickness (mm)"),
    ("nominal_thickness_mm", "nominal thickness (mm)"),
    ("deflection_mm", "deflection (mm)"),
    ("bulge_mm", "bulge beside or in the paddle (mm)"),
    ("force_n", "force (N)"),
    ("contact_area_cm2", "contact area, face (cm²)"),
    ("front_area_cm2", "contact area, front (cm²)"),
    ("edge_area_cm2", "contact area, other edges (cm²)"),
    ("mean_pressure_kpa", "mean pressure (kPa)"),
    ("peak_pressure_kpa", "largest pressure, fronts and edges too (kPa)"),
    ("pressure_p95_kpa", "pressure, 95 % of area (kPa)"),
    ("paddle_peak_pressure_kpa", "largest pressure, paddle's face (kPa)"),
    ("paddle_pressure_p95_kpa", "pressure, 95 % of paddle's face (kPa)"),
    ("face_peak_pressure_kpa", "largest pressure, faces of both plates (kPa)"),
    ("front_peak_pressure_kpa", "largest pressure, fronts (kPa)"),
    ("edge_peak_pressure_kpa", "largest pressure, other edges (kPa)"),
    ("juxtathoracic_share", "juxtathoracic share of force"),
    ("mat_contact_area_cm2", "mat: contact area (cm²)"),
    ("mat_peak_kpa", "mat: largest (kPa)"),
    ("von_mises_p95_kpa", "von Mises, 95 % of volume (kPa)"),
    ("smallest_stress_p05_kpa", "smallest principal stress, 5 % of volume (kPa)"),
    ("smallest_strain_p05", "smallest logarithmic strain, 5 % of volume"),
    ("stretch_rear_p95", "largest stretch, rear third, 95 %"),
    ("clamp_force_start_n", "clamping begins: force (N)"),
    ("clamp_force_end_n", "clamping ends: force (N)"),
    ("clamp_thickness_end_mm", "clamping ends: thickness (mm)"),
    ("clamp_energy_lost_mj", "work not given back (mJ)"),
    ("snr_300um_mean", "SNR, 300 µm"),
    ("sdnr_200um_mean", "SDNR, 200 µm"),
    ("sdnr_300um_mean", "SDNR, 300 µm"),
    ("agd_mgy", "average glandular dose (mGy)"),
];

/// A file that goes with the page.
#[derive(Debug)]
pub struct Figure {
    /// Name of the file.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// SVG text or PNG bytes.
    pub bytes: Vec<u8>,
    /// As an element of a page.
    element: String,
}

/// The page and its figures; beside what the thesis has, where it is one of its studies.
pub fn page(
    subject: &str,
    study: Option<ThesisStudy>,
    ways: &[Way],
    stated: &str,
    juxtathoracic_mm: f64,
) -> (String, Vec<Figure>) {
    let title = match study {
        Some(ThesisStudy::Paddles) => "One breast under several paddles",
        Some(ThesisStudy::Positions) => "One breast, the paddle at several distances",
        None => "Compressions of several studies",
    };
    let figures = figures(study, ways);
    let mut html = begin(title, subject, FIGURES_AND_TABLES);
    let found: Vec<(&Way, &Found)> =
        ways.iter().filter_map(|way| Some((way, way.found.as_ref().ok()?))).collect();
    // Writing to a string does not fail.
    for way in ways {
        match &way.found {
            Err(why) => {
                let _ = writeln!(html, "<p><b>{}</b> failed: {}</p>", way.label, escaped(why));
            }
            Ok(found) => {
                if let Some(why) = &found.compression.stopped_early {
                    let label = &way.label;
                    let why = escaped(why);
                    let _ = writeln!(html, "<p><b>{label}</b> ended early: {why}</p>");
                }
            }
        }
    }
    html += "<h2>Ours</h2>\n";
    let mut head = vec![String::new()];
    head.extend(found.iter().map(|(way, _)| way.label.clone()));
    let ended = found.iter().map(|(_, f)| f.compression.met.clone().unwrap_or("–".into()));
    let mut rows = vec![[vec!["ended by".to_owned()], ended.collect()].concat()];
    for (name, words) in SHOWN {
        if found.iter().any(|(_, f)| f.metric(name).is_finite()) {
            let values = found.iter().map(|(_, f)| give_or_take(f.metric(name), f.sd(name)));
            rows.push([vec![words.to_owned()], values.collect()].concat());
        }
    }
    html += &table(&head, &rows);
    for line in stated.lines() {
        let _ = writeln!(html, "<p>{}</p>", escaped(line));
    }
    let said = found.iter().filter_map(|(way, f)| Some((&*way.label, f.deviations.as_deref()?)));
    let said = match study {
        Some(_) => deviations_stated(said),
        // Other persons, or other fits.
        None => deviations_of_each(said),
    };
    if !said.is_empty() {
        let _ = writeln!(html, "<p>{}</p>", escaped(&said));
    }
    if let Some(study) = study {
        html += "<h2>The thesis</h2>\n";
        let (head, rows) = study.table();
        html += &table(&head, &rows);
        let _ = writeln!(html, "<p>{}</p>", escaped(study.caption()));
    }
    html += "<h2>Published compressions</h2>\n";
    let rows: Vec<Vec<String>> =
        trends::agreements(&found, juxtathoracic_mm).iter().map(agreement).collect();
    let head = ["what", "published", "way", "ours", "agrees?", "source"].map(String::from);
    html += &table(&head, &rows);
    let said = trends::caption(&found, juxtathoracic_mm);
    let _ = writeln!(html, "<p>{}</p>", escaped(&said));
    html += "<h2>Figures</h2>\n";
    for figure in &figures {
        let (element, title) = (&figure.element, escaped(&figure.title));
        let _ = writeln!(html, "<figure>{element}<figcaption>{title}</figcaption></figure>");
    }
    if let Some(((base, first), others)) = found.split_first() {
        let _ = writeln!(html, "<h2>Against {}</h2>", base.label);
        html += "<p>Effect size: difference of means over the pooled standard deviation. Overlap: \
                 common part of both distributions. p: Welch; Mann and Whitney, over regions of interest only; \
                 elements and sensors of one body are no independent samples.</p>\n";
        html += &differences_table(first, others);
    }
    html += "</body></html>\n";
    (html, figures)
}

/// A row of the table of agreement.
fn agreement(one: &Agreement) -> Vec<String> {
    let agrees = one.agrees.map_or("cannot be compared", |yes| if yes { "yes" } else { "no" });
    let Agreement { what, published, way, ours, source, .. } = one;
    [what, published, way, ours, agrees, source].map(ToString::to_string).to_vec()
}

fn differences_table(first: &Found, others: &[(&Way, &Found)]) -> String {
    let head = ["", "what", "first", "here", "difference", "effect size", "overlap", "p"];
    let mut rows = Vec::new();
    for (way, other) in others {
        for Difference { what, comparison: c, p } in differences(first, other) {
            rows.push(vec![
                way.label.clone(),
                what,
                number(c.means[0]),
                number(c.means[1]),
                number(c.difference),
                number(c.effect_size),
                number(c.overlap),
                p.map(|p| p.map_or("–".into(), |p| format!("{p:.3}"))).join("; "),
            ]);
        }
        if let Some([most, p95]) = shift_to_wall(&first.compression, &other.compression) {
            let mut row = vec![way.label.clone()];
            row.push("tissue nearer to the chest wall (mm): largest; 95 %".into());
            let both = format!("{}; {}", number(most), number(p95));
            row.extend(["–".into(), "–".into(), both]);
            row.extend(["–", "–", "–"].map(String::from));
            rows.push(row);
        }
    }
    table(&head.map(String::from), &rows)
}

fn figures(study: Option<ThesisStudy>, ways: &[Way]) -> Vec<Figure> {
    let found: Vec<(&Way, &Found)> =
        ways.iter().filter_map(|way| Some((way, way.found.as_ref().ok()?))).collect();
    // Courses of more than a handful of ways cannot be told apart: those of the first paddle.
    let drawn: Vec<(&Way, &Found)> = match (study, found.first()) {
        (Some(ThesisStudy::Positions), Some((first, _))) => {
            found.iter().copied().filter(|(way, _)| way.plan.paddle == first.plan.paddle).collect()
        }
        _ => found.clone(),
    };
    let mut all = Vec::new();
    let mut add = |name: &str, chart: Chart| {
        let svg = lines(&chart);
        let (title, element) = (chart.title, svg.clone());
        all.push(Figure { name: name.into(), title, bytes: svg.into_bytes(), element });
    };
    let course = |title: &str, y: &str, of: &dyn Fn(&Found) -> Vec<f64>| {
        let line = |(way, f): &(&Way, &Found)| {
            let along = f.compression.curve.thickness_mm.iter().copied();
            Line { name: way.label.clone(), points: along.zip(of(f)).collect() }
        };
        chart(title, "thickness (mm)", y, drawn.iter().map(line).collect(), Axis::Falling)
    };
    let of = |f: &Found| f.compression.curve.force_n.clone();
    add("force.svg", course("Force against thickness", "force (N)", &of));
    if let Some(chart) = trends::chart(&drawn) {
        add("thickness_by_force.svg", chart);
    }
    let of = |f: &Found| f.compression.curve.paddle_peak_pressure_kpa.clone();
    add(
        "peak_pressure.svg",
        course("Largest pressure of the paddle's face against thickness", "pressure (kPa)", &of),
    );
    let by_force = |(way, f): &(&Way, &Found)| {
        let curve = &f.compression.curve;
        let along = curve.force_n.iter().copied();
        let points = along.zip(curve.paddle_peak_pressure_kpa.iter().copied()).collect();
        Line { name: way.label.clone(), points }
    };
    let (title, pressure) =
        ("Largest pressure of the paddle's face at the same force", "pressure (kPa)");
    let all_ways = drawn.iter().map(by_force).collect();
    add("peak_by_force.svg", chart(title, "force (N)", pressure, all_ways, Axis::Rising));
    let of = |f: &Found| f.compression.curve.mean_pressure_kpa.clone();
    let title = "Mean pressure of the paddle's face against thickness";
    add("mean_pressure.svg", course(title, "pressure (kPa)", &of));
    let of = |f: &Found| f.compression.curve.deflection_mm.clone();
    if drawn.iter().any(|(_, f)| gives_way_mm(f) > 0.0) {
        add("deflection.svg", course("What the paddle gives way", "deflection (mm)", &of));
    }
    if drawn.iter().any(|(_, f)| f.course.is_some()) {
        let line = |(way, f): &(&Way, &Found)| {
            let course = f.course.as_ref()?;
            let points = course.time_s.iter().copied().zip(course.force_n.iter().copied());
            Some(Line { name: way.label.clone(), points: points.collect() })
        };
        let all = drawn.iter().filter_map(line).collect();
        let title = "Force in time: closing, clamping, opening";
        add("force_in_time.svg", chart(title, "time (s)", "force (N)", all, Axis::Rising));
    }
    if study == Some(ThesisStudy::Positions) {
        type ByDistance = (&'static str, fn(&Found) -> f64, &'static str, &'static str);
        let by_distance: [ByDistance; 3] = [
            ("force_by_distance.svg", |f| f.metric("force_n"), "Force at the end", "force (N)"),
            (
                "pressure_by_distance.svg",
                |f| f.metric("paddle_peak_pressure_kpa"),
                "Largest pressure of the paddle's face at the end",
                "pressure (kPa)",
            ),
            (
                "deflection_by_distance.svg",
                gives_way_mm,
                "What the paddle gives way at the end",
                "deflection (mm)",
            ),
        ];
        for (file, value, title, y) in by_distance {
            if found.iter().all(|(_, f)| value(f) == 0.0) {
                continue;
            }
            let mut by_paddle: Vec<Line> = Vec::new();
            for (way, f) in &found {
                let name = way.plan.paddle.name();
                let point = (way.plan.chest_wall_distance_mm, value(f));
                match by_paddle.iter_mut().find(|line| line.name == name) {
                    Some(line) => line.points.push(point),
                    None => by_paddle.push(Line { name: name.into(), points: vec![point] }),
                }
            }
            add(file, chart(title, "chest wall to paddle (mm)", y, by_paddle, Axis::Falling));
        }
    }
    // One scale for all maps, so that they compare.
    let pressures: Vec<f64> = found
        .iter()
        .flat_map(|(_, f)| f.compression.contact_pressure_kpa.iter().copied())
        .filter(|pressure| *pressure > 0.0)
        .collect();
    let range = Palette::Sequential.range(&pressures);
    let mats: Vec<PressureMat> =
        found.iter().map(|(_, f)| PressureMat::under_paddle(&f.compression, 5.0, 0.0)).collect();
    let shown: Vec<f64> = mats.iter().flat_map(|mat| mat.pressure_kpa.iter().copied()).collect();
    let mat_range = Palette::Sequential.range(&shown);
    for ((way, f), mat) in found.iter().zip(&mats) {
        let title = format!(
            "{}: pressure of both plates on the skin, from above, 0 to {} kPa; the chest wall below",
            way.label, range[1]
        );
        all.push(picture(&format!("skin_{}.png", way.label), title, &skin_map(f, range)));
        let title = format!(
            "{}: pressure mat under the paddle, 5 mm, 0 to {} kPa; the chest wall below",
            way.label, mat_range[1]
        );
        all.push(picture(&format!("mat_{}.png", way.label), title, &mat_map(mat, mat_range)));
    }
    all
}

/// How far (mm) the paddle gives way at the end.
fn gives_way_mm(found: &Found) -> f64 {
    found.compression.curve.deflection_mm.last().copied().unwrap_or(0.0)
}

fn chart(title: &str, x: &str, y: &str, lines: Vec<Line>, x_axis: Axis) -> Chart {
    Chart {
        title: title.into(),
        caption: String::new(),
        x_label: x.into(),
        y_label: y.into(),
        lines,
        marks: Vec::new(),
        x_axis,
    }
}

fn picture(name: &str, title: String, raster: &Raster) -> Figure {
    let element = format!("<img alt=\"\" src=\"{}\">", raster.data_uri());
    Figure { name: name.into(), title, bytes: raster.png(), element }
}

fn skin_map(found: &Found, range: [f64; 2]) -> Raster {
    let c = &found.compression;
    let triangles = c.mesh.patch(Patch::Skin).to_vec();
    let skin = TriMesh { points: c.solution.points.clone(), triangles };
    let scale = (Palette::Sequential, range);
    draw(&skin, &c.contact_pressure_kpa, scale, Camera::Above, MAP_MM, BAR_MM)
}

/// The mat from above: x to the right, away from the chest wall upwards.
fn mat_map(mat: &PressureMat, range: [f64; 2]) -> Raster {
    let [columns, rows] = mat.size;
    let (width, height) = ((columns * SENSOR_PIXELS).max(2), (rows * SENSOR_PIXELS).max(2));
    let mut raster = Raster::filled(width, height, [255, 255, 255]);
    for row in 0..rows * SENSOR_PIXELS {
        for column in 0..columns * SENSOR_PIXELS {
            let sensor = [column / SENSOR_PIXELS, rows - 1 - row / SENSOR_PIXELS];
            let pressure = mat.pressure_kpa[sensor[1] * columns + sensor[0]];
            let border = row % SENSOR_PIXELS == 0 || column % SENSOR_PIXELS == 0;
            let value = if pressure > 0.0 { pressure } else { f64::NAN };
            if !border {
                raster.pixels[row * width + column] = Palette::Sequential.color(value, range);
            }
        }
    }
    raster
}
