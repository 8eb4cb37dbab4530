//! Which Jₘ and which place of the paddle explain measured forces, and how surely.
//!
//! Forces of the model are known on a grid of both; between its points the logarithm of a force is
//! bilinear in 1/Jₘ and in the distance. Errors of a record are independent and normal; all forces of the
//! model are off by one unknown factor besides: meshes, moduli and friction between skin and plates make it. The
//! model's curve is bent as well, by its elements: by factors that are alike over a few millimetres. Jₘ is as likely in every
//! interval of its logarithm, the distance in every interval of itself, within the grid.

use super::Measured;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::FRAC_PI_2;

/// Points of the fine grid along each axis.
const FINE: usize = 81;
/// What elements do to a curve of force is alike over this range of thickness (mm).
const BENT_MM: f64 = 5.0;
/// Logarithm of the largest ratio of the forces of two states that are read off by equal growth between.
const MOST_GROWTH: f64 = 1.7;

/// Sizes of the errors of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordError {
    /// Of the force, in proportion.
    pub force_part: f64,
    /// Of the force (N).
    pub force_n: f64,
    /// Of the thickness (mm).
    pub thickness_mm: f64,
    /// Of all forces of the model alike, in proportion.
    pub model_part: f64,
    /// Of the model's forces, alike over 5 mm of thickness, in proportion: what elements do to the curve.
    pub bent_part: f64,
}

impl RecordError {
    /// Errors of the model's forces, in proportion and with variance one each, at thicknesses (mm): a row for a
    /// thickness, a column for an independent error. The squares of a row add up to the same in every row.
    fn of_model(&self, thicknesses_mm: &[f64]) -> DMatrix<f64> {
        let least = thicknesses_mm.iter().copied().fold(f64::INFINITY, f64::min);
        let most = thicknesses_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let knots = if self.bent_part > 0.0 { ((most - least) / BENT_MM) as usize + 2 } else { 0 };
        DMatrix::from_fn(thicknesses_mm.len(), 1 + knots, |row, column| match column {
            0 => self.model_part,
            _ => {
                let off = (thicknesses_mm[row] - least) / BENT_MM - (column - 1) as f64;
                self.bent_part * (FRAC_PI_2 * off.clamp(-1.0, 1.0)).cos()
            }
        })
    }
}

/// Course of one compression of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Distance of the plates (mm), falling.
    pub thickness_mm: Vec<f64>,
    /// Force of the paddle (N).
    pub force_n: Vec<f64>,
}

impl Course {
    /// Force (N) and its change with the thickness (N/mm); `None` where the course does not go.
    pub fn at(&self, thickness_mm: f64) -> Option<[f64; 2]> {
        let h = &self.thickness_mm;
        let n = h.windows(2).position(|pair| pair[0] >= thickness_mm && pair[1] <= thickness_mm)?;
        let [from, to] = [self.force_n[n], self.force_n[n + 1]];
        let (step, along) = ((h[n + 1] - h[n]).min(-1e-12), thickness_mm - h[n]);
        // Forces grow by about the same factor with each millimetre; a straight line would lie above the curve.
        // Not so where the plates only begin to touch.
        if from > 0.0 && to > 0.0 && (to / from).ln().abs() < MOST_GROWTH {
            let growth = (to / from).ln() / step;
            let force = from * (growth * along).exp();
            return Some([force, force * growth]);
        }
        let slope = (to - from) / step;
        Some([from + slope * along, slope])
    }
}

/// Courses for each Jₘ (rising) and each distance (mm, rising).
#[derive(Debug, Clone)]
pub struct Grid {
    /// Jₘ.
    pub jm: Vec<f64>,
    /// Distances (mm) from the chest wall to the paddle's edge.
    pub distance_mm: Vec<f64>,
    /// Row after row of Jₘ; `None` where the model found no equilibrium at all.
    pub courses: Vec<Option<Course>>,
}

/// What a record says of Jₘ and of the distance.
#[derive(Debug, Clone)]
pub struct Posterior {
    /// Jₘ of the fine grid.
    pub jm: Vec<f64>,
    /// Distances (mm) of the fine grid.
    pub distance_mm: Vec<f64>,
    /// Weights, row after row of Jₘ; their sum is 1.
    pub weights: Vec<f64>,
    /// Root mean square of the deviations of the best point, in standard deviations of the errors.
    pub misfit: f64,
}

/// A marginal: most likely value, median, 90 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marginal {
    /// Of the most likely point of both.
    pub best: f64,
    /// Half of the weight is below.
    pub median: f64,
    /// 5 % of the weight are below the first, 5 % above the second.
    pub interval: [f64; 2],
}

/// Where x lies between the points of an axis: the point below and the part of the way to the next.
fn between(axis: &[f64], x: f64) -> (usize, f64) {
    let last = axis.len().saturating_sub(2);
    let below = axis.iter().rposition(|a| *a <= x).unwrap_or(0).min(last);
    match axis.get(below + 1) {
        Some(next) => (below, ((x - axis[below]) / (next - axis[below])).clamp(0.0, 1.0)),
        None => (below, 0.0),
    }
}

impl Grid {
    /// Force (N) and its change with the thickness (N/mm) between the courses of the grid; `None` where
    /// one of the courses around does not go that far.
    pub fn force(&self, jm: f64, distance_mm: f64, thickness_mm: f64) -> Option<[f64; 2]> {
        let inverse: Vec<f64> = self.jm.iter().rev().map(|jm| jm.recip()).collect();
        let (row, up) = between(&inverse, jm.recip());
        let (column, right) = between(&self.distance_mm, distance_mm);
        let (mut log, mut slope) = (0.0, 0.0);
        for (dr, pr) in [(0, 1.0 - up), (1, up)] {
            for (dc, pc) in [(0, 1.0 - right), (1, right)] {
                if pr * pc == 0.0 {
                    continue;
                }
                let jm_row = self.jm.len() - 1 - (row + dr);
                let place = jm_row * self.distance_mm.len() + column + dc;
                let [force, change] = self.courses.get(place)?.as_ref()?.at(thickness_mm)?;
                log += pr * pc * force.max(1e-9).ln();
                slope += pr * pc * change / force.max(1e-9);
            }
        }
        let force = log.exp();
        Some([force, force * slope])
    }

    /// The posterior of a record; `None` when no point of the grid reaches all its thicknesses.
    pub fn posterior(&self, record: &[Measured], error: &RecordError) -> Option<Posterior> {
        let axis = |from: f64, to: f64, n: usize| -> Vec<f64> {
            let count = if to > from { n } else { 1 };
            let step = if count > 1 { (to - from) / (count - 1) as f64 } else { 0.0 };
            (0..count).map(|k| from + k as f64 * step).collect()
        };
        let ends = |axis: &[f64]| [*axis.first().unwrap_or(&0.0), *axis.last().unwrap_or(&0.0)];
        let [least, most] = ends(&self.jm).map(f64::ln);
        let jm: Vec<f64> = axis(least, most, FINE).into_iter().map(f64::exp).collect();
        let [near, far] = ends(&self.distance_mm);
        let distance_mm = axis(near, far, FINE);
        let thicknesses: Vec<f64> = record.iter().map(|point| point.thickness_mm).collect();
        let of_model = error.of_model(&thicknesses);
        let deviation = |jm: f64, distance: f64| -> Option<[f64; 2]> {
            let mut widths = 0.0;
            let mut rest = DVector::zeros(record.len());
            let mut model = of_model.clone();
            for (n, Measured { thickness_mm, force_n }) in record.iter().enumerate() {
                let [force, slope] = self.force(jm, distance, *thickness_mm)?;
                let size = (error.force_part * force).hypot(error.force_n);
                let size = size.hypot(slope * error.thickness_mm);
                rest[n] = (force - force_n) / size;
                widths += size.ln();
                model.row_mut(n).scale_mut(force / size);
            }
            // Errors of the model, integrated out (Woodbury).
            let columns = model.ncols();
            let inner = DMatrix::identity(columns, columns) + model.tr_mul(&model);
            let factor = Cholesky::new(inner)?.unpack();
            let taken = factor.solve_lower_triangular(&model.tr_mul(&rest))?;
            widths += factor.diagonal().iter().map(|pivot| pivot.ln()).sum::<f64>();
            Some([rest.norm_squared() - taken.norm_squared(), widths])
        };
        let mut logs = Vec::new();
        let mut misfit = f64::INFINITY;
        for &jm in &jm {
            for &distance in &distance_mm {
                let found = deviation(jm, distance);
                misfit = found.map_or(misfit, |[squares, _]| misfit.min(squares));
                logs.push(
                    found.map_or(f64::NEG_INFINITY, |[squares, widths]| -0.5 * squares - widths),
                );
            }
        }
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return None;
        }
        let weights: Vec<f64> = logs.iter().map(|log| (log - largest).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let weights = weights.into_iter().map(|w| w / sum).collect();
        let misfit = (misfit / record.len().max(1) as f64).sqrt();
        Some(Posterior { jm, distance_mm, weights, misfit })
    }
}

impl Posterior {
    fn best(&self) -> (usize, usize) {
        let mut best = 0;
        for (n, weight) in self.weights.iter().enumerate() {
            if *weight > self.weights[best] {
                best = n;
            }
        }
        (best / self.distance_mm.len(), best % self.distance_mm.len())
    }

    /// Weights of each Jₘ and of each distance.
    pub(super) fn sums(&self) -> [Vec<f64>; 2] {
        let columns = self.distance_mm.len();
        let rows = self.weights.chunks(columns).map(|row| row.iter().sum()).collect();
        let column = |c: usize| self.weights.iter().skip(c).step_by(columns).sum();
        [rows, (0..columns).map(column).collect()]
    }

    /// Of Jₘ.
    pub fn jm(&self) -> Marginal {
        marginal(&self.jm, &self.sums()[0], self.best().0)
    }

    /// Of the distance (mm).
    pub fn distance(&self) -> Marginal {
        marginal(&self.distance_mm, &self.sums()[1], self.best().1)
    }

    /// Correlation of ln Jₘ and the distance.
    pub fn correlation(&self) -> f64 {
        let columns = self.distance_mm.len();
        let mean = |of: &dyn Fn(usize) -> f64| -> f64 {
            self.weights.iter().enumerate().map(|(n, weight)| weight * of(n)).sum()
        };
        let x = |n: usize| self.jm[n / columns].ln();
        let y = |n: usize| self.distance_mm[n % columns];
        let (mx, my) = (mean(&x), mean(&y));
        let xy = mean(&|n| (x(n) - mx) * (y(n) - my));
        let xx = mean(&|n| (x(n) - mx).powi(2));
        let yy = mean(&|n| (y(n) - my).powi(2));
        if xx * yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }
    }

    /// Whether an interval touches an end of its axis: the grid limits it, not the record.
    pub fn limited(&self) -> [bool; 2] {
        let touches = |axis: &[f64], m: Marginal| {
            axis.len() > 1 && (m.interval[0] <= axis[1] || m.interval[1] >= axis[axis.len() - 2])
        };
        [touches(&self.jm, self.jm()), touches(&self.distance_mm, self.distance())]
    }
}

/// The marginal of weights on an axis, with the place of the most likely value.
pub(super) fn marginal(axis: &[f64], weights: &[f64], best: usize) -> Marginal {
    let quantile = |part: f64| {
        let mut sum = 0.0;
        for (n, (value, weight)) in axis.iter().zip(weights).enumerate() {
            let before = sum;
            sum += weight;
            if sum >= part {
                // Weights stand for the intervals around their points.
                let from = if n > 0 { 0.5 * (axis[n - 1] + value) } else { *value };
                let to = axis.get(n + 1).map_or(*value, |next| 0.5 * (value + next));
                return from + (to - from) * ((part - before) / weight.max(f64::MIN_POSITIVE));
            }
        }
        axis.last().copied().unwrap_or(f64::NAN)
    };
    Marginal { best: axis[best], median: quantile(0.5), interval: [quantile(0.05), quantile(0.95)] }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A force that grows the faster the smaller Jₘ is, and falls with the distance.
    fn force(jm: f64, distance_mm: f64, thickness_mm: f64) -> f64 {
        let pressed = (80.0 - thickness_mm) / 40.0;
        (40.0 - distance_mm) * pressed * (1.5 * pressed / jm).exp() / 10.0
    }

    fn grid() -> Grid {
        let jm = vec![0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0];
        let distance_mm = vec![10.0, 15.0, 20.0, 25.0];
        let thickness_mm: Vec<f64> = (0..=80).map(|n| 80.0 - 0.5 * f64::from(n)).collect();
        let course = |jm: f64, d: f64| Course {
            force_n: thickness_mm.iter().map(|h| force(jm, d, *h)).collect(),
            thickness_mm: thickness_mm.clone(),
        };
        let courses = jm.iter().flat_map(|j| distance_mm.iter().map(|d| Some(course(*j, *d))));
        Grid { courses: courses.collect(), jm: jm.clone(), distance_mm: distance_mm.clone() }
    }

    const ERROR: RecordError = RecordError {
        force_part: 0.03,
        force_n: 0.1,
        thickness_mm: 0.5,
        model_part: 0.1,
        bent_part: 0.05,
    };

    fn record(jm: f64, distance: f64, thicknesses: &[f64], seed: u64) -> Vec<Measured> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let columns = ERROR.of_model(thicknesses).ncols();
        let drawn = DVector::from_fn(columns, |_, _| normal());
        let factors = ERROR.of_model(thicknesses) * drawn;
        let mut one = |(thickness_mm, off): (f64, f64)| {
            let real = thickness_mm + ERROR.thickness_mm * normal();
            let force = (1.0 + off) * force(jm, distance, real);
            let force_n = force * (1.0 + ERROR.force_part * normal()) + ERROR.force_n * normal();
            Measured { thickness_mm, force_n }
        };
        thicknesses.iter().copied().zip(factors.iter().copied()).map(&mut one).collect()
    }

    #[test]
    fn the_model_between_the_points_of_the_grid_is_the_model() {
        let grid = grid();
        for (jm, d, h) in [(0.6, 12.0, 50.0), (1.7, 17.0, 61.0), (4.0, 24.0, 45.0)] {
            let [found, slope] = grid.force(jm, d, h).unwrap();
            assert!((found / force(jm, d, h) - 1.0).abs() < 0.02, "{jm} {d} {h}");
            let change = (force(jm, d, h + 0.01) - force(jm, d, h)) / 0.01;
            assert!((slope / change - 1.0).abs() < 0.06, "{jm} {d} {h}: {slope} {change}");
        }
        assert_eq!(grid.force(1.0, 10.0, 30.0), None);
    }

    #[test]
    fn a_curve_that_grows_alike_is_read_off_between_far_states() {
        let thickness_mm = vec![70.0, 65.0, 60.0];
        let grows = |h: f64| 0.3 * (0.17 * (70.0 - h)).exp();
        let course =
            Course { force_n: thickness_mm.iter().map(|h| grows(*h)).collect(), thickness_mm };
        let [force, slope] = course.at(62.0).unwrap();
        assert!((force / grows(62.0) - 1.0).abs() < 1e-12 && (slope / force + 0.17).abs() < 1e-12);
        let touches = Course { thickness_mm: vec![70.0, 65.0], force_n: vec![0.0, 1.0] };
        assert_eq!(touches.at(67.5), Some([0.5, -0.2]));
        let touches = Course { force_n: vec![1e-6, 0.05], ..touches };
        assert!((touches.at(67.5).unwrap()[0] / 0.025 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_errors_of_the_model_are_alike_near_by_and_as_large_everywhere() {
        let thicknesses: Vec<f64> = (0..60).map(|n| 40.0 + 0.5 * f64::from(n)).collect();
        let errors = ERROR.of_model(&thicknesses);
        let together = &errors * errors.transpose();
        let (alike, bent) = (ERROR.model_part.powi(2), ERROR.bent_part.powi(2));
        for n in 0..60 {
            assert!((together[(n, n)] / (alike + bent) - 1.0).abs() < 1e-12);
        }
        assert!(
            together[(0, 1)] > alike + 0.9 * bent
                && (together[(0, 40)] / alike - 1.0).abs() < 1e-12
        );
    }

    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say() {
        let grid = grid();
        let thicknesses: Vec<f64> = (0..8).map(|n| 75.0 - 4.5 * f64::from(n)).collect();
        let (mut jm_in, mut place_in) = (0, 0);
        let draws: u32 = 200;
        for seed in 0..u64::from(draws) {
            let (jm, place) = (1.2, 17.0);
            let record = record(jm, place, &thicknesses, seed);
            let found = grid.posterior(&record, &ERROR).unwrap();
            let holds = |m: Marginal, v: f64| u32::from(m.interval[0] <= v && v <= m.interval[1]);
            jm_in += holds(found.jm(), jm);
            place_in += holds(found.distance(), place);
        }
        for inside in [jm_in, place_in] {
            let part = f64::from(inside) / f64::from(draws);
            // 0.9 and three standard errors of 200 draws.
            assert!((0.83..=0.97).contains(&part), "{part}");
        }
    }

    #[test]
    fn one_point_of_a_curve_cannot_tell_place_from_stiffness() {
        let found = grid().posterior(&record(1.2, 17.0, &[45.0], 1), &ERROR).unwrap();
        // Farther away and stiffer is the same.
        assert!(found.correlation() < -0.8, "{}", found.correlation());
        let wide = found.jm().interval[1] / found.jm().interval[0];
        assert!(wide > 1.5, "{wide}");
        let whole = [72.0, 66.0, 60.0, 55.0, 50.0, 45.0];
        let more = grid().posterior(&record(1.2, 17.0, &whole, 1), &ERROR).unwrap();
        let width = |p: &Posterior| p.jm().interval[1].ln() - p.jm().interval[0].ln();
        assert!(width(&more) < 0.7 * width(&found));
    }
}
