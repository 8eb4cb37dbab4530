//! Tables and figure of the study of the calibration.

use super::{Fitted, Hypothesis, MarkerError, PoseError, Role};
use crate::page::median;
use mammotwin_stages::report::chart::{Axis, Chart, Line, lines};
use std::fmt::Write;

/// Half width of the 90 % interval of a normal distribution.
const NINETY: f64 = 1.645;
/// Aims: fitted poses (mm), held-out poses over the floor (mm), moduli, held-out error of the right law over that of the
/// simple one.
const FIT_MM: f64 = 0.6;
const OVER_FLOOR_MM: f64 = 0.3;
const MODULUS: f64 = 0.15;
const OVER_SIMPLE: f64 = 0.5;

/// All fits and poses as comma-separated values.
pub fn table(all: &[Fitted]) -> String {
    let mut text = String::from(
        "# Modified Hausdorff distances; floor: true skin on an unchanged chest wall from measured skin; scores: ln(fitted / true) over its stated deviation\n\
         seed,tissue_and_model,pose,role,before_mm,after_mm,floor_mm,right_over_truth,left_over_truth,right_score,left_score,evaluations,\
         markers_moved_mm,markers_before_mm,markers_after_mm,markers_floor_mm,markers_along_before_mm,markers_along_after_mm,markers_along_floor_mm\n",
    );
    for fit in all {
        let [right, left] = fit.moduli;
        let score = |n: usize| fit.scores[n].map_or(String::new(), |score| format!("{score:.3}"));
        for pose in &fit.poses {
            let _ = writeln!(
                text,
                "{},{},{},{},{:.3},{:.3},{:.3},{right:.4},{left:.4},{},{},{},{}",
                fit.seed,
                fit.hypothesis.name(),
                pose.pose,
                pose.role.name(),
                pose.before_mm,
                pose.after_mm,
                pose.floor_mm,
                score(0),
                score(1),
                fit.evaluations,
                pose.markers.as_ref().map_or(",,,,,,".into(), marker_cells)
            );
        }
    }
    text
}

fn marker_cells(found: &MarkerError) -> String {
    let MarkerError { moved_mm, before, after, floor } = found;
    let all = [before, after, floor];
    let means = all.map(|s| format!("{:.3}", s.mean_mm)).join(",");
    let along = all.map(|s| format!("{:.3}", s.tangential_mean_mm)).join(",");
    format!("{moved_mm:.3},{means},{along}")
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

/// What all volunteers of one tissue and model say of one pose.
fn found<'a>(all: &'a [Fitted], hypothesis: Hypothesis, name: &str) -> Vec<&'a PoseError> {
    of(all, hypothesis).filter_map(|fit| fit.poses.iter().find(|pose| pose.pose == name)).collect()
}

fn middle(values: impl Iterator<Item = f64>) -> f64 {
    median(values.collect()).unwrap_or(f64::NAN)
}

fn greatest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, f64::max)
}

/// The summary as tables of Markdown.
pub fn markdown(all: &[Fitted]) -> String {
    [distances(all), against_simple(all), markers(all), moduli(all)].concat()
}

fn distances(all: &[Fitted]) -> String {
    let mut text = String::from(
        "| tissue by model | pose | before (mm) | after (mm) | worst (mm) | floor (mm) | aim | met by |\n|---|---|---|---|---|---|---|---|\n",
    );
    for hypothesis in Hypothesis::ALL {
        for name in poses(all) {
            let found = found(all, hypothesis, name);
            let Some(first) = found.first() else { continue };
            let over = |pose: &PoseError| match pose.role {
                Role::HeldOut => pose.after_mm - pose.floor_mm - OVER_FLOOR_MM,
                _ => pose.after_mm - FIT_MM,
            };
            let aim = match first.role {
                Role::HeldOut => format!("≤ floor + {OVER_FLOOR_MM}"),
                _ => format!("≤ {FIT_MM}"),
            };
            let met = found.iter().filter(|pose| over(pose) <= 0.0).count();
            let role = match first.role {
                Role::Fitted => "",
                Role::Reference => ", reference",
                Role::HeldOut => ", held out",
            };
            let _ = writeln!(
                text,
                "| {} | {name}{role} | {:.2} | {:.2} | {:.2} | {:.2} | {aim} | {met} of {} |",
                hypothesis.name(),
                middle(found.iter().map(|pose| pose.before_mm)),
                middle(found.iter().map(|pose| pose.after_mm)),
                greatest(found.iter().map(|pose| pose.after_mm)),
                middle(found.iter().map(|pose| pose.floor_mm)),
                found.len()
            );
        }
    }
    text
}

/// Held-out poses of tissue that stiffens: the law that knows it over the one that does not.
fn against_simple(all: &[Fitted]) -> String {
    let mut text = String::new();
    for name in poses(all) {
        let mut ratios = Vec::new();
        let mut excess: Vec<f64> = Vec::new();
        for right in of(all, Hypothesis::Stiffening) {
            let same = of(all, Hypothesis::Simple).find(|simple| simple.seed == right.seed);
            let pose = |fit: &Fitted| fit.poses.iter().find(|pose| pose.pose == name).cloned();
            let Some((right, simple)) = pose(right).zip(same.and_then(pose)) else { continue };
            if right.role == Role::HeldOut {
                ratios.push(right.after_mm / simple.after_mm);
                let over = |pose: &PoseError| f64::max(0.0, pose.after_mm - pose.floor_mm);
                // Both at the floor differ by nothing.
                let (right, simple) = (over(&right), over(&simple));
                excess.push(if right > 0.0 { right / simple } else { 0.0 });
            }
        }
        if ratios.is_empty() {
            continue;
        }
        if text.is_empty() {
            text.push_str(
                "\n| held-out pose | error of Gent by Gent over that of Gent by neo-Hookean | aim | met by | the same of what is over the floor, greatest |\n|---|---|---|---|---|\n",
            );
        }
        let met = ratios.iter().filter(|ratio| **ratio <= OVER_SIMPLE).count();
        let _ = writeln!(
            text,
            "| {name} | {:.2} | ≤ {OVER_SIMPLE} | {met} of {} | {:.2} |",
            middle(ratios.iter().copied()),
            ratios.len(),
            greatest(excess.iter().copied())
        );
    }
    text
}

fn markers(all: &[Fitted]) -> String {
    let mut text = String::new();
    for hypothesis in Hypothesis::ALL {
        for name in poses(all) {
            let found: Vec<MarkerError> =
                found(all, hypothesis, name).iter().filter_map(|pose| pose.markers).collect();
            if found.is_empty() {
                continue;
            }
            if text.is_empty() {
                text.push_str(
                    "\n| markers: tissue by model | pose | moved (mm) | off before (mm) | off after (mm) | largest after (mm) | floor (mm) | along the skin before (mm) | after (mm) | floor (mm) |\n|---|---|---|---|---|---|---|---|---|---|\n",
                );
            }
            let _ = writeln!(
                text,
                "| {} | {name} | {:.1} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
                hypothesis.name(),
                middle(found.iter().map(|m| m.moved_mm)),
                middle(found.iter().map(|m| m.before.mean_mm)),
                middle(found.iter().map(|m| m.after.mean_mm)),
                greatest(found.iter().map(|m| m.after.max_mm)),
                middle(found.iter().map(|m| m.floor.mean_mm)),
                middle(found.iter().map(|m| m.before.tangential_mean_mm)),
                middle(found.iter().map(|m| m.after.tangential_mean_mm)),
                middle(found.iter().map(|m| m.floor.tangential_mean_mm))
            );
        }
    }
    text
}

fn moduli(all: &[Fitted]) -> String {
    let mut text = String::from(
        "\n| tissue by model | moduli over truth, median | least | greatest | within 15 % (aim: all) | inside of the 90 % interval | evaluations, at most |\n|---|---|---|---|---|---|---|\n",
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
            "| {} | {:.3} | {:.3} | {:.3} | {near} of {}{} | {inside} of {} | {} |",
            hypothesis.name(),
            middle(ratios.iter().copied()),
            ratios.iter().copied().fold(f64::INFINITY, f64::min),
            greatest(ratios.iter().copied()),
            ratios.len(),
            if near < ratios.len() { ": missed" } else { "" },
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
    use mammotwin_stages::fiducials::Summary;

    fn fit(seed: u64, hypothesis: Hypothesis, after_mm: f64, ratio: f64) -> Fitted {
        let pose = |pose: &str, role, markers| PoseError {
            pose: pose.into(),
            role,
            before_mm: 4.0,
            after_mm,
            floor_mm: 0.5,
            markers,
        };
        let misses = |mean_mm: f64| Summary {
            mean_mm,
            max_mm: 2.0 * mean_mm,
            tangential_mean_mm: 0.8 * mean_mm,
            tangential_max_mm: 2.0 * mean_mm,
            normal_mean_mm: 0.3 * mean_mm,
        };
        let markers = MarkerError {
            moved_mm: 21.0,
            before: misses(6.0),
            after: misses(2.0 * after_mm),
            floor: misses(1.0),
        };
        Fitted {
            seed,
            hypothesis,
            poses: vec![
                pose("supine", Role::Reference, None),
                pose("prone", Role::Fitted, Some(markers)),
                pose("tilted", Role::HeldOut, None),
            ],
            moduli: [ratio, 1.0],
            scores: [Some(ratio.ln() / 0.05), None],
            evaluations: 5,
        }
    }

    #[test]
    fn aims_are_counted() {
        let fit = |seed, after_mm, ratio| fit(seed, Hypothesis::Right, after_mm, ratio);
        let all = [fit(1, 0.55, 1.02), fit(2, 0.7, 1.2), fit(3, 0.9, 0.9)];
        let text = markdown(&all);
        for row in [
            "| supine, reference | 4.00 | 0.70 | 0.90 | 0.50 | ≤ 0.6 | 1 of 3 |",
            "| prone | 4.00 | 0.70 | 0.90 | 0.50 | ≤ 0.6 | 1 of 3 |",
            "| tilted, held out | 4.00 | 0.70 | 0.90 | 0.50 | ≤ floor + 0.3 | 2 of 3 |",
            "| prone | 21.0 | 6.00 | 1.40 | 3.60 | 1.00 | 4.80 | 1.12 | 0.80 |",
            "| 1.000 | 0.900 | 1.200 | 5 of 6: missed | 1 of 3 | 5 |",
        ] {
            assert!(text.contains(row), "{row}: {text}");
        }
        assert!(!text.contains("held-out pose"), "no tissue that stiffens: {text}");
        let rows = table(&all);
        assert_eq!(rows.lines().count(), 2 + 9);
        let commas = |line: &str| line.matches(',').count();
        assert!(rows.lines().skip(1).all(|line| commas(line) == 18), "{rows}");
        assert!(chart(&all, "tilted").contains("<svg"));
    }

    #[test]
    fn the_right_law_is_held_against_the_simple_one_person_by_person() {
        let all = [
            fit(1, Hypothesis::Simple, 1.5, 1.3),
            fit(1, Hypothesis::Stiffening, 0.7, 1.0),
            fit(2, Hypothesis::Simple, 1.0, 1.3),
            fit(2, Hypothesis::Stiffening, 0.4, 1.0),
            fit(3, Hypothesis::Stiffening, 0.4, 1.0),
        ];
        let text = markdown(&all);
        // 0.7 / 1.5 and 0.4 / 1.0; over the floor of 0.5: 0.2 / 1.0 and none. The third has no other fit.
        assert!(text.contains("| tilted | 0.43 | ≤ 0.5 | 2 of 2 | 0.20 |"), "{text}");
    }
}
