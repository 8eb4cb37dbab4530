//! The answer, and what it rests on.

use super::{
    budget::Whitener,
    observe::{Frame, Observed},
    refit::Refitted,
    screen::Screening,
};
use crate::{
    calibrate::Fit,
    effects::{EFFECTS, Effect},
};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Kinds of answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VerdictName {
    /// The errors explain all residuals.
    NoDiscrepancy,
    /// Not physics: a pose lies wrong.
    MeasurementArtifact,
    /// One effect explains them.
    Named,
    /// Several effects explain them equally well.
    Ambiguous,
    /// None of the library explains them.
    Unknown,
    /// The data cannot tell.
    InsufficientData,
}

/// An effect, fitted together with the moduli.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Its word.
    pub effect: String,
    /// Fitted amplitude and its standard deviation.
    pub amplitude: [f64; 2],
    /// Fall of the misfit of the seen poses (squared standard deviations).
    pub gain: f64,
    /// Fitted moduli (kPa), right and left.
    pub moduli_kpa: [f64; 2],
    /// What it does to the held-out pose.
    pub held_out: HeldOut,
    /// Score of what is left in smooth shapes; beyond `limit` something else is missing.
    pub left: [f64; 2],
}

/// A pose that the search did not see.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Root mean square distance (mm) without rigid motion: moduli alone fitted.
    pub before_mm: f64,
    /// The same with the effect.
    pub after_mm: f64,
    /// What the errors alone leave.
    pub floor_mm: f64,
    /// Fall of the misfit in standard errors.
    pub z: f64,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Kind.
    pub verdict: VerdictName,
    /// Effect or artefact that is named.
    pub effect: Option<String>,
    /// Effects that the data do not tell apart, the best first.
    pub set: Vec<String>,
    /// Weight of the named effect among all that were fitted and none; not calibrated.
    pub weight: f64,
    /// Why, in plain words.
    pub reason: String,
    /// Effects that these data could not show.
    pub not_testable: Vec<String>,
    /// Fitted effects, the best first.
    pub candidates: Vec<Candidate>,
}

/// Smooth shapes in which something left over is looked for, per pose, and their length (mm).
const SMOOTH_SHAPES: usize = 12;
const SMOOTH_LENGTH_MM: f64 = 35.0;
/// Quantile 99.9 % of the normal distribution.
const RARE: f64 = 3.09;
/// Effects whose misfit is this near to the best are not told apart.
const ALIKE: f64 = 4.0;
/// The held-out pose must gain so many standard errors.
const HELD_OUT: f64 = 2.0;
/// A pose that lies farther off (mm) than this was registered wrongly.
const MISPLACED_MM: f64 = 4.0;
/// Share of effects without a signature that spoils a verdict.
const FAILED: f64 = 0.1;

pub(super) struct Judge<'a> {
    pub frame: &'a Frame,
    pub covariance: &'a DMatrix<f64>,
    pub screening: &'a Screening,
    pub seen: &'a [usize],
    pub held_out: usize,
    pub held_out_whitener: &'a Whitener,
}

impl Judge<'_> {
    /// The verdict, and the fit with the best effect.
    pub fn judge<'f>(
        &self,
        without: &Refitted,
        with: &'f [(&'static Effect, Refitted)],
    ) -> (Verdict, Option<&'f Fit>) {
        let before = self.frame.observe(&without.fit);
        let mut fitted: Vec<(Candidate, &Fit)> = with
            .iter()
            .map(|(effect, found)| (self.candidate(effect, found, without, &before), &found.fit))
            .collect();
        fitted.sort_by(|a, b| b.0.gain.total_cmp(&a.0.gain));
        let candidates: Vec<Candidate> = fitted.iter().map(|(c, _)| c.clone()).collect();
        let best_fit = fitted.first().map(|(_, fit)| *fit);
        let not_testable = self.screening.scores.iter().filter(|s| !s.testable);
        let mut verdict = Verdict {
            verdict: VerdictName::NoDiscrepancy,
            effect: None,
            set: Vec::new(),
            weight: 0.0,
            reason: String::new(),
            not_testable: not_testable.map(|s| s.effect.clone()).collect(),
            candidates,
        };
        self.decide(&mut verdict, &before);
        (verdict, best_fit)
    }

    fn decide(&self, verdict: &mut Verdict, before: &Observed) {
        let Screening { scores, limit, .. } = self.screening;
        if self.screening.failed() as f64 > FAILED * EFFECTS.len() as f64 {
            verdict.verdict = VerdictName::InsufficientData;
            verdict.reason = format!("{} effects could not be computed", self.screening.failed());
            return;
        }
        for &p in self.seen {
            let pose = &before.poses[p];
            let rigid = pose.rigid_part(&before.residual(&[p]));
            let off = (rigid.norm_squared() / rigid.len().max(1) as f64).sqrt();
            if off > MISPLACED_MM {
                verdict.verdict = VerdictName::MeasurementArtifact;
                verdict.effect = Some("registration".into());
                verdict.reason = format!("a pose lies {off:.1} mm off as a whole");
                return;
            }
        }
        let found = scores.iter().any(|score| score.z > *limit);
        let left = self.left(before);
        let Some(best) = verdict.candidates.first().filter(|_| found) else {
            if left[0] > left[1] {
                verdict.verdict = VerdictName::Unknown;
                verdict.reason = format!(
                    "smooth residuals of {:.0} where errors leave {:.0}, and no effect explains them",
                    left[0], left[1]
                );
            } else {
                let largest = scores.iter().map(|score| score.z).fold(0.0, f64::max);
                verdict.reason =
                    format!("largest score {largest:.1}, below {limit:.1}: errors explain it");
            }
            return;
        };
        let alike: Vec<String> = verdict
            .candidates
            .iter()
            .filter(|c| best.gain - c.gain < ALIKE && c.held_out.z > 0.0)
            .map(|c| c.effect.clone())
            .collect();
        let weights: Vec<f64> = verdict
            .candidates
            .iter()
            .map(|c| 0.5 * (c.gain - best.gain))
            .chain([-0.5 * best.gain])
            .map(f64::exp)
            .collect();
        verdict.weight = weights[0] / weights.iter().sum::<f64>();
        let z = best.held_out.z;
        (verdict.verdict, verdict.reason) = if best.gain < limit * limit {
            let reason = format!(
                "fitted together with the moduli, {} explains no more than chance",
                best.effect
            );
            (VerdictName::NoDiscrepancy, reason)
        } else if best.left[0] > best.left[1] {
            let reason = format!(
                "{} explains most of the library, but smooth residuals of {:.0} remain where errors \
                 leave {:.0}",
                best.effect, best.left[0], best.left[1]
            );
            (VerdictName::Unknown, reason)
        } else if z < 0.0 {
            let reason = format!("{} makes the held-out pose worse ({z:.1} s.e.)", best.effect);
            (VerdictName::Unknown, reason)
        } else if alike.len() > 1 {
            (VerdictName::Ambiguous, format!("{} explain the data alike", alike.join(" and ")))
        } else if z < HELD_OUT {
            let reason = format!(
                "{} explains the seen poses; the held-out pose gains only {z:.1} s.e.",
                best.effect
            );
            (VerdictName::InsufficientData, reason)
        } else {
            let reason = format!("held-out pose better by {z:.1} s.e.");
            (VerdictName::Named, reason)
        };
        if matches!(verdict.verdict, VerdictName::Named | VerdictName::InsufficientData) {
            verdict.effect = Some(best.effect.clone());
        }
        if verdict.verdict != VerdictName::NoDiscrepancy {
            verdict.set = alike;
        }
    }

    fn candidate(
        &self,
        effect: &Effect,
        found: &Refitted,
        without: &Refitted,
        before: &Observed,
    ) -> Candidate {
        let after = self.frame.observe(&found.fit);
        let here = &[self.held_out][..];
        let [residual_before, residual_after] = [before, &after].map(|o| o.residual(here));
        let whiten = |r: &DVector<f64>| self.held_out_whitener.whiten(r);
        let (old, new) = (whiten(&residual_before), whiten(&residual_after));
        // With independent errors of variance 1 the difference of the squares has this error.
        let error = 2.0 * (&old - &new).norm();
        let nodes = self.frame.reference.len();
        let at = self.held_out * nodes;
        let own = self.covariance.view((at, at), (nodes, nodes)).into_owned();
        let pose = &before.poses[self.held_out];
        Candidate {
            effect: effect.name.into(),
            amplitude: [found.amplitude, found.amplitude_sd],
            gain: without.misfit - found.misfit,
            moduli_kpa: [found.fit.moduli.right_kpa, found.fit.moduli.left_kpa],
            held_out: HeldOut {
                before_mm: pose.without_rigid_mm(&residual_before),
                after_mm: after.poses[self.held_out].without_rigid_mm(&residual_after),
                floor_mm: pose.floor_mm(&own),
                z: (old.norm_squared() - new.norm_squared()) / error.max(f64::MIN_POSITIVE),
            },
            left: self.left(&after),
        }
    }

    /// Square of what the seen residuals have in smooth shapes, in standard deviations, and the
    /// value that errors alone exceed once in a thousand times.
    fn left(&self, observed: &Observed) -> [f64; 2] {
        let nodes = self.frame.reference.len();
        let mut columns: Vec<DVector<f64>> = Vec::new();
        for (block, &p) in self.seen.iter().enumerate() {
            let pose = &observed.poses[p];
            let kernel = DMatrix::from_fn(nodes, nodes, |i, j| {
                let far = (pose.points[i] - pose.points[j]).norm_squared();
                let facing = pose.normals[i].dot(&pose.normals[j]);
                (-0.5 * far / SMOOTH_LENGTH_MM.powi(2)).exp() * facing
            });
            let eigen = kernel.symmetric_eigen();
            let mut order: Vec<usize> = (0..nodes).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            for &k in order.iter().take(SMOOTH_SHAPES) {
                let mut column = DVector::zeros(nodes * self.seen.len());
                column.rows_mut(block * nodes, nodes).copy_from(&eigen.eigenvectors.column(k));
                columns.push(column);
            }
        }
        let shapes = DMatrix::from_columns(&columns);
        let rows: Vec<usize> = self.seen.iter().flat_map(|p| p * nodes..(p + 1) * nodes).collect();
        let covariance = self.covariance.select_rows(&rows).select_columns(&rows);
        let small = shapes.transpose() * covariance * &shapes;
        let parts = shapes.transpose() * observed.residual(self.seen);
        let square = small.cholesky().map_or(f64::NAN, |f| parts.dot(&f.solve(&parts)));
        // Quantile of chi-square (Wilson & Hilferty 1931).
        let k = columns.len() as f64;
        let limit = k * (1.0 - 2.0 / (9.0 * k) + RARE * (2.0 / (9.0 * k)).sqrt()).powi(3);
        [square, limit]
    }
}
