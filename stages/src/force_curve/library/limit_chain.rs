//! Tissue whose chains reach a limit of stretch in compression.

use super::CurveEffect;
use mammotwin_data::study::{CompressPlan, LawName};

/// How much 1/Jₘ may grow: from Jₘ of 2 to 1.25.
const MOST: f64 = 0.3;
/// The same of neo-Hookean tissue.
const MOST_OF_NONE: f64 = 1.2;
/// Smallest 1/Jₘ; zero would be no Gent law.
const LEAST: f64 = 1e-3;

pub(super) const EFFECT: CurveEffect = CurveEffect {
    name: "limit_chain",
    title: "limited chain extensibility in compression (Gent)",
    place: "breast, skin and fascia",
    meaning: "1/Jₘ above the study's",
    unit: "1",
    sentence: "The tissue reaches its limit of stretch at another compression than the study says.",
    signature: "the curve turns up at its end, with the same beginning",
    confused_with: &["paddle_offset", "paddle_elastic", "paddle_hinge"],
    separated_by: "smaller thicknesses; the tilt and the deflection of the paddle",
    keys: "compress.law",
    scaling: 0,
    range: |plan| match (plan.law.name, plan.law.jm) {
        (LawName::NeoHookean, _) => Some([0.0, MOST_OF_NONE]),
        (LawName::Gent, Some(jm)) => Some([LEAST - jm.recip(), MOST]),
        _ => None,
    },
    apply,
};

fn apply(plan: &mut CompressPlan, amplitude: f64) {
    let own = match plan.law.name {
        LawName::Gent => plan.law.jm.map_or(0.0, f64::recip),
        _ => 0.0,
    };
    let inverse = (own + amplitude).max(LEAST);
    (plan.law.name, plan.law.jm) = (LawName::Gent, Some(inverse.recip()));
}
