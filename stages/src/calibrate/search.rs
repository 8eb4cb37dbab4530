//! Gauss-Newton on the moduli of both breasts, the rigid motion of every fitted pose left open.
//!
//! What is made least is the sum of the squared signed distances of the skin's nodes in the fitted
//! poses, after the rigid motion of each pose that makes it least: an error of the registration must
//! not look like stiffness. A modulus moves the skin of its own breast alone, so that one trial gives
//! the derivatives by both, as differences to the best trial before.

use super::{Calibration, Experiment, Fit, Precision, Trial};
use crate::{
    model::Moduli,
    pose::PoseFit,
    shape::{CHEST_LENGTH_MM, CHEST_MM, Shape},
};
use mammotwin_data::{
    Failure,
    labels::Side,
    progress::{Part, Progress},
};
use nalgebra::{DMatrix, DVector, Vector2};

/// Moduli between which the search stays (kPa).
const BOUNDS_KPA: [f64; 2] = [0.05, 20.0];
/// Trials at most.
const MAX_TRIALS: usize = 9;
/// First change of the logarithms of the moduli, and the largest in one step.
const FIRST: f64 = 0.25;
const STRIDE: f64 = 0.7;
/// The search ends when the next step is shorter than this part of the moduli.
const CLOSE: f64 = 0.01;
/// A search that ends with a whole step longer than this has not found the minimum.
const NEAR: f64 = 0.05;
/// Differences over a shorter step than this say nothing; over one shorter than the next they say nothing new: what the
/// other breast, or an equilibrium that is met within its tolerance, moves of a skin would count as the modulus' doing.
const SHORTEST: f64 = 0.003;
const TELLING: f64 = 0.05;
/// Length (mm) over which errors of segmentation and mesh are alike along the skin.
const ALIKE_MM: f64 = 20.0;

/// The search for the moduli.
pub(super) struct Search<'a> {
    pub experiment: Experiment<'a>,
    /// Breasts whose modulus is fitted.
    pub fitted: Vec<Side>,
}

/// One trial, as far as the search needs it.
struct Point {
    /// Logarithms of the moduli (kPa), right and left.
    at: Vector2<f64>,
    /// Signed distances (mm), pose after pose.
    signed_mm: DVector<f64>,
    /// Mean square after the best rigid motions (mm²).
    misfit: f64,
    fit: Fit,
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

    /// Change of the distances (mm) from one point to another for a change of one breast's modulus by
    /// a factor e; `None` when the logarithm of that modulus changed by less than `shortest`.
    fn slope(&self, from: &Point, to: &Point, side: Side, shortest: f64) -> Option<DVector<f64>> {
        let change = to.at[side as usize] - from.at[side as usize];
        if change.abs() < shortest {
            return None;
        }
        let all = (&to.signed_mm - &from.signed_mm) / change;
        let own = |(n, value): (usize, &f64)| if self.sides[n] == side { *value } else { 0.0 };
        Some(DVector::from_iterator(all.len(), all.iter().enumerate().map(own)))
    }
}

impl Search<'_> {
    /// Whether there is something to fit, and a pose to fit it to.
    pub fn searches(&self) -> bool {
        !self.fitted.is_empty() && self.experiment.targets.len() > 1
    }

    /// Searches from `start`.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the start has no equilibrium, or nothing beside it.
    pub fn run(&self, start: Moduli, progress: &dyn Progress) -> Result<Calibration, Failure> {
        let searched = self.searches();
        let rounds = if searched { MAX_TRIALS } else { 1 };
        let mut trials: Vec<Trial> = Vec::new();
        let mut failed: Option<(Moduli, String)> = None;
        let mut compared: Option<Compared> = None;
        let mut best: Option<Point> = None;
        let mut slopes: [Option<DVector<f64>>; 2] = [None, None];
        let mut before: Option<Fit> = None;
        let mut moduli = start;
        let (mut damping, mut converged) = (1.0, !searched);
        for round in 0..rounds {
            let Moduli { right_kpa, left_kpa } = moduli;
            let doing = format!("trial {}: {right_kpa:.3} / {left_kpa:.3} kPa", round + 1);
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
                    let back =
                        |now: f64, side: Side| (0.5 * (now.ln() + point.at[side as usize])).exp();
                    moduli = Moduli {
                        right_kpa: back(right_kpa, Side::Right),
                        left_kpa: back(left_kpa, Side::Left),
                    };
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let known = compared.get_or_insert_with(|| Compared::new(&self.experiment, &fit));
            let point = point(known, fit);
            trials.push(self.trial(&point));
            if before.is_none() {
                before = Some(point.fit.clone());
            }
            if let Some(best) = &best {
                for &side in &self.fitted {
                    let held = &mut slopes[side as usize];
                    let shortest = if held.is_some() { TELLING } else { SHORTEST };
                    if let Some(slope) = known.slope(best, &point, side, shortest) {
                        *held = Some(slope);
                    }
                }
            }
            if best.as_ref().is_none_or(|best| point.misfit <= best.misfit) {
                (best, damping) = (Some(point), 1.0);
            } else {
                damping *= 0.5;
            }
            let Some(best) = best.as_ref().filter(|_| searched) else { break };
            let step = self.step(known, best, &slopes);
            if let Some(step) = step
                && damping * step.amax() < CLOSE
            {
                // A search whose steps gain nothing ends as well, near the minimum or not.
                converged = step.amax() < NEAR;
                break;
            }
            let known_slopes = step.is_some();
            let step = step.map_or_else(|| self.first(best), |step| damping * step);
            let [low, high] = BOUNDS_KPA.map(f64::ln);
            let to = |side: Side| {
                let k = side as usize;
                (best.at[k] + step[k].clamp(-STRIDE, STRIDE)).clamp(low, high)
            };
            // A modulus that is held at its bound is not tried there again and again.
            let stays = |side: &Side| (to(*side) - best.at[*side as usize]).abs() < CLOSE;
            if known_slopes && self.fitted.iter().all(stays) {
                break;
            }
            let next = |side: Side| to(side).exp();
            let fitted =
                |side: Side, now: f64| if self.fitted.contains(&side) { next(side) } else { now };
            moduli = Moduli {
                right_kpa: fitted(Side::Right, start.right_kpa),
                left_kpa: fitted(Side::Left, start.left_kpa),
            };
        }
        // Moduli that no other could be compared with are not fitted.
        if let (1, Some((moduli, why))) = (trials.len(), failed) {
            return Err(Failure::Numerics(format!(
                "calibrate: nothing but the study's moduli stands; the last that was tried, {:.3} and \
                 {:.3} kPa, has no solution ({why}); begin with others, or keep the study's: \
                 calibrate.parameters = []",
                moduli.right_kpa, moduli.left_kpa
            )));
        }
        let (Some(before), Some(best), Some(compared)) = (before, best, compared) else {
            return Err(Failure::Numerics("calibrate: no trial was evaluated".into()));
        };
        let precision = precision(&compared, &best, &slopes);
        Ok(Calibration { before, after: best.fit, trials, converged, precision, second: None })
    }

    /// The first step: softer where the breast sags too little.
    fn first(&self, best: &Point) -> Vector2<f64> {
        let sign = |side: Side| FIRST * self.sag_mm(&best.fit, side).signum();
        Vector2::new(sign(Side::Right), sign(Side::Left))
    }

    /// The Gauss-Newton step of the fitted moduli; `None` while a derivative is missing or says
    /// nothing.
    fn step(
        &self,
        compared: &Compared,
        best: &Point,
        slopes: &[Option<DVector<f64>>; 2],
    ) -> Option<Vector2<f64>> {
        let slopes = self.fitted.iter().map(|&side| slopes[side as usize].as_ref());
        let columns: Vec<DVector<f64>> =
            slopes.map(|slope| slope.map(|slope| compared.rest(slope))).collect::<Option<_>>()?;
        let jacobian = DMatrix::from_columns(&columns);
        let rest = compared.rest(&best.signed_mm);
        let factor = (jacobian.transpose() * &jacobian).cholesky()?;
        let solved = factor.solve(&(-(jacobian.transpose() * rest)));
        let mut step = Vector2::zeros();
        self.fitted.iter().zip(solved.iter()).for_each(|(&side, by)| step[side as usize] = *by);
        step.iter().all(|v| v.is_finite()).then_some(step)
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

fn point(compared: &Compared, fit: Fit) -> Point {
    let all = fit.poses[1..].iter().flat_map(|pose| &pose.signed_mm).copied();
    let signed_mm = DVector::from_vec(all.collect());
    let rest = compared.rest(&signed_mm);
    Point {
        at: Vector2::new(fit.moduli.right_kpa.ln(), fit.moduli.left_kpa.ln()),
        misfit: rest.norm_squared() / rest.len().max(1) as f64,
        signed_mm,
        fit,
    }
}

/// Standard deviations of the logarithms of the moduli: as large as the distances that are left make
/// them. As much of these as people's chest walls change between poses is a change of the chest wall, alike over
/// [`CHEST_LENGTH_MM`], the rest an error that is alike over [`ALIKE_MM`].
fn precision(compared: &Compared, best: &Point, slopes: &[Option<DVector<f64>>; 2]) -> Precision {
    let known: Vec<usize> = (0..2).filter(|&side| slopes[side].is_some()).collect();
    let columns: Vec<DVector<f64>> =
        slopes.iter().flatten().map(|slope| compared.rest(slope)).collect();
    if columns.is_empty() {
        return Precision::default();
    }
    let jacobian = DMatrix::from_columns(&columns);
    let Some(inverse) = (jacobian.transpose() * &jacobian).try_inverse() else {
        return Precision::default();
    };
    let errors = compared.errors(best.misfit);
    let covariance = &inverse * compared.spread(&jacobian, &errors) * &inverse;
    let sd = |side: usize| {
        let place = known.iter().position(|&known| known == side)?;
        Some(covariance[(place, place)].max(0.0).sqrt())
    };
    let (right, left) = (sd(Side::Right as usize), sd(Side::Left as usize));
    let both = right.zip(left).map(|(right, left)| (right * left).max(f64::MIN_POSITIVE));
    let variance: f64 = errors.iter().map(DMatrix::trace).sum();
    let square: f64 = errors.iter().map(DMatrix::norm_squared).sum();
    Precision {
        right,
        left,
        correlation: both.map(|both| covariance[(0, 1)] / both),
        independent: variance * variance / square.max(f64::MIN_POSITIVE),
    }
}

impl Compared {
    /// Covariance (mm²) of errors in each pose whose mean square is `misfit` (mm²) when rigid motions are fitted.
    fn errors(&self, misfit: f64) -> Vec<DMatrix<f64>> {
        let lengths = [CHEST_LENGTH_MM, ALIKE_MM];
        let alike = |shape: &Shape| lengths.map(|length_mm| shape.alike(length_mm));
        let alike: Vec<[DMatrix<f64>; 2]> = self.shapes.iter().map(alike).collect();
        // What rigid motions leave of such errors of 1 mm.
        let (mut left, mut at) = ([0.0; 2], 0);
        for both in &alike {
            let nodes = both[0].nrows();
            let rigid = self.rigid.rows(at, nodes);
            for (sum, one) in left.iter_mut().zip(both) {
                *sum += one.trace() - (rigid.transpose() * one * rigid).trace();
            }
            at += nodes;
        }
        let [chest_left, local_left] = left.map(|sum| (sum / at.max(1) as f64).max(1e-9));
        let chest = f64::min(CHEST_MM * CHEST_MM, misfit / chest_left);
        let local = (misfit - chest * chest_left) / local_left;
        alike.into_iter().map(|[far, near]| chest * far + local * near).collect()
    }

    /// JᵀCJ with the covariances C of the errors of each pose.
    fn spread(&self, jacobian: &DMatrix<f64>, errors: &[DMatrix<f64>]) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(jacobian.ncols(), jacobian.ncols());
        let mut at = 0;
        for error in errors {
            let own = jacobian.rows(at, error.nrows());
            sum += own.transpose() * error * own;
            at += error.nrows();
        }
        sum
    }
}
