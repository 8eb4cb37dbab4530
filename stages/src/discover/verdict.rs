//! The answer, and what it rests on.

use super::{
    artefacts::REGISTRATION,
    budget::Whitener,
    drift::Drift,
    evidence::{Evidence, nothing_decides},
    held_out::{HeldOut, Weights},
    observe::{leftover, part},
    refit::{Fitted, linear},
    rest::Rest,
    screen::Screening,
    second::Second,
    signature::{Projector, Signature},
};
use crate::effects::Effect;
use mammotwin_data::Failure;
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
    /// By how many standard deviations the fit would go beyond the plausible range.
    pub beyond: f64,
    /// Fall of the misfit of the seen poses (squared standard deviations).
    pub gain: f64,
    /// Fitted moduli (kPa), right and left.
    pub moduli_kpa: [f64; 2],
    /// What it does to the held-out pose.
    pub held_out: HeldOut,
    /// Score of what is left in smooth shapes; beyond `limit` something else is missing.
    pub left: [f64; 2],
    /// Why its fit is no least misfit, if it is none: then nothing here tells anything.
    pub unsettled: Option<String>,
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
    /// Weight of the effect that is named, or else explains most, among all that were fitted and none; not calibrated.
    pub weight: f64,
    /// Why, in plain words.
    pub reason: String,
    /// Effects that these data could not show.
    pub not_testable: Vec<String>,
    /// Fitted effects, the best first.
    pub candidates: Vec<Candidate>,
    /// What the best of them leaves, where another effect explains it.
    pub second: Option<Second>,
}

impl Verdict {
    /// The effect that is told, or the best of several; else the one that explains most.
    pub fn chosen(&self) -> Option<&Candidate> {
        let several = self.set.first().filter(|_| self.verdict == VerdictName::Ambiguous);
        let told = self.effect.as_ref().or(several);
        let named = told.and_then(|name| self.candidates.iter().find(|c| c.effect == *name));
        named.or(self.candidates.first())
    }
}

/// Effects whose misfit is this near to the best are not told apart.
pub(crate) const ALIKE: f64 = 4.0;
/// A pose that lies farther off (mm) than this was registered wrongly.
const MISPLACED_MM: f64 = 4.0;
/// Share of effects without a signature that spoils a verdict.
const FAILED: f64 = 0.1;

/// A fit that would go beyond the plausible range by so many standard deviations explains nothing.
const IMPLAUSIBLE: f64 = 2.0;

/// Effects that are fitted after the screening.
pub(crate) const FITTED: usize = 3;

/// Weighs the evidence of a subject, with one pose held out.
pub struct Judge<'a> {
    pub(super) evidence: &'a Evidence,
    /// Poses that the search sees.
    pub(super) seen: Vec<usize>,
    held_out: usize,
    covariance: DMatrix<f64>,
    /// Of the seen poses.
    pub(super) whitener: Whitener,
    weights: Weights,
    pub(super) rest: Rest,
}

impl<'a> Judge<'a> {
    /// Prepares the weights of the errors.
    ///
    /// # Errors
    /// [`Failure::BadInput`] when there is no such pose, or none besides it.
    pub fn new(evidence: &'a Evidence) -> Result<Self, Failure> {
        let held_out = &evidence.held_out;
        let place = evidence.poses.iter().position(|pose| pose == held_out);
        let seen = evidence.seen();
        let (Some(place), false) = (place, seen.is_empty()) else {
            return Err(nothing_decides(held_out));
        };
        let rest = Rest::new(evidence, &seen);
        Self::on(evidence, seen, place, rest)
    }

    /// A judge of other evidence on the same nodes, e.g. with other errors.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when its errors have no covariance.
    pub fn again<'b>(&self, evidence: &'b Evidence) -> Result<Judge<'b>, Failure> {
        Judge::on(evidence, self.seen.clone(), self.held_out, self.rest.clone())
    }

    fn on(
        evidence: &'a Evidence,
        seen: Vec<usize>,
        held_out: usize,
        rest: Rest,
    ) -> Result<Self, Failure> {
        let Evidence { budget, meshings, .. } = evidence;
        let covariance = budget.covariance(&evidence.places(), meshings);
        let nodes = evidence.nodes();
        let none = || Failure::Numerics("discover: errors without a covariance".into());
        let whitener = Whitener::new(&covariance, &seen, nodes).ok_or_else(none)?;
        let poses = (&seen[..], held_out, nodes);
        let weights =
            Weights::new(&covariance, &whitener, evidence.slopes(), poses).ok_or_else(none)?;
        Ok(Self { whitener, weights, rest, evidence, seen, held_out, covariance })
    }

    /// Asks of each effect whether residuals (mm, all poses) have it.
    pub fn screen(&self, residual: &DVector<f64>) -> Screening {
        let seen = |signature: &Signature| signature.of(|v| self.seen(v));
        let signatures: Vec<Signature> = self.evidence.signatures.iter().map(seen).collect();
        let systematic = self.evidence.budget.systematic();
        Screening::new(&self.projector(), &self.seen(residual), &signatures, systematic)
    }

    /// Moduli pose by pose, of the poses that the search sees.
    pub fn drift(&self) -> Drift {
        Drift::of(self.evidence, &self.whitener, &self.seen, &self.evidence.residual)
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
    pub(super) fn seen(&self, all: &DVector<f64>) -> DVector<f64> {
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
        let mut candidates: Vec<Candidate> =
            with.iter().map(|(k, found)| self.candidate(*k, found, without)).collect();
        // What an unsettled fit gains is no measure.
        let unsettled = |c: &Candidate| c.unsettled.is_some();
        candidates.sort_by(|a, b| {
            unsettled(a).cmp(&unsettled(b)).then_with(|| b.gain.total_cmp(&a.gain))
        });
        let not_testable = screening.scores.iter().filter(|s| !s.testable);
        let mut verdict = Verdict {
            verdict: VerdictName::NoDiscrepancy,
            effect: None,
            set: Vec::new(),
            weight: 0.0,
            reason: String::new(),
            not_testable: not_testable.map(|s| s.effect.clone()).collect(),
            second: self.beside_the_best(screening, &candidates, with),
            candidates,
        };
        self.decide(&mut verdict, screening, without);
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
        // The moduli were not fitted to the held-out pose.
        let errors = if pose == self.held_out {
            leftover(&self.weights.errors, &shape.rigid_modes())
        } else {
            leftover(&self.covariance_of(pose), &self.fitted(pose))
        };
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

    fn decide(&self, verdict: &mut Verdict, screening: &Screening, without: &Fitted) {
        let before = &without.residual;
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
                verdict.effect = Some(REGISTRATION.into());
                verdict.reason = format!("a pose lies {off:.1} mm off as a whole");
                return;
            }
        }
        // An effect is weighed against the moduli's own best, and against effects that may explain as much.
        let over =
            |name: &str| scores.iter().any(|s| s.effect == name && s.testable && s.z > *limit);
        let unsettled = |c: &&Candidate| c.unsettled.is_some() && over(&c.effect);
        let unsettled = match (&without.unsettled, verdict.candidates.iter().find(unsettled)) {
            (Some(why), _) => Some(("the moduli alone", why)),
            (None, Some(c)) => c.unsettled.as_ref().map(|why| (c.effect.as_str(), why)),
            (None, None) => None,
        };
        if let Some((what, why)) = unsettled {
            verdict.reason = format!("the fit of {what} came to no end: {why}");
            verdict.verdict = VerdictName::InsufficientData;
            return;
        }
        let left = self.left(before, None);
        let rest = |[left, limit]: [f64; 2]| {
            (left > limit).then(|| {
                format!("smooth residuals of {left:.0} remain where errors leave {limit:.0}")
            })
        };
        let unexplained = |reason: String| match rest(left) {
            Some(rest) => (VerdictName::Unknown, format!("{rest}, and {reason}")),
            None => (VerdictName::NoDiscrepancy, reason),
        };
        let found = scores.iter().any(|score| score.testable && score.z > *limit);
        let settled = || verdict.candidates.iter().filter(|c| c.unsettled.is_none());
        let Some(best) = settled().next().filter(|_| found) else {
            let shown = scores.iter().filter(|score| score.testable);
            let largest = shown.map(|score| score.z).fold(0.0, f64::max);
            let reason = format!("the largest score is {largest:.1}, below {limit:.1}: by chance");
            (verdict.verdict, verdict.reason) = unexplained(reason);
            let blind = scores.iter().all(|score| !score.testable);
            if blind && verdict.verdict == VerdictName::NoDiscrepancy {
                verdict.verdict = VerdictName::InsufficientData;
                verdict.reason = "these data could show none of the effects".into();
            }
            return;
        };
        let near = settled().filter(|c| best.gain - c.gain < ALIKE);
        let (better, worse): (Vec<&Candidate>, Vec<&Candidate>) =
            near.partition(|c| c.held_out.fall > 0.0);
        let confirmed = better.iter().any(|c| c.held_out.confirms());
        let names = |of: &[&Candidate]| of.iter().map(|c| c.effect.clone()).collect::<Vec<_>>();
        let weight = |gain: f64| (0.5 * (gain - best.gain)).exp();
        let weights = settled().map(|c| weight(c.gain)).sum::<f64>() + weight(0.0);
        let mut told = best;
        let z = best.held_out.z;
        let completed = verdict.second.as_ref().is_some_and(Second::completes);
        let mut set = names(&better);
        if !better.is_empty() {
            let fitted = |name: &String| verdict.candidates.iter().any(|c| c.effect == *name);
            set.extend(screening.alike(&best.effect).into_iter().filter(|name| !fitted(name)));
        }
        (verdict.verdict, verdict.reason) = if best.gain < limit * limit {
            set.clear();
            unexplained(format!(
                "fitted together with the moduli, {} explains no more than chance",
                best.effect
            ))
        } else if let Some(rest) = rest(best.left).filter(|_| !completed) {
            (
                VerdictName::Unknown,
                format!("{} explains most of the library, but {rest}", best.effect),
            )
        } else if best.beyond > IMPLAUSIBLE {
            let (name, far) = (&best.effect, best.beyond);
            let reason = format!(
                "{name} would have to be more than is plausible, by {far:.1} standard deviations"
            );
            (VerdictName::Unknown, reason)
        } else if best.held_out.refutes() {
            let loss = -best.held_out.fall / best.held_out.fall_error;
            let reason = format!("{} makes the held-out pose worse by {loss:.1} s.e.", best.effect);
            (VerdictName::Unknown, reason)
        } else if set.len() > 1 && confirmed {
            (VerdictName::Ambiguous, format!("{} explain the data alike", set.join(" and ")))
        } else if best.held_out.confirms() {
            let reason = format!("{z:.1} s.e. of what it foretells are in the held-out pose");
            (VerdictName::Named, reason)
        } else if let Some(rival) = better.iter().find(|c| c.held_out.confirms()) {
            // The seen poses prefer one, the held-out pose another: no test is left that knows of neither.
            told = *rival;
            set.extend(names(&worse));
            let reason = format!(
                "{} explains the seen poses best, but makes the held-out pose worse; {}, which explains them alike, has {:.1} s.e. of what it foretells there",
                best.effect, rival.effect, rival.held_out.z
            );
            (VerdictName::InsufficientData, reason)
        } else {
            set.extend(names(&worse));
            let reason = format!(
                "{} explains the seen poses; of what it foretells {z:.1} s.e. are in the held-out pose",
                best.effect
            );
            (VerdictName::InsufficientData, reason)
        };
        if matches!(verdict.verdict, VerdictName::Named | VerdictName::InsufficientData) {
            verdict.effect = Some(told.effect.clone());
        } else if let (VerdictName::Ambiguous, Some(first)) = (verdict.verdict, better.first()) {
            told = *first;
        }
        verdict.weight = weight(told.gain) / weights;
        if let (Some(second), VerdictName::Named | VerdictName::Ambiguous) =
            (&verdict.second, verdict.verdict)
        {
            let Second { effect, z, limit, .. } = second;
            verdict.reason += &format!(
                "; beside it {effect} has a score of {z:.1} (limit {limit:.1}): ask the study with the first once more"
            );
        }
        verdict.set = set;
    }

    /// The second effect, beside the best candidate.
    fn beside_the_best(
        &self,
        screening: &Screening,
        candidates: &[Candidate],
        with: &[(usize, Fitted)],
    ) -> Option<Second> {
        let name = &candidates.first()?.effect;
        let of_best = |(k, _): &&(usize, Fitted)| self.evidence.signatures[*k].effect.name == name;
        let (place, found) = with.iter().find(of_best)?;
        self.second(*place, found, &screening.alike(name))
    }

    fn candidate(&self, place: usize, found: &Fitted, without: &Fitted) -> Candidate {
        let signature = &self.evidence.signatures[place];
        let rms_mm = self.rms_mm(self.held_out, &without.residual, &found.residual);
        Candidate {
            effect: signature.effect.name.into(),
            amplitude: [found.amplitude, found.amplitude_sd],
            beyond: found.beyond,
            gain: without.misfit - found.misfit,
            moduli_kpa: [found.moduli.right_kpa, found.moduli.left_kpa],
            held_out: self.weights.judge(&without.residual, &found.residual, rms_mm),
            left: self.left(&found.residual, Some(&signature.rate(found.amplitude))),
            unsettled: found.unsettled.clone(),
        }
    }

    /// Square of what residuals (mm, all poses) have in smooth shapes beyond the moduli, and an effect with this
    /// derivative (mm), in standard deviations; and the value that errors exceed once in a thousand times.
    fn left(&self, residual: &DVector<f64>, effect: Option<&DVector<f64>>) -> [f64; 2] {
        let fitted = self.evidence.slopes().into_iter().chain(effect);
        let fitted: Vec<DVector<f64>> = fitted.map(|column| self.seen(column)).collect();
        let systematic = self.evidence.budget.systematic();
        self.rest.of(&self.whitener, &fitted, &self.seen(residual), systematic)
    }
}
