//! Gent's limiting-chain rubber, the law in compression (Mira 2018, eq. 2.39).

use super::{InvariantEnergy, Jet1, Jet2, MaterialError, dilatation, isochoric};

/// ψ = -½ μ Jₘ ln(1 - (Ī₁ - 3)/Jₘ) + ½ K (½ (J² - 1) - ln J)
///
/// The stress grows without bound as Ī₁ - 3 approaches `limit`; for a large `limit` the model is
/// neo-Hookean.
///
/// Gent, *Rubber Chem. Technol.* 69 (1996) 59, <https://doi.org/10.5254/1.3538357>.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Gent {
    /// Initial shear modulus μ.
    pub shear_kpa: f64,
    /// Initial bulk modulus K.
    pub bulk_kpa: f64,
    /// Jₘ, the largest Ī₁ - 3 that the tissue can reach (no unit).
    pub limit: f64,
}

impl InvariantEnergy for Gent {
    fn distortion(&self, i1: f64, j: f64) -> Result<Jet2, MaterialError> {
        isochoric(i1, j, |bar| {
            let (strain, limit) = (bar - 3.0, self.limit);
            let room = 1.0 - strain / limit;
            if room <= 0.0 {
                return Err(MaterialError::Locked { strain, limit });
            }
            let d1 = 0.5 * self.shear_kpa / room;
            let value = -0.5 * self.shear_kpa * limit * room.ln();
            Ok(Jet1 { value, d1, d2: d1 / (room * limit) })
        })
    }

    fn dilatation(&self, j: f64) -> Jet1 {
        dilatation::square_and_logarithm(j)
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
    use crate::materials::{Material, testing};
    use mammotwin_data::Mat3;

    /// First volunteer's fat: 0.3 kPa at ν = 0.499, Jₘ = 1 (Mira 2018, § 5.1.4).
    const FAT: Gent = Gent { shear_kpa: 0.1, bulk_kpa: 50.0, limit: 1.0 };

    /// Verifies: Gent law: stress, tangent, symmetry, objectivity, moduli | sixth-order differences | 1e-9
    #[test]
    fn obeys_the_laws_of_every_material() {
        testing::check(&FAT, FAT.shear_kpa, FAT.bulk_kpa);
    }

    #[test]
    fn refuses_to_stretch_past_its_limit() {
        let f = Mat3::from_diagonal(&[2.0, 0.5f64.sqrt(), 0.5f64.sqrt()].into());
        let Err(MaterialError::Locked { strain, limit }) = FAT.stress(&f) else { panic!() };
        assert!((strain - 2.0).abs() < 1e-12 && limit == 1.0);
    }

    /// Verifies: Gent law: bar in tension and compression | closed form | 1e-11
    /// Verifies: Gent law: sheet stretched both ways | closed form | 1e-11
    /// Verifies: Gent law: simple shear | closed form | 1e-11
    #[test]
    fn has_the_stress_of_the_closed_forms() {
        testing::check_first_invariant(&FAT, |strain| FAT.shear_kpa / (1.0 - strain / FAT.limit));
    }

    /// Verifies: Gent law without a limit | neo-Hookean law | 1e-8
    #[test]
    fn is_neo_hookean_without_a_limit() {
        // Of the same volume: their volumetric parts differ.
        let f = testing::moderate() / testing::moderate().determinant().cbrt();
        let limit = NeoHookean { shear_kpa: FAT.shear_kpa, bulk_kpa: FAT.bulk_kpa };
        let law = Gent { limit: 1e9, ..FAT };
        let (one, two) = (law.stress(&f).unwrap(), limit.stress(&f).unwrap());
        assert!((one - two).norm() < 1e-8 * two.norm(), "{one}{two}");
    }
}
