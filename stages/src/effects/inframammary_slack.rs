//! Inframammary ligaments that are not taut at rest.

use super::{Amplitude, Effect};
use crate::model::Ligament;

pub(super) const EFFECT: Effect = Effect {
    name: "inframammary_slack",
    title: "slack inframammary ligaments",
    place: "inframammary fold of both breasts",
    amplitude: Amplitude { meaning: "slack at rest", unit: "mm", range: [0.0, 10.0], small: 0.5 },
    sentence: "The ligaments of the inframammary fold are slack at rest: the lower rim moves before \
               it is held.",
    signature: "the lower rim too far from the fold in poses that pull it up",
    confused_with: &["skin_region"],
    separated_by: "an upright pose",
    apply: |recipe, amplitude, _| {
        recipe.tethers_of(Ligament::Inframammary).for_each(|tether| tether.slack_mm += amplitude);
    },
};
