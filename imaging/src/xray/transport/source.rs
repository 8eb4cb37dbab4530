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
    /// The part of the field that is lit; all of it when absent.
    pub window: Option<Window>,
}

/// Equal cells of a field that are lit or not, along x first.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Cells along x and y.
    pub cells: [usize; 2],
    /// Which are lit.
    pub lit: Vec<bool>,
}

impl Window {
    /// Also lights what lies within this many cells of a lit one, both ways.
    pub fn widened(&self, cells: usize) -> Self {
        let [nx, ny] = self.cells;
        let near = |at: usize, count: usize| at.saturating_sub(cells)..(at + cells + 1).min(count);
        let lit = (0..nx * ny)
            .map(|n| near(n / nx, ny).any(|j| near(n % nx, nx).any(|i| self.lit[j * nx + i])))
            .collect();
        Self { cells: self.cells, lit }
    }
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
            window: None,
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
        let lit = self.window.as_ref().is_none_or(|window| {
            window.lit.len() == window.cells[0] * window.cells[1] && window.lit.contains(&true)
        });
        if !(wide && lit && self.z < self.position.z) {
            return Err(SourceError::Field);
        }
        Ok(())
    }

    /// The same light from the smallest field; `None` without any.
    pub fn cropped(self) -> Option<Self> {
        let Some(window) = &self.window else { return Some(self) };
        let [nx, ny] = window.cells;
        let lit = || (0..nx * ny).filter(|&n| window.lit[n]);
        let [left, right] = [lit().map(|n| n % nx).min()?, lit().map(|n| n % nx).max()? + 1];
        let [first, end] = [lit().map(|n| n / nx).min()?, lit().map(|n| n / nx).max()? + 1];
        let part = |[low, high]: [f64; 2], count: usize, cells: [usize; 2]| {
            cells.map(|n| low + n as f64 / count as f64 * (high - low))
        };
        let rows = (first..end).flat_map(|j| window.lit[j * nx..][left..right].iter().copied());
        Some(Self {
            x: part(self.x, nx, [left, right]),
            y: part(self.y, ny, [first, end]),
            window: Some(Window { cells: [right - left, end - first], lit: rows.collect() }),
            ..self
        })
    }

    /// Cell of a window with this many cells, at a place (mm) of the field.
    #[inline]
    pub(crate) fn cell(&self, [nx, ny]: [usize; 2], x: f64, y: f64) -> Option<usize> {
        let place = |at: f64, [low, high]: [f64; 2], count: usize| {
            let place = (at - low) / (high - low) * count as f64;
            (place >= 0.0 && place < count as f64).then_some(place as usize)
        };
        Some(place(y, self.y, ny)? * nx + place(x, self.x, nx)?)
    }

    /// Solid angle (sr) of the field, of its lit part.
    pub fn solid_angle(&self) -> f64 {
        let Some(window) = &self.window else { return self.angle_of(self.x, self.y) };
        let [nx, ny] = window.cells;
        let range = |n: usize, [low, high]: [f64; 2], count: usize| {
            [n, n + 1].map(|n| low + n as f64 / count as f64 * (high - low))
        };
        let lit = window.lit.iter().enumerate().filter(|(_, lit)| **lit);
        lit.map(|(n, _)| self.angle_of(range(n % nx, self.x, nx), range(n / nx, self.y, ny))).sum()
    }

    fn angle_of(&self, x: [f64; 2], y: [f64; 2]) -> f64 {
        let height = self.position.z - self.z;
        let corner = |x: f64, y: f64| {
            let (a, b) = (x - self.position.x, y - self.position.y);
            (a * b).atan2(height * (a * a + b * b + height * height).sqrt())
        };
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
    /// First line that a random number in each of equal parts may mean.
    guide: Vec<u32>,
}

/// Parts of the guide to the lines.
const GUIDE: usize = 256;

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
        let cumulative: Vec<f64> = source.spectrum.lines.iter().map(add).collect();
        let all = cumulative.last().copied().unwrap_or_default();
        let first = |part: usize| {
            let wanted = part as f64 / GUIDE as f64 * all;
            cumulative.partition_point(|&sum| sum <= wanted) as u32
        };
        let guide = (0..GUIDE).map(first).collect();
        Self {
            source,
            height,
            nearest: (a * a + b * b + height * height).sqrt(),
            cumulative,
            guide,
        }
    }

    /// A direction into the field and an energy (keV). Points of the field are uniform; a share
    /// (nearest / r)³ of them is kept: solid angle is h dA / r³.
    #[inline]
    pub fn draw(&self, random: &mut impl Rng) -> (Vec3, f64) {
        let pick = |[low, high]: [f64; 2], part: f64| low + part * (high - low);
        loop {
            let x = pick(self.source.x, random.random());
            let y = pick(self.source.y, random.random());
            if let Some(window) = &self.source.window {
                let cell = self.source.cell(window.cells, x, y);
                if !cell.is_some_and(|cell| window.lit[cell]) {
                    continue;
                }
            }
            let [x, y] = [x - self.source.position.x, y - self.source.position.y];
            let r = (x * x + y * y + self.height * self.height).sqrt();
            if random.random::<f64>() < (self.nearest / r).powi(3) {
                return (Vec3::new(x, y, -self.height) / r, self.energy(random));
            }
        }
    }

    #[inline]
    fn energy(&self, random: &mut impl Rng) -> f64 {
        let lines = &self.source.spectrum.lines;
        if lines.len() == 1 {
            return lines[0].energy_kev;
        }
        let part: f64 = random.random();
        let wanted = part * self.cumulative[lines.len() - 1];
        let mut line = self.guide[(part * GUIDE as f64) as usize] as usize;
        while line + 1 < lines.len() && self.cumulative[line] <= wanted {
            line += 1;
        }
        lines[line].energy_kev
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
        Source { position, x: [-130.0, 130.0], y: [0.0, 140.0], z: 0.0, spectrum, window: None }
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
        // Lit but for a corner.
        let window = Window { cells: [2, 2], lit: vec![false, true, true, true] };
        let right = Vec3::new(170.82, 0.0, 637.51);
        let cases = [(source().position, None), (right, None), (right, Some(window))];
        for (position, window) in cases {
            let all = Source { position, window, ..source() };
            let part = Source { x: [60.0, 130.0], y: [70.0, 140.0], window: None, ..all.clone() };
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
    fn lines_have_their_shares() {
        let tube = Spectrum::of_tube("Rh/Ag", 34).unwrap();
        let source = Source { spectrum: tube.clone(), ..source() };
        let emitter = Emitter::of(&source);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut found = std::collections::BTreeMap::new();
        for _ in 0..200_000 {
            *found.entry((4.0 * emitter.energy(&mut random)) as u32).or_insert(0.0) += 1.0 / 2e5;
        }
        for line in &tube.lines {
            let got = found.get(&((4.0 * line.energy_kev) as u32)).copied().unwrap_or(0.0);
            assert!((got - line.share).abs() < 5.0 * (line.share / 2e5).sqrt() + 1e-5, "{line:?}");
        }
    }

    #[test]
    fn a_cropped_field_gives_the_same_light() {
        let lit = (0..24).map(|n| [7, 8, 13, 14].contains(&n)).collect();
        let whole = Source { window: Some(Window { cells: [6, 4], lit }), ..source() };
        let cropped = whole.clone().cropped().unwrap();
        assert_eq!(cropped.window.as_ref().unwrap().cells, [2, 2]);
        assert!((cropped.x[0] + 260.0 / 3.0).abs() < 1e-9 && (cropped.y[0] - 35.0).abs() < 1e-9);
        assert!((cropped.solid_angle() / whole.solid_angle() - 1.0).abs() < 1e-12);
        let dark = Window { cells: [1, 1], lit: vec![false] };
        assert_eq!(Source { window: Some(dark), ..source() }.cropped(), None);
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
