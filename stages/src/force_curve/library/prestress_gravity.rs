//! Weight that acts while the breast is compressed.

use super::CurveEffect;

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "prestress_gravity",
    title: "prestress of gravity in the compression",
    place: "the whole breast",
    meaning: "share of the weight of an upright person's breast beyond the study's",
    unit: "1",
    sentence: "The weight of the breast acts while it is compressed: it hangs from the chest wall onto the receptor.",
    signature: "less force of the paddle at large thicknesses, by up to the weight; little at small ones",
    confused_with: &["paddle_offset", "limit_chain"],
    separated_by: "the force of the receptor, which is larger by the weight",
    keys: "compress.gravity_share",
    scaling: -1,
    // One that hangs has its weight already.
    range: |plan| (!plan.prestress).then_some([-plan.gravity_share, 1.0 - plan.gravity_share]),
    apply: |plan, amplitude| plan.gravity_share = (plan.gravity_share + amplitude).clamp(0.0, 1.0),
};
