//! What the detector makes of the photons that reach it.

use crate::xray::mtf::Scintillator;
use mammotwin_data::radiograph::Radiograph;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson, StandardNormal};
use rayon::prelude::*;

/// Where quantum noise arises.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Noise {
    /// After the spread of light: white noise of the spread signal. The thesis filters the
    /// detected beam and then draws it: its SD of SDNR at 0.2 mm (0.53 - 0.57) is that of the mean of
    /// π independent pixels, 0.56.
    #[default]
    AfterLight,
    /// When photons are absorbed: light spreads the noise as it spreads the signal, as in a real
    /// scintillator; neighbours are correlated.
    BeforeLight,
}

/// An indirect flat panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Detector {
    /// Spread of light; none when absent.
    pub scintillator: Option<Scintillator>,
    /// Where quantum noise arises.
    pub noise: Noise,
    /// Electronic noise of a pixel (quanta, root mean square).
    pub electronic_noise: f64,
    /// Share of the picture before that is left in a picture.
    pub lag: f64,
}

impl Detector {
    /// The published curve of the Senographe Essential: none of the Pristina was found.
    pub fn essential() -> Self {
        let scintillator = Scintillator::published("GE_Senographe_Essential");
        Self { scintillator, noise: Noise::AfterLight, electronic_noise: 0.0, lag: 0.0 }
    }

    /// The mean picture of a mean number of absorbed quanta, and one noisy picture of it.
    pub fn read(&self, quanta: &Radiograph, seed: u64) -> [Radiograph; 2] {
        let spread = |picture: &Radiograph| match &self.scintillator {
            Some(light) => light.spread(picture.pitch_mm).apply(picture),
            None => picture.clone(),
        };
        let signal = spread(quanta);
        let mut noisy = match self.noise {
            Noise::AfterLight => draw(&signal, seed),
            Noise::BeforeLight => spread(&draw(quanta, seed)),
        };
        if self.electronic_noise > 0.0 {
            self.amplify(&mut noisy, seed);
        }
        [signal, noisy]
    }

    /// Adds the noise of the electronics: white, Gaussian, in streams beyond those of the quanta. Pixels
    /// may fall below zero, as they do before an offset is added.
    fn amplify(&self, picture: &mut Radiograph, seed: u64) {
        let first = picture.rows as u64;
        picture.pixels.par_chunks_mut(picture.columns).enumerate().for_each(|(row, pixels)| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(first + row as u64);
            for pixel in pixels {
                let normal: f64 = StandardNormal.sample(&mut random);
                *pixel += (self.electronic_noise * normal) as f32;
            }
        });
    }

    /// Adds what is left of the picture before, as that one was read.
    pub fn remember(&self, picture: &mut Radiograph, before: &Radiograph) {
        for (pixel, ghost) in picture.pixels.iter_mut().zip(&before.pixels) {
            *pixel += (self.lag * f64::from(*ghost)) as f32;
        }
    }

    /// Variance of a pixel over its mean number of quanta, under uniform light.
    pub fn noise_power(&self, pitch_mm: f64) -> f64 {
        match (self.noise, &self.scintillator) {
            (Noise::BeforeLight, Some(light)) => light.spread(pitch_mm).noise_power(),
            _ => 1.0,
        }
    }
}

/// Each pixel a Poisson number of its mean. Every row has its own stream of random numbers: the
/// picture does not depend on the number of threads.
pub fn draw(mean: &Radiograph, seed: u64) -> Radiograph {
    let mut drawn = mean.clone();
    drawn.pixels.par_chunks_mut(mean.columns).enumerate().for_each(|(row, pixels)| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(row as u64);
        for pixel in pixels {
            // No distribution where there are no quanta: zero is sure.
            let quanta = Poisson::new(f64::from(*pixel)).map_or(0.0, |p| p.sample(&mut random));
            *pixel = quanta as f32;
        }
    });
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xray::geometry::Geometry;

    fn flat(rows: usize, columns: usize, quanta: f32) -> Radiograph {
        let geometry = Geometry { source_height_mm: 660.0, columns, rows, pitch_mm: 0.1 };
        geometry.picture(vec![quanta; rows * columns], "quanta")
    }

    fn moments(picture: &Radiograph) -> [f64; 2] {
        let count = picture.pixels.len() as f64;
        let mean = picture.pixels.iter().map(|&p| f64::from(p)).sum::<f64>() / count;
        let square = |&p: &f32| (f64::from(p) - mean).powi(2);
        [mean, picture.pixels.iter().map(square).sum::<f64>() / count]
    }

    #[test]
    fn quanta_are_poisson_at_any_level() {
        // 250 000 pixels: the mean is known within 0.2 % of an SD, the variance within 0.3 %.
        for level in [0.5f32, 4.0, 150.0, 17_424.0] {
            let [mean, variance] = moments(&draw(&flat(500, 500, level), 3));
            let wanted = f64::from(level);
            assert!((mean - wanted).abs() < 4.0 * (wanted / 250_000.0).sqrt(), "{mean} {wanted}");
            let kurtosis = (2.0 + 1.0 / wanted).sqrt() / 500.0;
            assert!((variance / wanted - 1.0).abs() < 4.0 * kurtosis, "{variance} {wanted}");
        }
        assert_eq!(moments(&draw(&flat(10, 10, 0.0), 3)), [0.0, 0.0]);
    }

    #[test]
    fn without_light_spread_snr_is_the_root_of_the_quanta() {
        let bare = Detector { scintillator: None, ..Detector::essential() };
        let [_, noisy] = bare.read(&flat(400, 400, 10_000.0), 1);
        let [mean, variance] = moments(&noisy);
        assert!((mean / variance.sqrt() / 100.0 - 1.0).abs() < 0.01);
    }

    /// Variances add: quanta and electronics.
    #[test]
    fn electronic_noise_adds_its_variance_and_lag_its_share() {
        let level = 900.0f32;
        let noisy = |electronic_noise: f64| {
            let bare = Detector { scintillator: None, electronic_noise, ..Detector::essential() };
            let [_, noisy] = bare.read(&flat(500, 500, level), 4);
            noisy
        };
        let [mean, variance] = moments(&noisy(40.0));
        assert!((mean - 900.0).abs() < 4.0 * (2500.0f64 / 250_000.0).sqrt(), "{mean}");
        assert!((variance / (900.0 + 1600.0) - 1.0).abs() < 0.012, "{variance}");
        assert_eq!(noisy(0.0), draw(&flat(500, 500, level), 4));

        let mut after = flat(3, 4, 100.0);
        let before = flat(3, 4, 700.0);
        Detector { lag: 0.02, ..Detector::essential() }.remember(&mut after, &before);
        assert!(after.pixels.iter().all(|&p| (p - 114.0).abs() < 1e-4));
    }

    #[test]
    fn light_spreads_noise_that_arises_before_it() {
        let mut detector = Detector::essential();
        for noise in [Noise::AfterLight, Noise::BeforeLight] {
            detector.noise = noise;
            let [_, noisy] = detector.read(&flat(600, 600, 10_000.0), 2);
            let power = moments(&noisy)[1] / 10_000.0;
            assert!((power / detector.noise_power(0.1) - 1.0).abs() < 0.02, "{noise:?}: {power}");
        }
    }

    #[test]
    fn a_seed_gives_the_same_bits_for_any_number_of_threads() {
        let level = flat(130, 170, 900.0);
        let with = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Detector::essential().read(&level, seed))
        };
        assert_eq!(with(1, 5), with(2, 5));
        assert_ne!(with(1, 5)[1], with(1, 6)[1]);
    }
}
