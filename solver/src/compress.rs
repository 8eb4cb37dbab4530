//! Squeezes a body between a receptor and a paddle, and records force against thickness.

mod meet;
mod press;
mod stop;

pub use stop::{StopRule, StoppedEarly, Stops};

use crate::model::{Model, ModelError};
use crate::paddles::{AT_REST, Outline, Paddle, Pose, RoundedPlate};
use crate::solve::{self, Options, SolveError};
use crate::terms::plate::{Plate, PlateKind};
use crate::terms::{At, Load, Slip, Term};
use mammotwin_data::{
    Vec3,
    progress::Progress,
    solution::{Checks, Solution},
};
use meet::Met;
use press::Press;

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
    /// Which paddle it is.
    pub paddle: Paddle,
    /// Where the paddle ends; the receptor is endless. Corners and what is left around a window are
    /// wide enough for the radius of the edges.
    pub outline: Outline,
    /// Coordinate of the middle of the paddle along `away` × `axis` (mm).
    pub middle_mm: f64,
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
    /// How far the receptor rises first, while the paddle waits (mm): it lifts the body.
    pub lift_mm: f64,
    /// Largest change of the thickness between recorded states (mm); on the way to a final thickness
    /// all steps are alike.
    pub step_mm: f64,
    /// When it ends.
    pub stops: Stops,
}

impl Closing {
    /// The largest step (mm) not above `step_mm` of which some whole number leads to the final
    /// thickness; `step_mm` itself without one. A last step of any size would make of slopes at the
    /// end what it likes.
    fn even_step_mm(&self) -> f64 {
        let Some(goal) = self.stops.thickness_mm else { return self.step_mm };
        let way = self.thickness_mm - goal;
        way / (way / self.step_mm - 1e-9).ceil().max(1.0)
    }

    /// Position of the receptor along the axis (mm) at a distance of the plates (mm).
    fn receptor_at_mm(&self, thickness_mm: f64) -> f64 {
        let closed = self.thickness_mm - thickness_mm;
        let lifted = closed.clamp(0.0, self.lift_mm);
        self.receptor_mm + lifted + self.receptor_share * (closed - lifted)
    }
}

/// What a plate does to a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pressing {
    /// The node.
    pub node: u32,
    /// Force (mN) of the plate on it, without friction, along the plate's normal.
    pub force_mn: Vec3,
    /// Area (mm²) of the plate that the skin around the node covers, along the plate's own surface.
    pub area_mm2: f64,
}

impl Pressing {
    /// Contact pressure (kPa).
    pub fn pressure_kpa(&self) -> f64 {
        self.force_mn.norm() / self.area_mm2
    }

    /// Cosine between the plate's normal here and the axis of the compression.
    pub fn facing(&self, axis: &Vec3) -> f64 {
        self.force_mn.try_normalize(0.0).map_or(0.0, |normal| normal.dot(axis).abs())
    }

    /// Whether the plate is nearer to upright here than to level: its front, which pushes towards
    /// the chest wall and not at what is between the plates, or another edge of a finite plate.
    pub fn is_upright(&self, axis: &Vec3) -> bool {
        self.facing(axis) < std::f64::consts::FRAC_1_SQRT_2
    }

    /// Whether it is the upright front, which pushes more towards the chest wall than to any other
    /// side.
    pub fn is_front(&self, axis: &Vec3, away: &Vec3) -> bool {
        let backwards = -self.force_mn.dot(away);
        let sideways = self.force_mn.dot(&away.cross(axis)).abs();
        self.is_upright(axis) && backwards > 0.0 && backwards >= sideways
    }

    /// Area (mm²) as seen along the axis of the compression: pressures over it sum up to the force
    /// along the axis, and an upright front has none.
    pub fn face_area(&self, axis: &Vec3) -> f64 {
        self.area_mm2 * self.facing(axis)
    }

    /// Area (mm²) of an upright edge, as seen across the axis; zero on the face.
    pub fn upright_area(&self, axis: &Vec3) -> f64 {
        let facing = self.facing(axis);
        let upright = (1.0 - facing * facing).max(0.0).sqrt();
        if self.is_upright(axis) { self.area_mm2 * upright } else { 0.0 }
    }
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
    /// Roll of the paddle about the other axis (rad), positive when its end along
    /// `away` × `axis` rises.
    pub roll_rad: f64,
    /// How far (mm) the paddle has given way at most where it is touched, by bending, tilt, roll or
    /// its foam.
    pub deflection_mm: f64,
    /// How far (mm) skin stands out above the paddle's surface at most, beside a finite paddle or in
    /// its window; behind its chest-wall edge does not count.
    pub bulge_mm: f64,
    /// Largest motion (mm) of a node since the recorded state before; zero for the first.
    pub moved_mm: f64,
    /// Smallest and largest distance of the plates (mm) where skin touches the paddle's face.
    pub gaps_mm: [f64; 2],
    /// Force of the paddle along the axis (mN), positive when pressing.
    pub paddle_force_mn: f64,
    /// Force of the receptor along the axis (mN), positive when pressing.
    pub receptor_force_mn: f64,
    /// By how much the paddle's force grows for a millimetre less of thickness (mN/mm), from this and the two
    /// recorded states before it; zero for the first.
    pub slope_mn_per_mm: f64,
    /// Area of the paddle that the skin covers (mm²), as seen along the axis: without its front.
    pub contact_area_mm2: f64,
    /// Area of the paddle's upright front that the skin covers (mm²), as seen across the axis.
    pub front_area_mm2: f64,
    /// The same of its other upright edges: sides, rear and window of a finite plate.
    pub edge_area_mm2: f64,
    /// Force of the paddle over its contact area (kPa).
    pub mean_pressure_kpa: f64,
    /// Largest contact pressure under either plate (kPa).
    pub peak_pressure_kpa: f64,
    /// Largest contact pressure on the paddle's face (kPa): without its front and other upright edges.
    pub paddle_peak_pressure_kpa: f64,
    /// Contact pressure of both plates at each node (kPa).
    pub contact_pressure_kpa: Vec<f64>,
    /// What receptor and paddle do to each node that they touch.
    pub pressing: [Vec<Pressing>; 2],
    /// Coordinates of a paddle that gives way.
    pub pose: Pose,
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
    /// The limit that ended it; `None` when none was reached.
    pub met: Option<StopRule>,
    /// Why the plates stopped before their goal; `None` when they reached it.
    pub stopped_early: Option<StoppedEarly>,
}

impl Step {
    /// Thickness (mm) and force of the paddle (mN).
    fn place(&self) -> [f64; 2] {
        [self.thickness_mm, self.paddle_force_mn]
    }
}

impl Plates {
    /// Receptor position and thickness (mm) at which both plates just touch the faces.
    pub fn touching(&self, points: &[Vec3]) -> (f64, f64) {
        let paddle = self.shape(PlateKind::Paddle);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for point in self.faces.iter().flatten().map(|&n| &points[n as usize]) {
            let height = self.axis.dot(point);
            if self.away.dot(point) >= self.edge_mm {
                low = low.min(height);
            }
            if self.outline.distance(paddle.place(point)).value <= 0.0 {
                high = high.max(height);
            }
        }
        (low, high - low)
    }

    fn shape(&self, kind: PlateKind) -> RoundedPlate {
        let (into, outline) = match kind {
            PlateKind::Receptor => (-self.axis, Outline::ENDLESS),
            PlateKind::Paddle => (self.axis, self.outline),
        };
        RoundedPlate {
            into,
            away: self.away,
            edge_mm: self.edge_mm,
            radius_mm: self.radius_mm,
            middle_mm: self.middle_mm,
            outline,
        }
    }

    fn plate(&self, kind: PlateKind, model: &Model) -> Result<Plate, ModelError> {
        let fixed = |n: u32| model.fixed()[n as usize] == [true; 3];
        let mut plate = Plate::new(kind, self.shape(kind), &model.rest, &self.faces).without(fixed);
        if kind == PlateKind::Paddle {
            plate = match &self.paddle {
                Paddle::Rigid => plate,
                Paddle::Flex(hinge) => plate.tilting(hinge.axis_mm),
                Paddle::Cushioned(cushion) => plate.cushioned(*cushion, &self.faces),
                Paddle::Lifted(lift) => plate.lifted(lift.clone()),
            };
        }
        plate.slip(Slip::Coulomb(self.friction))
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
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(what, value, "give a positive one");
            }
        }
        if let Some(cushion) = self.paddle.cushion() {
            for (what, value) in [
                ("thickness of the foam (mm)", cushion.thickness_mm),
                ("modulus of the foam (kPa)", cushion.young_kpa),
            ] {
                if !(value > 0.0 && value.is_finite()) {
                    return refuse(what, value, "give a positive one");
                }
            }
        }
        for shape in [self.outline.plate, self.outline.window].into_iter().flatten() {
            let [corner, half] = [shape.corner_mm, shape.half[0].min(shape.half[1])];
            if !(corner <= half && half.is_finite() && shape.middle.iter().all(|x| x.is_finite())) {
                return refuse("corner of an outline (mm)", corner, "give one that fits into it");
            }
        }
        let sharp = self.outline.plate.map_or(self.radius_mm, |plate| plate.corner_mm);
        if !(sharp >= self.radius_mm) {
            let remedy = "give one that is not below the radius of the edges";
            return refuse("corner of the paddle (mm)", sharp, remedy);
        }
        let limits = closing.stops.named();
        if limits.iter().all(|(_, limit)| limit.is_none()) {
            return refuse("number of stop rules", 0.0, "give one");
        }
        for (what, limit) in limits {
            let limit = limit.unwrap_or(1.0);
            if !(limit > 0.0 && limit.is_finite()) {
                return refuse(what, limit, "give a positive one");
            }
        }
        if let Some(hinge) = self.paddle.hinge() {
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
        if !(closing.lift_mm >= 0.0 && closing.lift_mm.is_finite()) {
            return refuse(
                "lift of the receptor (mm)",
                closing.lift_mm,
                "give one that is not negative",
            );
        }
        if !closing.receptor_mm.is_finite() || !(0.0..=1.0).contains(&closing.receptor_share) {
            let share = closing.receptor_share;
            return refuse("share of the receptor", share, "give a place, and a share from 0 to 1");
        }
        Ok(())
    }
}

/// Smallest part of the step that is tried under a paddle that gives way.
const SMALLEST_STEP: f64 = 0.25;

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
        receptor_mm: closing.receptor_at_mm(thickness_mm),
        thickness_mm,
        tilt_rad: 0.0,
        pose: AT_REST,
    };
    let (newton, state) = solve::prepare(&model, start, at(closing.thickness_mm))?;
    for (plate, &index) in [&receptor, &paddle].into_iter().zip(&indices) {
        apart(plate, &state.at(index)).map_err(refuse)?;
    }
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
        yielding: None,
    };
    let mut state = state;
    press.walk(&mut state, at(closing.thickness_mm))?;
    let mut steps: Vec<Step> = vec![press.record(&state)];
    let stops = &closing.stops;
    let goal = stops.thinnest_mm();
    let reached = stops.thickness_mm.is_some_and(|goal| state.load.thickness_mm <= goal);
    let mut met = reached.then_some(StopRule::Thickness);
    // Weight or a start between the plates may reach a limit before they close: there is no state before it.
    let mut stopped_early: Option<StoppedEarly> = None;
    if let Some((rule, share)) = stops.nearest(&steps[0]).filter(|_| !reached) {
        if meet::is_met(share) {
            met = Some(rule);
        } else if share > 1.0 {
            let thickness_mm = closing.thickness_mm;
            stopped_early = Some(StoppedEarly::Beyond { thickness_mm, share });
        }
    }
    let even_mm = closing.even_step_mm();
    let mut step_mm = even_mm;
    while met.is_none() && stopped_early.is_none() && state.load.thickness_mm > goal {
        let thickness = match state.load.thickness_mm - step_mm {
            // What rounding leaves is no step.
            next if next < goal + 1e-6 * step_mm => goal,
            next => next,
        };
        let before = state.clone();
        let failed = press.walk(&mut state, at(thickness)).err();
        if failed.is_some() && plates.paddle.gives_way() {
            // What was reached on the way is not in balance with the paddle.
            state = before.clone();
            press.forget();
            if step_mm > SMALLEST_STEP * even_mm {
                step_mm *= 0.5;
                continue;
            }
        }
        if failed.is_some() && state.load.thickness_mm == before.load.thickness_mm {
            stopped_early = failed.map(Into::into);
            break;
        }
        let course: Vec<[f64; 2]> = steps.iter().map(Step::place).collect();
        let mut step = press.record_after(&course, &state);
        if let (true, Some(last)) = (stops.share(&step) >= 1.0, steps.last()) {
            state = match press.meet(stops, &course, [(&before, last), (&state, &step)], &at) {
                Met::Limit(found) => {
                    step = press.record_after(&course, &found);
                    met = stops.nearest(&step).map(|(rule, _)| rule);
                    found
                }
                Met::Leap([low, high]) => {
                    stopped_early = Some(StoppedEarly::Leap {
                        thickness_mm: [low.thickness_mm, high.thickness_mm],
                        force_mn: [low.force_mn, high.force_mn],
                        share: [low.share, high.share],
                    });
                    step = press.record_after(&course, &low.state);
                    low.state
                }
            };
        } else if stops.thickness_mm.is_some() && state.load.thickness_mm <= goal {
            met = Some(StopRule::Thickness);
        } else if let Some(error) = failed {
            stopped_early = Some(error.into());
        } else if state.load.thickness_mm <= goal {
            let (thickness_mm, share) = (goal, stops.share(&step));
            stopped_early = Some(StoppedEarly::Thinnest { thickness_mm, share });
        }
        progress.report(
            fraction(closing, &step, goal),
            &format!("{:.1} mm, {:.1} N", step.thickness_mm, step.paddle_force_mn / 1000.0),
        );
        // A search that ends where it began has no new state.
        if state.load.thickness_mm < before.load.thickness_mm {
            step.moved_mm = steps.last().map_or(0.0, |last| largest_motion(last, &step));
            steps.push(step);
        }
    }
    let solution = solve::finish(&press.newton, &press.model, &state, press.counts)?;
    Ok(Compressed { steps, solution, met, stopped_early })
}

/// # Errors
/// A plate in which skin lies beyond the middle between the plates. Less is no fault: a curved paddle begins
/// beside the breast's middle a few millimetres in it.
fn apart(plate: &Plate, at: &At) -> Result<(), ModelError> {
    let check = plate.contact(at).unwrap_or_default();
    let (depth_mm, thickness_mm) = (check.penetration_mm, at.load.thickness_mm);
    if depth_mm <= 0.5 * thickness_mm {
        return Ok(());
    }
    let node = plate.nodes(check.worst_open)[0];
    Err(ModelError::Overlap { term: plate.name().into(), node, depth_mm, thickness_mm })
}

/// Largest motion (mm) of a node between two states.
fn largest_motion(before: &Step, after: &Step) -> f64 {
    let motions = before.points.iter().zip(&after.points).map(|(a, b)| (b - a).norm());
    motions.fold(0.0, f64::max)
}

fn fraction(closing: &Closing, step: &Step, goal: f64) -> f64 {
    let closed = (closing.thickness_mm - step.thickness_mm) / (closing.thickness_mm - goal);
    f64::max(closed, closing.stops.share(step)).clamp(0.0, 1.0)
}
