//! Table and page of the study of the segmentation.

use super::{LIMITS, Measured};
use crate::page::begin;
use std::fmt::Write;

/// Reads one value of an image.
type Of = fn(&Measured) -> f64;

/// A figure that is asked for: its name, value, unit, bound, and whether it must not be less.
struct Figure {
    name: &'static str,
    of: Of,
    bound: f64,
    at_least: bool,
}

/// Ledger A2 and the accuracy of the surfaces.
const FIGURES: [Figure; 5] = [
    Figure { name: "Dice, breast", of: |m| m.breast, bound: 0.97, at_least: true },
    Figure { name: "Dice, muscle", of: |m| m.muscle, bound: 0.93, at_least: true },
    Figure { name: "Dice, gland", of: |m| m.gland, bound: 0.85, at_least: true },
    Figure { name: "skin, 95 % (mm)", of: |m| m.skin.p95_mm, bound: 1.0, at_least: false },
    Figure { name: "muscle, 95 % (mm)", of: |m| m.muscle_p95_mm, bound: 2.0, at_least: false },
];

/// What else the tables show.
const OTHERS: [(&str, Of); 8] = [
    ("Dice, breast between true limits", |m| m.breast_within),
    ("Dice, breast, limits moving with the tissue", |m| m.breast_material),
    ("Dice, chest wall", |m| m.chest_wall),
    ("skin, mean (mm)", |m| m.skin.mean_mm),
    ("front of the muscle, 95 % (mm)", |m| m.front.p95_mm),
    ("front of the muscle, mean (mm)", |m| m.front.mean_mm),
    ("rear of the muscle, 95 % (mm)", |m| m.rear.p95_mm),
    ("rear of the muscle, mean (mm)", |m| m.rear.mean_mm),
];

/// All images as a table of comma-separated values.
pub fn table(all: &[Measured]) -> String {
    let mut text = String::from(
        "# Found against true labels. Gaps: mean positive outwards, 95 % of both surfaces. Limits: found \
         less true.\n\
         preset,seed,pose,voxel_mm,dice_breast,dice_breast_true_limits,dice_breast_material_limits,\
         dice_muscle,dice_gland,dice_chest_wall,skin_mean_mm,skin_p95_mm,front_mean_mm,front_p95_mm,\
         rear_mean_mm,rear_p95_mm,muscle_p95_mm",
    );
    for name in LIMITS {
        let _ = write!(text, ",{name}");
    }
    text.push('\n');
    for m in all {
        let Measured { preset, seed, pose, voxel_mm, .. } = m;
        let _ = write!(text, "{preset},{seed},{pose},{voxel_mm:.3}");
        let dice = [m.breast, m.breast_within, m.breast_material, m.muscle, m.gland, m.chest_wall];
        dice.iter().for_each(|dice| _ = write!(text, ",{dice:.4}"));
        for gap in [m.skin, m.front, m.rear] {
            let _ = write!(text, ",{:.3},{:.3}", gap.mean_mm, gap.p95_mm);
        }
        let _ = write!(text, ",{:.3}", m.muscle_p95_mm);
        m.limits_mm.iter().for_each(|mm| _ = write!(text, ",{mm:.2}"));
        text.push('\n');
    }
    text
}

/// Kinds of volunteers and their poses, in the order in which they were measured.
fn groups(all: &[Measured]) -> Vec<(&str, &str)> {
    let mut groups: Vec<(&str, &str)> = Vec::new();
    for m in all {
        let group = (m.preset.as_str(), m.pose.as_str());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups.sort_by_key(|(preset, _)| all.iter().position(|m| m.preset == *preset));
    groups
}

fn of_group<'a>(
    all: &'a [Measured],
    (preset, pose): (&'a str, &'a str),
) -> impl Iterator<Item = &'a Measured> {
    all.iter().filter(move |m| m.preset == preset && m.pose == pose)
}

/// Rows of cells: a heading, then one row a figure and group.
fn rows(all: &[Measured]) -> Vec<[String; 8]> {
    let mut rows = vec![
        ["volunteers", "voxel (mm)", "pose", "figure", "mean", "worst", "aim", "met by"]
            .map(String::from),
    ];
    for group in groups(all) {
        let (preset, pose) = group;
        let members: Vec<&Measured> = of_group(all, group).collect();
        let voxel = members.iter().map(|m| m.voxel_mm).sum::<f64>() / members.len() as f64;
        let head = |name: &str, of: Of, digits: usize| {
            let values: Vec<f64> = members.iter().map(|m| of(m)).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let start = [preset.into(), format!("{voxel:.2}"), pose.into(), name.into()];
            (start, format!("{mean:.digits$}"), values)
        };
        for figure in &FIGURES {
            let digits = if figure.at_least { 3 } else { 2 };
            let ([a, b, c, d], mean, values) = head(figure.name, figure.of, digits);
            let worse = if figure.at_least { f64::min } else { f64::max };
            let worst = values.iter().copied().reduce(worse).unwrap_or(f64::NAN);
            let met =
                |v: &&f64| if figure.at_least { **v >= figure.bound } else { **v <= figure.bound };
            let count = values.iter().filter(met).count();
            let sign = if figure.at_least { "≥" } else { "≤" };
            let aim = format!("{sign} {}", figure.bound);
            let met = format!("{count} of {}", values.len());
            rows.push([a, b, c, d, mean, format!("{worst:.digits$}"), aim, met]);
        }
        for (name, of) in OTHERS {
            let is_dice = name.starts_with("Dice");
            let digits = if is_dice { 3 } else { 2 };
            let ([a, b, c, d], mean, values) = head(name, of, digits);
            let worst = values.iter().copied().reduce(|a, b| match (is_dice, a.abs() > b.abs()) {
                (true, _) => a.min(b),
                (false, true) => a,
                (false, false) => b,
            });
            let worst = format!("{:.digits$}", worst.unwrap_or(f64::NAN));
            rows.push([a, b, c, d, mean, worst, String::new(), String::new()]);
        }
        for (n, name) in ["lower limit (mm)", "upper limit (mm)"].into_iter().enumerate() {
            let values: Vec<f64> =
                members.iter().flat_map(|m| [m.limits_mm[n], m.limits_mm[n + 2]]).collect();
            rows.push(limit(preset, pose, voxel, name, &values));
        }
        let lateral: Vec<f64> = members.iter().map(|m| m.limits_mm[4]).collect();
        rows.push(limit(preset, pose, voxel, "lateral limit (mm)", &lateral));
    }
    rows
}

fn limit(preset: &str, pose: &str, voxel: f64, name: &str, values: &[f64]) -> [String; 8] {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let worst = values.iter().copied().reduce(|a, b| if a.abs() > b.abs() { a } else { b });
    [
        preset.into(),
        format!("{voxel:.2}"),
        pose.into(),
        name.into(),
        format!("{mean:+.1}"),
        format!("{:+.1}", worst.unwrap_or(f64::NAN)),
        String::new(),
        String::new(),
    ]
}

/// The summary as a table of Markdown.
pub fn markdown(all: &[Measured]) -> String {
    let mut text = String::new();
    for (n, row) in rows(all).iter().enumerate() {
        let _ = writeln!(text, "| {} |", row.join(" | "));
        if n == 0 {
            let _ = writeln!(text, "|{}", "---|".repeat(row.len()));
        }
    }
    text
}

/// The page; `pictures` are captions and addresses of overlays.
pub fn page(all: &[Measured], pictures: &[(String, String)]) -> String {
    let style = "table{border-collapse:collapse}td,th{padding:.1em .6em;text-align:left;\
                 border-bottom:1px solid #ddd}img{max-width:100%}figcaption{font-size:14px;color:#444}";
    let mut seeds: Vec<u64> = all.iter().map(|m| m.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
    let subject = format!("Digital volunteers, seeds {}", seeds.join(", "));
    let mut html = begin("How near the segmentation comes to the truth", &subject, style);
    html += "<p>Worst: over the seeds. Mean gaps are positive where the found surface lies outside of the \
             true one; 95 % counts the vertices of both surfaces. Limits: found less true.</p>\n<table>\n";
    for (n, row) in rows(all).iter().enumerate() {
        let cell = if n == 0 { "th" } else { "td" };
        let cells: String = row.iter().map(|text| format!("<{cell}>{text}</{cell}>")).collect();
        let _ = writeln!(html, "<tr>{cells}</tr>");
    }
    html += "</table>\n";
    for (caption, address) in pictures {
        let _ = writeln!(
            html,
            "<figure><img src=\"{address}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>"
        );
    }
    html += "</body></html>\n";
    html
}
