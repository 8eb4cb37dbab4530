//! Skin that is taut before any load.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "skin_prestress",
    title: "prestressed skin",
    place: "the skin of both breasts",
    amplitude: Amplitude {
        meaning: "stretch of the skin in the stress-free shape of the tissue, above 1",
        unit: "1",
        range: [0.0, 0.2],
        small: 0.01,
    },
    sentence: "The skin is taut before gravity pulls at the breast.",
    signature: "rounder and flatter breasts in all poses, most where the skin would be slack",
    confused_with: &["skin_thickness", "limit_chain"],
    separated_by: "a pose in which the skin is slack; excised skin shrinks by 10 - 30 %",
    apply: |recipe, amplitude, _| recipe.skin_stretch += amplitude,
};
