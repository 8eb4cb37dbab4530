//! Mooney-Rivlin rubber (Mira 2018, eq. 2.38, with its misprint corrected).

use super::stretches::{Jet3, StretchEnergy, exp_above_tangent};
use super::{InvariantEnergy, Jet1, dilatation};
use mammotwin_data::Vec3;

/// ψ = ½ μ₁ (Ī₁ - 3) + ½ μ₂ (Ī₂ - 3) + ½ K (J - 1)²
///
/// Ī₁ = Σ λ̄ᵢ², Ī₂ = Σ λ̄ᵢ⁻². Eq. 2.38 prints ½ K (J - **2**)², which gives a body at rest energy
/// and pressure.
///
/// Rivlin & Saunders, *Phil. Trans. R. Soc. A* 243 (1951) 251,
/// <https://doi.org/10.1098/rsta.1951.0004>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MooneyRivlin {
    /// Initial shear modulus μ = μ₁ + μ₂.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
    /// μ₂/μ, from 0 to 1.
    pub second_share: f64,
}

impl InvariantEnergy for MooneyRivlin {
    fn stretch_energy(&self) -> Option<&dyn StretchEnergy> {
        Some(self)
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

impl StretchEnergy for MooneyRivlin {
    fn of_logarithms(&self, e: &Vec3) -> Jet3 {
        let second = self.second_share * self.shear_kpa;
        let first = self.shear_kpa - second;
        // Σ e = 0, so that the linear part of the exponentials counts for nothing.
        Jet3::sum(e, |e| {
            let (square, inverse) = ((2.0 * e).exp(), (-2.0 * e).exp());
            Jet1 {
                value: 0.5 * first * exp_above_tangent(2.0 * e)
                    + 0.5 * second * exp_above_tangent(-2.0 * e),
                d1: first * square - second * inverse,
                d2: 2.0 * (first * square + second * inverse),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::neo_hookean::NeoHookean;
    use crate::materials::testing::{self, Curves};

    const TISSUE: MooneyRivlin =
        MooneyRivlin { shear_kpa: 0.1678, bulk_kpa: 8.33, second_share: 0.3 };

    /// Verifies: Mooney-Rivlin law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&TISSUE, TISSUE.shear_kpa, TISSUE.bulk_kpa);
    }

    /// Verifies: Mooney-Rivlin law: bar in tension and compression | closed form | 1e-11
    /// Verifies: Mooney-Rivlin law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: Mooney-Rivlin law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let (first, second) = (0.7 * 0.1678, 0.3 * 0.1678);
        testing::check_curves(
            &TISSUE,
            &Curves {
                uniaxial: &|l| (l * l - 1.0 / l) * (first + second / l),
                equibiaxial: &|l| (l.powi(2) - l.powi(-4)) * (first + second * l * l),
                shear: &|gamma| (first + second) * gamma,
            },
        );
    }

    /// Verifies: Mooney-Rivlin law without its second part | neo-Hookean law | 1e-12
    #[test]
    fn is_neo_hookean_without_its_second_part() {
        let law = MooneyRivlin { second_share: 0.0, ..TISSUE };
        let limit = NeoHookean { shear_kpa: law.shear_kpa, bulk_kpa: law.bulk_kpa };
        testing::check_equal(&law, &limit, 1e-12);
    }
}
