//! A model between plates: equilibrium of body and paddle, and what is recorded of it.

use super::meet::{Met, Reached, meet};
use super::stop::slope_mn_per_mm;
use super::{Plates, Pressing, Step, Stops};
use crate::assemble::State;
use crate::model::Model;
use crate::newton::Newton;
use crate::paddles::{Hinge, Lift, Pose};
use crate::solve::{self, Options, SolveError};
use crate::terms::plate::Plate;
use crate::terms::{Load, contact::skin_around};
use mammotwin_data::{
    progress::Silent,
    solution::{Checks, von_mises_kpa},
};
use nalgebra::{DMatrix, DVector};

/// Torques are in balance within this part of what turns the paddle.
const TORQUE_TOLERANCE: f64 = 1e-3;
/// Largest tilt (rad), largest change of it in one trial, and most trials.
const LARGEST_TILT: f64 = 0.7;
const LARGEST_TURN: f64 = 0.05;
const TILT_TRIALS: usize = 30;

/// A pose is found when no coordinate would still change by more (mm).
const POSE_TOLERANCE_MM: f64 = 0.002;
/// Largest change (mm) of a coordinate in one trial, and most trials.
const LARGEST_MOVE_MM: f64 = 4.0;
const POSE_TRIALS: usize = 40;

/// A model between plates.
pub(super) struct Press<'a> {
    pub model: Model,
    pub plates: &'a Plates,
    pub receptor: Plate,
    pub paddle: Plate,
    /// Of receptor and paddle among the terms.
    pub indices: [usize; 2],
    pub newton: Newton,
    pub options: &'a Options,
    pub counts: Checks,
    /// How the torque that is out of balance changes with the tilt (mN mm/rad), as last seen.
    pub softening: Option<f64>,
    /// How the pose changes with the forces that are out of balance (mm/mN), as last seen.
    pub yielding: Option<DMatrix<f64>>,
}

impl Press<'_> {
    pub fn walk(&mut self, state: &mut State, load: Load) -> Result<(), SolveError> {
        if let Some(hinge) = self.plates.paddle.hinge() {
            return self.turn(&hinge, state, load);
        }
        match self.plates.paddle.lift().cloned() {
            Some(lift) if lift.coordinates() > 0 => self.settle(&*lift, state, load),
            _ if self.plates.paddle.cushion().is_some() => self.sink(state, load),
            _ => self.walk_rigid(state, load),
        }
    }

    /// Walks to `load` as long as the foam on the paddle has not given way altogether.
    fn sink(&mut self, state: &mut State, load: Load) -> Result<(), SolveError> {
        let Some(cushion) = self.plates.paddle.cushion() else { return Ok(()) };
        let before = state.clone();
        self.walk_rigid(state, load)?;
        let deepest = self.deepest(state);
        if deepest <= cushion.thickness_mm {
            return Ok(());
        }
        *state = before;
        let thickness_mm = load.thickness_mm;
        Err(SolveError::Cushion { thickness_mm, foam_mm: cushion.thickness_mm })
    }

    /// Deepest place (mm) of the skin in the foam.
    fn deepest(&self, state: &State) -> f64 {
        let nodes = self.plates.faces.iter().flatten();
        let depth = |n: &u32| self.paddle.indentation(&state.points[*n as usize], &state.load);
        nodes.map(depth).fold(0.0, f64::max)
    }

    /// Forgets what was learnt of how body and paddle give way.
    pub fn forget(&mut self) {
        (self.softening, self.yielding) = (None, None);
    }

    fn walk_rigid(&mut self, state: &mut State, load: Load) -> Result<(), SolveError> {
        let counts = &mut self.counts;
        solve::walk(&mut self.newton, &self.model, state, load, self.options, counts, &Silent)
    }

    /// Walks to `load` with the tilt at which body and hinge are in balance: a secant within a
    /// bracket, for the more the paddle tilts the less the body turns it.
    fn turn(&mut self, hinge: &Hinge, state: &mut State, load: Load) -> Result<(), SolveError> {
        let mut tilt = state.load.tilt_rad;
        let (mut least, mut most) = (-LARGEST_TILT, LARGEST_TILT);
        let mut last: Option<(f64, f64)> = None;
        for _ in 0..TILT_TRIALS {
            let mut trial = state.clone();
            self.walk_rigid(&mut trial, Load { tilt_rad: tilt, ..load })?;
            let (torque, size) = self.paddle.torque(&trial.at(self.indices[1]));
            let off = torque - hinge.torque(tilt);
            tracing::debug!(tilt, torque, off, "hinge");
            if off.abs() <= TORQUE_TOLERANCE * size.max(hinge.torque(tilt).abs()) {
                *state = trial;
                return Ok(());
            }
            if let Some((tilt_before, off_before)) = last {
                let slope = (off - off_before) / (tilt - tilt_before);
                self.softening = (slope < 0.0).then_some(slope);
            }
            last = Some((tilt, off));
            *(if off > 0.0 { &mut least } else { &mut most }) = tilt;
            let slope = self.softening.unwrap_or(-hinge.stiffness(tilt));
            let next = tilt + (-off / slope).clamp(-LARGEST_TURN, LARGEST_TURN);
            let inside = next > least && next < most;
            tilt = if inside { next } else { 0.5 * (least + most) };
        }
        Err(SolveError::Paddle { thickness_mm: load.thickness_mm })
    }

    /// Walks to `load` with the pose in which body and paddle are in balance: Broyden's method,
    /// which begins with the paddle's own stiffness and keeps what it learns of the body's.
    fn settle(&mut self, lift: &dyn Lift, state: &mut State, load: Load) -> Result<(), SolveError> {
        let count = lift.coordinates();
        let mut pose = state.load.pose;
        let mut trial = state.clone();
        let mut last: Option<(DVector<f64>, DVector<f64>)> = None;
        for round in 0..POSE_TRIALS {
            // Friction counts from the last load; without it the last trial is the nearest start.
            if self.plates.friction > 0.0 {
                trial = state.clone();
            }
            self.walk_rigid(&mut trial, Load { pose, ..load })?;
            let push = self.paddle.push(&trial.at(self.indices[1]));
            let (resistance, stiffness) = lift.resistance(&pose);
            let off = DVector::from_fn(count, |n, _| push[n] - resistance[n]);
            let own = || {
                DMatrix::from_fn(count, count, |a, b| if a == b { 1.0 / stiffness[a] } else { 0.0 })
            };
            let mut yielding = self.yielding.take().unwrap_or_else(own);
            if let Some((step, before)) = &last {
                learn(&mut yielding, step, &(&off - before));
            }
            // Far off, what was learnt elsewhere may lead astray.
            let mut step = &yielding * &off;
            if round == POSE_TRIALS / 2 || step.dot(&off) <= 0.0 {
                yielding = own();
                step = &yielding * &off;
            }
            let largest = step.amax();
            tracing::debug!(round, largest, deflection = pose[0], "pose of the paddle");
            self.yielding = Some(yielding);
            if largest <= POSE_TOLERANCE_MM {
                *state = trial;
                return Ok(());
            }
            step *= f64::min(1.0, LARGEST_MOVE_MM / largest);
            for n in 0..count {
                pose[n] += step[n];
            }
            last = Some((step, off));
        }
        Err(SolveError::Paddle { thickness_mm: load.thickness_mm })
    }

    /// The state between `thick` and `thin` at which the nearest limit is reached, if there is one.
    pub fn meet(
        &mut self,
        stops: &Stops,
        course: &[[f64; 2]],
        [thick, thin]: [(&State, &Step); 2],
        at: &impl Fn(f64) -> Load,
    ) -> Met<State> {
        let reached = |state: &State, step: &Step| Reached {
            thickness_mm: step.thickness_mm,
            share: stops.share(step),
            force_mn: step.paddle_force_mn,
            state: state.clone(),
        };
        let go = |thickness_mm: f64| {
            let mut trial = thick.0.clone();
            let failed = self.walk(&mut trial, at(thickness_mm)).err();
            if let Some(error) = failed {
                tracing::debug!(?error, thickness_mm, "no state on the way to the limit");
                self.forget();
                return None;
            }
            let step = self.record_after(course, &trial);
            Some(reached(&trial, &step))
        };
        meet(reached(thick.0, thick.1), reached(thin.0, thin.1), go)
    }

    /// What a state is after a course, thickness (mm) and force (mN) of each recorded state.
    pub fn record_after(&self, course: &[[f64; 2]], state: &State) -> Step {
        let step = self.record(state);
        let last = &course[course.len().saturating_sub(2)..];
        let slope_mn_per_mm = slope_mn_per_mm(&[last, &[step.place()]].concat());
        Step { slope_mn_per_mm, ..step }
    }

    /// What a state is, without its motion since another one and the slope of its force.
    pub fn record(&self, state: &State) -> Step {
        let axis = self.plates.axis;
        let areas = skin_around(&state.points, &self.plates.faces);
        let mut pressures = vec![0.0; state.points.len()];
        let mut sums = [0.0, 0.0];
        let mut pressing = [Vec::new(), Vec::new()];
        for (which, plate) in [&self.receptor, &self.paddle].into_iter().enumerate() {
            for force in plate.node_forces(&state.at(self.indices[which])) {
                sums[which] += (force.normal + force.friction).dot(&axis);
                let Some(normal) = force.normal.try_normalize(0.0) else { continue };
                let area = areas.get(&force.node).map_or(f64::INFINITY, |a| a.facing(-normal));
                pressures[force.node as usize] += force.normal.norm() / area;
                let (node, force_mn) = (force.node, force.normal);
                pressing[which].push(Pressing { node, force_mn, area_mm2: area });
            }
        }
        let (receptor_force_mn, paddle_force_mn) = (sums[0], -sums[1]);
        let on_paddle = &pressing[1];
        let sum = |sum: f64, area: f64| sum + area;
        let contact_area = on_paddle.iter().map(|p| p.face_area(&axis)).fold(0.0, sum);
        let away = self.plates.away;
        let upright = |front: bool| {
            let here = on_paddle.iter().filter(|p| p.is_front(&axis, &away) == front);
            here.map(|p| p.upright_area(&axis)).fold(0.0, sum)
        };
        let place = |p: &Pressing| &state.points[p.node as usize];
        let deflections =
            on_paddle.iter().map(|p| self.paddle.deflection(place(p), &state.load).abs());
        let nodes = self.plates.faces.iter().flatten();
        let bulge = |n: &u32| self.paddle.bulge(&state.points[*n as usize], &state.load);
        let bulge_mm = nodes.map(bulge).fold(0.0, f64::max);
        let gaps = on_paddle
            .iter()
            .filter(|p| !p.is_upright(&axis))
            .map(|p| self.paddle.gap(place(p), &state.load));
        let gaps_mm = gaps.fold(None, |ends: Option<[f64; 2]>, gap| {
            let [low, high] = ends.unwrap_or([gap; 2]);
            Some([low.min(gap), high.max(gap)])
        });
        let stress = state.report(&self.model);
        let angles = |pose: &Pose| self.plates.paddle.lift().map_or([0.0; 2], |l| l.angles(pose));
        let [tilt, roll_rad] = angles(&state.load.pose);
        Step {
            thickness_mm: state.load.thickness_mm,
            receptor_mm: state.load.receptor_mm,
            tilt_rad: state.load.tilt_rad + tilt,
            roll_rad,
            deflection_mm: deflections.fold(0.0, f64::max),
            bulge_mm,
            moved_mm: 0.0,
            gaps_mm: gaps_mm.unwrap_or([state.load.thickness_mm; 2]),
            paddle_force_mn,
            receptor_force_mn,
            slope_mn_per_mm: 0.0,
            contact_area_mm2: contact_area,
            front_area_mm2: upright(true),
            edge_area_mm2: upright(false),
            mean_pressure_kpa: if contact_area > 0.0 {
                paddle_force_mn / contact_area
            } else {
                0.0
            },
            peak_pressure_kpa: pressures.iter().copied().fold(0.0, f64::max),
            paddle_peak_pressure_kpa: on_paddle
                .iter()
                .filter(|p| !p.is_upright(&axis))
                .map(Pressing::pressure_kpa)
                .fold(0.0, f64::max),
            contact_pressure_kpa: pressures,
            pressing,
            pose: state.load.pose,
            points: state.points.clone(),
            von_mises_kpa: stress.cauchy_kpa.iter().map(von_mises_kpa).collect(),
        }
    }
}

/// Broyden's update of the inverse of a Jacobian: `step` was made, and changed what is out of
/// balance by `change`, of which the inverse expects the opposite.
fn learn(yielding: &mut DMatrix<f64>, step: &DVector<f64>, change: &DVector<f64>) {
    let expected = -(&*yielding * change);
    let scale = step.dot(&expected);
    if scale.abs() > 1e-12 * step.norm_squared() {
        let left = (step - &expected) / scale;
        let right = step.transpose() * &*yielding;
        *yielding += left * right;
    }
}
