//! A part of the interface to the muscle that sticks.

use super::{Amplitude, Effect};
use mammotwin_data::study::{InterfaceRegion, RegionPlan};

pub(super) const EFFECT: Effect = Effect {
    name: "bond_region",
    title: "a part of the breast's base that sticks to the muscle",
    place: "upper rim of the base of both breasts",
    amplitude: Amplitude {
        meaning: "coefficient of friction above the study's, there",
        unit: "1",
        range: [0.0, 1.0],
        small: 0.1,
    },
    sentence: "The breast sticks to the muscle along its upper rim.",
    signature: "a residual confined to the upper rim; less motion sideways in the tilted pose",
    confused_with: &["friction", "cranial_ligament"],
    separated_by: "landmarks near the base",
    apply: |recipe, amplitude, _| {
        let region = InterfaceRegion::Cranial;
        let plan = recipe.interface.of(Some(region));
        if plan.kind.has_friction() {
            let friction = Some(plan.coefficient() + amplitude);
            recipe.interface.regions.insert(region, RegionPlan { friction, ..plan });
        }
    },
};
