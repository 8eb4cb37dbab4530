//! Yeoh's polynomial in the first invariant (Mira 2018, eq. 2.41).

use super::{InvariantEnergy, Jet1, Jet2, MaterialError, dilatation, isochoric};

/// ψ = Σ cᵢ (Ī₁ - 3)ⁱ + Σ ½ K (J - 1)^(2i), i = 1..=N, N <= 3
///
/// The thesis calls cᵢ μᵢ; the initial shear modulus is 2 c₁, not c₁.
///
/// Yeoh, *Rubber Chem. Technol.* 66 (1993) 754, <https://doi.org/10.5254/1.3538343>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Yeoh {
    /// Initial shear modulus μ = 2 c₁.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
    /// c₂/c₁ and c₃/c₁; N is the order of the last that is not zero.
    pub ratios: [f64; 2],
}

impl Yeoh {
    fn order(&self) -> usize {
        self.ratios.iter().rposition(|r| *r != 0.0).map_or(1, |last| last + 2)
    }
}

impl InvariantEnergy for Yeoh {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        isochoric(i1, j, |bar| {
            let (x, first, [second, third]) = (bar - 3.0, 0.5 * self.shear_kpa, self.ratios);
            Ok(Jet1 {
                value: first * x * (1.0 + x * (second + x * third)),
                d1: first * (1.0 + x * (2.0 * second + 3.0 * x * third)),
                d2: first * (2.0 * second + 6.0 * x * third),
            })
        })
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::even_powers(j, self.order())
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
    use crate::materials::neo_hookean::NeoHookean;
    use crate::materials::testing;

    const TISSUE: Yeoh = Yeoh { shear_kpa: 0.1678, bulk_kpa: 8.33, ratios: [0.4, 0.15] };

    /// Verifies: Yeoh law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&TISSUE, TISSUE.shear_kpa, TISSUE.bulk_kpa);
    }

    /// Verifies: Yeoh law: bar in tension and compression | closed form | 1e-11
    /// Verifies: Yeoh law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: Yeoh law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let stiffness = |x: f64| 0.1678 * (1.0 + 0.8 * x + 0.45 * x * x);
        testing::check_first_invariant(&TISSUE, stiffness);
    }

    /// Verifies: Yeoh law of one term | neo-Hookean law | 1e-14
    #[test]
    fn is_neo_hookean_with_one_term() {
        let law = Yeoh { ratios: [0.0; 2], ..TISSUE };
        let limit = NeoHookean { shear_kpa: law.shear_kpa, bulk_kpa: law.bulk_kpa };
        testing::check_equal(&law, &limit, 1e-14);
    }
}
