//! Squeezes a body between a receptor and a paddle, and records force against thickness.

use crate::assemble::State;
use crate::model::{Model, ModelError};
use crate::newton::Newton;
use crate::paddles::{Hinge, RoundedPlate};
use crate::solve::{self, Options, SolveError};
use crate::terms::plate::{Plate, PlateKind};
use crate::terms::{Load, Slip};
use mammotwin_data::{
    Vec3,
    progress::{Progress, Silent},
    solution::{Checks, Solution, von_mises_kpa},
};
use std::collections::BTreeMap;

/// The two plates, and what they press on.
#[derive(Debug, Clone)]
pub struct Plates {
    /// Unit vector from the receptor to the paddle.
    pub axis: Vec3,
    /// Unit vector away from the chest wall, along the plates.
    pub away: Vec3,
    /// Coordinate of the chest-wall edge of both plates along `away` (mm).
    pub edge_mm: f64,
    /// Radius of the rounded edges (mm).
    pub radius_mm: f64,
    /// Coulomb friction between skin and plates.
    pub friction: f64,
    /// What the paddle tilts about; it does not tilt when there is none.
    pub hinge: Option<Hinge>,
    /// Skin that the plates may touch; nodes that the model fixes are not touched: no force of a
    /// plate would move them out of its way.
    pub faces: Vec<[u32; 3]>,
}

/// How the plates come together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// Position of the receptor along the axis at the start (mm).
    pub receptor_mm: f64,
    /// Distance of the plates at the start (mm).
    pub thickness_mm: f64,
    /// Share of the closing that the receptor makes (0: it rests; 0.5: both move alike).
    pub receptor_share: f64,
    /// Largest change of the thickness between recorded states (mm).
    pub step_mm: f64,
    /// When it ends.
    pub stop: Stop,
}

/// When the plates stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stop {
    /// At a distance of the plates (mm).
    ThicknessMm(f64),
    /// At a force of the paddle (mN), to 1 %.
    ForceMn(f64),
}

/// One state on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// Position of the receptor along the axis (mm).
    pub receptor_mm: f64,
    /// Tilt of the paddle (rad), positive when the side of the nipple sinks.
    pub tilt_rad: f64,
    /// Force of the paddle along the axis (mN), positive when pressing.
    pub paddle_force_mn: f64,
    /// Force of the receptor along the axis (mN), positive when pressing.
    pub receptor_force_mn: f64,
    /// Area of the paddle that the skin covers (mm²).
    pub contact_area_mm2: f64,
    /// Force of the paddle over its contact area (kPa).
    pub mean_pressure_kpa: f64,
    /// Largest contact pressure under either plate (kPa).
    pub peak_pressure_kpa: f64,
    /// Contact pressure of both plates at each node (kPa).
    pub contact_pressure_kpa: Vec<f64>,
    /// Node positions (mm).
    pub points: Vec<Vec3>,
    /// Von Mises stress (kPa), one per tetrahedron.
    pub von_mises_kpa: Vec<f64>,
}

/// What a compression gives.
#[derive(Debug)]
pub struct Compressed {
    /// From the first to the last thickness.
    pub steps: Vec<Step>,
    /// The last state.
    pub solution: Solution,
    /// Why the plates stopped before their goal; `None` when they reached it.
    pub stopped_early: Option<SolveError>,
}

impl Plates {
    /// Receptor position and thickness (mm) at which both plates just touch the faces.
    pub fn touching(&self, points: &[Vec3]) -> (f64, f64) {
        let along = |&n: &u32| self.axis.dot(&points[n as usize]);
        let in_reach = |n: &&u32| self.away.dot(&points[**n as usize]) >= self.edge_mm;
        let heights = || self.faces.iter().flatten().filter(in_reach).map(along);
        let (low, high) =
            heights().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
        (low, high - low)
    }

    fn plate(&self, kind: PlateKind, model: &Model) -> Result<Plate, ModelError> {
        let into = match kind {
            PlateKind::Receptor => -self.axis,
            PlateKind::Paddle => self.axis,
        };
        let shape = RoundedPlate {
            into,
            away: self.away,
            edge_mm: self.edge_mm,
            radius_mm: self.radius_mm,
        };
        let fixed = |n: u32| model.fixed()[n as usize] == [true; 3];
        let plate = Plate::new(kind, shape, &model.rest, &self.faces).without(fixed);
        let axis_mm = self.hinge.map_or(0.0, |hinge| hinge.axis_mm);
        plate.tilting(axis_mm).slip(Slip::Coulomb(self.friction))
    }

    /// # Errors
    /// No body within reach, directions that are not perpendicular unit vectors, or a closing
    /// without meaning.
    fn check(&self, closing: &Closing) -> Result<(), ModelError> {
        let refuse = |what, value, remedy| {
            Err(ModelError::Value { term: "plates".into(), what, value, remedy })
        };
        let skew = (self.axis.norm() - 1.0)
            .abs()
            .max((self.away.norm() - 1.0).abs())
            .max(self.axis.dot(&self.away).abs());
        if !(skew < 1e-6) {
            let remedy = "give perpendicular unit vectors";
            return refuse("departure of axis and away from unit vectors", skew, remedy);
        }
        for (what, value) in [
            ("radius of the edges (mm)", self.radius_mm),
            ("thickness at the start (mm)", closing.thickness_mm),
            ("step (mm)", closing.step_mm),
            match closing.stop {
                Stop::ThicknessMm(thickness) => ("final thickness (mm)", thickness),
                Stop::ForceMn(force) => ("final force (mN)", force),
            },
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(what, value, "give a positive one");
            }
        }
        for hinge in self.hinge.iter() {
            if !(hinge.axis_mm.is_finite() && hinge.linear_mn_mm > 0.0) {
                return refuse(
                    "torque of the hinge (mN mm/rad)",
                    hinge.linear_mn_mm,
                    "give a positive one",
                );
            }
            if !(hinge.quadratic_mn_mm >= 0.0) {
                let value = hinge.quadratic_mn_mm;
                return refuse(
                    "torque of the hinge (mN mm/rad²)",
                    value,
                    "give one that is not negative",
                );
            }
        }
        if !closing.receptor_mm.is_finite() || !(0.0..=1.0).contains(&closing.receptor_share) {
            let share = closing.receptor_share;
            return refuse("share of the receptor", share, "give a place, and a share from 0 to 1");
        }
        Ok(())
    }
}

/// Thinnest gap (mm) that is tried for a force.
const THINNEST_MM: f64 = 5.0;
/// A force is met within this part of it.
const FORCE_TOLERANCE: f64 = 0.01;
/// Most trials to meet a force.
const FORCE_TRIALS: usize = 12;

/// Torques are in balance within this part of what turns the paddle.
const TORQUE_TOLERANCE: f64 = 1e-3;
/// Largest tilt (rad), largest change of it in one trial, and most trials.
const LARGEST_TILT: f64 = 0.7;
const LARGEST_TURN: f64 = 0.05;
const TILT_TRIALS: usize = 30;

/// Closes the plates on the model, whose nodes begin at `start` (mm) in equilibrium or near it.
///
/// # Errors
/// Plates or a closing without meaning, or no equilibrium at the first thickness. A later
/// failure is [`Compressed::stopped_early`], with all states before it.
pub fn compress(
    mut model: Model,
    plates: &Plates,
    closing: &Closing,
    start: &[Vec3],
    options: &Options,
    progress: &dyn Progress,
) -> Result<Compressed, SolveError> {
    let refuse = |error: ModelError| SolveError::Assembly(error.into());
    plates.check(closing).map_err(refuse)?;
    let receptor = plates.plate(PlateKind::Receptor, &model).map_err(refuse)?;
    let paddle = plates.plate(PlateKind::Paddle, &model).map_err(refuse)?;
    let indices = [model.terms().len(), model.terms().len() + 1];
    model.add(receptor.clone()).map_err(refuse)?;
    model.add(paddle.clone()).map_err(refuse)?;
    let at = |thickness_mm: f64| Load {
        gravity: 1.0,
        receptor_mm: closing.receptor_mm
            + closing.receptor_share * (closing.thickness_mm - thickness_mm),
        thickness_mm,
        tilt_rad: 0.0,
    };
    let (newton, state) = solve::prepare(&model, start, at(closing.thickness_mm))?;
    let mut press = Press {
        model,
        plates,
        receptor,
        paddle,
        indices,
        newton,
        options,
        counts: Checks::default(),
        softening: None,
    };
    let mut state = state;
    press.walk(&mut state, at(closing.thickness_mm))?;
    let mut steps = vec![press.record(&state)];
    let goal = match closing.stop {
        Stop::ThicknessMm(thickness) => thickness,
        Stop::ForceMn(_) => THINNEST_MM,
    };
    let mut stopped_early = None;
    while state.load.thickness_mm > goal {
        let thickness = f64::max(goal, state.load.thickness_mm - closing.step_mm);
        let before = state.clone();
        if let Err(error) = press.walk(&mut state, at(thickness)) {
            stopped_early = Some(error);
            break;
        }
        let mut step = press.record(&state);
        let reached = match closing.stop {
            Stop::ForceMn(force) if step.paddle_force_mn >= force => {
                let low = steps.last().map_or(0.0, |s| s.paddle_force_mn);
                let met = press.meet(&before, low, &state, step.paddle_force_mn, force, &at);
                match met {
                    Ok(found) => state = found,
                    Err(error) => stopped_early = Some(error),
                }
                step = press.record(&state);
                true
            }
            _ => false,
        };
        progress.report(
            fraction(closing, &step, goal),
            &format!("{:.1} mm, {:.1} N", step.thickness_mm, step.paddle_force_mn / 1000.0),
        );
        steps.push(step);
        if reached {
            break;
        }
    }
    let solution = solve::finish(&press.newton, &press.model, &state, press.counts)?;
    Ok(Compressed { steps, solution, stopped_early })
}

fn fraction(closing: &Closing, step: &Step, goal: f64) -> f64 {
    let done = match closing.stop {
        Stop::ThicknessMm(_) => {
            (closing.thickness_mm - step.thickness_mm) / (closing.thickness_mm - goal)
        }
        Stop::ForceMn(force) => step.paddle_force_mn / force,
    };
    done.clamp(0.0, 1.0)
}

/// Deformed skin (mm²) around a node.
#[derive(Default)]
struct Skin {
    area: f64,
    vector: Vec3,
}

/// Least part of the skin around a node that a plate is taken to touch.
const LEAST_FACING: f64 = 0.25;

impl Skin {
    /// Area of a plate with this normal that the skin covers. Pressures are those on the plate: they
    /// add up to its force whether or not the skin is folded under it.
    fn facing(&self, normal: Vec3) -> f64 {
        self.vector.dot(&normal).max(LEAST_FACING * self.area)
    }
}

fn area_vectors(points: &[Vec3], faces: &[[u32; 3]]) -> BTreeMap<u32, Skin> {
    let mut skins: BTreeMap<u32, Skin> = BTreeMap::new();
    for face in faces {
        let [a, b, c] = face.map(|n| points[n as usize]);
        let third = (b - a).cross(&(c - a)) / 6.0;
        for &n in face {
            let skin = skins.entry(n).or_default();
            skin.area += third.norm();
            skin.vector += third;
        }
    }
    skins
}

/// A model between plates.
struct Press<'a> {
    model: Model,
    plates: &'a Plates,
    receptor: Plate,
    paddle: Plate,
    /// Of receptor and paddle among the terms.
    indices: [usize; 2],
    newton: Newton,
    options: &'a Options,
    counts: Checks,
    /// How the torque that is out of balance changes with the tilt (mN mm/rad), as last seen.
    softening: Option<f64>,
}

impl Press<'_> {
    fn walk(&mut self, state: &mut State, load: Load) -> Result<(), SolveError> {
        match self.plates.hinge {
            Some(hinge) => self.turn(&hinge, state, load),
            None => self.walk_rigid(state, load),
        }
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
        Err(SolveError::Hinge { thickness_mm: load.thickness_mm })
    }

    /// The state between `thick` and `thin` at which the paddle's force is `force` (mN).
    fn meet(
        &mut self,
        thick: &State,
        low_mn: f64,
        thin: &State,
        high_mn: f64,
        force_mn: f64,
        at: &impl Fn(f64) -> Load,
    ) -> Result<State, SolveError> {
        let (mut wide, mut wide_mn) = (thick.load.thickness_mm, low_mn);
        let (mut narrow, mut narrow_mn) = (thin.load.thickness_mm, high_mn);
        let mut found = thin.clone();
        for _ in 0..FORCE_TRIALS {
            if (narrow_mn / force_mn - 1.0).abs() <= FORCE_TOLERANCE {
                break;
            }
            // The force curves upwards: stay away from the ends of the bracket.
            let part = ((force_mn - wide_mn) / (narrow_mn - wide_mn)).clamp(0.1, 0.9);
            let thickness = wide + part * (narrow - wide);
            let mut trial = thick.clone();
            self.walk(&mut trial, at(thickness))?;
            let trial_mn = self.record(&trial).paddle_force_mn;
            if (trial_mn / force_mn - 1.0).abs() <= FORCE_TOLERANCE {
                return Ok(trial);
            }
            if trial_mn < force_mn {
                (wide, wide_mn) = (thickness, trial_mn);
            } else {
                (narrow, narrow_mn) = (thickness, trial_mn);
                found = trial;
            }
        }
        Ok(found)
    }

    fn record(&self, state: &State) -> Step {
        let axis = self.plates.axis;
        let areas = area_vectors(&state.points, &self.plates.faces);
        let mut pressures = vec![0.0; state.points.len()];
        let mut sums = [0.0, 0.0];
        let mut contact_area = 0.0;
        for (which, plate) in [&self.receptor, &self.paddle].into_iter().enumerate() {
            for force in plate.node_forces(&state.at(self.indices[which])) {
                sums[which] += (force.normal + force.friction).dot(&axis);
                let Some(normal) = force.normal.try_normalize(0.0) else { continue };
                let area = areas.get(&force.node).map_or(f64::INFINITY, |a| a.facing(-normal));
                pressures[force.node as usize] += force.normal.norm() / area;
                if which == 1 {
                    contact_area += area;
                }
            }
        }
        let (receptor_force_mn, paddle_force_mn) = (sums[0], -sums[1]);
        let stress = state.report(&self.model);
        Step {
            thickness_mm: state.load.thickness_mm,
            receptor_mm: state.load.receptor_mm,
            tilt_rad: state.load.tilt_rad,
            paddle_force_mn,
            receptor_force_mn,
            contact_area_mm2: contact_area,
            mean_pressure_kpa: if contact_area > 0.0 {
                paddle_force_mn / contact_area
            } else {
                0.0
            },
            peak_pressure_kpa: pressures.iter().copied().fold(0.0, f64::max),
            contact_pressure_kpa: pressures,
            points: state.points.clone(),
            von_mises_kpa: stress.cauchy_kpa.iter().map(von_mises_kpa).collect(),
        }
    }
}
