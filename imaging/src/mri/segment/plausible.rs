//! Whether the wall that was found can be one: a contrast that the method does not know yields a surface, too.

use super::body::median;
use super::limits::BodyLimits;
use super::shading::Shaded;
use super::wall::Wall;
use mammotwin_data::labels::{LabelMap, Tissue};

/// Half width (rad) of the front of the chest that is looked at.
pub(super) const FRONT: f64 = 60.0 * std::f64::consts::PI / 180.0;
/// Behind less tissue than this (mm) lies hardly any fat.
const THICK_MM: f32 = 14.0;
/// Depth (mm) under the surface at which fat is looked at: behind the skin.
const UNDER_SKIN_MM: f32 = 9.0;
/// Brightness of what lies just before the wall over that of what lies under the skin: both are fat.
const ALIKE: [f64; 2] = [0.7, 1.25];
/// The rear of the muscle shows on this part of the wall at least: on 0.24 and more of sound ones (real and drawn),
/// on 0.17 and less of those with suppressed fat (three of other people; two more 0.05, drawn ones 0.09).
const REAR_SEEN: f64 = 0.2;

/// Whether fat lies just before the wall, and muscle with fat or ribs behind it.
///
/// Where fat is suppressed, the step from muscle to lung looks like one from fat to muscle. Then what lies before
/// it is muscle, brighter than the fat under the skin; and lung behind it has no rear that gets brighter.
pub(super) fn muscle_behind_fat(wall: &Wall, shaded: &Shaded) -> bool {
    let ratio = |column: usize| {
        let thick = wall.surface[column] - wall.front[column];
        let from_front = (wall.polar.angle(column) - std::f64::consts::FRAC_PI_2).abs();
        if thick < THICK_MM || from_front > FRONT {
            return None;
        }
        // Nothing where a part of it lies outside of the image.
        let sum = |from: f32| {
            let at = (0..5).map(|n| f64::from(from + 0.5 * n as f32));
            at.map(|radius| shaded.at(&wall.polar.point(column, radius)).map(f64::from)).sum()
        };
        let inner: Option<f64> = sum(wall.front[column] + 2.0);
        let outer: Option<f64> = sum(wall.surface[column] - UNDER_SKIN_MM);
        inner.zip(outer).filter(|(_, outer)| *outer > 0.0).map(|(inner, outer)| inner / outer)
    };
    let mut ratios: Vec<f64> = (0..wall.polar.len()).filter_map(ratio).collect();
    // Without enough tissue in front of the wall this says nothing.
    let found = median(&mut ratios).unwrap_or(1.0);
    (ALIKE[0]..=ALIKE[1]).contains(&found) && wall.rear.seen >= REAR_SEEN
}

/// One breast is at most so many times as large as the other, where the contrast is less sure.
const LARGER: f64 = 2.5;

/// Whether both breasts are there and of about one size.
pub(super) fn both_breasts(labels: &LabelMap) -> bool {
    let count = |tissues: [Tissue; 2]| {
        labels.values.iter().filter(|tissue| tissues.contains(tissue)).count() as f64
    };
    let right = count([Tissue::AdiposeRight, Tissue::FibroglandularRight]);
    let left = count([Tissue::AdiposeLeft, Tissue::FibroglandularLeft]);
    right > 0.0 && left > 0.0 && (right / left).ln().abs() < LARGER.ln()
}

/// The plane of the mid-axillary lines lies at most so far (mm) behind the axis: farther back it is drawn by a wall
/// that the image does not show.
const BEHIND_AXIS_MM: f64 = 50.0;

/// Whether the lateral plane lies in the part of the chest that the map of the wall covers.
pub(super) fn mid_axillary(wall: &Wall, limits: &BodyLimits) -> bool {
    limits.lateral_y > wall.polar.axis[1] - BEHIND_AXIS_MM
}
