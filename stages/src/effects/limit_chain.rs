//! Breast tissue whose chains reach a limit of stretch.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "limit_chain",
    title: "limited chain extensibility of the breast tissue (Gent)",
    place: "fat and gland of both breasts",
    amplitude: Amplitude {
        meaning: "1/Jₘ of the breast",
        unit: "1",
        range: [0.0, 1.2],
        small: 0.05,
    },
    sentence: "The breast tissue stiffens when it is stretched far: the measured breast hangs less \
               than its softness in the less stretched poses foretells.",
    signature: "grows with the stretch: little in the supine pose, strong in the pose that hangs most",
    confused_with: &["fascia_limit", "skin_thickness"],
    separated_by: "an upright pose; compression at two thicknesses",
    apply: |recipe, amplitude, _| {
        recipe.tissue.iter_mut().for_each(|tissue| tissue.limit_stretch(amplitude));
    },
};
