//! How far light spreads in the scintillator.

use mammotwin_data::{radiograph::Radiograph, tables};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels from the centre of the spread to its rim.
const RADIUS: usize = 8;
/// Samples of the transfer function along one axis, up to half a cycle per pixel.
const SAMPLES: usize = 128;

/// Modulation transfer of the light in a scintillator, alike in all directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Scintillator {
    /// Name of the detector.
    pub name: String,
    /// Frequency (line pairs per mm), ascending, and transfer of the light alone.
    pub points: Vec<[f64; 2]>,
}

impl Scintillator {
    /// A detector of the table of published curves: `GE_Senographe_Essential` or
    /// `GE_Senographe_DS`; `None` for others. The published curves are presampled and hold the
    /// 0.1 mm aperture of the pixels, which is divided out.
    pub fn published(name: &str) -> Option<Self> {
        let number = |cell: &str| cell.parse::<f64>().expect("embedded tables hold numbers");
        let points: Vec<[f64; 2]> = tables::rows(tables::DETECTOR_MTF)
            .filter(|row| row[0] == name && row[1] == "MTF")
            .map(|row| (number(row[2]), number(row[3])))
            .map(|(frequency, value)| [frequency, value / aperture(frequency, 0.1)])
            .collect();
        (!points.is_empty()).then(|| Self { name: name.into(), points })
    }

    /// Transfer at a frequency (line pairs per mm): between the points the logarithm is linear in
    /// the square of the frequency (a Gaussian), and beyond the last point it goes on.
    pub fn transfer(&self, frequency: f64) -> f64 {
        let mut from = [0.0, 0.0];
        let mut slope = 0.0;
        for [f, value] in &self.points {
            let to = [f * f, value.ln()];
            slope = (to[1] - from[1]) / (to[0] - from[0]);
            if frequency <= *f {
                break;
            }
            from = to;
        }
        (from[1] + slope * (frequency * frequency - from[0])).exp()
    }

    /// Transfer of scintillator and pixel aperture together.
    pub fn presampled(&self, frequency: f64, pitch_mm: f64) -> f64 {
        self.transfer(frequency) * aperture(frequency, pitch_mm)
    }

    /// The spread on pixels of this pitch: the inverse Fourier transform of the transfer over
    /// the frequencies that the pixels can hold, cut at 8 pixels and scaled to sum to 1.
    pub fn spread(&self, pitch_mm: f64) -> Spread {
        let cycles = |s: usize| 0.5 * (s as f64 + 0.5) / SAMPLES as f64;
        let wave = |m: usize, s: usize| (2.0 * PI * m as f64 * cycles(s)).cos();
        // One axis after the other: half[m][v] = Σᵤ T(u, v) cos 2πmu.
        let mut half = vec![[0.0; SAMPLES]; RADIUS + 1];
        for (v, u) in (0..SAMPLES).flat_map(|v| (0..SAMPLES).map(move |u| (v, u))) {
            let transfer = self.transfer(cycles(u).hypot(cycles(v)) / pitch_mm);
            for (m, half) in half.iter_mut().enumerate() {
                half[v] += transfer * wave(m, u);
            }
        }
        let side = 2 * RADIUS + 1;
        let tap = |n: usize| {
            let [m, k] = [n % side, n / side].map(|at| at.abs_diff(RADIUS));
            (0..SAMPLES).map(|v| half[m][v] * wave(k, v)).sum::<f64>()
        };
        let taps: Vec<f64> = (0..side * side).map(tap).collect();
        let sum: f64 = taps.iter().sum();
        Spread { taps: taps.iter().map(|tap| tap / sum).collect() }
    }
}

/// Transfer of a square pixel: sin πfa / πfa.
fn aperture(frequency: f64, side_mm: f64) -> f64 {
    let x = PI * frequency * side_mm;
    if x == 0.0 { 1.0 } else { x.sin() / x }
}

/// Share of a pixel's light that its neighbours get.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Square of 17 x 17, symmetric, of sum 1.
    taps: Vec<f64>,
}

impl Spread {
    /// Variance of a spread white noise over that before: Σ tap².
    pub fn noise_power(&self) -> f64 {
        self.taps.iter().map(|tap| tap * tap).sum()
    }

    /// Spreads a picture. Beyond its border lies what lies on the border.
    pub fn apply(&self, picture: &Radiograph) -> Radiograph {
        let (rows, columns) = (picture.rows, picture.columns);
        let side = 2 * RADIUS + 1;
        // Lines with RADIUS more pixels on both ends.
        let width = columns + 2 * RADIUS;
        let mut padded = vec![0f32; rows * width];
        padded.par_chunks_mut(width).zip(picture.pixels.par_chunks(columns)).for_each(
            |(to, from)| {
                to[..RADIUS].fill(from[0]);
                to[RADIUS..RADIUS + columns].copy_from_slice(from);
                to[RADIUS + columns..].fill(from[columns - 1]);
            },
        );
        let mut pixels = vec![0f32; rows * columns];
        pixels.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
            for (n, &tap) in self.taps.iter().enumerate() {
                let line = (row + n / side).saturating_sub(RADIUS).min(rows - 1);
                let from = &padded[line * width + n % side..][..columns];
                for (out, from) in out.iter_mut().zip(from) {
                    *out += tap as f32 * from;
                }
            }
        });
        Radiograph { pixels, ..frame(picture) }
    }
}

/// The same picture without pixels.
fn frame(picture: &Radiograph) -> Radiograph {
    Radiograph { pixels: Vec::new(), quantity: picture.quantity.clone(), ..*picture }
}
