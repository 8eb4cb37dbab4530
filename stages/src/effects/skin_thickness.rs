//! Skin thicker or thinner than the study says; only thickness times modulus shows.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "skin_thickness",
    title: "thickness (or stiffness) of the skin",
    place: "skin of the whole body",
    amplitude: Amplitude {
        meaning: "logarithm of thickness times modulus over the study's",
        unit: "1",
        range: [-1.6, 1.6],
        small: 0.1,
    },
    sentence: "The skin carries more or less than its thickness and modulus in the study; the two \
               cannot be told apart from shapes.",
    signature: "rounder (stiffer) or more pointed (softer) hanging shape at the same sag",
    confused_with: &["limit_chain", "density"],
    separated_by: "skin thickness from the images; suction on the skin",
    apply: |recipe, amplitude, _| {
        recipe.skin.iter_mut().for_each(|sheet| sheet.thickness_mm *= amplitude.exp());
    },
};
