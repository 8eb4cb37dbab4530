//! Breast tissue that changes its volume.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "compressible",
    title: "compressible breast tissue",
    place: "fat and gland of both breasts",
    amplitude: Amplitude {
        meaning: "how much Poisson's ratio is below the study's",
        unit: "1",
        range: [0.0, 0.14],
        small: 0.01,
    },
    sentence: "The tissue changes its volume between poses more than a nearly incompressible one \
               does.",
    signature: "the mean of the normal residual: the volume differs between poses",
    confused_with: &["gland_inclusion", "limit_chain"],
    separated_by: "the segmented volume of each pose",
    apply: |recipe, amplitude, _| {
        recipe.tissue.iter_mut().for_each(|tissue| tissue.poisson -= amplitude);
    },
};
