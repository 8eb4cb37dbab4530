//! Photons by energy, and what a beam does to air and aluminium.

use crate::xray::attenuation::{AttenuationError, Material};

/// 1 keV/g = 1.602176634e-16 J / 1e-3 kg = 1.602176634e-13 Gy.
const MGY_PER_KEV_PER_G: f64 = 1.602_176_634e-10;

/// Photons of one energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Photon energy (keV).
    pub energy_kev: f64,
    /// Share of the photons of the beam; all shares add up to 1.
    pub share: f64,
}

/// A beam as lines of one energy each.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Lines, ascending in energy.
    pub lines: Vec<Line>,
}

impl Spectrum {
    /// All photons have the same energy.
    pub fn mono(energy_kev: f64) -> Self {
        Self { lines: vec![Line { energy_kev, share: 1.0 }] }
    }

    /// Share of the photons that pass a thickness of a material without interaction.
    pub fn transmission(&self, material: &Material, path_mm: f64) -> Result<f64, AttenuationError> {
        let mut sum = 0.0;
        for line in &self.lines {
            let mu = material.attenuation_per_mm(line.energy_kev)?;
            sum += line.share * (-mu * path_mm).exp();
        }
        Ok(sum)
    }

    /// Air kerma (mGy) of one photon per mm², behind a thickness of a filter.
    pub fn kerma_mgy_mm2(&self, filter: &Material, path_mm: f64) -> Result<f64, AttenuationError> {
        let air = Material::named("air")?;
        let mut sum = 0.0;
        for line in &self.lines {
            let passed = (-filter.attenuation_per_mm(line.energy_kev)? * path_mm).exp();
            let transfer_mm2_per_g = 100.0 * air.transfer_cm2_per_g(line.energy_kev)?;
            sum += line.share * passed * line.energy_kev * transfer_mm2_per_g;
        }
        Ok(sum * MGY_PER_KEV_PER_G)
    }

    /// Half-value layer (mm of aluminium): halves the air kerma in narrow-beam geometry.
    pub fn hvl_mm_al(&self) -> Result<f64, AttenuationError> {
        let aluminium = Material::named("al")?;
        let half = 0.5 * self.kerma_mgy_mm2(&aluminium, 0.0)?;
        let (mut low, mut high) = (0.0, 1.0);
        while self.kerma_mgy_mm2(&aluminium, high)? > half {
            high *= 2.0;
        }
        // 60 halvings: below the last bit of the thickness.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.kerma_mgy_mm2(&aluminium, middle)? > half {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(0.5 * (low + high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_value_layer_of_one_energy_is_ln_2_over_mu() {
        let hvl = Spectrum::mono(24.0).hvl_mm_al().unwrap();
        let mu = Material::named("al").unwrap().attenuation_per_mm(24.0).unwrap();
        assert!((hvl * mu / 2f64.ln() - 1.0).abs() < 1e-12, "{hvl}");
        assert!((hvl - 1.2498).abs() < 1e-3, "{hvl}");
    }

    #[test]
    fn half_value_layer_of_two_energies_halves_their_kerma() {
        let line = |energy_kev| Line { energy_kev, share: 0.5 };
        let beam = Spectrum { lines: vec![line(17.0), line(30.0)] };
        let aluminium = Material::named("al").unwrap();
        let hvl = beam.hvl_mm_al().unwrap();
        let ratio = beam.kerma_mgy_mm2(&aluminium, hvl).unwrap()
            / beam.kerma_mgy_mm2(&aluminium, 0.0).unwrap();
        assert!((ratio - 0.5).abs() < 1e-12);
        let [soft, hard] = [17.0, 30.0].map(|e| Spectrum::mono(e).hvl_mm_al().unwrap());
        assert!(soft < hvl && hvl < hard);
    }

    /// 24 keV · 0.305397 cm²/g · 1.602e-16 J/keV · 1000 g/kg · 1000 mGy/Gy · 100 mm²/cm².
    #[test]
    fn kerma_of_a_photon() {
        let air = Material::named("air").unwrap();
        let kerma = Spectrum::mono(24.0).kerma_mgy_mm2(&air, 0.0).unwrap();
        assert!((kerma / 1.17431e-7 - 1.0).abs() < 1e-4, "{kerma}");
    }
}
