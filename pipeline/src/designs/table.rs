//! Designs as CSV files.

use super::{COMPARED, Compared, Objective, Overall, Pair, Person, Way};
use crate::page::quoted;
use std::fmt::Write;

/// A number with six digits after the point; empty where there is none.
fn cell(value: f64) -> String {
    // No minus before a zero.
    let value = if value.abs() < 5e-7 { 0.0 } else { value };
    if value.is_finite() { format!("{value:.6}") } else { String::new() }
}

/// What is compared in pairs and is no objective nor a column of its own.
fn others(objectives: &[Objective]) -> impl Iterator<Item = (usize, &'static Compared)> + '_ {
    let own = ["force_n", "nominal_thickness_mm"];
    let is_other = move |one: &Compared| {
        !own.contains(&one.name) && objectives.iter().all(|o| o.name != one.name)
    };
    COMPARED.iter().enumerate().filter(move |(_, one)| is_other(one))
}

/// One row for each way on each person.
pub fn designs_csv(ways: &[Way], persons: &[Person], objectives: &[Objective]) -> String {
    let mut text = String::from(
        "volunteer,mesh_mm,way,design,paddle,chest_wall_distance_mm,ended_by,on_front",
    );
    for objective in objectives {
        // Writing to a string does not fail.
        let _ = write!(text, ",{}", objective.name);
    }
    for (_, other) in others(objectives) {
        let _ = write!(text, ",{}", other.name);
    }
    let trials = || persons.iter().flat_map(|person| &person.trials);
    let uncertain: Vec<&str> = COMPARED
        .iter()
        .map(|one| one.name)
        .filter(|name| trials().any(|trial| trial.sd(name).is_finite()))
        .collect();
    for name in &uncertain {
        let _ = write!(text, ",{name}_sd");
    }
    text += ",end_force_n,end_nominal_thickness_mm,in_view_cm3,why_not\n";
    for person in persons {
        for ((way, trial), on_front) in ways.iter().zip(&person.trials).zip(&person.on_front) {
            let (label, design, paddle) = (&way.label, &way.design, way.plan.paddle.name());
            let (distance, met) =
                (trial.chest_wall_distance_mm, trial.ended_by.as_deref().unwrap_or_default());
            let _ = write!(
                text,
                "{},{},{label},{design},{paddle},{distance},{met},{}",
                person.id,
                person.mesh_mm,
                u8::from(*on_front)
            );
            for value in &trial.values {
                let _ = write!(text, ",{}", cell(*value));
            }
            for (n, _) in others(objectives) {
                let _ = write!(text, ",{}", cell(trial.compared[n]));
            }
            for name in &uncertain {
                let _ = write!(text, ",{}", cell(trial.sd(name)));
            }
            let why = trial.why_not.as_deref().map(quoted).unwrap_or_default();
            let [force, thickness, view] =
                [trial.force_n, trial.thickness_mm, trial.in_view_cm3].map(cell);
            let _ = writeln!(text, ",{force},{thickness},{view},{why}");
        }
    }
    text
}

/// One row for each way, over all persons: medians, and geometric means of the ratios of a pair with their 95 %
/// intervals, persons of the pair, and on how many of them the ratio is below one.
pub fn summary_csv(
    ways: &[Way],
    all: &[Overall],
    pairs: &[Pair],
    objectives: &[Objective],
) -> String {
    let mut text = String::from("way,design,paddle,on_front,fronts_of_volunteers,volunteers");
    for objective in objectives {
        let _ = write!(text, ",{}_over_first", objective.name);
    }
    text += ",paired_with";
    for Compared { name, .. } in COMPARED {
        let _ = write!(text, ",{name}_ratio,{name}_low,{name}_high,{name}_pairs,{name}_lower");
    }
    text.push('\n');
    for (n, (way, one)) in ways.iter().zip(all).enumerate() {
        let (label, design, paddle) = (&way.label, &way.design, way.plan.paddle.name());
        let on_front = u8::from(one.on_front);
        let _ = write!(text, "{label},{design},{paddle},{on_front},{},{}", one.fronts, one.persons);
        for value in &one.over_first {
            let _ = write!(text, ",{}", cell(*value));
        }
        match pairs.iter().find(|pair| pair.way == n) {
            Some(pair) => {
                let _ = write!(text, ",{}", ways[pair.against].label);
                for ratio in &pair.ratios {
                    let Some(ratio) = ratio else {
                        text += ",,,,0,0";
                        continue;
                    };
                    let [low, high] = ratio.interval.unwrap_or([f64::NAN; 2]);
                    let [mean, low, high] = [ratio.mean, low, high].map(cell);
                    let (persons, lower) = (ratio.persons, ratio.lower);
                    let _ = write!(text, ",{mean},{low},{high},{persons},{lower}");
                }
            }
            // It is what others are compared with.
            None => text += &",".repeat(1 + 5 * COMPARED.len()),
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
pub(in crate::designs) mod tests {
    use super::*;
    use crate::designs::{Ratio, Wanted};
    use mammotwin_stages::force_curve::trial::Person as Someone;

    /// A plan of a compression.
    pub(in crate::designs) fn plan() -> mammotwin_data::study::CompressPlan {
        let someone = Someone { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
        someone.plan(15.0, 46.0).unwrap()
    }

    #[test]
    fn rows_are_as_long_as_their_heading_and_hold_the_interval() {
        let way = |name: &str| Way { label: name.into(), design: name.into(), plan: plan() };
        let ways = [way("rigid"), way("flex")];
        let one = Overall { over_first: vec![1.0], on_front: true, fronts: 2, persons: 2 };
        let mut ratios = vec![Ratio::of([0.5, 0.8, 1.0]); COMPARED.len()];
        ratios[8] = None;
        let pairs = [Pair { way: 1, against: 0, ratios }];
        let wanted = [Objective { name: "force_n", words: "force (N)", wanted: Wanted::Least }];
        let text = summary_csv(&ways, &[one.clone(), one], &pairs, &wanted);
        let cells: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(cells.iter().all(|row| row.len() == cells[0].len()), "{text}");
        let at = |name: &str| cells[0].iter().position(|cell| *cell == name).unwrap();
        let first = at("paddle_peak_pressure_kpa_ratio");
        assert_eq!(cells[2][first..first + 5], ["0.736806", "0.305936", "1.774498", "3", "2"]);
        assert_eq!(cells[2][at("paired_with")], "rigid");
        assert_eq!(cells[2][at("agd_mgy_pairs")], "0");
        assert!(cells[1][at("paired_with")..].iter().all(|cell| cell.is_empty()));
    }
}
