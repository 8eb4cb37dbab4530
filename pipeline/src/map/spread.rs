//! How sure a carried place is: moduli, model, registration.

use super::Body;
use mammotwin_data::{Vec3, labels::Side};
use mammotwin_stages::{
    place::{Places, Shape},
    pose::PoseFit,
    register::Registered,
    results::DRAWS,
    stiffer::raised,
};
use serde::Serialize;

/// Markers this near (mm) to a place in the pose that they come from may be the place itself.
const SAME_MM: f64 = 10.0;
/// A distance to a surface is one of three components of an error.
const DIRECTIONS: f64 = 3.0;

/// One standard deviation of a place: root mean square lengths (mm).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// What the moduli leave open; absent when it was not asked for or nothing was fitted.
    pub moduli_mm: Option<f64>,
    /// What the model is off in this pose and that of the question: by the distances of the skin or, if that is
    /// more, by the markers.
    pub model_mm: f64,
    /// What other markers of this breast are off that were carried the same way; absent without such.
    pub markers_mm: Option<f64>,
    /// What both registrations are off.
    pub registration_mm: f64,
    /// How far outside of the tissue the point was.
    pub outside_mm: f64,
    /// All of them.
    pub total_mm: f64,
}

/// Errors of places that come from one shape.
pub(super) struct Errors<'a> {
    pub body: &'a Body,
    pub from: &'a Shape,
    pub side: Side,
    pub places: &'a Places,
}

/// A landmark of the skin, carried from one pose to another that has it, too.
pub(super) struct Marker {
    pub from: String,
    pub to: String,
    pub side: Side,
    /// Where it is in the pose that it comes from (mm, frame of the reference pose).
    pub at: Vec3,
    /// How far (mm) it lands from where it is.
    pub off_mm: f64,
}

impl Errors<'_> {
    /// Of a place (mm, frame of the reference pose or of the detector), which stiffer breasts bring elsewhere.
    pub fn of(&self, to: &Shape, place: &Vec3, stiffer: Option<Vec3>) -> Spread {
        if to == self.from {
            // It is given there.
            let outside_mm = self.places.outside_mm;
            return Spread { outside_mm, total_mm: outside_mm, ..Spread::default() };
        }
        let moduli_mm = stiffer.and_then(|moved| self.moduli_mm((moved - place).norm()));
        let skin = |shape: &Shape| skin_mm(self.body, shape, self.side);
        let markers_mm = self.markers_mm(to);
        let model_mm = (DIRECTIONS.sqrt() * skin(self.from).hypot(skin(to)))
            .max(markers_mm.unwrap_or_default());
        let registration_mm = registration_mm(self.body, self.from, place)
            .hypot(registration_mm(self.body, to, place));
        let outside_mm = self.places.outside_mm;
        let parts = [moduli_mm.unwrap_or_default(), model_mm, registration_mm, outside_mm];
        let total_mm = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
        Spread { moduli_mm, model_mm, markers_mm, registration_mm, outside_mm, total_mm }
    }

    /// Root mean square error (mm) of the markers of this breast that are carried from the pose of the question to
    /// this one, without those that may be the place itself; from and to a compressed breast, of all pairs of poses.
    fn markers_mm(&self, to: &Shape) -> Option<f64> {
        let is = |shape: &Shape, name: &str| match shape {
            Shape::Pose(pose) => pose == name,
            Shape::Pressed => true,
            Shape::Free => false,
        };
        let other = |marker: &&Marker| {
            let here = self.places.poses.get(&marker.from);
            here.is_none_or(|here| (here - marker.at).norm() > SAME_MM)
        };
        let alike = self.body.markers.iter().filter(|marker| {
            marker.side == self.side && is(self.from, &marker.from) && is(to, &marker.to)
        });
        let squares: Vec<f64> =
            alike.filter(other).map(|marker| marker.off_mm * marker.off_mm).collect();
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        (!squares.is_empty()).then(|| mean.sqrt())
    }

    /// Standard deviation (mm) over the draws of the moduli, of what one deviation moves by `moved_mm`; `None`
    /// where the modulus of this side was not fitted.
    fn moduli_mm(&self, moved_mm: f64) -> Option<f64> {
        let calibration = &self.body.calibration;
        let (best, high) = (calibration.after.moduli, raised(calibration));
        let [best, high] = [best, high].map(|moduli| moduli.of_side(self.side));
        calibration.precision.of_side(self.side)?;
        let draws = calibration.precision.draws(calibration.after.moduli, DRAWS);
        let logs: Vec<f64> =
            draws.iter().map(|draw| (draw.of_side(self.side) / best).ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len().max(1) as f64;
        let squares = logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>();
        let deviation = (squares / logs.len().saturating_sub(1).max(1) as f64).sqrt();
        Some(deviation * moved_mm / (high / best).ln())
    }
}

/// Root mean square distance (mm) of the simulated from the measured skin of one breast in a pose.
fn rms_mm(body: &Body, fit: &PoseFit, side: Side) -> f64 {
    let here = |node: &u32| {
        let nearest = body.mesh.anatomy.nearest(&body.mesh.mesh.points[*node as usize]);
        nearest.is_some_and(|(base, _)| base.side == side)
    };
    let own = fit.active.iter().zip(&fit.signed_mm).filter(|(node, _)| here(node));
    let squares: Vec<f64> = own.map(|(_, mm)| mm * mm).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// What the skin is off in a shape (mm): measured in poses; nothing is measured of the stress-free shape; a
/// compressed breast is taken for as wrong as the worst held-out pose or, without one, the worst pose.
fn skin_mm(body: &Body, shape: &Shape, side: Side) -> f64 {
    let rms_mm = |fit: &PoseFit| rms_mm(body, fit, side);
    match shape {
        Shape::Free => 0.0,
        Shape::Pose(name) => body.fits.get(name).map_or(0.0, rms_mm),
        Shape::Pressed => {
            let largest =
                |of: &mut dyn Iterator<Item = &PoseFit>| of.map(rms_mm).fold(0.0, f64::max);
            match body.held_out.is_empty() {
                true => largest(&mut body.fits.values()),
                false => largest(&mut body.held_out.iter().filter_map(|name| body.fits.get(name))),
            }
        }
    }
}

/// What the registration of a pose is off at a place (mm); none for the reference pose and what is computed
/// in its frame.
fn registration_mm(body: &Body, shape: &Shape, place: &Vec3) -> f64 {
    let Shape::Pose(name) = shape else { return 0.0 };
    body.registered.get(name).map_or(0.0, |motion| motion_mm(motion, place))
}

/// One standard deviation of a motion at a place (mm), root mean square length.
fn motion_mm(registered: &Registered, place: &Vec3) -> f64 {
    let Some(image) = &registered.image else {
        return registered.start.landmark_rms_mm.unwrap_or_default();
    };
    let shift = Vec3::from(image.uncertainty.translation_mm).norm_squared();
    let arm = place - image.center;
    let turn = |axis: usize| {
        let across = arm.norm_squared() - arm[axis] * arm[axis];
        image.uncertainty.rotation_rad[axis].powi(2) * across
    };
    (shift + (0..3).map(turn).sum::<f64>()).sqrt()
}

/// What the columns of a spread rest on.
pub(super) fn sources(body: &Body) -> Vec<String> {
    let mut said = Vec::new();
    let [right, left] =
        [Side::Right, Side::Left].map(|side| body.calibration.precision.of_side(side));
    said.push(match (body.stiffer.is_some(), right.or(left)) {
        (true, Some(_)) => format!(
            "moduli: {DRAWS} draws of the calibration, along what one standard deviation (right {}, left {}) moves",
            percent(right),
            percent(left)
        ),
        (false, Some(_)) => "moduli: left out (--quick)".into(),
        (_, None) => "moduli: none was fitted; what they leave open is not known".into(),
    });
    let of = |(name, fit): (&String, &PoseFit)| {
        let held = if body.held_out.contains(name) { ", held out" } else { "" };
        let [right, left] = [Side::Right, Side::Left].map(|side| rms_mm(body, fit, side));
        format!("{name} right {right:.2}, left {left:.2} mm{held}")
    };
    said.push(format!(
        "model: distance of the simulated from the measured skin, root mean square ({}); times √3, since a distance \
         knows one direction of three and no sliding along the skin",
        body.fits.iter().map(of).collect::<Vec<_>>().join("; ")
    ));
    said.push(match body.markers.len() {
        0 => "markers: no landmark of the skin is in two poses; sliding along the skin is not in these numbers".into(),
        count => format!(
            "markers: landmarks of the skin in two poses, {count} ways; where those of this breast, the place itself left out, are \
             farther off than the skin, they count"
        ),
    });
    if body.compression.is_some() {
        let worst = match body.held_out.is_empty() {
            true => "pose; none was held out, so that this is too small",
            false => "held-out pose",
        };
        said.push(format!(
            "compressed: no image shows it; taken for as wrong as the worst {worst}. Published errors of lesions \
             between MRI and mammogram are 5 to 40 mm"
        ));
    }
    said.push("registration: its own standard deviation, of both poses".into());
    said.push(
        "stress_free: nothing is measured of it; only the pose of the question counts".into(),
    );
    said
}

fn percent(deviation: Option<f64>) -> String {
    deviation.map_or("not fitted".into(), |ln| format!("{:.1} %", 100.0 * ln))
}
