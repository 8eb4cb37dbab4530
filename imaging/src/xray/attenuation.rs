//! How strongly materials attenuate X-rays.

use mammotwin_data::tables;
use std::{collections::BTreeMap, sync::LazyLock};

/// Why there is no coefficient.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AttenuationError {
    /// No such row in the table of materials.
    #[error("unknown material {0:?}; the table has {known}", known = names())]
    Unknown(String),
    /// The table ends before this energy.
    #[error("{energy_kev} keV is outside of the attenuation table ({low} - {high} keV)")]
    Energy {
        /// Asked for (keV).
        energy_kev: f64,
        /// First energy of the table (keV).
        low: f64,
        /// Last energy of the table (keV).
        high: f64,
    },
    /// A mass fraction that is none.
    #[error("glandularity {0} is not a mass fraction: give 0..1")]
    Glandularity(f64),
}

/// A homogeneous material.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// What reports call it.
    pub name: String,
    /// Mass density (g/cm³).
    pub density_g_per_cm3: f64,
    /// Rows of the attenuation table and their mass fractions.
    pub parts: Vec<(String, f64)>,
}

impl Material {
    /// A row of the table of materials at its tabulated density.
    pub fn named(name: &str) -> Result<Self, AttenuationError> {
        let curve = curve(name)?;
        let parts = vec![(name.into(), 1.0)];
        Ok(Self { name: name.into(), density_g_per_cm3: curve.density, parts })
    }

    /// Breast tissue with this mass fraction of gland; the rest is fat, both of Hammerstein
    /// (1979). Volumes add up: 1/ρ = Σ wᵢ/ρᵢ.
    pub fn breast(glandularity: f64) -> Result<Self, AttenuationError> {
        if !(0.0..=1.0).contains(&glandularity) {
            return Err(AttenuationError::Glandularity(glandularity));
        }
        let gland = Self::named(GLAND)?;
        let fat = Self::named(FAT)?;
        let volume =
            glandularity / gland.density_g_per_cm3 + (1.0 - glandularity) / fat.density_g_per_cm3;
        Ok(Self {
            name: format!("breast, {:.0} % gland by mass", 100.0 * glandularity),
            density_g_per_cm3: 1.0 / volume,
            parts: vec![(gland.name, glandularity), (fat.name, 1.0 - glandularity)],
        })
    }

    /// The surrogate of microcalcifications: aluminium at 60 % of its density (Mîra 2018, § 5.2.2).
    pub fn calcification() -> Result<Self, AttenuationError> {
        let aluminium = Self::named("al")?;
        let density_g_per_cm3 = 0.6 * aluminium.density_g_per_cm3;
        Ok(Self { name: "aluminium at 60 % density".into(), density_g_per_cm3, ..aluminium })
    }

    /// Linear attenuation coefficient µ (1/mm): photoelectric, coherent and incoherent.
    pub fn attenuation_per_mm(&self, energy_kev: f64) -> Result<f64, AttenuationError> {
        Ok(0.1 * self.density_g_per_cm3 * self.mass_coefficient(energy_kev, |c| &c.total)?)
    }

    /// Mass energy-transfer coefficient µ_tr/ρ (cm²/g), for kerma.
    pub fn transfer_cm2_per_g(&self, energy_kev: f64) -> Result<f64, AttenuationError> {
        self.mass_coefficient(energy_kev, |c| &c.transfer)
    }

    /// Photoelectric, coherent and incoherent mass coefficients (cm²/g).
    pub fn processes_cm2_per_g(&self, energy_kev: f64) -> Result<[f64; 3], AttenuationError> {
        Ok([
            self.mass_coefficient(energy_kev, |c| &c.photo)?,
            self.mass_coefficient(energy_kev, |c| &c.coherent)?,
            self.mass_coefficient(energy_kev, |c| &c.incoherent)?,
        ])
    }

    /// Share of the energy absorbed in breast tissue that its gland gets: w µ_tr/ρ of the gland
    /// over that of gland and fat. 0 for what is no breast tissue.
    pub fn gland_share(&self, energy_kev: f64) -> Result<f64, AttenuationError> {
        let of = |name: &str| -> Result<f64, AttenuationError> {
            let fraction: f64 = self.parts.iter().filter(|p| p.0 == name).map(|p| p.1).sum();
            let part = curve(name)?;
            Ok(fraction * log_log(&part.energy_kev, &part.transfer, energy_kev)?)
        };
        let (gland, fat) = (of(GLAND)?, of(FAT)?);
        Ok(if gland > 0.0 { gland / (gland + fat) } else { 0.0 })
    }

    /// Mass fraction of gland; 0 for what is no breast tissue.
    pub fn glandularity(&self) -> f64 {
        self.parts.iter().filter(|p| p.0 == GLAND).map(|p| p.1).sum()
    }

    /// Mass fractions by element, as indices of [`ELEMENTS`]. Elements beyond that list (traces in
    /// muscle) are left out.
    pub fn elements(&self) -> Result<Vec<(usize, f64)>, AttenuationError> {
        let mut sum = [0.0; ELEMENTS.len()];
        for (name, fraction) in &self.parts {
            let curve = curve(name)?;
            for (sum, share) in sum.iter_mut().zip(curve.elements) {
                *sum += fraction * share;
            }
        }
        Ok(sum.into_iter().enumerate().filter(|(_, share)| *share > 0.0).collect())
    }

    fn mass_coefficient(
        &self,
        energy_kev: f64,
        of: impl Fn(&Curve) -> &[f64],
    ) -> Result<f64, AttenuationError> {
        let mut sum = 0.0;
        for (name, fraction) in &self.parts {
            let curve = curve(name)?;
            sum += fraction * log_log(&curve.energy_kev, of(curve), energy_kev)?;
        }
        Ok(sum)
    }
}

/// Coefficients of one material, ascending in energy. Rows on an absorption edge hold one side of
/// it only: interpolation is smooth across the 0.5 keV that contain the edge.
struct Curve {
    density: f64,
    energy_kev: Vec<f64>,
    total: Vec<f64>,
    photo: Vec<f64>,
    coherent: Vec<f64>,
    incoherent: Vec<f64>,
    transfer: Vec<f64>,
    /// Mass fractions of [`ELEMENTS`].
    elements: [f64; ELEMENTS.len()],
}

/// Elements whose scatter is tabulated, in the order of the columns of form factors.
pub const ELEMENTS: [&str; 13] =
    ["H", "C", "N", "O", "Na", "Mg", "Al", "P", "S", "Cl", "Ar", "K", "Ca"];
const GLAND: &str = "glandular_hammerstein";
const FAT: &str = "adipose_hammerstein";

static CURVES: LazyLock<BTreeMap<&str, Curve>> = LazyLock::new(|| {
    let number = |cell: &str| cell.parse::<f64>().expect("embedded tables hold numbers");
    let mut curves = BTreeMap::new();
    let names: Vec<&str> = tables::header(tables::MATERIALS).collect();
    let column = |element| names.iter().position(|name| *name == element);
    let columns = ELEMENTS.map(|element| column(element).expect("the table has all elements"));
    for row in tables::rows(tables::MATERIALS) {
        let curve = Curve {
            density: number(row[1]),
            energy_kev: Vec::new(),
            total: Vec::new(),
            photo: Vec::new(),
            coherent: Vec::new(),
            incoherent: Vec::new(),
            transfer: Vec::new(),
            elements: columns.map(|column| number(row[column])),
        };
        curves.insert(row[0], curve);
    }
    for row in tables::rows(tables::ATTENUATION) {
        if let Some(curve) = curves.get_mut(row[0]) {
            curve.energy_kev.push(number(row[1]));
            curve.total.push(number(row[2]));
            curve.photo.push(number(row[3]));
            curve.coherent.push(number(row[4]));
            curve.incoherent.push(number(row[5]));
            curve.transfer.push(number(row[6]));
        }
    }
    curves
});

fn names() -> String {
    CURVES.keys().copied().collect::<Vec<_>>().join(", ")
}

fn curve(name: &str) -> Result<&'static Curve, AttenuationError> {
    CURVES.get(name).ok_or_else(|| AttenuationError::Unknown(name.into()))
}

/// Power law between neighbouring energies; never outside of the table.
fn log_log(energies: &[f64], values: &[f64], energy_kev: f64) -> Result<f64, AttenuationError> {
    let (low, high) = (energies[0], energies[energies.len() - 1]);
    if !(low..=high).contains(&energy_kev) {
        return Err(AttenuationError::Energy { energy_kev, low, high });
    }
    let after = energies.partition_point(|&e| e <= energy_kev).clamp(1, energies.len() - 1);
    let part =
        (energy_kev / energies[after - 1]).ln() / (energies[after] / energies[after - 1]).ln();
    Ok(values[after - 1] * (values[after] / values[after - 1]).powf(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_material_has_ascending_energies_over_the_whole_range() {
        for (name, curve) in CURVES.iter() {
            assert!(curve.energy_kev.windows(2).all(|e| e[0] < e[1]), "{name}");
            assert_eq!((curve.energy_kev[0], curve.energy_kev.len()), (5.0, 92), "{name}");
        }
    }

    #[test]
    fn nodes_are_reproduced_and_powers_are_exact_between_them() {
        let aluminium = Material::named("al").unwrap();
        let at_24 = aluminium.attenuation_per_mm(24.0).unwrap();
        assert!((at_24 - 0.1 * 2.699 * 2.05483).abs() < 1e-12);
        let cube = |e: &f64| e.powi(-3);
        let energies = [10.0, 12.0, 20.0];
        let values: Vec<f64> = energies.iter().map(cube).collect();
        for e in [10.0, 11.3, 15.0, 20.0] {
            assert!((log_log(&energies, &values, e).unwrap() / cube(&e) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_mixture_is_the_tabulated_mixture() {
        for (glandularity, name) in [(0.2, "breast_20_80"), (0.5, "breast_50_50")] {
            let (mixed, tabulated) =
                (Material::breast(glandularity).unwrap(), Material::named(name).unwrap());
            for e in [16.8, 24.0, 31.2] {
                let ratio =
                    mixed.attenuation_per_mm(e).unwrap() / tabulated.attenuation_per_mm(e).unwrap();
                assert!((ratio - 1.0).abs() < 1e-4, "{name} {e} keV: {ratio}");
            }
        }
    }

    #[test]
    fn nothing_is_extrapolated() {
        let water = Material::named("water").unwrap();
        assert!(matches!(water.attenuation_per_mm(4.9), Err(AttenuationError::Energy { .. })));
        assert!(matches!(water.attenuation_per_mm(50.1), Err(AttenuationError::Energy { .. })));
        assert!(matches!(water.attenuation_per_mm(f64::NAN), Err(AttenuationError::Energy { .. })));
        assert!(water.attenuation_per_mm(50.0).is_ok());
        let unknown = Material::named("chalk").unwrap_err().to_string();
        assert!(unknown.contains("polycarbonate"), "{unknown}");
        assert!(Material::breast(20.0).is_err());
    }
}
