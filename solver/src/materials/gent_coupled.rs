//! Gent's law on the full first invariant, for comparison with other codes.

use super::{InvariantEnergy, Jet1, Jet2, MaterialError, dilatation};

/// ψ = -½ μ Jₘ ln(1 - (I₁ - 3)/Jₘ) - μ ln J + ½ λ ln² J
///
/// The limit acts on dilatation, too: the initial bulk modulus is λ + 2μ/3 + 2μ/Jₘ.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GentCoupled {
    /// Initial shear modulus μ.
    pub shear_kpa: f64,
    /// λ, the factor of ½ ln² J.
    pub lambda_kpa: f64,
    /// Jₘ, the largest I₁ - 3 that the tissue can reach (no unit).
    pub limit: f64,
}

impl InvariantEnergy for GentCoupled {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        let (mu, limit, strain) = (self.shear_kpa, self.limit, i1 - 3.0);
        let room = 1.0 - strain / limit;
        if room <= 0.0 {
            return Err(MaterialError::Locked { strain, limit });
        }
        let w1 = 0.5 * mu / room;
        Ok(Jet2 {
            w: -0.5 * mu * limit * room.ln() - mu * j.ln(),
            w1,
            wj: -mu / j,
            w11: w1 / (room * limit),
            w1j: 0.0,
            wjj: mu / (j * j),
        })
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::logarithmic(j)
    }

    fn shear_kpa(&self) -> f64 {
        self.shear_kpa
    }

    fn volumetric_kpa(&self) -> f64 {
        self.lambda_kpa
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::neo_hookean_coupled::NeoHookeanCoupled;
    use crate::materials::testing;

    const TISSUE: GentCoupled = GentCoupled { shear_kpa: 0.1678, lambda_kpa: 8.221, limit: 2.0 };

    /// Verifies: coupled Gent law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        let mu = TISSUE.shear_kpa;
        testing::check(&TISSUE, mu, TISSUE.lambda_kpa + 2.0 / 3.0 * mu + 2.0 * mu / TISSUE.limit);
    }

    /// Verifies: coupled Gent law: bar in tension and compression | closed form | 1e-11
    /// Verifies: coupled Gent law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: coupled Gent law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        testing::check_first_invariant(&TISSUE, |x| TISSUE.shear_kpa / (1.0 - x / TISSUE.limit));
    }

    /// Verifies: coupled Gent law without a limit | coupled neo-Hookean law | 1e-7
    #[test]
    fn is_neo_hookean_without_a_limit() {
        let law = GentCoupled { limit: 1e9, ..TISSUE };
        let limit = NeoHookeanCoupled { shear_kpa: law.shear_kpa, lambda_kpa: law.lambda_kpa };
        testing::check_equal(&law, &limit, 1e-7);
    }
}
