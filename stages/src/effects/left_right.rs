//! Skin of one side stiffer than that of the other.

use super::{Amplitude, Effect};
use mammotwin_data::labels::Side;

pub(super) const EFFECT: Effect = Effect {
    name: "left_right",
    title: "unlike skin of the two sides",
    place: "skin of the right against the left breast",
    amplitude: Amplitude {
        meaning: "logarithm of the right skin's stiffness over the study's, the left's inverse",
        unit: "1",
        range: [-1.6, 1.6],
        small: 0.1,
    },
    sentence: "The skin of one breast is stiffer than that of the other.",
    signature: "antisymmetric in all poses",
    confused_with: &["skin_region", "skin_thickness"],
    separated_by: "a pose tilted to the other side",
    apply: |recipe, amplitude, scene| {
        for sheet in &mut recipe.skin {
            let Some((base, radius)) = scene.anatomy.nearest(&sheet.center) else { continue };
            let sign = if base.side == Side::Right { 1.0 } else { -1.0 };
            let here = if radius < 1.3 { sign } else { 0.0 };
            sheet.tissue.young_kpa *= (amplitude * here).exp();
        }
    },
};
