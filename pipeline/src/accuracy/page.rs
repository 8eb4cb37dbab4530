//! Tables and figure of the study of the calibration.

use super::{Fitted, Hypothesis, PoseError};
use crate::page::median;
use mammotwin_stages::report::chart::{Axis, Chart, Line, lines};
use std::fmt::Write;

/// Half width of the 90 % interval of a normal distribution.
const NINETY: f64 = 1.645;
/// Aims: fitted poses (mm), held-out poses over the floor (mm), moduli.
const FIT_MM: f64 = 0.6;
const OVER_FLOOR_MM: f64 = 0.3;
const MODULUS: f64 = 0.15;

/// All fits and poses as comma-separated values.
pub fn table(all: &[Fitted]) -> String {
    let mut text = String::from(
        "# Modified Hausdorff distances; floor: true skin on an unchanged chest wall from measured skin; scores: ln(fitted / true) over its stated deviation\n\
         seed,tissue_and_model,pose,fitted,before_mm,after_mm,floor_mm,right_over_truth,left_over_truth,right_score,left_score,evaluations\n",
    );
    for fit in all {
        let [right, left] = fit.moduli;
        let score = |n: usize| fit.scores[n].map_or(String::new(), |score| format!("{score:.3}"));
        for pose in &fit.poses {
            let _ = writeln!(
                text,
                "{},{},{},{},{:.3},{:.3},{:.3},{right:.4},{left:.4},{},{},{}",
                fit.seed,
                fit.hypothesis.name(),
                pose.pose,
                pose.fitted,
                pose.before_mm,
                pose.after_mm,
                pose.floor_mm,
                score(0),
                score(1),
                fit.evaluations
            );
        }
    }
    text
}

fn of(all: &[Fitted], hypothesis: Hypothesis) -> impl Iterator<Item = &Fitted> {
    all.iter().filter(move |fit| fit.hypothesis == hypothesis)
}

/// Names of the poses, in the order in which they occur.
fn poses(all: &[Fitted]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for pose in all.iter().flat_map(|fit| &fit.poses) {
        if !names.contains(&pose.pose.as_str()) {
            names.push(&pose.pose);
        }
    }
    names
}

/// The summary as tables of Markdown.
pub fn markdown(all: &[Fitted]) -> String {
    let mut text = String::from(
        "| tissue by model | pose | before (mm) | after (mm) | worst (mm) | floor (mm) | aim | met by |\n|---|---|---|---|---|---|---|---|\n",
    );
    for hypothesis in Hypothesis::ALL {
        for name in poses(all) {
            let found: Vec<&PoseError> = of(all, hypothesis)
                .filter_map(|fit| fit.poses.iter().find(|pose| pose.pose == name))
                .collect();
            let Some(first) = found.first() else { continue };
            let over = |pose: &PoseError| match pose.fitted {
                true => pose.after_mm - FIT_MM,
                false => pose.after_mm - pose.floor_mm - OVER_FLOOR_MM,
            };
            let aim = match first.fitted {
                true => format!("≤ {FIT_MM}"),
                false => format!("≤ floor + {OVER_FLOOR_MM}"),
            };
            let all = |of: fn(&PoseError) -> f64| {
                median(found.iter().map(|p| of(p)).collect()).unwrap_or(f64::NAN)
            };
            let worst = found.iter().map(|pose| pose.after_mm).fold(f64::NEG_INFINITY, f64::max);
            let met = found.iter().filter(|pose| over(pose) <= 0.0).count();
            let held = if first.fitted { "" } else { ", held out" };
            let _ = writeln!(
                text,
                "| {} | {name}{held} | {:.2} | {:.2} | {worst:.2} | {:.2} | {aim} | {met} of {} |",
                hypothesis.name(),
                all(|pose| pose.before_mm),
                all(|pose| pose.after_mm),
                all(|pose| pose.floor_mm),
                found.len()
            );
        }
    }
    text.push_str(
        "\n| tissue by model | moduli over truth, median | least | greatest | within 15 % | inside of the 90 % interval | evaluations, at most |\n|---|---|---|---|---|---|---|\n",
    );
    for hypothesis in Hypothesis::ALL {
        let ratios: Vec<f64> = of(all, hypothesis).flat_map(|fit| fit.moduli).collect();
        if ratios.is_empty() {
            continue;
        }
        let scores: Vec<f64> = of(all, hypothesis).flat_map(|fit| fit.scores).flatten().collect();
        let inside = scores.iter().filter(|score| score.abs() <= NINETY).count();
        let near = ratios.iter().filter(|ratio| (**ratio - 1.0).abs() <= MODULUS).count();
        let _ = writeln!(
            text,
            "| {} | {:.3} | {:.3} | {:.3} | {near} of {} | {inside} of {} | {} |",
            hypothesis.name(),
            median(ratios.clone()).unwrap_or(f64::NAN),
            ratios.iter().copied().fold(f64::INFINITY, f64::min),
            ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ratios.len(),
            scores.len(),
            of(all, hypothesis).map(|fit| fit.evaluations).max().unwrap_or(0)
        );
    }
    text
}

/// The held-out pose of every volunteer: each tissue and model, and the floor.
pub fn chart(all: &[Fitted], held_out: &str) -> String {
    let find = |fit: &Fitted| fit.poses.iter().find(|pose| pose.pose == held_out).cloned();
    let points = |hypothesis: Hypothesis, value: fn(&PoseError) -> f64| {
        let point = |(n, fit): (usize, &Fitted)| Some((n as f64 + 1.0, value(&find(fit)?)));
        of(all, hypothesis).enumerate().filter_map(point).collect()
    };
    let line = |hypothesis: Hypothesis| Line {
        name: hypothesis.name().into(),
        points: points(hypothesis, |pose| pose.after_mm),
    };
    let mut drawn: Vec<Line> = Hypothesis::ALL.map(line).into();
    let floor = points(Hypothesis::Right, |pose| pose.floor_mm);
    drawn.push(Line { name: "true from measured skin".into(), points: floor });
    lines(&Chart {
        title: format!("Held-out pose: {held_out}"),
        caption: "Modified Hausdorff distance of the simulated to the measured skin.".into(),
        x_label: "volunteer".into(),
        y_label: "distance (mm)".into(),
        lines: drawn,
        marks: Vec::new(),
        x_axis: Axis::Rising,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(seed: u64, after_mm: f64, ratio: f64) -> Fitted {
        let pose = |pose: &str, fitted| PoseError {
            pose: pose.into(),
            fitted,
            before_mm: 4.0,
            after_mm,
            floor_mm: 0.5,
        };
        Fitted {
            seed,
            hypothesis: Hypothesis::Right,
            poses: vec![pose("prone", true), pose("tilted", false)],
            moduli: [ratio, 1.0],
            scores: [Some(ratio.ln() / 0.05), None],
            evaluations: 5,
        }
    }

    #[test]
    fn aims_are_counted() {
        let all = [fit(1, 0.55, 1.02), fit(2, 0.7, 1.2), fit(3, 0.9, 0.9)];
        let text = markdown(&all);
        assert!(text.contains("| prone | 4.00 | 0.70 | 0.90 | 0.50 | ≤ 0.6 | 1 of 3 |"), "{text}");
        assert!(
            text.contains(
                "| tilted, held out | 4.00 | 0.70 | 0.90 | 0.50 | ≤ floor + 0.3 | 2 of 3 |"
            )
        );
        assert!(text.contains("| 1.000 | 0.900 | 1.200 | 5 of 6 | 1 of 3 | 5 |"), "{text}");
        assert_eq!(table(&all).lines().count(), 2 + 6);
        assert!(chart(&all, "tilted").contains("<svg"));
    }
}
