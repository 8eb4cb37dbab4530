//! The start of an ascent when nobody knows it: many short ascents, of which the best go on.

use super::optimise::{Level, Optimum};
use mammotwin_data::{Vec3, rigid::RigidTransform, units::DEGREE};
use rayon::prelude::*;

/// Spacing (mm) of the points that are compared in the first ascents.
pub(super) const COARSE_MM: f64 = 15.0;
/// Shifts (mm) along each axis that are tried.
const SHIFTS_MM: [f64; 3] = [0.0, -30.0, 30.0];
/// Turns (degrees) about z that are tried: a tilted person.
const TILTS_DEG: [f64; 7] = [0.0, -20.0, 20.0, -40.0, 40.0, -60.0, 60.0];
/// Turns (degrees) about x and y that are tried beside each of them.
const LEANS_DEG: [[f64; 2]; 5] = [[0.0, 0.0], [-20.0, 0.0], [20.0, 0.0], [0.0, -20.0], [0.0, 20.0]];
/// Steps of the first ascents.
const FIRST_STEPS: usize = 3;
/// So many of them go on ...
const CONTINUED: usize = 24;
/// ... with so many steps more.
const STEPS: usize = 12;
/// So many of the ends are compared on the finer level, each farther than this path from the better ones (mm).
const ENDS: usize = 4;
const APART_MM: f64 = 10.0;

/// The best of the ascents from turns and shifts of `start` (reference to moving): first on
/// `coarse`, at last on `finer`.
pub(super) fn wide(coarse: &Level, finer: &Level, start: &RigidTransform) -> Optimum {
    let pivot = start.point(&coarse.center);
    let mut starts = Vec::with_capacity(TILTS_DEG.len() * LEANS_DEG.len() * 27);
    for tilt in TILTS_DEG {
        for [about_x, about_y] in LEANS_DEG {
            let turn = Vec3::new(about_x, about_y, tilt) * DEGREE;
            for n in 0..27 {
                let shift = Vec3::from([n % 3, n / 3 % 3, n / 9].map(|m: usize| SHIFTS_MM[m]));
                starts.push(start.then(&RigidTransform::about(&pivot, &turn, &shift)));
            }
        }
    }
    let first = best_of(coarse, &starts, FIRST_STEPS);
    let mut iterations = total(&first);
    let first: Vec<RigidTransform> = first.iter().take(CONTINUED).map(|end| end.motion).collect();
    let second = best_of(coarse, &first, STEPS);
    iterations += total(&second);
    let mut ends: Vec<RigidTransform> = Vec::with_capacity(ENDS);
    for end in &second {
        let apart = |other: &RigidTransform| coarse.path_mm(&end.motion, other) > APART_MM;
        if ends.len() < ENDS && ends.iter().all(apart) {
            ends.push(end.motion);
        }
    }
    let last = best_of(finer, &ends, STEPS);
    iterations += total(&last);
    match last.into_iter().next() {
        Some(best) => Optimum { iterations, ..best },
        None => finer.stay(start),
    }
}

/// Shifts (mm) along the body that are tried about the end of an ascent: ribs look alike, and lie about 27 mm apart.
const RIBS_MM: [f64; 8] = [-13.5, 13.5, -27.0, 27.0, -40.5, 40.5, -54.0, 54.0];
/// What another rib must have more of the similarity, and of the mask's points at least.
const CLEARLY: f64 = 0.02;
const ENOUGH: f64 = 0.7;

/// The end of an ascent, or of one from a place some ribs up or down the body where that is clearly more alike.
///
/// An ascent compares the points that are covered at its start, so the ends are compared anew, each over
/// what is covered there; and one that came back to the same place is no other rib.
pub(super) fn other_ribs(level: &Level, end: Optimum) -> Optimum {
    let shifted = |along: &f64| {
        let shift = RigidTransform::about(&Vec3::zeros(), &Vec3::zeros(), &(*along * Vec3::z()));
        shift.then(&end.motion)
    };
    let starts: Vec<RigidTransform> = RIBS_MM.iter().map(shifted).collect();
    let others = best_of(level, &starts, STEPS);
    let iterations = end.iterations + total(&others);
    let here = level.stay(&end.motion);
    let better = others
        .into_iter()
        .filter(|other| level.path_mm(&other.motion, &end.motion) > APART_MM)
        .map(|other| level.stay(&other.motion))
        .filter(|other| {
            let gain = other.evaluation.similarity - here.evaluation.similarity;
            gain > CLEARLY && other.overlap > ENOUGH * here.overlap
        })
        .max_by(|a, b| a.evaluation.similarity.total_cmp(&b.evaluation.similarity));
    Optimum { iterations, ..better.unwrap_or(end) }
}

/// Ascents from all starts, the highest first; of equal ones the earlier start.
fn best_of(level: &Level, starts: &[RigidTransform], steps: usize) -> Vec<Optimum> {
    let mut ends: Vec<Optimum> = starts.par_iter().map(|start| level.climb(start, steps)).collect();
    ends.sort_by(|a, b| b.evaluation.similarity.total_cmp(&a.evaluation.similarity));
    ends
}

fn total(ends: &[Optimum]) -> usize {
    ends.iter().map(|end| end.iterations).sum()
}
