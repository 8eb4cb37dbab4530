//! Counter-based noise: the value at a place depends on the place and a seed alone.

use mammotwin_data::Vec3;

/// Mixes a counter into 64 random bits (the finalizer of SplitMix64; Steele et al. 2014,
/// <https://doi.org/10.1145/2660193.2660195>).
pub fn mix(counter: u64) -> u64 {
    let mut z = counter.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Uniform in (0, 1) from 64 random bits; never 0 or 1.
fn unit(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) / (1u64 << 52) as f64
}

/// Two independent standard normal numbers of a counter (Box-Muller).
pub fn normal_pair(seed: u64, counter: u64) -> [f64; 2] {
    let first = mix(seed ^ mix(counter));
    let radius = (-2.0 * unit(first).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * unit(mix(first))).sin_cos();
    [radius * cos, radius * sin]
}

/// Smooth noise in -1..1 with features about `scale_mm` across: random values on a cubic
/// lattice, blended with a C1 weight.
pub fn smooth(seed: u64, place: &Vec3, scale_mm: f64) -> f64 {
    Smooth::new(seed, scale_mm).at(place)
}

/// The same for many places: what is drawn for the corners of a cell is kept while places stay in it.
#[derive(Debug, Clone)]
pub struct Smooth {
    seed: u64,
    scale_mm: f64,
    /// Lower corner of the cell; no number before the first place.
    cell: Vec3,
    corners: [f64; 8],
}

impl Smooth {
    /// Features about `scale_mm` across.
    pub fn new(seed: u64, scale_mm: f64) -> Self {
        Self { seed, scale_mm, cell: Vec3::repeat(f64::NAN), corners: [0.0; 8] }
    }

    /// The value at a place.
    pub fn at(&mut self, place: &Vec3) -> f64 {
        let scaled = place / self.scale_mm;
        let low = scaled.map(f64::floor);
        if low != self.cell {
            self.enter(low);
        }
        let part = (scaled - low).map(|t| t * t * (3.0 - 2.0 * t));
        let mut sum = 0.0;
        for (n, value) in self.corners.iter().enumerate() {
            let mut weight = *value;
            for axis in 0..3 {
                weight *= if n >> axis & 1 == 1 { part[axis] } else { 1.0 - part[axis] };
            }
            sum += weight;
        }
        sum
    }

    fn enter(&mut self, low: Vec3) {
        self.cell = low;
        let corner = |axis: usize, up: i64| ((low[axis] as i64 + up) as u64) & 0x1F_FFFF;
        for (n, value) in self.corners.iter_mut().enumerate() {
            let up = |axis: usize| (n >> axis & 1) as i64;
            let key = corner(0, up(0)) | corner(1, up(1)) << 21 | corner(2, up(2)) << 42;
            *value = 2.0 * unit(mix(self.seed ^ mix(key))) - 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_the_moments_of_a_normal_distribution() {
        let count = 200_000;
        let all: Vec<f64> = (0..count / 2).flat_map(|n| normal_pair(7, n)).collect();
        let moment = |power: i32| all.iter().map(|v| v.powi(power)).sum::<f64>() / count as f64;
        // Five standard errors each.
        let error = 5.0 / (count as f64).sqrt();
        assert!(moment(1).abs() < error);
        assert!((moment(2) - 1.0).abs() < error * 2f64.sqrt());
        assert!(moment(3).abs() < error * 15f64.sqrt());
        assert!((moment(4) - 3.0).abs() < error * 96f64.sqrt());
    }

    #[test]
    fn what_is_kept_of_a_cell_changes_nothing() {
        let mut kept = Smooth::new(5, 3.0);
        for n in 0..400 {
            let t = f64::from(n);
            let place = Vec3::new(0.37 * t - 40.0, 9.0 * (0.1 * t).sin(), 0.11 * t);
            assert_eq!(kept.at(&place).to_bits(), smooth(5, &place, 3.0).to_bits());
        }
    }

    #[test]
    fn smooth_noise_is_continuous_across_lattice_cells_and_negative_places() {
        for n in -40..40 {
            let at = Vec3::new(f64::from(n) * 0.5, -3.0, 7.7);
            let step = Vec3::new(1e-9, -1e-9, 1e-9);
            let jump = smooth(3, &(at + step), 2.0) - smooth(3, &(at - step), 2.0);
            assert!(jump.abs() < 1e-7, "jump {jump} at {at}");
        }
    }
}
