//! Fibroglandular tissue stiffer than fat.

use super::{Amplitude, Effect};

/// Elliptic radius within which the gland lies behind the nipple, and the width of its border.
const RADIUS: f64 = 0.55;
const BORDER: f64 = 0.1;

pub(super) const EFFECT: Effect = Effect {
    name: "gland_inclusion",
    title: "stiff fibroglandular tissue",
    place: "behind the nipple, within about half the radius of the base",
    amplitude: Amplitude {
        meaning: "logarithm of the gland's modulus over the fat's",
        unit: "1",
        range: [-1.0, 2.5],
        small: 0.1,
    },
    sentence: "A core behind the nipple is stiffer than the fat around it and moves less.",
    signature: "less motion in front of the gland in all poses",
    confused_with: &["skin_region", "compressible"],
    separated_by: "landmarks inside of the breast",
    apply: |recipe, amplitude, scene| {
        for (tissue, tet) in recipe.tissue.iter_mut().zip(&scene.mesh.tets) {
            let center =
                tet.iter().map(|&n| scene.mesh.points[n as usize]).sum::<super::Vec3>() / 4.0;
            let Some((_, radius)) = scene.anatomy.nearest(&center) else { continue };
            let inside = 0.5 * (1.0 + ((RADIUS - radius) / BORDER).tanh());
            tissue.young_kpa *= (amplitude * inside).exp();
        }
    },
};
