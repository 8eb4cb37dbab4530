//! A deep fascia that stiffens like a cable.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "fascia_limit",
    title: "cable-like stiffening of the deep fascia",
    place: "deep layer of the superficial fascia, on the rear of the breast",
    amplitude: Amplitude {
        meaning: "1/Jₘ of the fascia",
        unit: "1",
        range: [0.0, 50.0],
        small: 2.0,
    },
    sentence: "The deep fascia stiffens early and keeps the rear of the breast from sliding and \
               spreading.",
    signature: "a deficit of tangential motion near the base; nothing near the nipple",
    confused_with: &["limit_chain", "lateral_ligament"],
    separated_by: "landmarks deep in the breast; an upright pose",
    apply: |recipe, amplitude, _| {
        recipe.fascia.iter_mut().for_each(|sheet| sheet.tissue.limit_stretch(amplitude));
    },
};
