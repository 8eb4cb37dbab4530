//! Lateral ligaments stiffer than the study says.

use super::{Amplitude, Effect, stiffen};
use crate::model::Ligament;

pub(super) const EFFECT: Effect = Effect {
    name: "lateral_ligament",
    title: "lateral suspensory ligaments",
    place: "lateral rim of both breasts",
    amplitude: Amplitude {
        meaning: "added stiffness over the study's",
        unit: "1",
        range: [-1.0, 20.0],
        small: 0.5,
    },
    sentence: "The lateral rim is held more firmly than the model has it: the breast falls less to \
               the middle.",
    signature: "lateral deficit in tilted poses, antisymmetric between the breasts",
    confused_with: &["fascia_limit"],
    separated_by: "a pose tilted to the other side",
    apply: |recipe, amplitude, _| stiffen(recipe, Ligament::Lateral, 1.0 + amplitude),
};
