//! What the detector makes of the photons that reach it.

use crate::xray::mtf::Scintillator;
use mammotwin_data::radiograph::Radiograph;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};
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
}

impl Detector {
    /// The published curve of the Senographe Essential: none of the Pristina was found.
    pub fn essential() -> Self {
        let scintillator = Scintillator::published("GE_Senographe_Essential");
        Self { scintillator, noise: Noise::AfterLight }
    }

    /// The mean picture of a mean number of absorbed quanta, and one noisy picture of it.
    pub fn read(&self, quanta: &Radiograph, seed: u64) -> [Radiograph; 2] {
        let spread = |picture: &Radiograph| match &self.scintillator {
            Some(light) => light.spread(picture.pitch_mm).apply(picture),
            None => picture.clone(),
        };
        let signal = spread(quanta);
        let noisy = match self.noise {
            Noise::AfterLight => draw(&signal, seed),
            Noise::BeforeLight => spread(&draw(quanta, seed)),
        };
        [signal, noisy]
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
