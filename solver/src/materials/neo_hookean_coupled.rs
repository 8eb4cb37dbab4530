//! Neo-Hookean tissue on the full first invariant, as in FEBio's "neo-Hookean".

use super::{InvariantEnergy, Jet1, Jet2, MaterialError, dilatation};

/// ψ = ½ μ (I₁ - 3) - μ ln J + ½ λ ln² J
///
/// Initial bulk modulus: λ + 2μ/3. It differs from [`super::neo_hookean`] by a few per cent at
/// ν = 0.49; results of the two must not be mixed.
///
/// Bonet & Wood, *Nonlinear continuum mechanics for finite element analysis* (2008), eq. 6.27.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NeoHookeanCoupled {
    /// Initial shear modulus μ.
    pub shear_kpa: f64,
    /// Lamé's first parameter λ.
    pub lambda_kpa: f64,
}

impl InvariantEnergy for NeoHookeanCoupled {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        let mu = self.shear_kpa;
        Ok(Jet2 {
            w: 0.5 * mu * (i1 - 3.0) - mu * j.ln(),
            w1: 0.5 * mu,
            wj: -mu / j,
            wjj: mu / (j * j),
            ..Jet2::default()
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
    use crate::materials::testing;

    /// Verifies: coupled neo-Hookean law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        let tissue = NeoHookeanCoupled { shear_kpa: 0.1678, lambda_kpa: 8.221 };
        testing::check(&tissue, 0.1678, 8.221 + 2.0 / 3.0 * 0.1678);
    }

    /// Verifies: coupled neo-Hookean law: bar in tension and compression | closed form | 1e-11
    /// Verifies: coupled neo-Hookean law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: coupled neo-Hookean law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let law = NeoHookeanCoupled { shear_kpa: 0.1678, lambda_kpa: 8.221 };
        testing::check_first_invariant(&law, |_| law.shear_kpa);
    }
}
