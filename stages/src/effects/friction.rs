//! Friction between breast and muscle.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "friction",
    title: "friction of the breast on the muscle",
    place: "between breast and pectoral muscle, where it slides",
    amplitude: Amplitude {
        meaning: "coefficient of friction above the study's",
        unit: "1",
        range: [0.0, 0.5],
        small: 0.05,
    },
    sentence: "The breast does not slide freely on the muscle: friction holds it back.",
    signature: "less sideways motion where the breast is pressed on; its sign depends on the way there",
    confused_with: &["fascia_limit", "bond_region"],
    separated_by: "two ways to one pose; landmarks near the base",
    apply: |recipe, amplitude, _| {
        let plan = &mut recipe.interface;
        let more = |plan: mammotwin_data::study::RegionPlan| plan.coefficient() + amplitude;
        let outside = more(plan.of(None));
        plan.regions.values_mut().for_each(|region| region.friction = Some(more(*region)));
        plan.friction = Some(outside);
    },
};
