//! A material as plain data: what a study names, and what each element carries.

use super::gent::Gent;
use super::neo_hookean::NeoHookean;
use super::neo_hookean_coupled::NeoHookeanCoupled;
use super::{InvariantEnergy, Jet1, Jet2, MaterialError};
use mammotwin_data::study::LawName;
use serde::{Deserialize, Serialize};

/// Parameters that no material has.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LawError {
    /// A modulus that is not positive and finite.
    #[error("Young's modulus of {0} kPa; give a positive one")]
    Young(f64),
    /// Poisson's ratio without a finite bulk modulus.
    #[error("Poisson's ratio of {0}; give one between 0 and 0.5 (0.499 for soft tissue)")]
    Poisson(f64),
    /// A Gent law without, or with an impossible, limit.
    #[error("Gent law with Jm = {0:?}; give a positive one (1 or 2 for soft tissue)")]
    Limit(Option<f64>),
}

/// An isotropic law with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Isochoric neo-Hookean (Mira 2018, eq. 2.37).
    NeoHookean(NeoHookean),
    /// Neo-Hookean on the full invariant, for comparison with other codes.
    NeoHookeanCoupled(NeoHookeanCoupled),
    /// Gent (Mira 2018, eq. 2.39).
    Gent(Gent),
}

impl Law {
    /// The law of a study file; `jm` is read by Gent alone.
    ///
    /// # Errors
    /// A modulus, ratio or limit that no material has.
    pub fn new(
        name: LawName,
        young_kpa: f64,
        poisson: f64,
        jm: Option<f64>,
    ) -> Result<Self, LawError> {
        let (shear_kpa, bulk_kpa) = moduli(young_kpa, poisson)?;
        match name {
            LawName::NeoHookean => Ok(Self::NeoHookean(NeoHookean { shear_kpa, bulk_kpa })),
            LawName::Gent => match jm {
                Some(limit) if limit > 0.0 && limit.is_finite() => {
                    Ok(Self::Gent(Gent { shear_kpa, bulk_kpa, limit }))
                }
                _ => Err(LawError::Limit(jm)),
            },
        }
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
            Self::NeoHookean(law) => law.bulk_kpa,
            Self::NeoHookeanCoupled(law) => law.lambda_kpa + 2.0 / 3.0 * law.shear_kpa,
            Self::Gent(law) => law.bulk_kpa,
        }
    }

    /// Initial Young's modulus (kPa).
    pub fn young_kpa(&self) -> f64 {
        let (shear, bulk) = (self.shear_kpa(), self.bulk_kpa());
        9.0 * bulk * shear / (3.0 * bulk + shear)
    }

    /// The same law with the shear modulus that an incompressible body of the same Young's
    /// modulus has, μ = E/3: for membranes, which are incompressible by their kinematics.
    pub(crate) fn incompressible(self) -> Self {
        let third = self.young_kpa() / 3.0;
        match self {
            Self::NeoHookean(law) => Self::NeoHookean(NeoHookean { shear_kpa: third, ..law }),
            Self::NeoHookeanCoupled(law) => {
                Self::NeoHookeanCoupled(NeoHookeanCoupled { shear_kpa: third, ..law })
            }
            Self::Gent(law) => Self::Gent(Gent { shear_kpa: third, ..law }),
        }
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
        match self {
            Self::NeoHookean(law) => law.distortion(i1, j),
            Self::NeoHookeanCoupled(law) => law.distortion(i1, j),
            Self::Gent(law) => law.distortion(i1, j),
        }
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        match self {
            Self::NeoHookean(law) => law.dilatation(j),
            Self::NeoHookeanCoupled(law) => law.dilatation(j),
            Self::Gent(law) => law.dilatation(j),
        }
    }

    fn shear_kpa(&self) -> f64 {
        match self {
            Self::NeoHookean(law) => law.shear_kpa,
            Self::NeoHookeanCoupled(law) => law.shear_kpa,
            Self::Gent(law) => law.shear_kpa,
        }
    }

    fn volumetric_kpa(&self) -> f64 {
        match self {
            Self::NeoHookean(law) => law.volumetric_kpa(),
            Self::NeoHookeanCoupled(law) => law.volumetric_kpa(),
            Self::Gent(law) => law.volumetric_kpa(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::testing;

    #[test]
    fn every_law_has_the_moduli_of_its_parameters() {
        let laws = [
            Law::new(LawName::NeoHookean, 0.5, 0.49, None).unwrap(),
            Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap(),
            Law::neo_hookean_coupled(0.5, 0.49).unwrap(),
        ];
        for law in laws {
            testing::check(&law, 0.5 / 2.98, 0.5 / 0.06);
            assert!((law.young_kpa() - 0.5).abs() < 1e-14);
        }
    }

    #[test]
    fn impossible_parameters_are_refused() {
        assert_eq!(Law::new(LawName::NeoHookean, -1.0, 0.4, None), Err(LawError::Young(-1.0)));
        assert!(matches!(Law::neo_hookean_coupled(f64::NAN, 0.4), Err(LawError::Young(_))));
        assert_eq!(Law::new(LawName::NeoHookean, 1.0, 0.5, None), Err(LawError::Poisson(0.5)));
        assert_eq!(Law::new(LawName::Gent, 1.0, 0.4, None), Err(LawError::Limit(None)));
        assert_eq!(Law::new(LawName::Gent, 1.0, 0.4, Some(0.0)), Err(LawError::Limit(Some(0.0))));
    }
}
