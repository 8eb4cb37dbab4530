//! Tissue that has not come to rest yet when a pose is scanned.

use super::{Amplitude, Effect, on_the_front};

pub(super) const EFFECT: Effect = Effect {
    name: "viscosity",
    title: "creep of the tissue after lying down",
    place: "all tissue, in the prone pose",
    amplitude: Amplitude {
        meaning: "how much stiffer all tissue is in the prone pose than in the others, over its stiffness",
        unit: "1",
        range: [-0.3, 1.0],
        small: 0.03,
    },
    sentence: "In the prone pose the tissue hangs less far than in the others it would: it still crept when it was scanned.",
    signature: "in the prone pose alone, less of the whole deformation",
    confused_with: &["limit_chain", "pectoral_shift"],
    separated_by: "two scans of one pose, minutes apart; the order of the scans turned round",
    apply: |recipe, amplitude, _| {
        if on_the_front(recipe) {
            let sheets = recipe.skin.iter_mut().chain(&mut recipe.fascia);
            let tissue = recipe.tissue.iter_mut().chain(sheets.map(|sheet| &mut sheet.tissue));
            tissue.for_each(|tissue| tissue.young_kpa *= 1.0 + amplitude);
        }
    },
};
