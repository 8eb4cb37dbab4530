//! Isochoric neo-Hookean tissue, the law under gravity (Mira 2018, eq. 2.37).

use super::{InvariantEnergy, Jet1, Jet2, MaterialError, dilatation, isochoric};

/// ψ = ½ μ (Ī₁ - 3) + ½ K (J - 1)²
///
/// Ogden, *Non-linear elastic deformations* (1984), § 7.2.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NeoHookean {
    /// Initial shear modulus μ.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
}

impl InvariantEnergy for NeoHookean {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        let half = 0.5 * self.shear_kpa;
        isochoric(i1, j, |bar| Ok(Jet1 { value: half * (bar - 3.0), d1: half, d2: 0.0 }))
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::linear(j)
    }

    fn shear_kpa(&self) -> f64 {
        self.shear_kpa
    }

    fn volumetric_kpa(&self) -> f64 {
        self.bulk_kpa
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::testing;

    /// Verifies: isochoric neo-Hookean law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&NeoHookean { shear_kpa: 0.1678, bulk_kpa: 8.33 }, 0.1678, 8.33);
    }

    /// Verifies: isochoric neo-Hookean law: bar in tension and compression | closed form | 1e-11
    /// Verifies: isochoric neo-Hookean law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: isochoric neo-Hookean law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let law = NeoHookean { shear_kpa: 0.1678, bulk_kpa: 8.33 };
        testing::check_first_invariant(&law, |_| law.shear_kpa);
    }
}
