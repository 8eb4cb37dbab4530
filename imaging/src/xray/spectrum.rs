//! Photons by energy, and what a beam does to air and aluminium.

use crate::xray::attenuation::{AttenuationError, Material};
use mammotwin_data::tables;

/// No such spectrum.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no spectrum of {beam} at {kv} kV; the table has {known}")]
pub struct UnknownBeam {
    /// Target and filter.
    pub beam: String,
    /// Tube voltage (kV).
    pub kv: u32,
    /// What the table has.
    pub known: String,
}

/// 1 keV/g = 1.602176634e-16 J / 1e-3 kg = 1.602176634e-13 Gy.
pub(crate) const MGY_PER_KEV_PER_G: f64 = 1.602_176_634e-10;

/// Photons of one energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Photon energy (keV).
    pub energy_kev: f64,
    /// Share of the photons of the beam.
    pub share: f64,
}

/// A beam as lines of one energy each.
///
/// Shares say how many photons each line has of those that the beam began with: behind a filter
/// they add up to less than 1.
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

    /// The spectrum of a tube behind its filter, without air and paddle: `Mo/Mo` at 28 kV,
    /// `Mo/Rh` at 28, `Rh/Ag` at 34, `W/Rh` at 28, or `Mo/Mo (TG-195)` at 30.
    pub fn of_tube(beam: &str, kv: u32) -> Result<Self, UnknownBeam> {
        let number = |cell: &str| cell.parse::<f64>().expect("embedded tables hold numbers");
        let wanted = kv.to_string();
        let lines: Vec<Line> = tables::rows(tables::SPECTRA)
            .filter(|row| row[0] == beam && row[1] == wanted)
            .map(|row| Line { energy_kev: number(row[2]), share: number(row[3]) })
            .collect();
        if lines.is_empty() {
            let mut known: Vec<String> = tables::rows(tables::SPECTRA)
                .map(|row| format!("{} at {} kV", row[0], row[1]))
                .collect();
            known.dedup();
            return Err(UnknownBeam { beam: beam.into(), kv, known: known.join(", ") });
        }
        Ok(Self { lines })
    }

    /// What is left of the beam behind a thickness of a material (narrow beam).
    pub fn behind(&self, filter: &Material, path_mm: f64) -> Result<Self, AttenuationError> {
        let mut lines = self.lines.clone();
        for line in &mut lines {
            line.share *= (-filter.attenuation_per_mm(line.energy_kev)? * path_mm).exp();
        }
        Ok(Self { lines })
    }

    /// The same beam with shares of the photons that are left: they add up to 1.
    pub fn of_all(mut self) -> Self {
        let sum: f64 = self.lines.iter().map(|line| line.share).sum();
        self.lines.iter_mut().for_each(|line| line.share /= sum);
        self
    }

    /// Mean energy (keV) of its photons.
    pub fn mean_kev(&self) -> f64 {
        let sum: f64 = self.lines.iter().map(|line| line.share).sum();
        self.lines.iter().map(|line| line.share * line.energy_kev).sum::<f64>() / sum
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

    fn at_the_breast(beam: &str, kv: u32) -> Spectrum {
        let [air, paddle] = ["air", "pmma"].map(|name| Material::named(name).unwrap());
        let tube = Spectrum::of_tube(beam, kv).unwrap();
        tube.behind(&air, 560.0).unwrap().behind(&paddle, 2.5).unwrap()
    }

    /// European guidelines, with the paddle in the beam.
    #[test]
    fn half_value_layers_of_tubes_are_within_the_cited_ranges() {
        let mut checked = 0;
        for row in tables::rows(tables::HALF_VALUE_LAYERS).filter(|row| row[1] == "28") {
            let Ok(_) = Spectrum::of_tube(row[0], 28) else { continue };
            let hvl = at_the_breast(row[0], 28).hvl_mm_al().unwrap();
            let [cited, range] = [2, 3].map(|k| row[k].parse::<f64>().unwrap());
            assert!((hvl - cited).abs() <= range, "{}: {hvl}, cited {cited}", row[0]);
            checked += 1;
        }
        assert_eq!(checked, 3);
    }

    /// SpekPy's own half-value layers of the same beams, behind air and 2.5 mm PMMA: other
    /// coefficients and finer bins.
    #[test]
    fn half_value_layers_agree_with_the_program_that_made_the_spectra() {
        let wanted = [("Mo/Mo", 28, 0.3539), ("Mo/Rh", 28, 0.4039), ("Rh/Ag", 34, 0.5369)];
        for (beam, kv, hvl) in wanted.into_iter().chain([("W/Rh", 28, 0.5096)]) {
            let got = at_the_breast(beam, kv).hvl_mm_al().unwrap();
            assert!((got / hvl - 1.0).abs() < 0.01, "{beam}: {got}, {hvl}");
        }
    }

    #[test]
    fn tubes_have_all_their_photons_and_unknown_ones_are_refused() {
        let tubes = [("Mo/Mo (TG-195)", 30), ("Mo/Mo", 28), ("Rh/Ag", 34), ("W/Rh", 28)];
        for (beam, kv) in tubes {
            let tube = Spectrum::of_tube(beam, kv).unwrap();
            let sum: f64 = tube.lines.iter().map(|line| line.share).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{beam}: {sum}");
            assert!(tube.lines.windows(2).all(|l| l[0].energy_kev < l[1].energy_kev));
            assert!((15.0..21.0).contains(&tube.mean_kev()), "{beam}: {}", tube.mean_kev());
        }
        let refused = Spectrum::of_tube("Rh/Ag", 30).unwrap_err().to_string();
        assert!(refused.contains("Rh/Ag at 34 kV"), "{refused}");
    }

    /// 24 keV · 0.305397 cm²/g · 1.602e-16 J/keV · 1000 g/kg · 1000 mGy/Gy · 100 mm²/cm².
    #[test]
    fn kerma_of_a_photon() {
        let air = Material::named("air").unwrap();
        let kerma = Spectrum::mono(24.0).kerma_mgy_mm2(&air, 0.0).unwrap();
        assert!((kerma / 1.17431e-7 - 1.0).abs() < 1e-4, "{kerma}");
    }
}
