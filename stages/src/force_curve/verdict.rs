//! The answer, and what it rests on.

use super::{
    evidence::{Evidence, HeldOut, Parameters},
    library::CurveEffect,
    record::Record,
    search::{CurveScore, CurveScreening, Fitted, refit, screen},
};
use crate::discover::{ALIKE, ALIKE_COSINE, FITTED, HELD_OUT, RARE, VerdictName};
use serde::Serialize;

/// Fewest forces that are seen: fewer tell no shape from offset and stiffness.
const FEWEST_FORCES: usize = 6;
/// An offset of so many standard deviations is an artefact of the measurement.
const MISPLACED: f64 = 3.0;

/// An effect, fitted with offset and stiffness.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurveCandidate {
    /// Its word.
    pub effect: &'static str,
    /// Amplitude and its standard deviation.
    pub amplitude: [f64; 2],
    /// Offset (mm) of the thickness beside it.
    pub offset_mm: f64,
    /// Stiffness of all tissue over the model's beside it.
    pub stiffness: f64,
    /// Fall of the misfit of what was seen (squared standard deviations).
    pub gain: f64,
    /// Score of what is left in smooth shapes.
    pub left: f64,
    /// Misfit of the held-out forces without and with it (root mean square in standard deviations).
    pub held_out: [f64; 2],
    /// Fall of their misfit in standard errors.
    pub held_out_z: f64,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurveVerdict {
    /// Kind.
    pub verdict: VerdictName,
    /// The named effect, or `thickness_offset`.
    pub effect: Option<&'static str>,
    /// Effects that the data do not tell apart, the best first; with insufficient data those that explain what
    /// was seen.
    pub set: Vec<&'static str>,
    /// Why.
    pub reason: String,
    /// Largest score that chance gives once in a hundred times.
    pub limit: f64,
    /// All effects, testable ones first, then the likeliest.
    pub scores: Vec<CurveScore>,
    /// Effects that these data could not show at all.
    pub not_testable: Vec<&'static str>,
    /// Offset (mm) of the thickness without any effect.
    pub offset_mm: f64,
    /// Stiffness of all tissue over the model's without any effect.
    pub stiffness: f64,
    /// Score of smooth shapes without any effect.
    pub left: f64,
    /// Fitted effects, the best first.
    pub candidates: Vec<CurveCandidate>,
}

/// Judges a record by another one of the same compression; by its own last forces where there is none. `None`
/// when the errors have no covariance.
pub fn judge(
    evidence: &Evidence,
    record: &Record,
    another: Option<&Record>,
) -> Option<CurveVerdict> {
    let (joint, [seen_rows, held_out_rows], kind) = match another {
        Some(another) => {
            let (count, more) = (record.0.len(), another.0.len());
            let joint = Record(record.0.iter().chain(&another.0).copied().collect());
            let rows = [(0..count).collect(), (count..count + more).collect()];
            (joint, rows, HeldOut::Another)
        }
        None => (record.clone(), record.split(), HeldOut::Last),
    };
    let whole = evidence.weigh(&joint)?;
    let seen = joint.rows(&seen_rows);
    let weighed = whole.part(&seen, &seen_rows)?;
    let held_out = joint.rows(&held_out_rows);
    let decides = whole.part(&held_out, &held_out_rows)?;
    // Another record has an offset of its own.
    let there = |ladder: Option<usize>, at: &Parameters| match kind {
        HeldOut::Last => *at,
        HeldOut::Another => decides.placed(ladder, *at),
    };
    let screening = screen(&weighed);
    let CurveScreening { scores, limit, plain, left, cosines } = screening;
    let not_testable = scores.iter().filter(|s| !s.testable).map(|s| s.effect).collect();
    let mut answer = CurveVerdict {
        verdict: VerdictName::NoDiscrepancy,
        effect: None,
        set: Vec::new(),
        reason: "Errors, an offset of the thickness and the stiffness explain the record.".into(),
        limit,
        scores,
        not_testable,
        offset_mm: plain.offset_mm,
        stiffness: plain.stiffness.exp(),
        left,
        candidates: Vec::new(),
    };
    if seen.forces() < FEWEST_FORCES {
        answer.verdict = VerdictName::InsufficientData;
        answer.reason = format!(
            "{} forces beside those that decide; {FEWEST_FORCES} at least tell the shape of a curve \
             from an offset and a stiffness.",
            seen.forces()
        );
        return Some(answer);
    }
    let detected = answer.scores.iter().any(|s| s.testable && s.z > limit);
    if !detected {
        conclude_nothing(&mut answer, weighed.offset_error_mm);
        return Some(answer);
    }
    let place = |name: &str| evidence.ladders.iter().position(|l| l.effect.name == name);
    // The best three, and what these data do not tell from them.
    let mut wanted: Vec<usize> = Vec::new();
    let likely = answer.scores.iter().filter(|s| s.testable && s.z > RARE).take(FITTED);
    for score in likely {
        for name in std::iter::once(&score.effect).chain(&score.alike) {
            wanted.extend(place(name).filter(|n| !wanted.contains(n)));
        }
    }
    let mut fits: Vec<(Fitted, CurveCandidate)> = Vec::new();
    for ladder in wanted {
        let fit = refit(&weighed, ladder, &plain);
        let rows = [&seen_rows[..], &held_out_rows[..]];
        let without = [&plain, &there(None, &plain)];
        let with = [&fit.at, &there(Some(ladder), &fit.at)];
        let [before, after] = whole.foretold(rows, without, (ladder, with), kind)?;
        let apart = (&before - &after).norm();
        let fall = before.norm_squared() - after.norm_squared();
        let size = (before.len() as f64).sqrt();
        let candidate = CurveCandidate {
            effect: evidence.ladders[ladder].effect.name,
            amplitude: [fit.at.amplitude, fit.deviation],
            offset_mm: fit.at.offset_mm,
            stiffness: fit.at.stiffness.exp(),
            gain: fit.gain,
            left: fit.left,
            held_out: [before.norm() / size, after.norm() / size],
            held_out_z: fall / (2.0 * apart).max(f64::MIN_POSITIVE),
        };
        fits.push((fit, candidate));
    }
    fits.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    conclude(&mut answer, &fits, &cosines);
    answer.candidates = fits.into_iter().map(|(_, candidate)| candidate).collect();
    Some(answer)
}

/// Nothing was detected: an offset beyond its error is one of the measurement.
fn conclude_nothing(answer: &mut CurveVerdict, offset_error_mm: f64) {
    if answer.left > RARE {
        answer.verdict = VerdictName::Unknown;
        answer.reason = format!(
            "Smooth residuals are beyond what errors leave (score {:.1}), and no effect of the library \
             has their shape.",
            answer.left
        );
    } else if answer.offset_mm.abs() > MISPLACED * offset_error_mm {
        answer.verdict = VerdictName::MeasurementArtifact;
        answer.effect = Some("thickness_offset");
        answer.reason = format!(
            "The thickness that the unit shows is off by {:.1} mm: no physics.",
            answer.offset_mm
        );
    }
}

fn conclude(answer: &mut CurveVerdict, fits: &[(Fitted, CurveCandidate)], cosines: &[Vec<f64>]) {
    let Some((best_fit, best)) = fits.first() else { return };
    let together = |(fit, c): &&(Fitted, CurveCandidate)| {
        let cosine = cosines[best_fit.ladder][fit.ladder].abs();
        let same = best.gain - c.gain < ALIKE || cosine > ALIKE_COSINE;
        same && c.held_out_z > -HELD_OUT
    };
    answer.set = fits.iter().filter(together).map(|(_, c)| c.effect).collect();
    let (verdict, reason) = if best.left > RARE {
        let text = format!(
            "{} explains most, yet smooth residuals stay beyond what errors leave (score {:.1}): something \
             that the library lacks.",
            best.effect, best.left
        );
        (VerdictName::Unknown, text)
    } else if best.held_out_z <= -HELD_OUT {
        let text = format!(
            "{} explains what was seen and foretells the held-out forces worse than nothing ({:.1} \
             standard errors): something that the library lacks.",
            best.effect, best.held_out_z
        );
        (VerdictName::Unknown, text)
    } else if answer.set.len() > 1 {
        (VerdictName::Ambiguous, "Several effects explain the record equally well.".into())
    } else if best.held_out_z < HELD_OUT {
        let text = format!(
            "{} explains what was seen; the held-out forces gain {:.1} standard errors only.",
            best.effect, best.held_out_z
        );
        (VerdictName::InsufficientData, text)
    } else {
        let sentence = CurveEffect::named(best.effect).map_or("", |e| e.sentence);
        (VerdictName::Named, format!("{sentence} The held-out forces bear it out."))
    };
    if verdict == VerdictName::Named {
        answer.effect = Some(best.effect);
    }
    // What explains the seen forces and is not borne out stays for the reader; `unknown` has none.
    if verdict == VerdictName::Unknown {
        answer.set.clear();
    }
    (answer.verdict, answer.reason) = (verdict, reason);
}

/// Offset, stiffness and amplitude of a fitted effect.
impl CurveCandidate {
    /// As the model takes them.
    pub fn parameters(&self) -> Parameters {
        Parameters {
            offset_mm: self.offset_mm,
            stiffness: self.stiffness.ln(),
            amplitude: self.amplitude[0],
        }
    }
}
