//! Tissue whose Young's modulus grows exponentially with strain (Mira 2018, eq. 2.35).

use super::stretches::{Jet3, StretchEnergy, exp_above_tangent};
use super::{InvariantEnergy, Jet1, dilatation};
use mammotwin_data::{Mat3, Vec3};

/// ψ = E/m² (e^(m ε) - 1 - m ε) + ½ K ln² J, ε² = ⅔ Σ ln² λ̄ᵢ
///
/// The thesis gives the modulus of a bar, dσ/dε = b e^(m ε), for stretch. Here ε is the equivalent
/// logarithmic strain, which is |ln λ| for a bar that keeps its volume, so that the bar obeys eq.
/// 2.35 exactly in true stress and strain, tissue is as stiff in compression as in tension, and
/// b = E = 3 μ is Young's modulus of incompressible tissue at rest. For m = 0 it would be
/// [`super::linear`].
///
/// Azar, Metaxas & Schnall, *Med. Image Anal.* 6 (2002) 1,
/// <https://doi.org/10.1016/S1361-8415(00)00053-6>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Exponential {
    /// Initial shear modulus μ = b/3.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
    /// m, how fast tissue stiffens (no unit), positive.
    pub exponent: f64,
}

impl InvariantEnergy for Exponential {
    fn stretch_energy(&self) -> Option<&dyn StretchEnergy> {
        Some(self)
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::logarithmic(j)
    }

    fn shear_kpa(&self) -> f64 {
        self.shear_kpa
    }

    fn volumetric_kpa(&self) -> f64 {
        self.bulk_kpa
    }
}

impl StretchEnergy for Exponential {
    fn of_logarithms(&self, e: &Vec3) -> Jet3 {
        let (young, m) = (3.0 * self.shear_kpa, self.exponent);
        let strain = (2.0 / 3.0 * e.norm_squared()).sqrt();
        let tangent = young * (m * strain).exp();
        // Stress over strain, and the direction e/ε, at rest and elsewhere.
        let (secant, along) = if strain > 0.0 {
            (young * (m * strain).exp_m1() / (m * strain), e / strain)
        } else {
            (young, Vec3::zeros())
        };
        Jet3 {
            value: young / (m * m) * exp_above_tangent(m * strain),
            d1: 2.0 / 3.0 * secant * e,
            d2: Mat3::from_diagonal_element(2.0 / 3.0 * secant)
                + 4.0 / 9.0 * (tangent - secant) * along * along.transpose(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::linear::Linear;
    use crate::materials::testing::{self, Curves};

    const TISSUE: Exponential = Exponential { shear_kpa: 0.1678, bulk_kpa: 8.33, exponent: 3.0 };

    /// Verifies: exponential law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&TISSUE, TISSUE.shear_kpa, TISSUE.bulk_kpa);
    }

    /// Verifies: exponential law: bar in tension and compression | closed form | 1e-11
    /// Verifies: exponential law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: exponential law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let (b, m) = (3.0 * TISSUE.shear_kpa, TISSUE.exponent);
        let bar = |strain: f64| b / m * ((m * strain.abs()).exp() - 1.0) * strain.signum();
        testing::check_curves(
            &TISSUE,
            &Curves {
                uniaxial: &|l| bar(l.ln()),
                equibiaxial: &|l| bar(2.0 * l.ln()),
                shear: &|gamma| {
                    let l = testing::shear_stretch(gamma);
                    2.0 / 3.0f64.sqrt() * bar(2.0 / 3.0f64.sqrt() * l.ln()) / (l + 1.0 / l)
                },
            },
        );
    }

    /// Verifies: exponential law of a small exponent | logarithmic law | 1e-6
    #[test]
    fn is_linear_when_it_stiffens_slowly() {
        let law = Exponential { exponent: 1e-6, ..TISSUE };
        let limit = Linear { shear_kpa: law.shear_kpa, bulk_kpa: law.bulk_kpa };
        testing::check_equal(&law, &limit, 1e-6);
    }
}
