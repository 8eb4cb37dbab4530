//! Which effect the image model lacks.

use super::{
    evidence::{Exposures, Free, Parameters},
    field::ChainError,
    library::{IMAGE_EFFECTS, ImageEffect},
};
use crate::{
    discover::{ALIKE, FITTED, HELD_OUT, RARE, VerdictName, by_chance},
    span::{FLAT, orthonormal, without},
};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// One effect in the screening.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChainScore {
    /// Its word.
    pub effect: &'static str,
    /// Score (standard deviations).
    pub z: f64,
    /// Amplitude to first order.
    pub amplitude: f64,
    /// Share of its signature that exposure, glandularity and contrast do not take.
    pub surviving: f64,
    /// Whether an amplitude in its range could be seen.
    pub testable: bool,
}

/// An effect, fitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChainCandidate {
    /// Its word.
    pub effect: &'static str,
    /// Amplitude and its standard deviation.
    pub amplitude: [f64; 2],
    /// Fall of the misfit (squared standard deviations).
    pub gain: f64,
    /// Score of what is left in smooth shapes.
    pub left: f64,
    /// Misfit of smooth shapes of the held-out exposures that it changes (root mean square, in standard
    /// deviations) without and with it; errors leave 1.
    pub held_out: [f64; 2],
    /// Fall of their misfit in standard errors.
    pub held_out_z: f64,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChainVerdict {
    /// Kind.
    pub verdict: VerdictName,
    /// The named effect.
    pub effect: Option<&'static str>,
    /// Effects that the data do not tell apart, the best first.
    pub set: Vec<&'static str>,
    /// Why.
    pub reason: String,
    /// Largest score that chance gives once in a hundred times.
    pub limit: f64,
    /// All effects, the likeliest first.
    pub scores: Vec<ChainScore>,
    /// Score of smooth shapes without any effect.
    pub left: f64,
    /// Fitted effects, the best first.
    pub candidates: Vec<ChainCandidate>,
}

/// The model's exposures, seen and held out, made ready.
pub struct Search {
    /// Exposures that the search sees.
    pub seen: Exposures,
    /// Exposures that decide.
    pub held_out: Exposures,
    nuisance: DMatrix<f64>,
    /// Unit signatures without what is fitted anyway, their lengths before and after.
    signatures: Vec<(DVector<f64>, [f64; 2])>,
    limit: f64,
    smooth: DMatrix<f64>,
}

impl Search {
    /// Signatures of all effects, and the limit of chance.
    ///
    /// # Errors
    /// As [`Exposures::predicted`].
    pub fn new(seen: Exposures, held_out: Exposures) -> Result<Self, ChainError> {
        let start = seen.start();
        let nuisance = orthonormal(&seen.jacobian(&start, &seen.nuisances())?);
        let mut signatures = Vec::new();
        for n in 0..IMAGE_EFFECTS.len() {
            let whole = seen.jacobian(&start, &[Free::Effect(n)])?.column(0).into_owned();
            let kept = without(&nuisance, &whole);
            let length = kept.norm();
            let unit = if length > FLAT * whole.norm() { kept / length } else { kept * 0.0 };
            signatures.push((unit, [whole.norm(), length]));
        }
        let cosine = |i: usize, j: usize| signatures[i].0.dot(&signatures[j].0);
        let cosines = DMatrix::from_fn(signatures.len(), signatures.len(), cosine);
        let limit = by_chance(&cosines, &IMAGE_EFFECTS.each_ref().map(|effect| effect.range));
        let smooth = seen.smooth();
        Ok(Self { seen, held_out, nuisance, signatures, limit, smooth })
    }

    /// Largest score that chance gives once in a hundred times.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Scores of all effects, the likeliest first, and of smooth shapes.
    ///
    /// # Errors
    /// As [`Exposures::predicted`].
    pub fn screen(&self, measured: &[Vec<f64>]) -> Result<(Vec<ChainScore>, f64), ChainError> {
        let residual = self.seen.residual(measured, &self.seen.start())?;
        let residual = without(&self.nuisance, &residual);
        let score =
            |(effect, (unit, [whole, kept])): (&'static ImageEffect, &(DVector<f64>, [f64; 2]))| {
                let signed = unit.dot(&residual);
                // Where only one sign is plausible, the other is chance.
                let two_sided = effect.range[0] < 0.0;
                let reach = effect.range[1].max(-effect.range[0]);
                ChainScore {
                    effect: effect.name,
                    z: if two_sided { signed.abs() } else { signed.max(0.0) },
                    amplitude: signed / kept.max(f64::MIN_POSITIVE),
                    surviving: kept / whole.max(f64::MIN_POSITIVE),
                    testable: kept * reach > self.limit,
                }
            };
        let mut scores: Vec<_> = IMAGE_EFFECTS.iter().zip(&self.signatures).map(score).collect();
        scores.sort_by(|a, b| b.z.total_cmp(&a.z));
        Ok((scores, self.left(&residual, &self.nuisance)))
    }

    /// Score of what a residual has in smooth shapes, beyond what was fitted.
    fn left(&self, residual: &DVector<f64>, fitted: &DMatrix<f64>) -> f64 {
        let rest = |shape: DVector<f64>| {
            let rest = without(fitted, &shape);
            (rest.norm() > FLAT * shape.norm()).then_some(rest)
        };
        let shapes: Vec<DVector<f64>> =
            self.smooth.column_iter().filter_map(|shape| rest(shape.into_owned())).collect();
        let basis = orthonormal(&DMatrix::from_columns(&shapes));
        let squares = (basis.transpose() * residual).norm_squared();
        let count = basis.ncols() as f64;
        // Wilson and Hilferty: the cube root of chi squared is nearly normal.
        let spread = 2.0 / (9.0 * count);
        ((squares / count).cbrt() - (1.0 - spread)) / spread.sqrt()
    }

    /// Screens, fits the likeliest effects and judges by the held-out exposures.
    ///
    /// # Errors
    /// As [`Exposures::predicted`].
    pub fn judge(
        &self,
        measured: &[Vec<f64>],
        held_out: &[Vec<f64>],
    ) -> Result<ChainVerdict, ChainError> {
        let (scores, left) = self.screen(measured)?;
        let mut answer = ChainVerdict {
            verdict: VerdictName::NoDiscrepancy,
            effect: None,
            set: Vec::new(),
            reason: "Errors explain all residuals.".into(),
            limit: self.limit,
            left,
            candidates: Vec::new(),
            scores,
        };
        let best = &answer.scores[0];
        if best.z <= self.limit {
            if left > RARE {
                answer.verdict = VerdictName::Unknown;
                answer.reason = format!(
                    "Smooth residuals are beyond what errors leave (score {left:.1}), and no effect of \
                     the library has their shape."
                );
            }
            return Ok(answer);
        }
        let likely: Vec<_> =
            answer.scores.iter().filter(|s| s.z > RARE).take(FITTED).cloned().collect();
        let (plain, without, _) =
            self.seen.fit(measured, &self.seen.start(), &self.seen.nuisances())?;
        for score in &likely {
            let candidate = self.candidate(score, measured, held_out, (&plain, &without))?;
            answer.candidates.push(candidate);
        }
        answer.candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        self.conclude(&mut answer);
        Ok(answer)
    }

    /// The image model with a fitted effect.
    ///
    /// # Errors
    /// As [`Exposures::predicted`].
    pub fn with(
        &self,
        candidate: &ChainCandidate,
        measured: &[Vec<f64>],
    ) -> Result<Parameters, ChainError> {
        let mut start = self.seen.start();
        if let Some(effect) = ImageEffect::named(candidate.effect) {
            *(effect.of)(&mut start.chain) = candidate.amplitude[0];
        }
        self.seen.fit(measured, &start, &self.seen.nuisances()).map(|(fitted, ..)| fitted)
    }

    /// One effect, fitted together with exposure, glandularity and contrast.
    fn candidate(
        &self,
        score: &ChainScore,
        measured: &[Vec<f64>],
        held_out: &[Vec<f64>],
        (plain, without_it): (&Parameters, &DVector<f64>),
    ) -> Result<ChainCandidate, ChainError> {
        let place = IMAGE_EFFECTS.iter().position(|e| e.name == score.effect).unwrap_or_default();
        let mut free = self.seen.nuisances();
        free.push(Free::Effect(place));
        let mut start = plain.clone();
        let [low, high] = IMAGE_EFFECTS[place].range;
        *(IMAGE_EFFECTS[place].of)(&mut start.chain) = score.amplitude.clamp(low, high);
        let (mut with, residual, errors) = self.seen.fit(measured, &start, &free)?;
        let fitted = orthonormal(&self.seen.jacobian(&with, &free)?);
        let left = self.left(&without(&fitted, &residual), &fitted);
        let amplitude = *(IMAGE_EFFECTS[place].of)(&mut with.chain);
        let held = |from: &Parameters| {
            let start = Parameters { scale: self.held_out.start().scale, ..from.clone() };
            let free = self.held_out.scales();
            self.held_out.fit(held_out, &start, &free).map(|(_, residual, _)| residual)
        };
        let [before, after] = [held(plain)?, held(&with)?];
        let apart = (&before - &after).norm();
        let fall = before.norm_squared() - after.norm_squared();
        Ok(ChainCandidate {
            effect: score.effect,
            amplitude: [amplitude, errors.last().copied().unwrap_or_default()],
            gain: without_it.norm_squared() - residual.norm_squared(),
            left,
            held_out: self.misfit(&before, &after),
            held_out_z: fall / (2.0 * apart).max(f64::MIN_POSITIVE),
        })
    }

    /// Root mean squares over the smooth shapes (of test objects and doses: all values) of the held-out
    /// exposures that an effect changes; errors leave 1.
    fn misfit(&self, before: &DVector<f64>, after: &DVector<f64>) -> [f64; 2] {
        let rows = self.held_out.rows();
        let apart = |rows: &std::ops::Range<usize>| {
            (before.rows(rows.start, rows.len()) - after.rows(rows.start, rows.len())).norm()
        };
        let most = rows.iter().map(apart).fold(0.0, f64::max);
        let changed = |n: usize| apart(&rows[n]) > 0.3 * most;
        let smooth = self.held_out.smooth();
        let kept: Vec<DVector<f64>> = smooth
            .column_iter()
            .filter(|shape| {
                rows.iter()
                    .enumerate()
                    .any(|(n, rows)| changed(n) && shape.rows(rows.start, rows.len()).norm() > 0.0)
            })
            .map(|shape| shape.into_owned())
            .collect();
        if kept.is_empty() {
            return [0.0; 2];
        }
        let basis = orthonormal(&DMatrix::from_columns(&kept));
        let size = (basis.ncols() as f64).sqrt();
        [before, after].map(|residual| (basis.transpose() * residual).norm() / size)
    }

    fn conclude(&self, answer: &mut ChainVerdict) {
        let Some(best) = answer.candidates.first().cloned() else { return };
        let alike = |c: &&ChainCandidate| best.gain - c.gain < ALIKE && c.held_out_z >= HELD_OUT;
        answer.set = answer.candidates.iter().filter(alike).map(|c| c.effect).collect();
        let (verdict, reason) = if best.left > RARE {
            let text = format!(
                "{} explains most, yet smooth residuals stay beyond what errors leave (score {:.1}): \
                 something that the library lacks.",
                best.effect, best.left
            );
            (VerdictName::Unknown, text)
        } else if best.held_out_z < HELD_OUT {
            let text = format!(
                "{} explains the seen exposures; the held-out ones gain {:.1} standard errors only.",
                best.effect, best.held_out_z
            );
            (VerdictName::InsufficientData, text)
        } else if answer.set.len() > 1 {
            (VerdictName::Ambiguous, "Several effects explain the residuals equally well.".into())
        } else {
            let sentence = ImageEffect::named(best.effect).map_or("", |e| e.sentence);
            (VerdictName::Named, format!("{sentence} The held-out exposures bear it out."))
        };
        if verdict == VerdictName::Named {
            answer.effect = Some(best.effect);
        }
        if matches!(verdict, VerdictName::Unknown | VerdictName::InsufficientData) {
            answer.set.clear();
        }
        (answer.verdict, answer.reason) = (verdict, reason);
    }
}
