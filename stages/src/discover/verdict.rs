//! The answer, and what it rests on.

use super::{
    budget::Whitener,
    evidence::Evidence,
    observe::{leftover, part, rows},
    refit::{Fitted, linear},
    screen::Screening,
    signature::{Projector, Signature},
};
use crate::effects::Effect;
use mammotwin_data::Failure;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
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
pub(crate) const RARE: f64 = 3.09;
/// Effects whose misfit is this near to the best are not told apart.
pub(crate) const ALIKE: f64 = 4.0;
/// The held-out pose must gain so many standard errors; if it loses as many, the effect is refuted.
pub(crate) const HELD_OUT: f64 = 2.0;
/// A pose that lies farther off (mm) than this was registered wrongly.
const MISPLACED_MM: f64 = 4.0;
/// Share of effects without a signature that spoils a verdict.
const FAILED: f64 = 0.1;

/// Effects that are fitted after the screening.
pub(crate) const FITTED: usize = 3;

/// Weighs the evidence of a subject, with one pose held out.
pub struct Judge<'a> {
    evidence: &'a Evidence,
    /// Poses that the search sees.
    pub(super) seen: Vec<usize>,
    held_out: usize,
    covariance: DMatrix<f64>,
    /// Of the seen poses.
    pub(super) whitener: Whitener,
    held_out_whitener: Whitener,
    /// Smooth shapes of the seen residuals, as columns, and the factor of their covariance.
    smooth: (DMatrix<f64>, Cholesky<f64, Dyn>),
}

impl<'a> Judge<'a> {
    /// Prepares the weights of the errors.
    ///
    /// # Errors
    /// [`Failure::BadInput`] when there is no such pose, or none besides it.
    pub fn new(evidence: &'a Evidence, held_out: &str) -> Result<Self, Failure> {
        let place = evidence.poses.iter().position(|pose| pose == held_out);
        let seen: Vec<usize> = (0..evidence.poses.len()).filter(|p| Some(*p) != place).collect();
        let (Some(place), false) = (place, seen.is_empty()) else {
            return Err(Failure::BadInput(format!(
                "discover: needs the held-out pose {held_out} and at least one more beside the \
                 reference pose"
            )));
        };
        let shapes = smooth(evidence, &seen);
        Self::on(evidence, seen, place, shapes)
    }

    /// A judge of other evidence on the same nodes, e.g. with other errors.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when its errors have no covariance.
    pub fn again<'b>(&self, evidence: &'b Evidence) -> Result<Judge<'b>, Failure> {
        Judge::on(evidence, self.seen.clone(), self.held_out, self.smooth.0.clone())
    }

    fn on(
        evidence: &'a Evidence,
        seen: Vec<usize>,
        held_out: usize,
        smooth: DMatrix<f64>,
    ) -> Result<Self, Failure> {
        let Evidence { budget, meshings, .. } = evidence;
        let covariance = budget.covariance(&evidence.places(), meshings);
        let nodes = evidence.nodes();
        let none = || Failure::Numerics("discover: errors without a covariance".into());
        let whiten = |poses: &[usize]| Whitener::new(&covariance, poses, nodes).ok_or_else(none);
        let rows = rows(&seen, nodes);
        let own = covariance.select_rows(&rows).select_columns(&rows);
        let factor = (smooth.transpose() * own * &smooth).cholesky().ok_or_else(none)?;
        Ok(Self {
            whitener: whiten(&seen)?,
            held_out_whitener: whiten(&[held_out])?,
            smooth: (smooth, factor),
            evidence,
            seen,
            held_out,
            covariance,
        })
    }

    /// Asks of each effect whether residuals (mm, all poses) have it.
    pub fn screen(&self, residual: &DVector<f64>) -> Screening {
        let seen = |signature: &Signature| signature.of(|v| self.seen(v));
        let signatures: Vec<Signature> = self.evidence.signatures.iter().map(seen).collect();
        let systematic = self.evidence.budget.systematic();
        Screening::new(&self.projector(), &self.seen(residual), &signatures, systematic)
    }

    /// What the moduli leave of the seen residuals.
    fn projector(&self) -> Projector<'_> {
        let moduli: Vec<DVector<f64>> =
            self.evidence.slopes().into_iter().map(|v| self.seen(v)).collect();
        Projector::new(&self.whitener, &moduli)
    }

    /// The amplitude of each effect that changes the seen poses by a size (standard deviations) beyond what moduli
    /// can do; `None` where no plausible one does.
    pub fn amplitudes_of(&self, size: f64) -> Vec<(&'static Effect, Option<f64>)> {
        let projector = self.projector();
        let amplitude = |signature: &Signature| {
            let seen = signature.of(|v| self.seen(v));
            let nothing = DVector::zeros(seen.course.mean.slope.len());
            (signature.effect, projector.explain(&seen, &nothing).amplitude_of(size))
        };
        self.evidence.signatures.iter().map(amplitude).collect()
    }

    /// The size (standard deviations) of the change of the seen poses by an amplitude, the calibrated model
    /// being the one without it.
    pub fn size_of(&self, effect: &str, amplitude: f64) -> Option<f64> {
        let signature = self.evidence.signatures.iter().find(|s| s.effect.name == effect)?;
        let change = self.seen(&signature.change(amplitude));
        Some(self.projector().surviving(&change).0.norm())
    }

    /// The seen part of a column of all poses.
    fn seen(&self, all: &DVector<f64>) -> DVector<f64> {
        part(all, &self.seen, self.evidence.nodes())
    }

    /// The effects to fit, as places in the evidence, and their linear amplitudes.
    pub(super) fn likely(&self, screening: &Screening) -> Vec<(usize, f64)> {
        let signatures = &self.evidence.signatures;
        let place =
            |name: &str| signatures.iter().position(|signature| signature.effect.name == name);
        let ranked = screening.ranked().into_iter().filter(|score| score.z > 0.0);
        ranked.filter_map(|s| Some((place(&s.effect)?, s.amplitude?))).take(FITTED).collect()
    }

    /// The verdict on residuals (mm, all poses), as far as they are linear in moduli and amplitudes.
    pub fn linear(&self, residual: &DVector<f64>) -> (Screening, Verdict) {
        let fit = |effect| linear(self.evidence, &self.whitener, &self.seen, residual, effect);
        let screening = self.screen(residual);
        let likely = self.likely(&screening).into_iter();
        let with: Vec<(usize, Fitted)> = likely.map(|(k, _)| (k, fit(Some(k)))).collect();
        let verdict = self.judge(&screening, &fit(None), &with);
        (screening, verdict)
    }

    /// The verdict. `with` are fits with an effect each, as places in the evidence.
    pub(super) fn judge(
        &self,
        screening: &Screening,
        without: &Fitted,
        with: &[(usize, Fitted)],
    ) -> Verdict {
        let mut candidates: Vec<Candidate> = with
            .iter()
            .map(|(k, found)| self.candidate(self.evidence.signatures[*k].effect, found, without))
            .collect();
        candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let not_testable = screening.scores.iter().filter(|s| !s.testable);
        let mut verdict = Verdict {
            verdict: VerdictName::NoDiscrepancy,
            effect: None,
            set: Vec::new(),
            weight: 0.0,
            reason: String::new(),
            not_testable: not_testable.map(|s| s.effect.clone()).collect(),
            candidates,
        };
        self.decide(&mut verdict, screening, &without.residual);
        verdict
    }

    /// Root mean squares (mm) of a pose's residuals after its best rigid motion: before, after, and
    /// of what errors leave when the moduli are fitted.
    pub(super) fn rms_mm(
        &self,
        pose: usize,
        before: &DVector<f64>,
        after: &DVector<f64>,
    ) -> [f64; 3] {
        let (shape, nodes) = (&self.evidence.shapes[pose], self.evidence.nodes());
        let [before, after] = [before, after].map(|all| part(all, &[pose], nodes));
        let errors = leftover(&self.covariance_of(pose), &self.fitted(pose));
        let floor_mm = (errors.trace() / nodes.max(1) as f64).max(0.0).sqrt();
        [shape.without_rigid_mm(&before), shape.without_rigid_mm(&after), floor_mm]
    }

    /// Covariance (mm²) of the errors of one pose.
    pub(super) fn covariance_of(&self, pose: usize) -> DMatrix<f64> {
        let nodes = self.evidence.nodes();
        let at = pose * nodes;
        self.covariance.view((at, at), (nodes, nodes)).into_owned()
    }

    /// What is fitted to the residuals of a pose whatever the effect: rigid motion and moduli (mm).
    pub(super) fn fitted(&self, pose: usize) -> Vec<DVector<f64>> {
        let moduli = self.evidence.slopes().into_iter();
        let moduli = moduli.map(|column| part(column, &[pose], self.evidence.nodes()));
        self.evidence.shapes[pose].rigid_modes().into_iter().chain(moduli).collect()
    }

    fn decide(&self, verdict: &mut Verdict, screening: &Screening, before: &DVector<f64>) {
        let Screening { scores, limit, .. } = screening;
        let failed = &self.evidence.failed;
        let tried = failed.len() + self.evidence.signatures.len();
        if failed.len() as f64 > FAILED * tried as f64 {
            verdict.verdict = VerdictName::InsufficientData;
            verdict.reason = format!("the model failed with {}", failed.join(", "));
            return;
        }
        for &p in &self.seen {
            let pose = &self.evidence.shapes[p];
            let rigid = pose.rigid_part(&part(before, &[p], self.evidence.nodes()));
            let off = (rigid.norm_squared() / rigid.len().max(1) as f64).sqrt();
            if off > MISPLACED_MM {
                verdict.verdict = VerdictName::MeasurementArtifact;
                verdict.effect = Some("registration".into());
                verdict.reason = format!("a pose lies {off:.1} mm off as a whole");
                return;
            }
        }
        let found = scores.iter().any(|score| score.testable && score.z > *limit);
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
        } else if z < -HELD_OUT {
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

    fn candidate(&self, effect: &Effect, found: &Fitted, without: &Fitted) -> Candidate {
        let whiten = |all: &DVector<f64>| {
            self.held_out_whitener.whiten(&part(all, &[self.held_out], self.evidence.nodes()))
        };
        let (old, new) = (whiten(&without.residual), whiten(&found.residual));
        // With independent errors of variance 1 the difference of the squares has this error.
        let error = 2.0 * (&old - &new).norm();
        let [before_mm, after_mm, floor_mm] =
            self.rms_mm(self.held_out, &without.residual, &found.residual);
        Candidate {
            effect: effect.name.into(),
            amplitude: [found.amplitude, found.amplitude_sd],
            gain: without.misfit - found.misfit,
            moduli_kpa: [found.moduli.right_kpa, found.moduli.left_kpa],
            held_out: HeldOut {
                before_mm,
                after_mm,
                floor_mm,
                z: (old.norm_squared() - new.norm_squared()) / error.max(f64::MIN_POSITIVE),
            },
            left: self.left(&found.residual),
        }
    }

    /// Square of what the seen residuals have in smooth shapes, in standard deviations, and the
    /// value that errors alone exceed once in a thousand times.
    fn left(&self, residual: &DVector<f64>) -> [f64; 2] {
        let (shapes, factor) = &self.smooth;
        let parts = shapes.transpose() * part(residual, &self.seen, self.evidence.nodes());
        // Quantile of chi-square (Wilson & Hilferty 1931).
        let k = shapes.ncols() as f64;
        let limit = k * (1.0 - 2.0 / (9.0 * k) + RARE * (2.0 / (9.0 * k)).sqrt()).powi(3);
        [parts.dot(&factor.solve(&parts)), limit]
    }
}

/// The smoothest shapes that the residuals of the seen poses may have, pose by pose, as columns.
fn smooth(evidence: &Evidence, seen: &[usize]) -> DMatrix<f64> {
    let nodes = evidence.nodes();
    let mut columns: Vec<DVector<f64>> = Vec::new();
    for (block, &p) in seen.iter().enumerate() {
        let pose = &evidence.shapes[p];
        let kernel = DMatrix::from_fn(nodes, nodes, |i, j| {
            let far = (pose.points[i] - pose.points[j]).norm_squared();
            let facing = pose.normals[i].dot(&pose.normals[j]);
            (-0.5 * far / SMOOTH_LENGTH_MM.powi(2)).exp() * facing
        });
        let eigen = kernel.symmetric_eigen();
        let mut order: Vec<usize> = (0..nodes).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        for &k in order.iter().take(SMOOTH_SHAPES) {
            let mut column = DVector::zeros(nodes * seen.len());
            column.rows_mut(block * nodes, nodes).copy_from(&eigen.eigenvectors.column(k));
            columns.push(column);
        }
    }
    DMatrix::from_columns(&columns)
}
