//! Tissue that is stiffer in a fast compression than under slow gravity.

use super::CurveEffect;

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "rate_stiffening",
    title: "tissue stiffer in a fast compression",
    place: "all tissues",
    meaning: "moduli over those of a slow load, less 1",
    unit: "1",
    sentence: "All tissues are stiffer in the fast compression than under slow gravity, by which they were calibrated.",
    signature: "all forces alike, beyond what the calibration leaves open",
    confused_with: &["paddle_offset", "paddle_friction", "limit_chain"],
    separated_by: "a slow and a fast compression; force while the thickness is held (relaxation)",
    keys: "compress.rate_stiffening",
    scaling: 0,
    // Creep of tissue implies about twice the stiffness.
    range: |plan| {
        let own = 1.0 + plan.rate_stiffening;
        Some([-0.3 * own, 1.5 * own])
    },
    apply: |plan, amplitude| plan.rate_stiffening += amplitude,
};
