//! Tissue heavier or lighter than the study says.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "density",
    title: "mass density",
    place: "all tissue",
    amplitude: Amplitude {
        meaning: "logarithm of the density over the study's",
        unit: "1",
        range: [-0.1, 0.1],
        small: 0.02,
    },
    sentence: "The tissue is heavier or lighter than assumed; under gravity alone that is nearly \
               the same as softer or stiffer.",
    signature: "nearly a common scale of all moduli; only a measured force tells it",
    confused_with: &["skin_thickness"],
    separated_by: "a measured force of compression",
    apply: |recipe, amplitude, _| recipe.density_g_per_cm3 *= amplitude.exp(),
};
