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

    /// Transfer at a frequency (line pairs per mm): exp(-f²/q(f)) with the polynomial q that meets
    /// all points. It is a Gaussian at low frequencies, as a spread of finite width must be, and
    /// smooth, so that the spread dies away within a few pixels.
    pub fn transfer(&self, frequency: f64) -> f64 {
        let lagrange = |(n, [f, value]): (usize, &[f64; 2])| {
            let others = self.points.iter().enumerate().filter(|(m, _)| *m != n);
            let basis: f64 = others.map(|(_, [g, _])| (frequency - g) / (f - g)).product();
            -f * f / value.ln() * basis
        };
        let q: f64 = self.points.iter().enumerate().map(lagrange).sum();
        (-frequency * frequency / q).exp()
    }

    /// A scintillator whose light spreads further: by a Gaussian of this standard deviation (mm).
    pub fn blurred(&self, sigma_mm: f64) -> Self {
        let more = |f: f64| (-2.0 * (PI * sigma_mm * f).powi(2)).exp();
        let points = self.points.iter().map(|&[f, value]| [f, value * more(f)]).collect();
        Self { name: self.name.clone(), points }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn essential() -> Scintillator {
        Scintillator::published("GE_Senographe_Essential").unwrap()
    }

    #[test]
    fn published_points_are_reproduced_with_the_pixel_aperture() {
        for (frequency, value) in [(0.0, 1.0), (1.0, 0.85), (2.0, 0.59), (4.0, 0.24)] {
            assert!((essential().presampled(frequency, 0.1) - value).abs() < 1e-12);
        }
        let curve: Vec<f64> = (0..100).map(|n| essential().transfer(0.1 * n as f64)).collect();
        assert!(curve.windows(2).all(|pair| pair[1] < pair[0]));
        assert!(Scintillator::published("Pristina").is_none());
    }

    /// Presampled transfer as IEC 62220-1 measures it: a straight edge, slanted to the pixels,
    /// gives an edge profile finer than the pixels; its derivative's spectrum is the transfer.
    #[test]
    fn a_slanted_edge_measures_the_published_curve() {
        let (columns, rows, pitch_mm, slope) = (128usize, 300usize, 0.1, 0.0437);
        // Exact share of each pixel on the bright side of x = x0 + slope y.
        let covered = |row: usize, column: usize| {
            let fine = 64;
            let share = |k: usize| {
                let y = row as f64 + (k as f64 + 0.5) / fine as f64 - 0.5;
                (column as f64 + 0.5 - (55.27 + slope * y)).clamp(0.0, 1.0)
            };
            (0..fine).map(share).sum::<f64>() / fine as f64
        };
        let pixels =
            (0..rows * columns).map(|n| 1e4 * covered(n / columns, n % columns) as f32).collect();
        let edge = Radiograph {
            columns,
            rows,
            pitch_mm,
            left_mm: 0.0,
            first_row_mm: 0.0,
            pixels,
            quantity: "edge".into(),
        };
        let blurred = essential().spread(pitch_mm).apply(&edge);
        // Mean of the signal in bins of a tenth of a pixel across the edge.
        let (bins, per_pixel) = (800usize, 10.0);
        let mut profile = vec![(0.0, 0usize); bins];
        for n in 10 * columns..(rows - 10) * columns {
            let (row, column) = ((n / columns) as f64, (n % columns) as f64);
            let across = (column - 55.27 - slope * row) / (1.0f64 + slope * slope).sqrt();
            let bin = (across * per_pixel).floor() + bins as f64 / 2.0;
            if (0.0..bins as f64).contains(&bin) {
                let (sum, count) = &mut profile[bin as usize];
                *sum += f64::from(blurred.pixels[n]);
                *count += 1;
            }
        }
        assert!(profile.iter().all(|bin| bin.1 > 0));
        let profile: Vec<f64> = profile.iter().map(|(sum, count)| sum / *count as f64).collect();
        let measured = |frequency: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (n, pair) in profile.windows(2).enumerate() {
                let phase = 2.0 * PI * frequency * n as f64 * pitch_mm / per_pixel;
                re += (pair[1] - pair[0]) * phase.cos();
                im += (pair[1] - pair[0]) * phase.sin();
            }
            // Bins and differences are apertures of their own.
            let own = aperture(frequency, pitch_mm / per_pixel).powi(2);
            f64::hypot(re, im) / 1e4 / own
        };
        for frequency in [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 4.5] {
            let (got, wanted) = (measured(frequency), essential().presampled(frequency, pitch_mm));
            assert!((got - wanted).abs() < 0.005, "{frequency} lp/mm: {got} {wanted}");
        }
    }

    #[test]
    fn a_flat_picture_stays_flat_to_its_border() {
        let flat = Radiograph {
            columns: 30,
            rows: 20,
            pitch_mm: 0.1,
            left_mm: 0.0,
            first_row_mm: 0.0,
            pixels: vec![17_424.0; 600],
            quantity: "flat".into(),
        };
        let spread = essential().spread(0.1);
        assert!(spread.apply(&flat).pixels.iter().all(|p| (p / 17_424.0 - 1.0).abs() < 1e-5));
        assert!((0.1..0.4).contains(&spread.noise_power()), "{}", spread.noise_power());
    }
}
