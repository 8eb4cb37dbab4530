//! A paddle whose edge is not where the study has it.

use super::CurveEffect;

/// How far (mm) plates are placed off at most.
const FARTHEST_MM: f64 = 12.0;

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "paddle_offset",
    title: "another distance of the paddle from the chest wall",
    place: "chest-wall edge of both plates",
    meaning: "distance from the chest wall above the study's",
    unit: "mm",
    sentence: "The paddle's edge lay farther from or nearer to the chest wall than the study says.",
    signature: "scales forces, most at their beginning, and moves the edge of the image by as much",
    confused_with: &["limit_chain", "rate_stiffening"],
    separated_by: "the edge of the image; six points of the curve or more",
    keys: "compress.chest_wall_distance_mm",
    scaling: 0,
    range: |plan| Some([-FARTHEST_MM.min(plan.chest_wall_distance_mm), FARTHEST_MM]),
    apply: |plan, amplitude| plan.chest_wall_distance_mm += amplitude,
};
