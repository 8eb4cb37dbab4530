//! A paddle that bends.

use super::CurveEffect;
use mammotwin_data::study::{CompressPlan, PaddleName};

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "paddle_elastic",
    title: "a paddle that bends",
    place: "plate of the paddle",
    meaning: "compliance of the plate over that of the thesis' one, beyond the study's",
    unit: "1",
    sentence: "The paddle bends: between its frame and the skin there is more room than the unit shows.",
    signature: "forces at small thicknesses stay behind, without a tilt",
    confused_with: &["paddle_hinge", "limit_chain"],
    separated_by: "the tilt of the paddle; its deflection on a rigid block at two forces",
    keys: "compress.paddle, compress.plate",
    scaling: 1,
    range: |plan| {
        matches!(plan.paddle, PaddleName::Rigid | PaddleName::Elastic).then_some([0.0, 3.0])
    },
    apply,
};

fn apply(plan: &mut CompressPlan, amplitude: f64) {
    let own = if plan.paddle == PaddleName::Elastic { 1.0 } else { 0.0 };
    let mut plate = plan.plate.unwrap_or_default();
    plate.young_mpa /= own + amplitude;
    (plan.paddle, plan.plate) = (PaddleName::Elastic, Some(plate));
}
