//! One page for a group of people: their numbers side by side.

use super::html::{escaped, significant};
use mammotwin_data::Failure;
use minijinja::{Environment, context};
use serde::Serialize;

/// What the page of a group shows.
#[derive(Debug, Clone, Default)]
pub struct GroupInput {
    /// The people, in the order of the values.
    pub members: Vec<Member>,
    /// Their numbers.
    pub metrics: Vec<GroupMetric>,
    /// Version of the program that gathered them.
    pub program_version: String,
}

/// One person.
#[derive(Debug, Clone, Serialize)]
pub struct Member {
    /// `sub-01`.
    pub name: String,
    /// `done`, `failed`, `missing`.
    pub status: String,
    /// Address of her own page, from that of the group.
    pub report: Option<String>,
}

/// One number of all people.
#[derive(Debug, Clone)]
pub struct GroupMetric {
    /// Machine name.
    pub name: String,
    /// What it says.
    pub long_name: String,
    /// Unit; empty for a pure number.
    pub unit: String,
    /// The values; `None` where there is none.
    pub values: Vec<Option<f64>>,
}

/// Numbers that are drawn; all are in the table.
const DRAWN: [&str; 8] = [
    "young_right_kpa",
    "young_left_kpa",
    "force_n",
    "contact_area_cm2",
    "mean_pressure_kpa",
    "peak_pressure_kpa",
    "von_mises_p95_kpa",
    "agd_mgy",
];

/// The page of a group, without any outside resource but the pages of its people.
///
/// # Errors
/// [`Failure::BadInput`] when a number has not one value for each person.
pub fn render(input: &GroupInput) -> Result<String, Failure> {
    let members = input.members.len();
    if let Some(bad) = input.metrics.iter().find(|metric| metric.values.len() != members) {
        let (name, values) = (&bad.name, bad.values.len());
        let why = format!("group: {name}: {values} values of {members} people");
        return Err(Failure::BadInput(why));
    }
    let drawn = |metric: &&GroupMetric| DRAWN.contains(&metric.name.as_str());
    let strips: Vec<_> =
        input.metrics.iter().filter(drawn).map(|m| strip(m, &input.members)).collect();
    let rows: Vec<_> = input.metrics.iter().map(row).collect();
    let done = input.members.iter().filter(|member| member.status == "done").count();
    let page = context! {
        members => input.members,
        done => done,
        strips => strips,
        rows => rows,
        version => input.program_version,
        style => include_str!("style.css"),
        page_js => include_str!("page.js"),
    };
    let mut environment = Environment::new();
    environment
        .add_template("group.html", include_str!("group.html"))
        .and_then(|()| environment.get_template("group.html")?.render(page))
        .map_err(|cause| Failure::BadInput(format!("group: {cause:#}")))
}

fn unit(metric: &GroupMetric) -> String {
    metric.unit.replace("m2", "m²")
}

/// Mean, standard deviation, least and largest of what is there.
fn row(metric: &GroupMetric) -> minijinja::Value {
    let known: Vec<f64> =
        metric.values.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    let count = known.len() as f64;
    let mean = known.iter().sum::<f64>() / count;
    let squares: f64 = known.iter().map(|v| (v - mean).powi(2)).sum();
    let spread =
        if known.len() > 1 { significant((squares / (count - 1.0)).sqrt()) } else { "–".into() };
    let text = |value: Option<f64>| value.map_or_else(|| "–".into(), significant);
    context! {
        name => metric.name,
        long_name => metric.long_name,
        unit => unit(metric),
        count => known.len(),
        mean => text(Some(mean).filter(|m| m.is_finite())),
        spread => spread,
        least => text(known.iter().copied().reduce(f64::min)),
        largest => text(known.iter().copied().reduce(f64::max)),
        values => metric.values.iter().map(|v| text(*v)).collect::<Vec<_>>(),
    }
}

/// Size of a strip (its own units), and its border.
const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 74.0;
const BORDER: f64 = 26.0;

/// A dot for each person over one axis; people of near values lie over one another.
fn strip(metric: &GroupMetric, members: &[Member]) -> minijinja::Value {
    let known = || {
        metric
            .values
            .iter()
            .zip(members)
            .filter_map(|(v, m)| v.filter(|v| v.is_finite()).map(|v| (v, m)))
    };
    let (low, high) = known().fold((f64::MAX, f64::MIN), |(l, h), (v, _)| (l.min(v), h.max(v)));
    // Where all have the same value, it alone stands below the dots.
    let (low, high, ticks) =
        if low < high { (low, high, 0..3) } else { (low - 1.0, low + 1.0, 1..2) };
    let place = |value: f64| BORDER + (WIDTH - 2.0 * BORDER) * (value - low) / (high - low);
    let mut dots = String::new();
    let mut last: Vec<f64> = Vec::new();
    let mut sorted: Vec<_> = known().collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (value, member) in &sorted {
        let x = place(*value);
        // The lowest lane whose last dot is far enough.
        let lane = last.iter().position(|there| x - there > 11.0).unwrap_or(last.len());
        if lane == last.len() {
            last.push(x)
        } else {
            last[lane] = x
        }
        let y = HEIGHT - 30.0 - 10.0 * (lane % 4) as f64;
        let text = format!("{}: {} {}", member.name, significant(*value), unit(metric));
        dots += &format!(
            "<circle cx=\"{x:.1}\" cy=\"{y}\" r=\"5\" fill=\"#005E9E\" fill-opacity=\"0.75\"/>\
             <circle class=\"hit\" cx=\"{x:.1}\" cy=\"{y}\" r=\"7\"><title>{}</title></circle>",
            escaped(text.trim_end())
        );
    }
    let axis = HEIGHT - 20.0;
    let ticks: String = ticks
        .map(|n| low + (high - low) * f64::from(n) / 2.0)
        .map(|value| {
            format!(
                "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\" font-size=\"13\" fill=\"#464646\">{}</text>",
                place(value), HEIGHT - 4.0, significant(value)
            )
        })
        .collect();
    let svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         xmlns=\"http://www.w3.org/2000/svg\"><line x1=\"{BORDER}\" x2=\"{}\" y1=\"{axis}\" y2=\"{axis}\" \
         stroke=\"#464646\" stroke-width=\"1.5\"/>{dots}{ticks}</svg>",
        WIDTH - BORDER
    );
    let unit = unit(metric);
    let title = if unit.is_empty() {
        metric.long_name.clone()
    } else {
        format!("{} ({unit})", metric.long_name)
    };
    context! { title => title, body => svg }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input() -> GroupInput {
        let member = |name: &str, status: &str| Member {
            name: name.into(),
            status: status.into(),
            report: (status == "done").then(|| format!("{name}.html")),
        };
        GroupInput {
            members: vec![
                member("sub-01", "done"),
                member("sub-02", "failed"),
                member("sub-03", "done"),
            ],
            metrics: vec![GroupMetric {
                name: "force_n".into(),
                long_name: "compression force <".into(),
                unit: "N".into(),
                values: vec![Some(80.0), None, Some(100.0)],
            }],
            program_version: "1".into(),
        }
    }

    #[test]
    fn a_group_has_dots_a_table_and_links() {
        let page = render(&input()).unwrap();
        assert_eq!(page.matches("class=\"hit\"").count(), 2);
        assert!(page.contains("<title>sub-03: 100 N</title>"));
        assert!(page.contains("href=\"sub-01.html\"") && !page.contains("href=\"sub-02.html\""));
        assert!(page.contains("compression force &lt; (N)"));
        // Mean 90, standard deviation 14.1.
        assert!(page.contains(">90<") && page.contains(">14.1<"), "{page}");
    }

    #[test]
    fn values_that_do_not_fit_are_refused() {
        let mut wrong = input();
        wrong.metrics[0].values.pop();
        assert!(render(&wrong).unwrap_err().to_string().contains("2 values of 3 people"));
    }
}
