//! What the model says of a record, with effects, and what its mesh is off by.

use super::{
    course::{Pressed, bent, straight, tangent},
    library::CurveEffect,
    record::{Channel, Reading, Record, RecordError},
};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Parts of the largest and of the least amplitude for which whole solutions are made.
const UP: [f64; 4] = [0.1, 0.3, 0.6, 1.0];
const DOWN: [f64; 2] = [0.4, 1.0];

/// Whole solutions of an effect at rising amplitudes, zero among them.
#[derive(Debug, Clone)]
pub struct Ladder {
    /// The effect.
    pub effect: &'static CurveEffect,
    /// Amplitude and course.
    pub rungs: Vec<(f64, Pressed)>,
}

/// Amplitudes of an effect's ladder in a range, without zero.
pub fn rungs([least, greatest]: [f64; 2]) -> Vec<f64> {
    let down = DOWN.iter().map(|part| part * least);
    let up = UP.iter().map(|part| part * greatest);
    down.chain(up).filter(|amplitude| *amplitude != 0.0).collect()
}

impl Ladder {
    /// Of the study itself and what was solved. Solutions that end before a thickness (mm) are left out: the
    /// range is what the model reaches.
    pub fn new(
        effect: &'static CurveEffect,
        plain: &Pressed,
        solved: impl IntoIterator<Item = (f64, Pressed)>,
        thinnest_mm: f64,
    ) -> Self {
        let reaches = |(_, course): &(f64, Pressed)| course.thinnest_mm() <= thinnest_mm + 1e-6;
        let mut rungs: Vec<_> = solved.into_iter().filter(reaches).collect();
        rungs.push((0.0, plain.clone()));
        rungs.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { effect, rungs }
    }

    /// Amplitudes between which it knows the effect.
    pub fn range(&self) -> [f64; 2] {
        let end = |rung: Option<&(f64, Pressed)>| rung.map_or(0.0, |rung| rung.0);
        [end(self.rungs.first()), end(self.rungs.last())]
    }

    /// A quantity with an amplitude of the effect at a thickness (mm).
    pub fn at(&self, channel: Channel, thickness_mm: f64, amplitude: f64) -> f64 {
        let [least, greatest] = self.range();
        let a = amplitude.clamp(least, greatest);
        let x: Vec<f64> = self.rungs.iter().map(|rung| rung.0).collect();
        let last = x.len() - 1;
        if last == 0 {
            return self.rungs[0].1.at(channel, thickness_mm);
        }
        let y = |n: usize| bent(channel, self.rungs[n].1.at(channel, thickness_mm));
        let n = x[1..].iter().position(|next| *next >= a).unwrap_or(last - 1);
        let step = x[n + 1] - x[n];
        let t = (a - x[n]) / step;
        let (t2, t3) = (t * t, t * t * t);
        let found = y(n) * (2.0 * t3 - 3.0 * t2 + 1.0)
            + step * tangent(&x, &y, n) * (t3 - 2.0 * t2 + t)
            + y(n + 1) * (3.0 * t2 - 2.0 * t3)
            + step * tangent(&x, &y, n + 1) * (t3 - t2);
        straight(channel, found)
    }
}

/// What is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Parameters {
    /// How much larger (mm) thicknesses are than the unit shows.
    pub offset_mm: f64,
    /// Logarithm of the stiffness of all tissue over the model's.
    pub stiffness: f64,
    /// Amplitude of the effect that is looked at.
    pub amplitude: f64,
}

/// The model of a compression.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// As the study has it.
    pub plain: Pressed,
    /// With effects.
    pub ladders: Vec<Ladder>,
    /// As the study has it, on other meshes.
    pub others: Vec<Pressed>,
    /// Sizes of errors.
    pub error: RecordError,
}

/// Length (mm of thickness) over which the error of a mesh stays alike.
const MESH_LENGTH_MM: f64 = 10.0;
/// Standard deviation of an offset over what is stated: nearly free, so that a thickness that is shown wrongly
/// is not taken for physics.
const FREE: f64 = 5.0;
/// Steps of a fit, and changes for its derivatives.
const STEPS: usize = 12;
const STEP_MM: f64 = 0.05;
const STEP_STIFFNESS: f64 = 0.01;
/// Refinements of an offset alone.
const PLACINGS: usize = 24;
/// Part of an effect's range.
const STEP_AMPLITUDE: f64 = 0.0125;
/// Largest offset (mm) and logarithm of a stiffness in a fit.
const FARTHEST: [f64; 2] = [15.0, 1.5];

/// What the held-out readings are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldOut {
    /// The last forces of the same record.
    Last,
    /// Another record of the same compression.
    Another,
}

/// A record beside the model.
pub struct Weighed<'a> {
    /// The model.
    pub evidence: &'a Evidence,
    /// What was measured.
    pub record: &'a Record,
    /// Known error of the mesh.
    mesh: DVector<f64>,
    covariance: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Standard deviations of offset (mm) and stiffness.
    pub priors: [f64; 2],
    /// Standard deviation of an offset (mm) by what is stated and what meshes show.
    pub offset_error_mm: f64,
}

impl Evidence {
    /// What the model says of readings; `ladder` is the effect whose amplitude counts.
    pub fn predicted(
        &self,
        readings: &[Reading],
        ladder: Option<usize>,
        at: &Parameters,
    ) -> DVector<f64> {
        let ladder = ladder.map(|n| &self.ladders[n]);
        let stiffer = at.stiffness.exp();
        let one = |reading: &Reading| {
            let (channel, h) = (reading.channel, reading.thickness_mm + at.offset_mm);
            let value = match ladder {
                Some(l) => l.at(channel, h, at.amplitude * stiffer.powi(l.effect.scaling)),
                None => self.plain.at(channel, h),
            };
            if channel == Channel::Force { stiffer * value } else { value }
        };
        DVector::from_iterator(readings.len(), readings.iter().map(one))
    }

    /// A record as the model has it, on a mesh as fine as the others hint at; `None` when the errors have no
    /// covariance.
    pub fn as_measured(
        &self,
        record: &Record,
        ladder: Option<usize>,
        at: &Parameters,
    ) -> Option<Record> {
        let values = self.predicted(&record.0, ladder, at) + self.weigh(record)?.mesh;
        let same = record.0.iter().zip(values.iter());
        Some(Record(same.map(|(r, value)| Reading { value: *value, ..*r }).collect()))
    }

    /// The same model with fewer effects.
    pub fn without(&self, name: &str) -> Self {
        let mut less = self.clone();
        less.ladders.retain(|ladder| ladder.effect.name != name);
        less
    }

    /// Offsets (mm) and logarithms of stiffness by which other meshes differ from this one, and what these
    /// leave at readings.
    fn meshes(&self, readings: &[Reading]) -> (Vec<[f64; 2]>, Vec<DVector<f64>>) {
        let values = |course: &Pressed| {
            let at = |r: &Reading| Reading { value: course.at(r.channel, r.thickness_mm), ..*r };
            Record(readings.iter().map(at).collect())
        };
        let one = |course: &Pressed| {
            let record = values(course);
            let sizes = record.0.iter().map(|r| self.error.of(r.channel, r.value).powi(2));
            let sizes = DVector::from_iterator(record.0.len(), sizes);
            let covariance = DMatrix::from_diagonal(&sizes);
            let weighed = Weighed {
                evidence: self,
                record: &record,
                mesh: DVector::zeros(record.0.len()),
                factor: covariance.clone().cholesky()?,
                covariance,
                // Only offsets and factors that a record may have as well.
                priors: [5.0, 0.5],
                offset_error_mm: 5.0,
            };
            let fit = weighed.fit(None, Parameters::default());
            let left = weighed.off(None, &fit);
            Some(([fit.offset_mm, fit.stiffness], left))
        };
        self.others.iter().filter_map(one).unzip()
    }

    /// A record with the errors of this model.
    ///
    /// `None` when these have no covariance.
    pub fn weigh<'a>(&'a self, record: &'a Record) -> Option<Weighed<'a>> {
        let readings = &record.0;
        let (shifts, left) = self.meshes(readings);
        let count = left.len() as f64;
        let mut mesh = DVector::zeros(readings.len());
        left.iter().for_each(|one| mesh += one / count);
        let mut covariance = DMatrix::zeros(readings.len(), readings.len());
        if count > 1.0 {
            // The mean of so many meshes is uncertain as well.
            let weight = (1.0 + 1.0 / count) / (count - 1.0);
            let mut scatter = DMatrix::zeros(readings.len(), readings.len());
            for one in &left {
                let off = one - &mesh;
                scatter += weight * &off * off.transpose();
            }
            // Half of it in the shapes that were seen, half in any other that is as smooth.
            covariance = DMatrix::from_fn(readings.len(), readings.len(), |i, j| {
                let (a, b) = (&readings[i], &readings[j]);
                let apart = (a.thickness_mm - b.thickness_mm) / MESH_LENGTH_MM;
                let alike = if a.channel == b.channel { (-0.5 * apart * apart).exp() } else { 0.0 };
                let size = (scatter[(i, i)] * scatter[(j, j)]).sqrt();
                0.5 * scatter[(i, j)] + 0.5 * size * alike
            });
        }
        for (n, reading) in readings.iter().enumerate() {
            covariance[(n, n)] += self.error.of(reading.channel, reading.value).powi(2);
        }
        let size = |n: usize| {
            let squares: f64 = shifts.iter().map(|shift| shift[n] * shift[n]).sum();
            squares / count.max(1.0)
        };
        let stiffness = [self.error.stiffness, self.error.gain].iter().map(|s| s * s).sum::<f64>();
        let [stated, shown] = [self.error.thickness_mm.powi(2), size(0)];
        Some(Weighed {
            evidence: self,
            record,
            mesh,
            factor: covariance.clone().cholesky()?,
            covariance,
            priors: [(FREE * FREE * stated + shown).sqrt(), (stiffness + size(1)).sqrt()],
            offset_error_mm: (stated + shown).sqrt(),
        })
    }
}

impl<'a> Weighed<'a> {
    /// Some of the readings, with their errors; `record` holds them.
    ///
    /// `None` when these have no covariance.
    pub fn part<'b>(&self, record: &'b Record, rows: &[usize]) -> Option<Weighed<'b>>
    where
        'a: 'b,
    {
        let covariance = self.covariance.select_rows(rows).select_columns(rows);
        Some(Weighed {
            evidence: self.evidence,
            record,
            mesh: self.mesh.select_rows(rows),
            factor: covariance.clone().cholesky()?,
            covariance,
            ..*self
        })
    }

    /// Measured less predicted (units of the quantities).
    fn off(&self, ladder: Option<usize>, at: &Parameters) -> DVector<f64> {
        let predicted = self.evidence.predicted(&self.record.0, ladder, at);
        let measured = self.record.0.iter().map(|r| r.value);
        DVector::from_iterator(self.record.0.len(), measured) - predicted - &self.mesh
    }

    /// The same in independent standard deviations; offset and stiffness follow.
    pub fn residual(&self, ladder: Option<usize>, at: &Parameters) -> DVector<f64> {
        let white = self.whiten(self.off(ladder, at));
        let n = white.len();
        let [offset, stiffness] = self.priors;
        let mut all = white.resize_vertically(n + 2, 0.0);
        all[n] = -at.offset_mm / offset;
        all[n + 1] = -at.stiffness / stiffness;
        all
    }

    fn whiten(&self, values: DVector<f64>) -> DVector<f64> {
        let mut solved = values;
        self.factor.l_dirty().solve_lower_triangular_mut(&mut solved);
        solved
    }

    /// Changes of the predictions by offset and stiffness, as columns.
    pub fn nuisance(&self, ladder: Option<usize>, at: &Parameters) -> DMatrix<f64> {
        let by = |more: Parameters, less: Parameters, step: f64| {
            (self.residual(ladder, &less) - self.residual(ladder, &more)) / (2.0 * step)
        };
        let moved = |mm: f64| Parameters { offset_mm: at.offset_mm + mm, ..*at };
        let stiffer = |s: f64| Parameters { stiffness: at.stiffness + s, ..*at };
        DMatrix::from_columns(&[
            by(moved(STEP_MM), moved(-STEP_MM), STEP_MM),
            by(stiffer(STEP_STIFFNESS), stiffer(-STEP_STIFFNESS), STEP_STIFFNESS),
        ])
    }

    /// Fits offset and stiffness by Gauss and Newton; a step that does not lower the misfit is halved.
    pub fn fit(&self, ladder: Option<usize>, start: Parameters) -> Parameters {
        let mut found = start;
        let mut residual = self.residual(ladder, &found);
        for _ in 0..STEPS {
            let jacobian = self.nuisance(ladder, &found);
            let normal = jacobian.transpose() * &jacobian;
            let Some(factor) = normal.cholesky() else { break };
            let mut step = factor.solve(&(jacobian.transpose() * &residual));
            let before = residual.norm_squared();
            let mut fall = 0.0;
            for _ in 0..6 {
                let [mm, s] = FARTHEST;
                let tried = Parameters {
                    offset_mm: (found.offset_mm + step[0]).clamp(-mm, mm),
                    stiffness: (found.stiffness + step[1]).clamp(-s, s),
                    ..found
                };
                let left = self.residual(ladder, &tried);
                fall = before - left.norm_squared();
                if fall > 0.0 {
                    (found, residual) = (tried, left);
                    break;
                }
                step *= 0.5;
            }
            if fall < 1e-3 {
                break;
            }
        }
        found
    }

    /// Held-out readings in independent standard deviations, with the parameters of a fit without and with an
    /// effect, each at the seen and at the held-out readings: less what the errors of the seen ones foretell of
    /// theirs. What the fit with the effect leaves open of its three numbers is in the errors of both.
    pub fn foretold(
        &self,
        [seen, held_out]: [&[usize]; 2],
        plain: [&Parameters; 2],
        (ladder, with): (usize, [&Parameters; 2]),
        record: HeldOut,
    ) -> Option<[DVector<f64>; 2]> {
        let block = |rows: &[usize], columns: &[usize]| {
            self.covariance.select_rows(rows).select_columns(columns)
        };
        let between = block(held_out, seen);
        let factor = block(seen, seen).cholesky()?;
        let known = factor.solve(&between.transpose()).transpose();
        let [at_seen, at_held_out] = with.map(|at| self.by_parameters(ladder, at));
        let own: Vec<DVector<f64>> = at_seen.iter().map(|c| c.select_rows(seen)).collect();
        let own = DMatrix::from_columns(&own);
        let [offset, stiffness] = self.priors;
        // At the end of a ladder nothing changes with the amplitude: it lies within the ladder, at least.
        let [least, greatest] = self.evidence.ladders[ladder].range();
        let amplitude = greatest - least;
        let prior = [offset, stiffness, amplitude].map(|size| size.powi(-2)).to_vec();
        let prior = DMatrix::from_diagonal(&DVector::from_vec(prior));
        let open = (own.transpose() * factor.solve(&own) + prior).try_inverse()?;
        let mut by = DMatrix::from_columns(
            &at_held_out.each_ref().map(|column| column.select_rows(held_out)),
        );
        let mut covariance = block(held_out, held_out) - &known * between.transpose();
        if record == HeldOut::Another {
            // It has an offset and a gain of its own.
            let moved = by.column(0).into_owned();
            covariance += offset.powi(2) * &moved * moved.transpose();
            let gained = by.column(1).into_owned();
            covariance += 2.0 * self.evidence.error.gain.powi(2) * &gained * gained.transpose();
            by.column_mut(0).fill(0.0);
        }
        // What is left of a column once the seen readings are known.
        by -= &known * own;
        covariance += &by * open * by.transpose();
        let factor = covariance.cholesky()?;
        let white = |ladder: Option<usize>, [seen_at, held_out_at]: [&Parameters; 2]| {
            let off = self.off(ladder, held_out_at).select_rows(held_out);
            let mut rows = off - &known * self.off(ladder, seen_at).select_rows(seen);
            factor.l_dirty().solve_lower_triangular_mut(&mut rows);
            rows
        };
        Some([white(None, plain), white(Some(ladder), with)])
    }

    /// The offset of a record alone, everything else as it is.
    pub fn placed(&self, ladder: Option<usize>, start: Parameters) -> Parameters {
        let size = |at: &Parameters| {
            self.whiten(self.off(ladder, at)).norm_squared()
                + (at.offset_mm / self.priors[0]).powi(2)
        };
        let (mut best, mut step) = (start, 8.0);
        let mut least = size(&best);
        for _ in 0..PLACINGS {
            for way in [-step, step] {
                let offset_mm = (best.offset_mm + way).clamp(-FARTHEST[0], FARTHEST[0]);
                let tried = Parameters { offset_mm, ..best };
                let here = size(&tried);
                if here < least {
                    (best, least) = (tried, here);
                }
            }
            step *= 0.7;
        }
        best
    }

    /// Changes of the predictions (units of the quantities) by offset, stiffness and amplitude.
    fn by_parameters(&self, ladder: usize, at: &Parameters) -> [DVector<f64>; 3] {
        let [least, greatest] = self.evidence.ladders[ladder].range();
        let step = STEP_AMPLITUDE * (greatest - least);
        let amplitude =
            |a: f64| Parameters { amplitude: (at.amplitude + a).clamp(least, greatest), ..*at };
        let offset = |mm: f64| Parameters { offset_mm: at.offset_mm + mm, ..*at };
        let stiffness = |s: f64| Parameters { stiffness: at.stiffness + s, ..*at };
        let by = |[less, more]: [Parameters; 2], whole: f64| {
            let predicted =
                |at: &Parameters| self.evidence.predicted(&self.record.0, Some(ladder), at);
            (predicted(&more) - predicted(&less)) / whole
        };
        let ends = [-step, step].map(amplitude);
        let whole = (ends[1].amplitude - ends[0].amplitude).max(f64::MIN_POSITIVE);
        [
            by([-STEP_MM, STEP_MM].map(offset), 2.0 * STEP_MM),
            by([-STEP_STIFFNESS, STEP_STIFFNESS].map(stiffness), 2.0 * STEP_STIFFNESS),
            by(ends, whole),
        ]
    }
}
