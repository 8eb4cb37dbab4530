//! Designs as one page that needs no other file.

use super::{COMPARED, FORCE, Objective, Overall, Pair, Person, Trial, Wanted, Way};
use crate::{
    comparison::deviations_stated,
    page::{FIGURES_AND_TABLES, begin, give_or_take, number, table},
};
use mammotwin_stages::report::{
    escaped,
    scatter::{Dot, Fill, Group, Scatter, scatter},
};
use std::fmt::Write;

/// A file that goes with the page.
#[derive(Debug)]
pub struct Figure {
    /// Name of the file.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// The picture.
    pub svg: String,
}

/// The page and its figures.
pub fn page(
    ways: &[Way],
    persons: &[Person],
    all: &[Overall],
    pairs: &[Pair],
    objectives: &[Objective],
) -> (String, Vec<Figure>) {
    let names: Vec<&str> = persons.iter().map(|person| person.id.as_str()).collect();
    let mut html = begin("Designs of paddles, compared", &names.join(", "), FIGURES_AND_TABLES);
    let first = ways.first().map_or("", |way| way.label.as_str());
    // Writing to a string does not fail.
    let _ = writeln!(
        html,
        "<p>● lies on the Pareto front: nothing else is as good in every column and better in one. Of {} \
         much is wanted, of the others little; the darker a cell, the better in its column. \
         Differences are those of one mesh each: such of a few per cent may be the mesh's. The largest pressure is that of \
         the paddle's face; those of both plates and of upright fronts and edges are in designs.csv{}.</p>",
        objectives
            .iter()
            .filter(|o| o.wanted == Wanted::Most)
            .map(|o| o.words)
            .collect::<Vec<_>>()
            .join(", "),
        if pairs.is_empty() { "" } else { " and in the pairs" }
    );
    let mut meshes: Vec<String> = persons.iter().map(|p| p.mesh_mm.to_string()).collect();
    meshes.dedup();
    let meshes = meshes.join(", ");
    let _ = writeln!(
        html,
        "<p>Elements of {meshes} mm. Forces and pressures depend on them: compare numbers of one size.</p>"
    );
    if objectives.contains(&FORCE) {
        html += "<p>The thickness that is given is the distance of the plates. Under a paddle that rises, bends or tilts the \
                 breast is thicker elsewhere: a given force (--force-n) compares more fairly.</p>\n";
    }
    let figures = figures(ways, persons, all, objectives);
    if persons.len() > 1 {
        let _ = writeln!(
            html,
            "<h2>All volunteers</h2>\n<p>Medians over the volunteers of each value over that of {} on the same \
             person, and on how many of their fronts a way lies.</p>",
            escaped(first)
        );
        html += &overall_table(ways, persons.len(), all, objectives);
        html += &paired_table(ways, pairs);
    }
    for person in persons {
        let _ = writeln!(html, "<h2>{}</h2>", escaped(&person.id));
        html += &person_table(ways, person, objectives);
        let said = ways.iter().zip(&person.trials);
        let said =
            said.filter_map(|(way, trial)| Some((&*way.label, trial.deviations_of.as_deref()?)));
        let said = deviations_stated(said);
        if !said.is_empty() {
            let _ = writeln!(html, "<p>{}</p>", escaped(&said));
        }
    }
    html += "<h2>Figures</h2>\n";
    for figure in &figures {
        let (svg, title) = (&figure.svg, escaped(&figure.title));
        let _ = writeln!(html, "<figure>{svg}<figcaption>{title}</figcaption></figure>");
    }
    html += "</body></html>\n";
    (html, figures)
}

/// Colour of a cell by its place between the worst and the best of its column.
fn shade(value: f64, column: &[f64], wanted: Wanted) -> String {
    let finite = || column.iter().copied().filter(|v| v.is_finite());
    let (low, high) =
        (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    if !value.is_finite() || high <= low {
        return String::new();
    }
    let share = match wanted {
        Wanted::Least => (high - value) / (high - low),
        Wanted::Most => (value - low) / (high - low),
    };
    format!(" style=\"background:rgba(0,94,158,{:.2})\"", 0.4 * share)
}

/// A row: texts before its objectives, their values with one standard deviation, texts after them.
type Row = (Vec<String>, Vec<[f64; 2]>, Vec<String>);

/// A table whose columns of objectives are shaded.
fn shaded(head: &[String], rows: &[Row], objectives: &[Objective]) -> String {
    let mut html = String::from("<table>\n<tr>");
    let cell = |html: &mut String, tag: &str, style: &str, text: &str| {
        let _ = write!(html, "<{tag}{style}>{}</{tag}>", escaped(text));
    };
    head.iter().for_each(|text| cell(&mut html, "th", "", text));
    html += "</tr>\n";
    for (before, values, after) in rows {
        html += "<tr>";
        before.iter().for_each(|text| cell(&mut html, "td", "", text));
        for (n, ([value, sd], objective)) in values.iter().zip(objectives).enumerate() {
            let column: Vec<f64> = rows.iter().map(|row| row.1[n][0]).collect();
            let style = shade(*value, &column, objective.wanted);
            cell(&mut html, "td", &style, &give_or_take(*value, *sd));
        }
        after.iter().for_each(|text| cell(&mut html, "td", "", text));
        html += "</tr>\n";
    }
    html + "</table>\n"
}

fn dot(on_front: bool) -> String {
    if on_front { "●".into() } else { String::new() }
}

fn overall_table(
    ways: &[Way],
    persons: usize,
    all: &[Overall],
    objectives: &[Objective],
) -> String {
    let mut head = vec!["way".to_owned(), "front".into()];
    // Ratios have no unit.
    head.extend(objectives.iter().map(|o| format!("{}, ×", bare(o.words))));
    head.push("on fronts of".into());
    let row = |(way, one): (&Way, &Overall)| {
        let fronts = format!("{} of {persons}", one.fronts);
        let missing = match persons - one.persons {
            0 => fronts,
            missing => format!("{fronts}; not found on {missing}"),
        };
        let values = one.over_first.iter().map(|value| [*value, f64::NAN]).collect();
        (vec![way.label.clone(), dot(one.on_front)], values, vec![missing])
    };
    shaded(&head, &ways.iter().zip(all).map(row).collect::<Vec<_>>(), objectives)
}

/// Each way against the first design at its distance, over the persons.
fn paired_table(ways: &[Way], pairs: &[Pair]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let head = ["way", "against", "what", "ratio", "95 % interval", "volunteers", "lower on"];
    let mut rows = Vec::new();
    for pair in pairs {
        for (what, ratio) in COMPARED.iter().zip(&pair.ratios) {
            let Some(ratio) = ratio else { continue };
            let interval = match ratio.interval {
                Some([low, high]) => {
                    let mark = if ratio.is_clear() { " *" } else { "" };
                    format!("{low:.3} to {high:.3}{mark}")
                }
                None => "–".into(),
            };
            rows.push(vec![
                ways[pair.way].label.clone(),
                ways[pair.against].label.clone(),
                what.words.to_owned(),
                format!("{:.3}", ratio.mean),
                interval,
                ratio.persons.to_string(),
                ratio.lower.to_string(),
            ]);
        }
    }
    format!(
        "<h2>In pairs</h2>\n<p>Each way over the first paddle at the same distance, on the same volunteer: geometric mean \
         of the ratios, with its 95 % interval (Student's t of ln ratio over the volunteers), and on how many the ratio is \
         below one. * the interval holds no 1. The interval is that of these volunteers' spread: errors that all share \
         (law, elements, hinge) are not in it, and of many rows some are marked by chance. Volunteers on whom one of both \
         does not count are left out.</p>\n{}",
        table(&head.map(String::from), &rows)
    )
}

fn person_table(ways: &[Way], person: &Person, objectives: &[Objective]) -> String {
    let mut head = vec!["way".to_owned(), "front".into()];
    head.extend(objectives.iter().map(|o| o.words.to_owned()));
    // What ended the compression is alike for all; the other one of force and thickness is an objective.
    let judged_by_force = objectives.contains(&FORCE);
    let given = if judged_by_force { "thickness (mm)" } else { "force (N)" };
    head.extend([given, "in view (cm³)", "remark"].map(String::from));
    let trials = ways.iter().zip(&person.trials).zip(&person.on_front);
    let row = |((way, trial), on_front): ((&Way, &Trial), &bool)| {
        let given = if judged_by_force { trial.thickness_mm } else { trial.force_n };
        let given_sd = trial.sd(if judged_by_force { "nominal_thickness_mm" } else { "force_n" });
        let more = [give_or_take(given, given_sd), number(trial.in_view_cm3)];
        let remark = trial.why_not.as_ref().map(|why| format!("does not count: {why}"));
        let after = [&more[..], &[remark.unwrap_or_default()]].concat();
        // What does not count shades no cell.
        let counts = |value: &f64| if trial.why_not.is_none() { *value } else { f64::NAN };
        let values = trial.values.iter().map(counts).zip(objectives);
        let values = values.map(|(value, one)| [value, trial.sd(one.name)]).collect();
        (vec![way.label.clone(), dot(*on_front)], values, after)
    };
    shaded(&head, &trials.map(row).collect::<Vec<_>>(), objectives)
}

/// A label without its unit.
fn bare(words: &str) -> &str {
    words.split(" (").next().unwrap_or(words)
}

/// Largest pressure over every other objective: of all volunteers where there are several, and of each.
fn figures(
    ways: &[Way],
    persons: &[Person],
    all: &[Overall],
    objectives: &[Objective],
) -> Vec<Figure> {
    let mut figures = Vec::new();
    let first = ways.first().map_or("", |way| way.label.as_str());
    if persons.len() > 1 {
        let place = |way: usize, n: usize| all[way].over_first[n];
        let on_front: Vec<bool> = all.iter().map(|one| one.on_front).collect();
        let label = |objective: &Objective| format!("{}, over {first}", bare(objective.words));
        for n in 1..objectives.len() {
            let labels = [label(&objectives[n]), label(&objectives[0])];
            let title =
                format!("All volunteers, medians: {}", against(&objectives[0], &objectives[n]));
            let name = format!("all_{}.svg", objectives[n].name);
            figures.push(figure(ways, &on_front, name, title, labels, &|way| {
                (place(way, n), place(way, 0))
            }));
        }
    }
    for person in persons {
        for n in 1..objectives.len() {
            let value = |way: usize, n: usize| {
                let trial = &person.trials[way];
                if trial.why_not.is_none() { trial.values[n] } else { f64::NAN }
            };
            let labels = [n, 0].map(|n| objectives[n].words.to_owned());
            let title = format!("{}: {}", person.id, against(&objectives[0], &objectives[n]));
            let name = format!("{}_{}.svg", person.id, objectives[n].name);
            figures.push(figure(ways, &person.on_front, name, title, labels, &|way| {
                (value(way, n), value(way, 0))
            }));
        }
    }
    figures
}

fn against(y: &Objective, x: &Objective) -> String {
    let better = match x.wanted {
        Wanted::Least => "lower left",
        Wanted::Most => "lower right",
    };
    format!("{} against {}; better is {better}", bare(y.words), bare(x.words))
}

fn figure(
    ways: &[Way],
    on_front: &[bool],
    name: String,
    title: String,
    [x_label, y_label]: [String; 2],
    at: &dyn Fn(usize) -> (f64, f64),
) -> Figure {
    let mut distances: Vec<f64> = Vec::new();
    let mut groups: Vec<Group> = Vec::new();
    for (n, way) in ways.iter().enumerate() {
        let distance = way.plan.chest_wall_distance_mm;
        let shape = distances.iter().position(|known| *known == distance).unwrap_or_else(|| {
            distances.push(distance);
            distances.len() - 1
        });
        let fill = if on_front[n] { Fill::Full } else { Fill::Hollow };
        let dot = Dot { at: at(n), shape, fill, name: way.label.clone() };
        match groups.iter_mut().find(|group| group.name == way.design) {
            Some(group) => group.dots.push(dot),
            None => groups.push(Group { name: way.design.clone(), dots: vec![dot] }),
        }
    }
    let shapes = match distances.len() {
        1 => Vec::new(),
        _ => distances.iter().map(|mm| format!("{mm} mm from wall")).collect(),
    };
    let full = "on the front".into();
    let svg = scatter(&Scatter { title: title.clone(), x_label, y_label, groups, shapes, full });
    Figure { name, title, svg }
}
