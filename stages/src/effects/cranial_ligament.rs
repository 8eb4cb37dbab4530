//! Cranial ligaments stiffer than the study says.

use super::{Amplitude, Effect, stiffen};
use crate::model::Ligament;

pub(super) const EFFECT: Effect = Effect {
    name: "cranial_ligament",
    title: "cranial suspensory ligaments",
    place: "upper rim of both breasts",
    amplitude: Amplitude {
        meaning: "added stiffness over the study's",
        unit: "1",
        range: [-1.0, 20.0],
        small: 0.5,
    },
    sentence: "The upper rim is held more firmly than the model has it: the upper pole stays where \
               the model lets it come down.",
    signature: "the upper pole too low when upright: a crest above, a bulge below",
    confused_with: &["skin_region"],
    separated_by: "an upright pose",
    apply: |recipe, amplitude, _| stiffen(recipe, Ligament::Cranial, 1.0 + amplitude),
};
