//! Every law, with constants that make it differ from the others.

use mammotwin_data::study::{LawConstants, LawName, OgdenTerms};
use mammotwin_solver::materials::Law;
use mammotwin_solver::materials::gent_coupled::GentCoupled;

/// Every law of a Young's modulus (kPa) and Poisson's ratio, with its name.
pub fn every(young_kpa: f64, poisson: f64) -> Vec<(&'static str, Law)> {
    let none = LawConstants::default();
    let terms = OgdenTerms::try_from(vec![[0.5, 3.0], [0.5, -1.0]]).unwrap();
    let law = |name, jm, constants: LawConstants| {
        Law::with_constants(name, young_kpa, poisson, jm, &constants).unwrap()
    };
    let coupled = Law::neo_hookean_coupled(young_kpa, poisson).unwrap();
    let shear_kpa = young_kpa / 2.0 / (1.0 + poisson);
    let lambda_kpa = 2.0 * shear_kpa * poisson / (1.0 - 2.0 * poisson);
    vec![
        ("neo-Hookean", law(LawName::NeoHookean, None, none)),
        ("neo-Hookean, coupled", coupled),
        (
            "Mooney-Rivlin",
            law(LawName::MooneyRivlin, None, LawConstants { second_share: Some(0.3), ..none }),
        ),
        ("Gent", law(LawName::Gent, Some(2.0), none)),
        ("Gent, coupled", Law::GentCoupled(GentCoupled { shear_kpa, lambda_kpa, limit: 2.0 })),
        ("Ogden", law(LawName::Ogden, None, LawConstants { terms: Some(terms), ..none })),
        ("Yeoh", law(LawName::Yeoh, None, LawConstants { ratios: Some([0.5, 0.1]), ..none })),
        ("Hooke, logarithmic", law(LawName::Linear, None, none)),
        (
            "exponential",
            law(LawName::Exponential, None, LawConstants { exponent: Some(3.0), ..none }),
        ),
    ]
}
