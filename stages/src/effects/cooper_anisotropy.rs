//! Fibres that hold the breast from the chest wall to the skin.

use super::{Amplitude, Effect};

pub(super) const EFFECT: Effect = Effect {
    name: "cooper_anisotropy",
    title: "Cooper's ligaments as fibres in the tissue",
    place: "both breasts, from the chest wall to the skin",
    amplitude: Amplitude {
        meaning: "Young's modulus of taut fibres over the breast's",
        unit: "1",
        range: [0.0, 3.0],
        small: 0.05,
    },
    sentence: "Stretched away from the chest wall the breast is stiffer than across: Cooper's ligaments pull, and do not push.",
    signature: "less of the stretch where the breast hangs from its base, nothing where it lies on it",
    confused_with: &["limit_chain", "viscosity"],
    separated_by: "an upright pose; landmarks inside of the breast",
    apply: |recipe, amplitude, _| {
        let count = recipe.tissue.len().max(1) as f64;
        let mean_kpa = recipe.tissue.iter().map(|tissue| tissue.young_kpa).sum::<f64>() / count;
        recipe.fibres_kpa += amplitude * mean_kpa;
    },
};
