//! Gauss-Newton on what is fitted of the tissues, the rigid motion of every fitted pose left open.
//!
//! What is made least is the sum of the squared signed distances of the skin's nodes in the fitted
//! poses, after the rigid motion of each pose that makes it least: an error of the registration must
//! not look like stiffness. A breast's modulus moves the skin of its own side alone, so that one trial gives
//! the derivatives by both, as differences to the best trial before. Where numbers that both sides share are fitted too,
//! each is tried by itself and the breasts by themselves, anew where the search went far and gains no more.

use super::{Calibration, Experiment, Fit, Parameter, Precision, Trial, precision::Spread};
use crate::{model::Moduli, pose::PoseFit, shape::Shape};
use mammotwin_data::{
    Failure,
    labels::Side,
    progress::{Part, Progress},
};
use nalgebra::{DMatrix, DVector};

/// Trials of the moduli of the breasts at most, as many more for each number that both share, and in all.
const MAX_TRIALS: usize = 9;
const MORE_TRIALS: usize = 9;
const MOST_TRIALS: usize = 60;
/// First change of the logarithms of the moduli, that of numbers that are tried by themselves later, and the largest in
/// one step.
const FIRST: f64 = 0.25;
const ALONE: f64 = 0.15;
const STRIDE: f64 = 0.7;
/// The search ends when the next step is shorter than this part of the numbers.
const CLOSE: f64 = 0.01;
/// A search that ends with a whole step longer than this has not found the minimum.
const NEAR: f64 = 0.05;
/// Differences over a shorter step than this say nothing; over one shorter than the next they say nothing new: what the
/// other breast, or an equilibrium that is met within its tolerance, moves of a skin would count as the modulus' doing.
const SHORTEST: f64 = 0.003;
const TELLING: f64 = 0.05;
/// Dampings of a step that are tried, each four times the last.
const DAMPINGS: i32 = 20;
/// Derivatives beside shared numbers are of this place while the search is nearer to where they were found than this.
const STALE: f64 = 0.2;

/// The search for the numbers that fit best.
pub(super) struct Search<'a> {
    pub experiment: Experiment<'a>,
    /// What is fitted, breasts first.
    pub fitted: Vec<Parameter>,
}

/// One trial, as far as the search needs it.
struct Point {
    /// Logarithms of what is fitted.
    at: DVector<f64>,
    /// Signed distances (mm), pose after pose.
    signed_mm: DVector<f64>,
    /// Mean square after the best rigid motions (mm²).
    misfit: f64,
    fit: Fit,
}

/// Change of the distances (mm) for a change of one number by a factor e.
struct Slope {
    column: DVector<f64>,
    /// Logarithms of what is fitted, where it was found.
    at: DVector<f64>,
    /// Whether the search went far from there: it is to be found anew, and the best that is known until then.
    stale: bool,
}

/// A derivative that the search can go by.
fn fresh(slope: &Option<Slope>) -> Option<&Slope> {
    slope.as_ref().filter(|slope| !slope.stale)
}

/// The nodes that are compared, and the rigid motions of their poses as orthonormal columns.
struct Compared {
    sides: Vec<Side>,
    rigid: DMatrix<f64>,
    shapes: Vec<Shape>,
}

impl Compared {
    fn new(experiment: &Experiment, fit: &Fit) -> Self {
        let (mut sides, mut shapes) = (Vec::new(), Vec::new());
        for (target, pose) in experiment.targets.iter().zip(&fit.poses).skip(1) {
            sides.extend_from_slice(target.sides());
            shapes.push(target.shape(pose));
        }
        let mut columns = Vec::new();
        let mut at = 0;
        for shape in &shapes {
            let nodes = shape.points.len();
            for mode in shape.rigid_modes() {
                let mut column = DVector::zeros(sides.len());
                column.rows_mut(at, nodes).copy_from(&mode);
                columns.push(column);
            }
            at += nodes;
        }
        let rigid = if columns.is_empty() {
            DMatrix::zeros(0, 0)
        } else {
            DMatrix::from_columns(&columns).qr().q()
        };
        Self { sides, rigid, shapes }
    }

    /// What rigid motions do not explain.
    fn rest(&self, v: &DVector<f64>) -> DVector<f64> {
        v - &self.rigid * (self.rigid.transpose() * v)
    }

    /// Change of the distances (mm) from one point to another for a change of one number by a factor e: of a breast on its
    /// own skin; `None` when its logarithm changed by less than `shortest`.
    fn slope(
        &self,
        (from, to): (&Point, &Point),
        place: usize,
        side: Option<Side>,
        shortest: f64,
    ) -> Option<Slope> {
        let change = to.at[place] - from.at[place];
        if change.abs() < shortest {
            return None;
        }
        let mut column = (&to.signed_mm - &from.signed_mm) / change;
        if let Some(side) = side {
            for (value, of) in column.iter_mut().zip(&self.sides) {
                *value = if *of == side { *value } else { 0.0 };
            }
        }
        Some(Slope { column, at: from.at.clone(), stale: false })
    }
}

impl Search<'_> {
    /// Whether there is something to fit, and a pose to fit it to.
    pub fn searches(&self) -> bool {
        !self.fitted.is_empty() && self.experiment.targets.len() > 1
    }

    /// What is fitted of what both breasts share.
    fn shared(&self) -> impl Iterator<Item = Parameter> {
        self.fitted.iter().copied().filter(|parameter| parameter.side().is_none())
    }

    /// Searches from `start`.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the start has no equilibrium, or nothing beside it.
    pub fn run(&self, start: Moduli, progress: &dyn Progress) -> Result<Calibration, Failure> {
        let searched = self.searches();
        let most = (MAX_TRIALS + MORE_TRIALS * self.shared().count()).min(MOST_TRIALS);
        let rounds = if searched { most } else { 1 };
        let mut trials: Vec<Trial> = Vec::new();
        let mut failed: Option<(Moduli, String)> = None;
        let mut compared: Option<Compared> = None;
        let mut best: Option<Point> = None;
        let mut slopes: Vec<Option<Slope>> = self.fitted.iter().map(|_| None).collect();
        let mut before: Option<Fit> = None;
        let mut moduli = start;
        let mut alone = false;
        let (mut damping, mut converged) = (1.0, !searched);
        for round in 0..rounds {
            let doing = format!("trial {}: {}", round + 1, self.told(&moduli));
            let [from, to] = [round, round + 1].map(|n| n as f64 / rounds as f64);
            let part = Part { whole: progress, from, to };
            part.report(0.0, &doing);
            let near = best.as_ref().map(|point| &point.fit);
            let fit = match self.experiment.evaluate(moduli, near, &part, &doing) {
                Ok(fit) => fit,
                // Too soft to stand: go half way back to the best that stood.
                Err(Failure::Numerics(why)) if best.is_some() => {
                    failed = Some((moduli, why));
                    let Some(point) = &best else { break };
                    moduli = self.moduli(&moduli, &(0.5 * (self.at(&moduli) + &point.at)));
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let known = compared.get_or_insert_with(|| Compared::new(&self.experiment, &fit));
            let point = self.point(known, fit);
            trials.push(self.trial(&point));
            if before.is_none() {
                before = Some(point.fit.clone());
            }
            if let Some(best) = &best {
                self.learn(known, (best, &point), &mut slopes);
            }
            let gained = best.as_ref().is_none_or(|best| point.misfit <= best.misfit);
            if gained {
                (best, damping) = (Some(point), 1.0);
            }
            let Some(best) = best.as_ref().filter(|_| searched) else { break };
            if !gained && !alone && !self.mark_stale(best, &mut slopes) {
                damping *= 0.5;
            }
            alone = false;
            let mut step = self.step(known, best, &slopes);
            if step.as_ref().is_some_and(|step| damping * step.amax() < CLOSE)
                && self.mark_stale(best, &mut slopes)
            {
                (step, damping) = (None, 1.0);
            }
            if let Some(step) = &step
                && damping * step.amax() < CLOSE
            {
                // A search whose steps gain nothing ends as well, near the minimum or not.
                converged = step.amax() < NEAR;
                break;
            }
            let to = match step {
                Some(step) => {
                    let to = self.within(&best.at, &(damping * step));
                    // A number that is held at its bound is not tried there again and again.
                    if (&to - &best.at).amax() < CLOSE {
                        break;
                    }
                    to
                }
                // Known, and they say nothing.
                None if slopes.iter().all(|slope| fresh(slope).is_some()) => break,
                None => {
                    let first = trials.len() == 1;
                    alone = !first;
                    self.within(&best.at, &self.unknown(best, &slopes, first))
                }
            };
            moduli = self.moduli(&start, &to);
        }
        // Moduli that no other could be compared with are not fitted.
        if let (1, Some((moduli, why))) = (trials.len(), failed) {
            return Err(Failure::Numerics(format!(
                "calibrate: nothing but the study's moduli stands; the last that was tried, {}, has no solution ({why}); \
                 begin with others, or keep the study's: calibrate.parameters = []",
                self.told(&moduli)
            )));
        }
        let (Some(before), Some(best), Some(compared)) = (before, best, compared) else {
            return Err(Failure::Numerics("calibrate: no trial was evaluated".into()));
        };
        let precision = precision(&compared, &self.fitted, &best, &slopes);
        Ok(Calibration { before, after: best.fit, trials, converged, precision, second: None })
    }

    /// What a trial is told by: both moduli, and what else is fitted.
    fn told(&self, moduli: &Moduli) -> String {
        let mut text = format!("{:.3} / {:.3} kPa", moduli.right_kpa, moduli.left_kpa);
        for parameter in self.shared() {
            let value = parameter.written(self.value(parameter, moduli));
            text += &format!(", {} {value}", parameter.words());
        }
        text
    }

    /// A number of the tissues; studies that fit a Jₘ have one.
    fn value(&self, parameter: Parameter, moduli: &Moduli) -> f64 {
        parameter.value(moduli, self.experiment.body.plan).unwrap_or(f64::NAN)
    }

    /// Logarithms of what is fitted.
    fn at(&self, moduli: &Moduli) -> DVector<f64> {
        let all = self.fitted.iter().map(|parameter| self.value(*parameter, moduli).ln());
        DVector::from_iterator(self.fitted.len(), all)
    }

    /// Numbers of these logarithms; what is not fitted is that of `held`.
    fn moduli(&self, held: &Moduli, at: &DVector<f64>) -> Moduli {
        let mut moduli = *held;
        for (parameter, at) in self.fitted.iter().zip(at.iter()) {
            parameter.set(&mut moduli, at.exp());
        }
        moduli
    }

    fn point(&self, compared: &Compared, fit: Fit) -> Point {
        let all = fit.poses[1..].iter().flat_map(|pose| &pose.signed_mm).copied();
        let signed_mm = DVector::from_vec(all.collect());
        let rest = compared.rest(&signed_mm);
        Point {
            at: self.at(&fit.moduli),
            misfit: rest.norm_squared() / rest.len().max(1) as f64,
            signed_mm,
            fit,
        }
    }

    /// Derivatives from two points between which the moduli of the breasts changed alone, or one shared number.
    fn learn(&self, compared: &Compared, points: (&Point, &Point), slopes: &mut [Option<Slope>]) {
        let change = &points.1.at - &points.0.at;
        let moved = |place: &usize| change[*place] != 0.0;
        let moved: Vec<usize> = (0..self.fitted.len()).filter(moved).collect();
        let shared = moved.iter().any(|&place| self.fitted[place].side().is_none());
        if shared && moved.len() > 1 {
            return;
        }
        for place in moved {
            let shortest = if fresh(&slopes[place]).is_some() { TELLING } else { SHORTEST };
            let found = compared.slope(points, place, self.fitted[place].side(), shortest);
            if found.is_some() {
                slopes[place] = found;
            }
        }
    }

    /// Marks derivatives that were found elsewhere, to be found anew; whether there were any that were not marked yet. Those
    /// by breasts alone follow the search.
    fn mark_stale(&self, best: &Point, slopes: &mut [Option<Slope>]) -> bool {
        if self.shared().next().is_none() {
            return false;
        }
        let mut any = false;
        for slope in slopes.iter_mut().flatten() {
            if !slope.stale && (&slope.at - &best.at).amax() > STALE {
                (slope.stale, any) = (true, true);
            }
        }
        any
    }

    /// A step to find derivatives that are not known: of both breasts, at `first` softer where one sags too little, else
    /// of one shared number.
    fn unknown(&self, best: &Point, slopes: &[Option<Slope>], first: bool) -> DVector<f64> {
        let mut step = DVector::zeros(self.fitted.len());
        for (place, parameter) in self.fitted.iter().enumerate() {
            if fresh(&slopes[place]).is_some() {
                continue;
            }
            if let Some(side) = parameter.side() {
                let sign = self.sag_mm(&best.fit, side).signum();
                step[place] = sign * if first { FIRST } else { ALONE };
            } else if step.amax() == 0.0 {
                let [_, high] = parameter.bounds().map(f64::ln);
                step[place] = if best.at[place] + ALONE > high { -ALONE } else { ALONE };
            }
        }
        step
    }

    /// The end of a step that is cut, and stays within the bounds.
    fn within(&self, from: &DVector<f64>, step: &DVector<f64>) -> DVector<f64> {
        let one = |(n, parameter): (usize, &Parameter)| {
            let [low, high] = parameter.bounds().map(f64::ln);
            // A study may begin beyond them.
            let (low, high) = (low.min(from[n]), high.max(from[n]));
            (from[n] + step[n].clamp(-STRIDE, STRIDE)).clamp(low, high)
        };
        DVector::from_iterator(from.len(), self.fitted.iter().enumerate().map(one))
    }

    /// The Gauss-Newton step of what is fitted; `None` while a derivative is missing, or where they say nothing.
    ///
    /// With shared numbers it is damped as Levenberg has it until nothing moves farther than [`STRIDE`], so that what is
    /// hardly told does not carry the rest away; what would leave its bounds is held there.
    fn step(
        &self,
        compared: &Compared,
        best: &Point,
        slopes: &[Option<Slope>],
    ) -> Option<DVector<f64>> {
        let column = |slope: &Option<Slope>| Some(compared.rest(&fresh(slope)?.column));
        let columns: Vec<DVector<f64>> = slopes.iter().map(column).collect::<Option<_>>()?;
        let jacobian = DMatrix::from_columns(&columns);
        let rest = compared.rest(&best.signed_mm);
        let (normal, right) = (jacobian.transpose() * &jacobian, -(jacobian.transpose() * rest));
        if self.shared().next().is_none() {
            let step = normal.cholesky()?.solve(&right);
            return step.iter().all(|v| v.is_finite()).then_some(step);
        }
        let mut held = vec![false; columns.len()];
        loop {
            let step = damped(&normal, &right, &held)?;
            let beyond = |place: &usize| {
                let [low, high] = self.fitted[*place].bounds().map(f64::ln);
                let (at, to) = (best.at[*place], best.at[*place] + step[*place]);
                !held[*place] && ((at <= low && to < low) || (at >= high && to > high))
            };
            match (0..held.len()).find(beyond) {
                Some(place) => held[place] = true,
                None => return Some(step),
            }
        }
    }

    fn trial(&self, point: &Point) -> Trial {
        let poses = point.fit.poses[1..].iter();
        Trial {
            moduli: point.fit.moduli,
            residual_right_mm: self.sag_mm(&point.fit, Side::Right),
            residual_left_mm: self.sag_mm(&point.fit, Side::Left),
            misfit_mm: point.misfit.sqrt(),
            modified_hausdorff_mm: poses
                .map(|pose: &PoseFit| pose.distances.modified_hausdorff)
                .fold(0.0, f64::max),
        }
    }

    /// Mean over the fitted poses of how far (mm) one breast sags too far.
    fn sag_mm(&self, fit: &Fit, side: Side) -> f64 {
        let others = self.experiment.targets.iter().zip(&fit.poses).skip(1);
        let residuals: Vec<f64> = others.map(|(t, p)| t.sag_residual_mm(p, side)).collect();
        residuals.iter().sum::<f64>() / residuals.len().max(1) as f64
    }
}

/// The step that `normal` and `right` ask for, without what is held, damped until nothing moves farther than
/// [`STRIDE`]; `None` where they say nothing.
fn damped(normal: &DMatrix<f64>, right: &DVector<f64>, held: &[bool]) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..held.len()).filter(|&place| !held[place]).collect();
    let mut step = DVector::zeros(held.len());
    if free.is_empty() {
        return Some(step);
    }
    let count = free.len();
    let normal = normal.select_rows(&free).select_columns(&free);
    let right = right.select_rows(&free);
    let mean = normal.trace() / count as f64;
    let dampings = (0..DAMPINGS).map(|n| if n == 0 { 0.0 } else { 1e-6 * mean * 4f64.powi(n) });
    let mut found = dampings.filter_map(|damping| {
        let damped = &normal + DMatrix::identity(count, count) * damping;
        Some(damped.cholesky()?.solve(&right))
    });
    let short = found.find(|step| step.amax() <= STRIDE)?;
    for (place, by) in free.into_iter().zip(short.iter()) {
        step[place] = *by;
    }
    Some(step)
}

/// How well what was fitted is known: as well as the distances that are left have it.
fn precision(
    compared: &Compared,
    fitted: &[Parameter],
    best: &Point,
    slopes: &[Option<Slope>],
) -> Precision {
    let known = fitted.iter().zip(slopes).filter_map(|(p, slope)| Some((p, slope.as_ref()?)));
    let (known, columns): (Vec<&Parameter>, Vec<DVector<f64>>) =
        known.map(|(p, slope)| (p, compared.rest(&slope.column))).unzip();
    if columns.is_empty() {
        return Precision::default();
    }
    let jacobian = DMatrix::from_columns(&columns);
    let Some(inverse) = (jacobian.transpose() * &jacobian).try_inverse() else {
        return Precision::default();
    };
    let spread = Spread::new(&compared.shapes, &compared.rigid, &jacobian, best.misfit);
    let covariance = &inverse * spread.of_columns * &inverse;
    Precision {
        keys: known.iter().map(|parameter| parameter.key().into()).collect(),
        covariance: covariance.transpose().iter().copied().collect(),
        independent: spread.independent,
    }
}
