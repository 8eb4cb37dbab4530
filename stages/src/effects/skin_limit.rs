//! Skin and fascia whose fibres reach a limit of stretch.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "skin_limit",
    title: "limited extensibility of skin and fascia (Gent)",
    place: "skin of the whole body and the deep layer of the superficial fascia",
    amplitude: Amplitude {
        meaning: "1/Jₘ of skin and fascia",
        unit: "1",
        range: [0.0, 4.0],
        small: 0.2,
    },
    sentence: "Skin and fascia stiffen when they are stretched far: the measured breast hangs less \
               than its shape in the less stretched poses foretells.",
    signature: "grows with the stretch of the skin: strong where the breast hangs, nothing supine",
    confused_with: &["limit_chain", "skin_thickness", "fascia_limit"],
    separated_by: "suction on the skin at two depths; an upright pose",
    apply: |recipe, amplitude, _| {
        let sheets = recipe.skin.iter_mut().chain(&mut recipe.fascia);
        sheets.for_each(|sheet| sheet.tissue.limit_stretch(amplitude));
    },
};
