//! A paddle that tilts on a hinge.

use super::CurveEffect;
use mammotwin_data::study::{CompressPlan, PaddleName};

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "paddle_hinge",
    title: "a paddle that tilts (flex)",
    place: "hinge of the paddle",
    meaning: "compliance of the hinge over that of the assumed one, beyond the study's",
    unit: "1",
    sentence: "The paddle gives way on its hinge: it tilts towards the nipple as the force grows.",
    signature: "forces at small thicknesses stay behind; the paddle tilts",
    confused_with: &["paddle_elastic", "limit_chain"],
    separated_by: "the tilt of the paddle, with an inclinometer",
    keys: "compress.paddle, compress.hinge",
    scaling: 1,
    range: |plan| matches!(plan.paddle, PaddleName::Rigid | PaddleName::Flex).then_some([0.0, 3.0]),
    apply,
};

/// Angles grow in proportion at equal torque: the torques of both terms shrink.
fn apply(plan: &mut CompressPlan, amplitude: f64) {
    let own = if plan.paddle == PaddleName::Flex { 1.0 } else { 0.0 };
    let softer = own + amplitude;
    let mut hinge = plan.hinge.clone().unwrap_or_default();
    hinge.linear_n_mm_per_rad /= softer;
    hinge.quadratic_n_mm_per_rad2 /= softer;
    (plan.paddle, plan.hinge) = (PaddleName::Flex, Some(hinge));
}
