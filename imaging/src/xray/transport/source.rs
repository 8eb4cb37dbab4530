//! Where photons come from.

use crate::xray::{geometry::Geometry, spectrum::Spectrum, transport::media::Media};
use mammotwin_data::Vec3;
use rand::Rng;

/// A point source, alike in all directions, collimated to a rectangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Focal spot (mm).
    pub position: Vec3,
    /// Range (mm) of the field along x.
    pub x: [f64; 2],
    /// Range (mm) of the field along y.
    pub y: [f64; 2],
    /// Height (mm) of the plane of the field.
    pub z: f64,
    /// Photons by energy.
    pub spectrum: Spectrum,
}

/// Why a source does not shine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SourceError {
    /// A line beyond the table of coefficients.
    #[error("a line of {0} keV: photons are followed from 5 to 50 keV")]
    Energy(f64),
    /// Shares that are none.
    #[error("the shares of the spectrum add up to {0}, not to 1")]
    Shares(f64),
    /// No field below the source.
    #[error("the field must be a rectangle of positive size below the source")]
    Field,
}

impl Source {
    /// The whole detector of a unit.
    pub fn of(geometry: &Geometry, spectrum: &Spectrum) -> Self {
        let half = 0.5 * geometry.columns as f64 * geometry.pitch_mm;
        Self {
            position: Vec3::new(0.0, 0.0, geometry.source_height_mm),
            x: [-half, half],
            y: [0.0, geometry.rows as f64 * geometry.pitch_mm],
            z: 0.0,
            spectrum: spectrum.clone(),
        }
    }

    /// Refuses what cannot be followed.
    pub fn check(&self) -> Result<(), SourceError> {
        let lines = &self.spectrum.lines;
        if let Some(line) = lines.iter().find(|line| !Media::covers(line.energy_kev)) {
            return Err(SourceError::Energy(line.energy_kev));
        }
        let sum: f64 = lines.iter().map(|line| line.share).sum();
        if !((sum - 1.0).abs() < 1e-3 && lines.iter().all(|line| line.share >= 0.0)) {
            return Err(SourceError::Shares(sum));
        }
        let wide = self.x[0] < self.x[1] && self.y[0] < self.y[1];
        if !(wide && self.z < self.position.z) {
            return Err(SourceError::Field);
        }
        Ok(())
    }

    /// Solid angle (sr) of the field.
    pub fn solid_angle(&self) -> f64 {
        let height = self.position.z - self.z;
        let corner = |x: f64, y: f64| {
            let (a, b) = (x - self.position.x, y - self.position.y);
            (a * b).atan2(height * (a * a + b * b + height * height).sqrt())
        };
        let [x, y] = [self.x, self.y];
        corner(x[1], y[1]) - corner(x[0], y[1]) - corner(x[1], y[0]) + corner(x[0], y[0])
    }
}

/// Draws photons of a source.
#[derive(Debug, Clone)]
pub(crate) struct Emitter<'a> {
    source: &'a Source,
    height: f64,
    /// Smallest distance (mm) from the source to the field.
    nearest: f64,
    /// Sums of the shares.
    cumulative: Vec<f64>,
}

impl<'a> Emitter<'a> {
    pub fn of(source: &'a Source) -> Self {
        let height = source.position.z - source.z;
        let beside = |at: f64, [low, high]: [f64; 2]| (low - at).max(at - high).max(0.0);
        let (a, b) = (beside(source.position.x, source.x), beside(source.position.y, source.y));
        let mut sum = 0.0;
        let add = |line: &crate::xray::spectrum::Line| {
            sum += line.share;
            sum
        };
        let cumulative = source.spectrum.lines.iter().map(add).collect();
        Self { source, height, nearest: (a * a + b * b + height * height).sqrt(), cumulative }
    }

    /// A direction into the field and an energy (keV). Points of the field are uniform; a share
    /// (nearest / r)³ of them is kept: solid angle is h dA / r³.
    pub fn draw(&self, random: &mut impl Rng) -> (Vec3, f64) {
        let pick = |[low, high]: [f64; 2], part: f64| low + part * (high - low);
        loop {
            let x = pick(self.source.x, random.random()) - self.source.position.x;
            let y = pick(self.source.y, random.random()) - self.source.position.y;
            let r = (x * x + y * y + self.height * self.height).sqrt();
            if random.random::<f64>() < (self.nearest / r).powi(3) {
                return (Vec3::new(x, y, -self.height) / r, self.energy(random));
            }
        }
    }

    fn energy(&self, random: &mut impl Rng) -> f64 {
        let lines = &self.source.spectrum.lines;
        if lines.len() == 1 {
            return lines[0].energy_kev;
        }
        let wanted = random.random::<f64>() * self.cumulative[lines.len() - 1];
        let line = self.cumulative.partition_point(|&sum| sum <= wanted);
        lines[line.min(lines.len() - 1)].energy_kev
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn source() -> Source {
        let position = Vec3::new(0.0, 0.0, 660.0);
        let spectrum = Spectrum::mono(20.0);
        Source { position, x: [-130.0, 130.0], y: [0.0, 140.0], z: 0.0, spectrum }
    }

    /// 4 π / 24 is a quarter of the side of a cube seen from its middle.
    #[test]
    fn solid_angle_of_a_side_of_a_cube() {
        let cube = Source { x: [-660.0, 660.0], y: [0.0, 660.0], ..source() };
        assert!((cube.solid_angle() - std::f64::consts::PI / 3.0).abs() < 1e-12);
    }

    /// Photons per solid angle are alike everywhere: shares of sub-fields.
    #[test]
    fn photons_fill_the_solid_angle_evenly() {
        for position in [Vec3::new(0.0, 0.0, 660.0), Vec3::new(170.82, 0.0, 637.51)] {
            let all = Source { position, ..source() };
            let part = Source { x: [60.0, 130.0], y: [70.0, 140.0], ..all.clone() };
            let emitter = Emitter::of(&all);
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let mut inside = 0;
            for _ in 0..200_000 {
                let (direction, _) = emitter.draw(&mut random);
                assert!((direction.norm() - 1.0).abs() < 1e-12);
                let at = position + direction * (-position.z / direction.z);
                inside += usize::from(at.x > 60.0 && at.y > 70.0);
            }
            let wanted = part.solid_angle() / all.solid_angle();
            let found = inside as f64 / 200_000.0;
            assert!((found / wanted - 1.0).abs() < 0.02, "{found} {wanted}");
        }
    }

    #[test]
    fn bad_sources_are_refused() {
        let with = |spectrum| Source { spectrum, ..source() }.check();
        assert_eq!(with(Spectrum::mono(20.0)), Ok(()));
        assert_eq!(with(Spectrum::mono(60.0)), Err(SourceError::Energy(60.0)));
        assert!(matches!(with(Spectrum { lines: vec![] }), Err(SourceError::Shares(_))));
        let below = Source { z: 700.0, ..source() };
        assert_eq!(below.check(), Err(SourceError::Field));
    }
}
