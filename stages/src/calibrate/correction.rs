//! The stress-free shape as the thesis sought it (Mîra 2018, § 3.3, figure 3.10): gravity turned round for a first guess, then prediction and
//! correction towards another pose.
//!
//! The stress-free body is loaded into the other pose; what its skin misses there is imposed in part on the stress-free skin, and the
//! rest of the body follows in equilibrium without weight. The reference pose takes no part but in the first guess: how far it is missed is the result's
//! round trip.

use super::Experiment;
use crate::model::{Body, Moduli};
use mammotwin_data::{Failure, Vec3, progress::Silent, solution::Solution};
use mammotwin_solver::{
    Options, SolveError, solve,
    unload::{self, Effort, Miss},
};

/// How the correction goes on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scheme {
    /// Part of the miss that is imposed (the thesis: below 1).
    part: f64,
    /// Gain (mm) of the mean miss below which it ends.
    least_gain_mm: f64,
    /// Whether the part is halved where the miss grows or no equilibrium is found, instead of giving up.
    damped: bool,
}

impl Scheme {
    /// The thesis': it says no part.
    pub const PUBLISHED: Self = Self { part: 0.5, least_gain_mm: 1.0, damped: false };
    /// The same to its end.
    pub const DAMPED: Self = Self { least_gain_mm: 0.02, damped: true, ..Self::PUBLISHED };
}

/// Most corrections, and the smallest part that is tried.
const MOST: usize = 30;
const SMALLEST: f64 = 0.05;
/// Steps in which displacements are imposed.
const RAMP: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// A stress-free shape, the other pose that it takes, and where its skin should be there.
struct Predicted {
    rest: Vec<Vec3>,
    posed: Vec<Vec3>,
    wanted: Vec<(u32, Vec3)>,
    /// Mean distance (mm) of the skin's nodes from there.
    off_mm: f64,
}

impl Scheme {
    /// The stress-free shape, corrected towards the first other pose.
    ///
    /// # Errors
    /// [`Failure::BadInput`] without another pose; [`Failure::Numerics`] where a shape carries no load.
    pub fn run(
        self,
        experiment: &Experiment,
        body: &Body,
        moduli: Moduli,
    ) -> Result<unload::StressFree, Failure> {
        let [reference, toward, ..] = &experiment.targets[..] else {
            return Err(Failure::BadInput(
                "calibrate.stress_free: a correction needs another pose with use = \"fit\"".into(),
            ));
        };
        let options = Options::default();
        let known = &body.mesh.points;
        let predicted = |rest: Vec<Vec3>| -> Result<Predicted, Failure> {
            let model = body.model(&rest, moduli, toward.gravity, None)?;
            let posed = solve(&model, &rest, &options, &Silent).map_err(wrong)?.points;
            let wanted = toward.corresponding(&posed)?;
            let ways = wanted.iter().map(|(node, to)| (to - posed[*node as usize]).norm());
            let off_mm = ways.sum::<f64>() / wanted.len().max(1) as f64;
            Ok(Predicted { rest, posed, wanted, off_mm })
        };
        let lifted = body.model(known, moduli, -reference.gravity, None)?;
        let first = solve(&lifted, known, &options, &Silent).map_err(wrong)?.points;
        let mut best = predicted(first)?;
        let (mut part, mut iterations) = (self.part, 0);
        while iterations < MOST && part >= SMALLEST {
            iterations += 1;
            let next = displaced(body, moduli, &best, part).and_then(predicted);
            let gain_mm = next.as_ref().map_or(f64::NEG_INFINITY, |n| best.off_mm - n.off_mm);
            tracing::debug!(iterations, part, best.off_mm, gain_mm, "prediction and correction");
            match next {
                Ok(next) if next.off_mm < best.off_mm => best = next,
                _ if self.damped => {
                    part *= 0.5;
                    continue;
                }
                Err(cause) => return Err(cause),
                Ok(_) => break,
            }
            if gain_mm <= self.least_gain_mm {
                break;
            }
        }
        let rest = best.rest;
        let model = body.model(&rest, moduli, reference.gravity, None)?;
        let loaded: Solution = solve(&model, &rest, &options, &Silent).map_err(wrong)?;
        let miss = Miss::between(&loaded.points, known);
        let (off_surface_mm, effort) = (0.0, Effort::default());
        Ok(unload::StressFree { rest, loaded, miss, off_surface_mm, iterations, effort })
    }
}

/// The stress-free shape with a part of what the other pose misses imposed on its skin.
fn displaced(
    body: &Body,
    moduli: Moduli,
    from: &Predicted,
    part: f64,
) -> Result<Vec<Vec3>, Failure> {
    let mut model = body.model(&from.rest, moduli, Vec3::zeros(), None)?;
    let mut points = from.rest.clone();
    for way in RAMP {
        for (node, to) in &from.wanted {
            let n = *node as usize;
            model.hold(*node, from.rest[n] + way * part * (to - from.posed[n]));
        }
        points = solve(&model, &points, &Options::default(), &Silent).map_err(wrong)?.points;
    }
    Ok(points)
}

fn wrong(cause: SolveError) -> Failure {
    Failure::Numerics(format!("stress-free shape: {cause}"))
}
