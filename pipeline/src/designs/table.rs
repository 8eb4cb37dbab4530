//! Designs as CSV files.

use super::{Objective, Overall, Person, Way};
use crate::page::quoted;
use std::fmt::Write;

/// A number with six digits after the point; empty where there is none.
fn cell(value: f64) -> String {
    // No minus before a zero.
    let value = if value.abs() < 5e-7 { 0.0 } else { value };
    if value.is_finite() { format!("{value:.6}") } else { String::new() }
}

/// One row for each way on each person.
pub fn designs_csv(ways: &[Way], persons: &[Person], objectives: &[Objective]) -> String {
    let mut text =
        String::from("volunteer,way,design,paddle,chest_wall_distance_mm,ended_by,on_front");
    for objective in objectives {
        // Writing to a string does not fail.
        let _ = write!(text, ",{}", objective.name);
    }
    text += ",end_force_n,end_nominal_thickness_mm,in_view_cm3,why_not\n";
    for person in persons {
        for ((way, trial), on_front) in ways.iter().zip(&person.trials).zip(&person.on_front) {
            let (label, design, paddle) = (&way.label, &way.design, way.plan.paddle.name());
            let (distance, met) =
                (trial.chest_wall_distance_mm, trial.ended_by.as_deref().unwrap_or_default());
            let _ = write!(
                text,
                "{},{label},{design},{paddle},{distance},{met},{}",
                person.id,
                u8::from(*on_front)
            );
            for value in &trial.values {
                let _ = write!(text, ",{}", cell(*value));
            }
            let why = trial.why_not.as_deref().map(quoted).unwrap_or_default();
            let [force, thickness, view] =
                [trial.force_n, trial.thickness_mm, trial.in_view_cm3].map(cell);
            let _ = writeln!(text, ",{force},{thickness},{view},{why}");
        }
    }
    text
}

/// One row for each way, over all persons.
pub fn summary_csv(ways: &[Way], all: &[Overall], objectives: &[Objective]) -> String {
    let mut text = String::from("way,design,paddle,on_front,fronts_of_volunteers,volunteers");
    for objective in objectives {
        let _ = write!(text, ",{}_over_first", objective.name);
    }
    text.push('\n');
    for (way, one) in ways.iter().zip(all) {
        let (label, design, paddle) = (&way.label, &way.design, way.plan.paddle.name());
        let on_front = u8::from(one.on_front);
        let _ = write!(text, "{label},{design},{paddle},{on_front},{},{}", one.fronts, one.persons);
        for value in &one.over_first {
            let _ = write!(text, ",{}", cell(*value));
        }
        text.push('\n');
    }
    text
}
