//! Angles of scatter: Klein-Nishina with binding, and Rayleigh with form factors.

use crate::xray::attenuation::{AttenuationError, ELEMENTS, Material};
use mammotwin_data::tables;
use rand::Rng;
use std::sync::LazyLock;

/// h c (keV Å): x = sin(θ/2) E / (h c).
const HC_KEV_ANGSTROM: f64 = 12.398_42;
/// Rest energy of the electron (keV).
const ELECTRON_KEV: f64 = 510.998_95;
/// Step of the momentum transfer x (1/Å) of the fine tables.
const STEP: f64 = 0.005;
/// Cells of the fine tables: up to 4.1 per Å, above what 50 keV can give.
const CELLS: usize = 820;

/// Scatter in one material. Atoms are independent: neither molecules nor the motion of the
/// electrons (Doppler broadening) are known.
#[derive(Debug, Clone)]
pub struct Angles {
    /// Incoherent scattering function Σ w S / A by x, relative.
    incoherent: Vec<f32>,
    /// ∫ Σ w F² / A d(x²), relative, by x.
    coherent: Vec<f64>,
}

impl Angles {
    /// Tabulates a material.
    pub fn of(material: &Material) -> Result<Self, AttenuationError> {
        let parts = material.elements()?;
        let sum = |table: &Table, x: f64, power: i32| -> f64 {
            let of = |(element, fraction): &(usize, f64)| {
                fraction / MASSES[*element] * table.at(x, *element).powi(power)
            };
            parts.iter().map(of).sum()
        };
        let incoherent = (0..=CELLS + 1)
            .map(|n| sum(&INCOHERENT_FUNCTION, (n as f64 * STEP).min(X_TOP), 1) as f32)
            .collect();
        let mut coherent = vec![0.0];
        for n in 0..CELLS {
            // Simpson in x: ∫ F² 2x dx.
            let of = |at: f64| {
                let x = (n as f64 + at) * STEP;
                2.0 * x * sum(&FORM_FACTOR, x.min(X_TOP), 2)
            };
            let cell = STEP / 6.0 * (of(0.0) + 4.0 * of(0.5) + of(1.0));
            coherent.push(coherent[n] + cell);
        }
        Ok(Self { incoherent, coherent })
    }

    /// Cosine of the angle of an incoherent scatter and the energy (keV) after it: the
    /// Klein-Nishina formula times the incoherent scattering function, by rejection.
    #[inline]
    pub fn incoherent(&self, energy_kev: f64, random: &mut impl Rng) -> (f64, f64) {
        let alpha = energy_kev / ELECTRON_KEV;
        let x_back = energy_kev / HC_KEV_ANGSTROM;
        // S rises with x, and the formula is 2 at most, forwards.
        let bound = 2.0 * self.binding(x_back);
        loop {
            let cosine = 2.0 * random.random::<f64>() - 1.0;
            let left = 1.0 / (1.0 + alpha * (1.0 - cosine));
            let formula = left * left * (left + 1.0 / left - 1.0 + cosine * cosine);
            let binding = self.binding(x_back * (0.5 * (1.0 - cosine)).sqrt());
            if random.random::<f64>() * bound <= formula * binding {
                return (cosine, energy_kev * left);
            }
        }
    }

    #[inline]
    fn binding(&self, x: f64) -> f64 {
        let place = x / STEP;
        let cell = (place as usize).min(CELLS);
        let [low, high] = [cell, cell + 1].map(|n| f64::from(self.incoherent[n]));
        low + (place - cell as f64) * (high - low)
    }

    /// Cosine of the angle of a coherent scatter: F² by the inverse of its integral over x²,
    /// Thomson's 1 + cos² by rejection.
    #[inline]
    pub fn coherent(&self, energy_kev: f64, random: &mut impl Rng) -> f64 {
        let back = energy_kev / HC_KEV_ANGSTROM;
        let place = (back / STEP).min(CELLS as f64 - 1e-9);
        let cell = place as usize;
        let square = |n: usize| (n as f64 * STEP) * (n as f64 * STEP);
        // F² is constant within a cell: its integral is linear in x².
        let part = (back * back - square(cell)) / (square(cell + 1) - square(cell));
        let all = self.coherent[cell] + part * (self.coherent[cell + 1] - self.coherent[cell]);
        loop {
            let wanted = random.random::<f64>() * all;
            let cell = self.coherent[..=cell].partition_point(|&sum| sum <= wanted) - 1;
            let [low, high] = [self.coherent[cell], self.coherent[cell + 1]];
            let part = (wanted - low) / (high - low);
            let x2 = square(cell) + part * (square(cell + 1) - square(cell));
            let cosine = (1.0 - 2.0 * x2 / (back * back)).max(-1.0);
            if 2.0 * random.random::<f64>() <= 1.0 + cosine * cosine {
                return cosine;
            }
        }
    }
}

/// Last momentum transfer of the tables (1/Å).
const X_TOP: f64 = 4.1;

/// Values by momentum transfer and element.
struct Table {
    x: Vec<f64>,
    rows: Vec<Vec<f64>>,
}

/// Atomic masses (g/mol) of [`ELEMENTS`], IUPAC, abridged.
const MASSES: [f64; ELEMENTS.len()] = [
    1.008, 12.011, 14.007, 15.999, 22.990, 24.305, 26.982, 30.974, 32.06, 35.45, 39.95, 39.098,
    40.078,
];

static FORM_FACTOR: LazyLock<Table> = LazyLock::new(|| Table::of(tables::FORM_FACTOR));
static INCOHERENT_FUNCTION: LazyLock<Table> =
    LazyLock::new(|| Table::of(tables::INCOHERENT_FUNCTION));

impl Table {
    fn of(text: &'static str) -> Self {
        let number = |cell: &&str| cell.parse::<f64>().expect("embedded tables hold numbers");
        let all: Vec<Vec<f64>> =
            tables::rows(text).map(|row| row.iter().map(number).collect()).collect();
        Self {
            x: all.iter().map(|row| row[0]).collect(),
            rows: all.iter().map(|row| row[1..].to_vec()).collect(),
        }
    }

    /// Linear between the nodes, which are 6 % apart.
    fn at(&self, x: f64, element: usize) -> f64 {
        let after = self.x.partition_point(|&node| node <= x).clamp(1, self.x.len() - 1);
        let part = (x - self.x[after - 1]) / (self.x[after] - self.x[after - 1]);
        let [low, high] = [after - 1, after].map(|n| self.rows[n][element]);
        low + part * (high - low)
    }
}
