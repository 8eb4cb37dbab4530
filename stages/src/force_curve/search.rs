//! Score test of all effects, and their nonlinear fits.

use super::{
    evidence::{Evidence, Parameters, Weighed},
    record::Record,
    smooth::shapes,
};
use crate::{
    discover::ALIKE_COSINE,
    span::{orthonormal, without},
};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

/// Chance of naming anything where there is nothing.
const ALPHA: f64 = 0.01;
/// Draws of the largest score under nothing.
const DRAWS: usize = 4000;
const SEED: u64 = 0x00c0_43e5;
/// Amplitudes that are tried in a score and in a fit.
const TRIED: usize = 40;
/// Refinements of the best one.
const REFINED: usize = 12;

/// One effect, tested.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurveScore {
    /// Its word.
    pub effect: &'static str,
    /// Score in standard deviations.
    pub z: f64,
    /// Amplitude to first order in offset and stiffness.
    pub amplitude: f64,
    /// Part of its change that offset and stiffness do not take.
    pub surviving: f64,
    /// Score that the largest amplitude would have.
    pub detectable_z: f64,
    /// Whether these data could show it at all.
    pub testable: bool,
    /// Testable effects that these data do not tell from it (cosine over 0.95).
    pub alike: Vec<&'static str>,
}

/// All effects, tested.
#[derive(Debug, Clone)]
pub struct CurveScreening {
    /// The likeliest first.
    pub scores: Vec<CurveScore>,
    /// Largest score that chance gives once in a hundred times.
    pub limit: f64,
    /// Offset and stiffness without any effect.
    pub plain: Parameters,
    /// Score of smooth shapes without any effect.
    pub left: f64,
    /// Cosines between the changes, row after row, in the order of the ladders.
    pub cosines: Vec<Vec<f64>>,
}

/// An effect, fitted with offset and stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// Place of its ladder.
    pub ladder: usize,
    /// Offset, stiffness, amplitude.
    pub at: Parameters,
    /// Standard deviation of the amplitude.
    pub deviation: f64,
    /// Fall of the misfit (squared standard deviations).
    pub gain: f64,
    /// Score of what is left in smooth shapes.
    pub left: f64,
}

/// The change of a record by amplitudes of one effect, without what offset and stiffness take.
struct Signature {
    amplitudes: Vec<f64>,
    changes: Vec<DVector<f64>>,
    whole: Vec<f64>,
}

impl Signature {
    fn new(weighed: &Weighed<'_>, basis: &DMatrix<f64>, ladder: usize, plain: &Parameters) -> Self {
        let [least, greatest] = weighed.evidence.ladders[ladder].range();
        let step = (greatest - least) / TRIED as f64;
        let amplitudes: Vec<f64> = (0..=TRIED).map(|n| least + n as f64 * step).collect();
        let none = weighed.residual(None, plain);
        let change = |a: &f64| {
            &none - weighed.residual(Some(ladder), &Parameters { amplitude: *a, ..*plain })
        };
        let whole: Vec<DVector<f64>> = amplitudes.iter().map(change).collect();
        let changes = whole.iter().map(|c| without(basis, c)).collect();
        Self { amplitudes, changes, whole: whole.iter().map(|c| c.norm()).collect() }
    }

    /// The amplitude that explains most of a residual, and by how much the squared misfit falls.
    fn best(&self, rest: &DVector<f64>) -> (f64, f64) {
        let mut best = (0.0, 0.0);
        for (a, change) in self.amplitudes.iter().zip(&self.changes) {
            let gain = 2.0 * rest.dot(change) - change.norm_squared();
            if gain > best.1 {
                best = (*a, gain);
            }
        }
        best
    }

    /// The largest change.
    fn largest(&self) -> (usize, f64) {
        let size = |n: usize| self.changes[n].norm();
        let most = (0..self.changes.len()).max_by(|&a, &b| size(a).total_cmp(&size(b)));
        most.map_or((0, 0.0), |n| (n, size(n)))
    }
}

/// Signatures of all effects, with offset and stiffness at a place.
fn signatures(weighed: &Weighed<'_>, at: &Parameters) -> (Vec<Signature>, DMatrix<f64>) {
    let nuisance = weighed.nuisance(None, at);
    let basis = orthonormal(&nuisance);
    let one = |ladder: usize| Signature::new(weighed, &basis, ladder, at);
    ((0..weighed.evidence.ladders.len()).map(one).collect(), basis)
}

/// Tests all effects of the evidence on a record.
///
/// What the data could show, and what they do not tell apart, is said of the study as it is; scores are of
/// changes around the fitted offset and stiffness.
pub fn screen(weighed: &Weighed<'_>) -> CurveScreening {
    let (nominal, nominal_basis) = signatures(weighed, &Parameters::default());
    let ladders = &weighed.evidence.ladders;
    let all: Vec<usize> = (0..ladders.len()).collect();
    let strictest = by_chance(&nominal, &all, &nominal_basis);
    let large = |&n: &usize| nominal[n].largest().1 > strictest;
    let testable: Vec<usize> = all.iter().copied().filter(large).collect();
    let limit = match testable.is_empty() {
        true => strictest,
        false => by_chance(&nominal, &testable, &nominal_basis),
    };
    let unit = |n: usize| -> DVector<f64> {
        let (most, size) = nominal[n].largest();
        &nominal[n].changes[most] / size.max(f64::MIN_POSITIVE)
    };
    let units: Vec<DVector<f64>> = all.iter().map(|&n| unit(n)).collect();
    let cosines: Vec<Vec<f64>> =
        units.iter().map(|a| units.iter().map(|b| a.dot(b)).collect()).collect();
    let alike = |n: usize| {
        let near = |m: &&usize| **m != n && cosines[n][**m].abs() > ALIKE_COSINE;
        testable.iter().filter(near).map(|&m| ladders[m].effect.name).collect()
    };
    let plain = weighed.fit(None, Parameters::default());
    let (around, basis) = signatures(weighed, &plain);
    let rest = without(&basis, &weighed.residual(None, &plain));
    let score = |n: usize| {
        let (amplitude, gain) = around[n].best(&rest);
        let (most, size) = nominal[n].largest();
        CurveScore {
            effect: ladders[n].effect.name,
            z: gain.sqrt(),
            amplitude,
            surviving: size / nominal[n].whole[most].max(f64::MIN_POSITIVE),
            detectable_z: size,
            testable: testable.contains(&n),
            alike: alike(n),
        }
    };
    let mut scores: Vec<CurveScore> = all.iter().map(|&n| score(n)).collect();
    scores.sort_by(|a, b| b.testable.cmp(&a.testable).then(b.z.total_cmp(&a.z)));
    let left = leftover(weighed.record, &rest, &basis);
    CurveScreening { scores, limit, plain, left, cosines }
}

/// The largest score of these effects that chance exceeds with probability [`ALPHA`]: drawn errors through the
/// same test.
fn by_chance(signatures: &[Signature], tested: &[usize], basis: &DMatrix<f64>) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut largest: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let drawn = DVector::from_fn(basis.nrows(), |_, _| StandardNormal.sample(&mut random));
            let rest = without(basis, &drawn);
            tested.iter().map(|&n| signatures[n].best(&rest).1).fold(0.0, f64::max).sqrt()
        })
        .collect();
    largest.sort_unstable_by(f64::total_cmp);
    largest.get(((1.0 - ALPHA) * DRAWS as f64) as usize).copied().unwrap_or(f64::INFINITY)
}

/// Score of what a residual has in smooth shapes beyond what was fitted.
fn leftover(record: &Record, residual: &DVector<f64>, fitted: &DMatrix<f64>) -> f64 {
    let rest = |shape: DVector<f64>| {
        let rest = without(fitted, &shape);
        (rest.norm() > 1e-3 * shape.norm()).then_some(rest)
    };
    let shapes: Vec<DVector<f64>> = shapes(record).into_iter().filter_map(rest).collect();
    let basis = match shapes.is_empty() {
        true => DMatrix::zeros(residual.len(), 0),
        false => orthonormal(&DMatrix::from_columns(&shapes)),
    };
    let squares = (basis.transpose() * residual).norm_squared();
    let count = (basis.ncols() as f64).max(1.0);
    // Wilson and Hilferty: the cube root of chi squared is nearly normal.
    let spread = 2.0 / (9.0 * count);
    ((squares / count).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Fits one effect together with offset and stiffness.
pub fn refit(weighed: &Weighed<'_>, ladder: usize, plain: &Parameters) -> Fitted {
    let [least, greatest] = weighed.evidence.ladders[ladder].range();
    let fit = |amplitude: f64, from: &Parameters| {
        let at = weighed.fit(Some(ladder), Parameters { amplitude, ..*from });
        (at, weighed.residual(Some(ladder), &at).norm_squared())
    };
    let without_it = weighed.residual(None, plain).norm_squared();
    let step = (greatest - least) / TRIED as f64;
    let mut best = (Parameters { amplitude: 0.0, ..*plain }, without_it);
    // On from zero to either side: neighbours are the best start.
    for way in [step, -step] {
        let mut from = *plain;
        let mut amplitude = way;
        while (least..=greatest).contains(&amplitude) {
            let found = fit(amplitude, &from);
            from = found.0;
            if found.1 < best.1 {
                best = found;
            }
            amplitude += way;
        }
    }
    let mut width = step;
    for _ in 0..REFINED {
        width *= 0.7;
        for side in [-width, width] {
            let found = fit((best.0.amplitude + side).clamp(least, greatest), &best.0);
            if found.1 < best.1 {
                best = found;
            }
        }
    }
    let (at, misfit) = best;
    let residual = weighed.residual(Some(ladder), &at);
    let nuisance = weighed.nuisance(Some(ladder), &at);
    let basis = orthonormal(&nuisance);
    let [low, high] = [-0.5, 0.5].map(|s| (at.amplitude + s * step).clamp(least, greatest));
    let by = |amplitude: f64| weighed.residual(Some(ladder), &Parameters { amplitude, ..at });
    let slope = (by(low) - by(high)) / (high - low).max(f64::MIN_POSITIVE);
    let deviation = without(&basis, &slope).norm().recip();
    let free = nuisance.ncols();
    let mut columns = nuisance.insert_column(free, 0.0);
    columns.set_column(free, &slope);
    let fitted = orthonormal(&columns);
    let left = leftover(weighed.record, &without(&fitted, &residual), &fitted);
    Fitted { ladder, at, deviation, gain: without_it - misfit, left }
}

/// The amplitude above zero that changes a record by so many standard deviations once offset and stiffness
/// took their part; `None` where no amplitude that the model reaches does. Of the record its places and
/// quantities count.
pub fn amplitude_of(evidence: &Evidence, record: &Record, ladder: usize, size: f64) -> Option<f64> {
    let mut before = (0.0, 0.0);
    let [_, greatest] = evidence.ladders[ladder].range();
    for n in 1..=TRIED {
        let amplitude = greatest * n as f64 / TRIED as f64;
        let here = size_of(evidence, record, ladder, amplitude)?;
        if here >= size {
            let part = (size - before.1) / (here - before.1);
            return Some(before.0 + part * (amplitude - before.0));
        }
        before = (amplitude, here);
    }
    None
}

/// The size (standard deviations) of the change of a record by an amplitude once offset and stiffness took
/// their part.
pub fn size_of(evidence: &Evidence, record: &Record, ladder: usize, amplitude: f64) -> Option<f64> {
    let with = Parameters { amplitude, ..Parameters::default() };
    let changed = evidence.as_measured(record, Some(ladder), &with)?;
    let weighed = evidence.weigh(&changed)?;
    let fitted = weighed.fit(None, Parameters::default());
    Some(weighed.residual(None, &fitted).norm())
}
