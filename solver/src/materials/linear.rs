//! Hooke's law for large rotations: stress linear in the logarithmic strain.

use super::stretches::{Jet3, StretchEnergy};
use super::{InvariantEnergy, Jet1, dilatation};
use mammotwin_data::Vec3;

/// ψ = μ Σ ln² λ̄ᵢ + ½ K ln² J
///
/// The thesis states Hooke's law σ = E ε for small strains (Mira 2018, eq. 2.33, which calls
/// Young's modulus λ). Among the objective laws with this limit we take Hencky's: uniaxial
/// Kirchhoff stress is E ln λ exactly, rotations leave no stress, and a squeezed body never gives
/// way, as it does below λ = 1/√3 with the Green-Lagrange strain (St Venant-Kirchhoff), whose
/// volumetric part moreover is no function of J. Above λ = e a bar's force sinks: for moderate
/// strains only.
///
/// Hencky, *Z. Tech. Phys.* 9 (1928) 215; Anand, *J. Appl. Mech.* 46 (1979) 78,
/// <https://doi.org/10.1115/1.3424532>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Linear {
    /// Shear modulus μ.
    pub shear_kpa: f64,
    /// Bulk modulus K.
    pub bulk_kpa: f64,
}

impl InvariantEnergy for Linear {
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

impl StretchEnergy for Linear {
    fn of_logarithms(&self, e: &Vec3) -> Jet3 {
        let mu = self.shear_kpa;
        Jet3::sum(e, |e| Jet1 { value: mu * e * e, d1: 2.0 * mu * e, d2: 2.0 * mu })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::Material;
    use crate::materials::testing::{self, Curves};
    use mammotwin_data::Mat3;

    const TISSUE: Linear = Linear { shear_kpa: 0.1678, bulk_kpa: 8.33 };

    /// Verifies: Hooke's law in logarithmic strain: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&TISSUE, TISSUE.shear_kpa, TISSUE.bulk_kpa);
    }

    /// Verifies: Hooke's law in logarithmic strain: bar in tension and compression | closed form | 1e-11
    /// Verifies: Hooke's law in logarithmic strain: sheet stretched both ways | closed form | 1e-11
    /// Verifies: Hooke's law in logarithmic strain: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        let mu = TISSUE.shear_kpa;
        testing::check_curves(
            &TISSUE,
            &Curves {
                uniaxial: &|l| 3.0 * mu * l.ln(),
                equibiaxial: &|l| 6.0 * mu * l.ln(),
                shear: &|gamma| {
                    let l = testing::shear_stretch(gamma);
                    4.0 * mu * l.ln() / (l + 1.0 / l)
                },
            },
        );
    }

    /// Verifies: logarithmic law at small strain | Hooke's law | 1e-5
    #[test]
    fn is_hookes_law_at_small_strain() {
        let strain = Mat3::new(3.0, 1.0, -2.0, 1.0, -4.0, 0.5, -2.0, 0.5, 2.0) * 1e-7;
        let stress = TISSUE.stress(&(Mat3::identity() + strain)).unwrap();
        let lame = TISSUE.bulk_kpa - 2.0 / 3.0 * TISSUE.shear_kpa;
        let hooke =
            2.0 * TISSUE.shear_kpa * strain + Mat3::from_diagonal_element(lame * strain.trace());
        assert!((stress - hooke).norm() < 1e-5 * hooke.norm());
    }
}
