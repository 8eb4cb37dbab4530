//! T2-weighted magnitude images of a body that is given as a function of place.
//!
//! A voxel averages the substances in it (partial volume, 2×2×2 samples where its neighbours
//! differ), is textured by noise that moves with the tissue, shaded by the coil, and gets the
//! Rician noise of a magnitude image (Gudbjartsson & Patz 1995,
//! <https://doi.org/10.1002/mrm.1910340618>).

mod coil;
pub mod noise;
mod substance;

pub use coil::Coil;
use noise::Smooth;
pub use substance::Substance;

use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Tissue},
    progress::Progress,
    volume::{Grid, Volume},
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What is at a place.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// What the scanner sees.
    pub substance: Substance,
    /// What an anatomist would call it.
    pub tissue: Tissue,
    /// The material point (mm) to which texture is attached.
    pub material: Vec3,
}

/// How the picture is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// Receive coil.
    pub coil: Coil,
    /// Stored value of fat under a sensitivity of 1.
    pub fat: f64,
    /// Standard deviation of each of the two noise channels, in stored values.
    pub noise: f64,
    /// Seed of the noise; another one for each picture.
    pub noise_seed: u64,
    /// Seed of the texture; the same for all pictures of a person.
    pub texture_seed: u64,
}

/// A picture and what is truly in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Magnitude image; whole values that a 16-bit integer holds.
    pub magnitude: Volume<f32>,
    /// Tissue at the centre of each voxel.
    pub labels: LabelMap,
}

/// Slices of one task; a fixed number, so that threads change nothing.
const SLICES: usize = 12;

/// Takes a picture of `body` on `grid`.
pub fn scan(
    grid: &Grid,
    scan: &Scan,
    body: &(impl Fn(&Vec3) -> Sample + Sync),
    progress: &dyn Progress,
) -> Picture {
    let mut magnitude = Volume::filled(grid.clone(), 0f32);
    let mut labels = Volume::filled(grid.clone(), Tissue::Background);
    let slice = grid.shape[0] * grid.shape[1];
    let done = AtomicUsize::new(0);
    let tasks = magnitude
        .values
        .par_chunks_mut(SLICES * slice)
        .zip(labels.values.par_chunks_mut(SLICES * slice));
    tasks.enumerate().for_each(|(task, (values, tissues))| {
        take_slices(grid, scan, body, task * SLICES, values, tissues);
        let finished = done.fetch_add(SLICES, Ordering::Relaxed) + SLICES;
        progress.report(finished as f64 / grid.shape[2] as f64, "taking the picture");
    });
    Picture { magnitude, labels }
}

/// Fills a run of slices that begins at slice `first`.
fn take_slices(
    grid: &Grid,
    scan: &Scan,
    body: &impl Fn(&Vec3) -> Sample,
    first: usize,
    values: &mut [f32],
    tissues: &mut [Tissue],
) {
    let [ni, nj, nk] = grid.shape;
    let slice = ni * nj;
    let mut texture = Texture::new(scan.texture_seed);
    let plane = |k: usize| -> Vec<Sample> {
        (0..slice).map(|n| body(&grid.center([n % ni, n / ni, k]))).collect()
    };
    // Rolling window over the slices below, at, and above; the border repeats itself.
    let mut here = plane(first);
    let mut below = if first > 0 { plane(first - 1) } else { here.clone() };
    for (offset, (values, tissues)) in
        values.chunks_mut(slice).zip(tissues.chunks_mut(slice)).enumerate()
    {
        let k = first + offset;
        let above = if k + 1 < nk { plane(k + 1) } else { here.clone() };
        for n in 0..slice {
            let [i, j] = [n % ni, n / ni];
            let sample = &here[n];
            tissues[n] = sample.tissue;
            let same = |other: &Sample| other.substance == sample.substance;
            let pure = same(&below[n])
                && same(&above[n])
                && same(&here[n - usize::from(i > 0)])
                && same(&here[n + usize::from(i + 1 < ni)])
                && same(&here[if j > 0 { n - ni } else { n }])
                && same(&here[if j + 1 < nj { n + ni } else { n }]);
            let place = grid.center([i, j, k]);
            let signal = if pure {
                texture.brightness(sample)
            } else {
                let mut sum = 0.0;
                for corner in 0..8 {
                    let quarter = |bit: usize| if corner >> bit & 1 == 1 { 0.25 } else { -0.25 };
                    let shift = grid.axes * Vec3::new(quarter(0), quarter(1), quarter(2));
                    sum += texture.brightness(&body(&(place + shift)));
                }
                sum / 8.0
            };
            let seen = signal * scan.coil.sensitivity(&place) * scan.fat;
            let noise = noise::normal_pair(scan.noise_seed, grid.index([i, j, k]) as u64);
            let [real, imaginary] = [seen + scan.noise * noise[0], scan.noise * noise[1]];
            values[n] = real.hypot(imaginary).round().min(f64::from(i16::MAX)) as f32;
        }
        below = std::mem::replace(&mut here, above);
    }
}

/// What textures a picture: grains, and septa of fat.
struct Texture {
    grains: [Smooth; 2],
    sheets: Smooth,
    strength: Smooth,
}

impl Texture {
    fn new(seed: u64) -> Self {
        Self {
            grains: [Smooth::new(seed, 2.5), Smooth::new(seed ^ 1, 7.0)],
            sheets: Smooth::new(seed ^ 2, 15.0),
            strength: Smooth::new(seed ^ 3, 20.0),
        }
    }

    /// Signal of a point relative to fat, with the texture of its tissue.
    fn brightness(&mut self, sample: &Sample) -> f64 {
        let amplitude = sample.substance.texture();
        if amplitude == 0.0 {
            return sample.substance.signal();
        }
        let at = &sample.material;
        let [fine, coarse] = &mut self.grains;
        let grain = fine.at(at) + 1.4 * coarse.at(at);
        let mut signal = sample.substance.signal() * (1.0 + amplitude * grain).max(0.0);
        if sample.substance == Substance::Fat {
            // Fibrous septa: thin dark sheets where a slow noise crosses zero.
            let sheet = 1.0 - self.sheets.at(at).abs() / 0.05;
            let strength = (0.5 + self.strength.at(at)).clamp(0.0, 1.0);
            signal *= 1.0 - 0.55 * strength * sheet.max(0.0);
        }
        signal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::progress::Silent;

    fn ball(place: &Vec3) -> Sample {
        let inside = place.norm() < 12.0;
        let substance = if inside { Substance::Skin } else { Substance::Air };
        let tissue = if inside { Tissue::Skin } else { Tissue::Background };
        Sample { substance, tissue, material: *place }
    }

    fn quiet() -> Scan {
        let coil = Coil { centers: vec![], reach_mm: 1.0, floor: 1.0 };
        Scan { coil, fat: 1000.0, noise: 0.0, noise_seed: 1, texture_seed: 2 }
    }

    #[test]
    fn partial_volume_conserves_the_signal_of_a_ball() {
        let grid = Grid::aligned([33, 31, 35], [1.0, 1.1, 0.9], Vec3::new(-16.2, -16.4, -15.1));
        let picture = scan(&grid, &quiet(), &ball, &Silent);
        let sum: f64 = picture.magnitude.values.iter().map(|&v| f64::from(v)).sum();
        // The texture does not average to nothing over so small a ball: integrate it, too.
        let fine = Grid::aligned([100; 3], [0.25; 3], Vec3::from_element(-12.375));
        let mut texture = Texture::new(quiet().texture_seed);
        let exact: f64 =
            (0..fine.len()).map(|n| texture.brightness(&ball(&fine.center(fine.voxel(n))))).sum();
        let ratio = sum * grid.voxel_mm3() / (1000.0 * exact * fine.voxel_mm3());
        assert!((ratio - 1.0).abs() < 0.003, "signal of the picture over the true one: {ratio}");
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 12f64.powi(3);
        let mean = exact * fine.voxel_mm3() / volume / Substance::Skin.signal();
        assert!((mean - 1.0).abs() < 0.03, "mean signal {mean}");
    }

    #[test]
    fn the_same_picture_comes_from_any_number_of_threads() {
        let grid = Grid::aligned([20, 20, 25], [1.5; 3], Vec3::from_element(-15.0));
        let noisy = Scan { noise: 20.0, ..quiet() };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| scan(&grid, &noisy, &ball, &Silent))
        };
        assert_eq!(on(1), on(2));
    }

    #[test]
    fn air_is_rayleigh_distributed() {
        let grid = Grid::aligned([60, 60, 20], [1.0; 3], Vec3::from_element(100.0));
        let picture = scan(&grid, &Scan { noise: 20.0, ..quiet() }, &ball, &Silent);
        let count = picture.magnitude.values.len() as f64;
        let mean = picture.magnitude.values.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
        let expected = 20.0 * (std::f64::consts::PI / 2.0).sqrt();
        assert!((mean - expected).abs() < 0.3, "mean {mean}, Rayleigh {expected}");
    }
}
