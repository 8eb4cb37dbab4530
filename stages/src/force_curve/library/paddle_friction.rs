//! Skin that rubs on the plates.

use super::CurveEffect;

/// Largest coefficient of friction between skin and plastic.
const LARGEST: f64 = 0.6;

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "paddle_friction",
    title: "friction between skin and plates",
    place: "skin under both plates",
    meaning: "coefficient of friction above the study's",
    unit: "1",
    sentence: "The skin does not glide on the plates: it is held where they touch it.",
    signature: "more force throughout; the breast is squeezed outwards a little more",
    confused_with: &["rate_stiffening", "paddle_offset"],
    separated_by: "unloading, on which friction changes its sign; talc on the plates",
    keys: "compress.friction",
    scaling: 0,
    range: |plan| (plan.friction < LARGEST).then_some([-plan.friction, LARGEST - plan.friction]),
    apply: |plan, amplitude| plan.friction = (plan.friction + amplitude).max(0.0),
};
