//! Ogden's powers of the principal stretches (Mira 2018, eq. 2.40, made isochoric).

use super::stretches::{Jet3, StretchEnergy, exp_above_tangent};
use super::{InvariantEnergy, Jet1, dilatation};
use mammotwin_data::{Vec3, study::OgdenTerms};

/// ψ = Σ μₖ/αₖ (λ̄₁^αₖ + λ̄₂^αₖ + λ̄₃^αₖ - 3) + Σ ½ K (J - 1)^(2k), k = 1..=N, N <= 3
///
/// Each term is given by its share sₖ = ½ μₖ αₖ/μ of the initial shear modulus. Eq. 2.40 prints
/// the unmodified λᵢ, whose terms are stress-free at rest only together and only if Σ μₖ = 0;
/// λ̄ᵢ = J^(-1/3) λᵢ is meant.
///
/// Ogden, *Proc. R. Soc. A* 326 (1972) 565, <https://doi.org/10.1098/rspa.1972.0026>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ogden {
    /// Initial shear modulus μ = ½ Σ μₖ αₖ.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
    /// Shares, which sum to 1, and exponents.
    pub terms: OgdenTerms,
}

impl InvariantEnergy for Ogden {
    fn stretch_energy(&self) -> Option<&dyn StretchEnergy> {
        Some(self)
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::even_powers(j, self.terms.list().len())
    }

    fn shear_kpa(&self) -> f64 {
        self.shear_kpa
    }

    fn volumetric_kpa(&self) -> f64 {
        self.bulk_kpa
    }
}

impl StretchEnergy for Ogden {
    fn of_logarithms(&self, e: &Vec3) -> Jet3 {
        Jet3::sum(e, |e| {
            let mut sum = Jet1::default();
            for &[share, exponent] in self.terms.list() {
                let factor = 2.0 * self.shear_kpa * share;
                let power = factor * (exponent * e).exp();
                // Σ e = 0, so that the linear part of the exponentials counts for nothing.
                sum.value += factor / (exponent * exponent) * exp_above_tangent(exponent * e);
                sum.d1 += power / exponent;
                sum.d2 += power;
            }
            sum
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::mooney_rivlin::MooneyRivlin;
    use crate::materials::neo_hookean::NeoHookean;
    use crate::materials::testing::{self, Curves};

    fn tissue(terms: &[[f64; 2]]) -> Ogden {
        let terms = OgdenTerms::try_from(terms.to_vec()).unwrap();
        Ogden { shear_kpa: 0.1678, bulk_kpa: 8.33, terms }
    }

    /// Verifies: Ogden law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        for terms in [&[[1.0, 6.0]][..], &[[0.6, 1.3], [0.3, 5.0], [0.1, -2.0]]] {
            testing::check(&tissue(terms), 0.1678, 8.33);
        }
    }

    /// Verifies: Ogden law: bar in tension and compression | closed form | 1e-11
    /// Verifies: Ogden law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: Ogden law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let terms = [[0.6, 1.3], [0.3, 5.0], [0.1, -2.0f64]];
        let sum = |each: &dyn Fn(f64) -> f64| -> f64 {
            terms.iter().map(|[share, a]| 2.0 * 0.1678 * share / a * each(*a)).sum()
        };
        testing::check_curves(
            &tissue(&terms),
            &Curves {
                uniaxial: &|l| sum(&|a| l.powf(a) - l.powf(-0.5 * a)),
                equibiaxial: &|l| sum(&|a| l.powf(a) - l.powf(-2.0 * a)),
                shear: &|gamma| {
                    let l = testing::shear_stretch(gamma);
                    sum(&|a| l.powf(a) - l.powf(-a)) / (l + 1.0 / l)
                },
            },
        );
    }

    /// Verifies: Ogden law with the exponents 2 and -2 | neo-Hookean and Mooney-Rivlin laws | 1e-12
    #[test]
    fn holds_neo_hooke_and_mooney_and_rivlin() {
        let limit = NeoHookean { shear_kpa: 0.1678, bulk_kpa: 8.33 };
        testing::check_equal(&tissue(&[[1.0, 2.0]]), &limit, 1e-12);
        let two = tissue(&[[0.7, 2.0], [0.3, -2.0]]);
        let mooney = MooneyRivlin { shear_kpa: 0.1678, bulk_kpa: 8.33, second_share: 0.3 };
        let f = testing::moderate();
        let distortion = |law: &dyn StretchEnergy| {
            law.of_stretches(&super::super::principal(&f, f.determinant()).unwrap().stretches)
        };
        // Their volumetric parts have different numbers of terms.
        let (a, b) = (distortion(&two), distortion(&mooney));
        assert!((a.value - b.value).abs() < 1e-14 && (a.d1 - b.d1).norm() < 1e-14);
    }
}
