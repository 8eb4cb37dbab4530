//! A chest wall that is not where the reference pose has it.

use super::{Amplitude, Effect, on_the_front};

pub(super) const EFFECT: Effect = Effect {
    name: "pectoral_shift",
    title: "muscle that moved in the prone pose",
    place: "chest wall behind the breasts, in the prone pose; bonded interfaces alone",
    amplitude: Amplitude {
        meaning: "how far the pectoral muscle stands out beyond that of the reference pose behind the middle of the breasts",
        unit: "mm",
        range: [-10.0, 10.0],
        small: 0.5,
    },
    sentence: "In the prone pose the muscle behind the breasts is not where the reference pose has it, and the skin moved with it.",
    signature: "in the prone pose alone, base and skin move together",
    confused_with: &["viscosity", "gravity_dir"],
    separated_by: "the segmented muscle of that pose",
    apply: |recipe, amplitude, _| {
        if on_the_front(recipe) {
            recipe.wall_shift_mm += amplitude;
        }
    },
};
