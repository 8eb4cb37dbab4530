//! A material as plain data: what a study names, and what each element carries.

use super::exponential::Exponential;
use super::gent::Gent;
use super::gent_coupled::GentCoupled;
use super::linear::Linear;
use super::mooney_rivlin::MooneyRivlin;
use super::neo_hookean::NeoHookean;
use super::neo_hookean_coupled::NeoHookeanCoupled;
use super::ogden::Ogden;
use super::stretches::StretchEnergy;
use super::yeoh::Yeoh;
use super::{InvariantEnergy, Jet1, Jet2, MaterialError};
use mammotwin_data::study::{BadConstant, LawConstants, LawName};
use serde::{Deserialize, Serialize};

/// Parameters that no material has.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LawError {
    /// A modulus that is not positive and finite.
    #[error("Young's modulus of {0} kPa; give a positive one")]
    Young(f64),
    /// Poisson's ratio without a finite bulk modulus.
    #[error("Poisson's ratio of {0}; give one between 0 and 0.5 (0.499 for soft tissue)")]
    Poisson(f64),
    /// A constant that is missing, impossible, or of another law.
    #[error(transparent)]
    Constant(#[from] BadConstant),
}

/// An isotropic law with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Isochoric neo-Hookean (Mira 2018, eq. 2.37).
    NeoHookean(NeoHookean),
    /// Neo-Hookean on the full invariant, for comparison with other codes.
    NeoHookeanCoupled(NeoHookeanCoupled),
    /// Mooney-Rivlin (Mira 2018, eq. 2.38).
    MooneyRivlin(MooneyRivlin),
    /// Gent (Mira 2018, eq. 2.39).
    Gent(Gent),
    /// Gent on the full invariant, for comparison with other codes.
    GentCoupled(GentCoupled),
    /// Ogden (Mira 2018, eq. 2.40).
    Ogden(Ogden),
    /// Yeoh (Mira 2018, eq. 2.41).
    Yeoh(Yeoh),
    /// Hooke's law in logarithmic strain (Mira 2018, eq. 2.33).
    Linear(Linear),
    /// Exponential elastic (Mira 2018, eq. 2.35).
    Exponential(Exponential),
}

/// One expression for whichever law it is.
macro_rules! each {
    ($self:expr, $law:ident => $result:expr) => {
        match $self {
            Law::NeoHookean($law) => $result,
            Law::NeoHookeanCoupled($law) => $result,
            Law::MooneyRivlin($law) => $result,
            Law::Gent($law) => $result,
            Law::GentCoupled($law) => $result,
            Law::Ogden($law) => $result,
            Law::Yeoh($law) => $result,
            Law::Linear($law) => $result,
            Law::Exponential($law) => $result,
        }
    };
}

impl Law {
    /// The law of a study file that has no other constant than `jm`, which is Gent's.
    ///
    /// # Errors
    /// A modulus, ratio or limit that no material has.
    pub fn new(
        name: LawName,
        young_kpa: f64,
        poisson: f64,
        jm: Option<f64>,
    ) -> Result<Self, LawError> {
        Self::with_constants(name, young_kpa, poisson, jm, &LawConstants::default())
    }

    /// The law of a study file.
    ///
    /// # Errors
    /// A modulus, ratio or constant that no material has.
    pub fn with_constants(
        name: LawName,
        young_kpa: f64,
        poisson: f64,
        jm: Option<f64>,
        constants: &LawConstants,
    ) -> Result<Self, LawError> {
        let (shear_kpa, bulk_kpa) = moduli(young_kpa, poisson)?;
        constants.check(name, jm)?;
        let LawConstants { second_share, ratios, terms, exponent } = *constants;
        let neo_hookean = Self::NeoHookean(NeoHookean { shear_kpa, bulk_kpa });
        let law = match name {
            LawName::NeoHookean => Some(neo_hookean),
            LawName::MooneyRivlin => second_share.map(|second_share| {
                Self::MooneyRivlin(MooneyRivlin { shear_kpa, bulk_kpa, second_share })
            }),
            LawName::Gent => jm.map(|limit| Self::Gent(Gent { shear_kpa, bulk_kpa, limit })),
            LawName::Ogden => terms.map(|terms| Self::Ogden(Ogden { shear_kpa, bulk_kpa, terms })),
            LawName::Yeoh => ratios.map(|ratios| Self::Yeoh(Yeoh { shear_kpa, bulk_kpa, ratios })),
            LawName::Linear => Some(Self::Linear(Linear { shear_kpa, bulk_kpa })),
            LawName::Exponential => exponent
                .map(|exponent| Self::Exponential(Exponential { shear_kpa, bulk_kpa, exponent })),
        };
        Ok(law.expect("`check` has seen the constants of this law"))
    }

    /// The coupled neo-Hookean law of Young's modulus (kPa) and Poisson's ratio.
    ///
    /// # Errors
    /// A modulus or ratio that no material has.
    pub fn neo_hookean_coupled(young_kpa: f64, poisson: f64) -> Result<Self, LawError> {
        let (shear_kpa, bulk_kpa) = moduli(young_kpa, poisson)?;
        let lambda_kpa = bulk_kpa - 2.0 / 3.0 * shear_kpa;
        Ok(Self::NeoHookeanCoupled(NeoHookeanCoupled { shear_kpa, lambda_kpa }))
    }

    /// Initial bulk modulus (kPa).
    pub fn bulk_kpa(&self) -> f64 {
        match self {
            Self::NeoHookeanCoupled(law) => law.lambda_kpa + 2.0 / 3.0 * law.shear_kpa,
            Self::GentCoupled(law) => {
                law.lambda_kpa + (2.0 / 3.0 + 2.0 / law.limit) * law.shear_kpa
            }
            law => law.volumetric_kpa(),
        }
    }

    /// Initial Young's modulus (kPa).
    pub fn young_kpa(&self) -> f64 {
        let (shear, bulk) = (self.shear_kpa(), self.bulk_kpa());
        9.0 * bulk * shear / (3.0 * bulk + shear)
    }

    /// The same law with the shear modulus that an incompressible body of the same Young's
    /// modulus has, μ = E/3: for membranes, which are incompressible by their kinematics.
    pub(crate) fn incompressible(mut self) -> Self {
        let third = self.young_kpa() / 3.0;
        each!(&mut self, law => law.shear_kpa = third);
        self
    }
}

/// Shear and bulk modulus (kPa) (Mira 2018, eq. 2.36).
fn moduli(young_kpa: f64, poisson: f64) -> Result<(f64, f64), LawError> {
    if !(young_kpa > 0.0 && young_kpa.is_finite()) {
        return Err(LawError::Young(young_kpa));
    }
    if !(poisson > 0.0 && poisson < 0.5) {
        return Err(LawError::Poisson(poisson));
    }
    Ok((young_kpa / (2.0 * (1.0 + poisson)), young_kpa / (3.0 * (1.0 - 2.0 * poisson))))
}

impl InvariantEnergy for Law {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        each!(self, law => law.distortion(i1, j))
    }

    fn stretch_energy(&self) -> Option<&dyn StretchEnergy> {
        each!(self, law => law.stretch_energy())
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        each!(self, law => law.dilatation(j))
    }

    fn shear_kpa(&self) -> f64 {
        each!(self, law => law.shear_kpa)
    }

    fn volumetric_kpa(&self) -> f64 {
        each!(self, law => law.volumetric_kpa())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::testing;
    use mammotwin_data::study::OgdenTerms;

    #[test]
    fn every_law_has_the_moduli_of_its_parameters() {
        let none = LawConstants::default();
        let terms = OgdenTerms::try_from(vec![[0.5, 3.0], [0.5, -1.0]]).unwrap();
        let named = [
            (LawName::NeoHookean, None, none),
            (LawName::Gent, Some(2.0), none),
            (LawName::MooneyRivlin, None, LawConstants { second_share: Some(0.2), ..none }),
            (LawName::Ogden, None, LawConstants { terms: Some(terms), ..none }),
            (LawName::Yeoh, None, LawConstants { ratios: Some([0.5, 0.1]), ..none }),
            (LawName::Linear, None, none),
            (LawName::Exponential, None, LawConstants { exponent: Some(5.0), ..none }),
        ];
        let named = named.map(|(name, jm, constants)| {
            Law::with_constants(name, 0.5, 0.49, jm, &constants).unwrap()
        });
        for law in named.into_iter().chain([Law::neo_hookean_coupled(0.5, 0.49).unwrap()]) {
            testing::check(&law, 0.5 / 2.98, 0.5 / 0.06);
            assert!((law.young_kpa() - 0.5).abs() < 1e-14);
            assert!((law.bulk_kpa() - 0.5 / 0.06).abs() < 1e-14);
            assert!((law.incompressible().shear_kpa() - 0.5 / 3.0).abs() < 1e-14);
        }
    }

    #[test]
    fn impossible_parameters_are_refused() {
        assert_eq!(Law::new(LawName::NeoHookean, -1.0, 0.4, None), Err(LawError::Young(-1.0)));
        assert!(matches!(Law::neo_hookean_coupled(f64::NAN, 0.4), Err(LawError::Young(_))));
        assert_eq!(Law::new(LawName::NeoHookean, 1.0, 0.5, None), Err(LawError::Poisson(0.5)));
        for (name, jm) in [(LawName::Gent, None), (LawName::Gent, Some(0.0)), (LawName::Yeoh, None)]
        {
            assert!(matches!(Law::new(name, 1.0, 0.4, jm), Err(LawError::Constant(_))));
        }
    }
}
