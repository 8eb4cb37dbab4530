//! Skin of the lower pole stiffer or softer than that of the upper pole.

use super::{Amplitude, Effect};

/// Width of the transition between the poles, in half axes of the base.
const TRANSITION: f64 = 0.3;

pub(super) const EFFECT: Effect = Effect {
    name: "skin_region",
    title: "regional stiffness of the skin",
    place: "skin of the lower against the upper pole",
    amplitude: Amplitude {
        meaning: "logarithm of the lower pole's stiffness over the study's, the upper pole's inverse",
        unit: "1",
        range: [-1.6, 1.6],
        small: 0.1,
    },
    sentence: "The skin is not equally stiff everywhere: lower and upper pole differ.",
    signature: "a dipole of the normal residual between the poles",
    confused_with: &["cranial_ligament", "gland_inclusion"],
    separated_by: "skin thickness from the images; an upright pose",
    apply: |recipe, amplitude, scene| {
        for sheet in &mut recipe.skin {
            let Some((base, radius)) = scene.anatomy.nearest(&sheet.center) else { continue };
            let [_, cranial] = base.elliptic(&sheet.center);
            let here = if radius < 1.3 { -(cranial / TRANSITION).tanh() } else { 0.0 };
            sheet.tissue.young_kpa *= (amplitude * here).exp();
        }
    },
};
