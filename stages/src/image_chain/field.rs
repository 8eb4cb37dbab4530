//! Pictures of smooth bodies, as mean signals of cells.

use super::library::Chain;
use mammotwin_data::{Vec3, surface::TriMesh};
use mammotwin_imaging::xray::{
    attenuation::{AttenuationError, Material},
    geometry::Geometry,
    phantom::SKIN_MM,
    raster::{RasterError, Window, path_lengths},
    spectrum::{Spectrum, UnknownBeam},
    transport::{
        bodies::Closed,
        exam::{Exam, ExamError, MEDIA, Setup, examine},
        photon::Histories,
        study::StudyError,
    },
};

/// Edge of a cell (mm).
pub const CELL_MM: f64 = 5.0;
/// Cells along x, around the middle, and away from the chest wall.
pub const CELLS: [usize; 2] = [40, 24];
/// A cell whose paths differ by more (mm) lies on an edge and is not compared.
const EDGE_MM: f64 = 4.0;
/// Paths of which the transmission is tabulated (mm).
const STEP_MM: f64 = 0.25;
/// Primary photons of Monte Carlo are compared behind so much tissue (mm).
const THICK_MM: f64 = 25.0;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum ChainError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// No such beam.
    #[error(transparent)]
    Beam(#[from] UnknownBeam),
    /// A surface has no path lengths.
    #[error(transparent)]
    Surface(#[from] RasterError),
    /// No scatter.
    #[error(transparent)]
    Exam(#[from] ExamError),
    /// No doses.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// The errors have no covariance.
    #[error("image chain: the errors of an exposure have no covariance")]
    Covariance,
}

/// A uniform body on the detector.
#[derive(Debug, Clone)]
pub struct Body {
    /// Closed surface (mm).
    pub surface: TriMesh,
    /// Mass fraction of gland.
    pub glandularity: f64,
}

/// How finely a picture is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fineness {
    /// Pixel pitch (mm).
    pub pixel_mm: f64,
    /// Photons of the scatter.
    pub histories: Histories,
    /// Step (mm) of the body's distances in Monte Carlo.
    pub step_mm: f64,
    /// Spread (mm) by which the scatter of Monte Carlo is smoothed: the noise of single cells is that of a
    /// few hundred photons.
    pub smooth_mm: f64,
}

/// One energy and the tube's spectrum, each of sum 1.
#[derive(Debug, Clone)]
pub struct Beams {
    /// One energy.
    pub mono: Spectrum,
    /// 34 kV Rh/Ag behind the paddle.
    pub tube: Spectrum,
}

impl Beams {
    /// 24 keV, and the tube that it stands for.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn new() -> Result<Self, ChainError> {
        let paddle = Material::named("pmma")?;
        let tube = Spectrum::of_tube("Rh/Ag", 34)?.behind(&paddle, 2.5)?.of_all();
        Ok(Self { mono: Spectrum::mono(24.0), tube })
    }
}

/// A body's picture but for what the image chain does.
#[derive(Debug, Clone)]
pub struct Field {
    /// Centres (mm) of the cells that are compared.
    pub centers: Vec<[f64; 2]>,
    /// Of each pixel: its cell among them, path (mm), fluence over that below the focal spot, and y (mm).
    pixels: Vec<(u32, f32, f32, f32)>,
    /// Scatter behind the grid in each cell, in the unit of primary signals.
    scatter: Vec<f64>,
    /// Longest path (mm).
    longest: f64,
    /// Mass fraction of gland.
    glandularity: f64,
    beams: Beams,
}

impl Field {
    /// Paths and scatter of a body, in the cells of these centres (mm); else in all but those on its edges.
    ///
    /// # Errors
    /// For surfaces and materials that have no picture.
    pub fn new(
        body: &Body,
        fineness: Fineness,
        keep: Option<&[[f64; 2]]>,
    ) -> Result<Self, ChainError> {
        let per_cell = (CELL_MM / fineness.pixel_mm).round().max(1.0) as usize;
        let pitch = CELL_MM / per_cell as f64;
        let [columns, rows] = CELLS.map(|n| n * per_cell);
        let geometry = Geometry { columns, rows, pitch_mm: pitch, ..Geometry::pristina(pitch) };
        let window = Window {
            left_mm: geometry.left_mm(),
            first_row_mm: geometry.first_row_mm(),
            pitch_mm: pitch,
            columns,
            rows,
        };
        let paths = path_lengths(&body.surface, geometry.source_height_mm, &window)?;
        let cell = |n: usize| (n / columns / per_cell) * CELLS[0] + n % columns / per_cell;
        let mut range = vec![[f32::MAX, f32::MIN]; CELLS[0] * CELLS[1]];
        for (n, &path) in paths.iter().enumerate() {
            let [low, high] = &mut range[cell(n)];
            (*low, *high) = (low.min(path), high.max(path));
        }
        let center = |c: usize| {
            let x = (c % CELLS[0]) as f64 - 0.5 * (CELLS[0] as f64 - 1.0);
            [CELL_MM * x, CELL_MM * ((c / CELLS[0]) as f64 + 0.5)]
        };
        let flat = |c: &usize| f64::from(range[*c][1] - range[*c][0]) <= EDGE_MM;
        let kept: Vec<usize> = match keep {
            None => (0..range.len()).filter(flat).collect(),
            Some(centers) => (0..range.len())
                .filter(|&c| {
                    centers
                        .iter()
                        .any(|at| at.iter().zip(center(c)).all(|(a, b)| (a - b).abs() < 0.1))
                })
                .collect(),
        };
        let mut place = vec![u32::MAX; range.len()];
        kept.iter().enumerate().for_each(|(n, &c)| place[c] = n as u32);
        let pixels = paths
            .iter()
            .enumerate()
            .filter(|(n, _)| place[cell(*n)] != u32::MAX)
            .map(|(n, &path)| {
                let at = geometry.pixel_mm(n / columns, n % columns);
                (place[cell(n)], path, geometry.relative_fluence(at) as f32, at[1] as f32)
            })
            .collect();
        let longest = paths.iter().fold(0f32, |most, &path| most.max(path));
        let mut field = Self {
            centers: kept.iter().map(|&c| center(c)).collect(),
            pixels,
            scatter: vec![0.0; kept.len()],
            longest: f64::from(longest),
            glandularity: body.glandularity,
            beams: Beams::new()?,
        };
        field.scatter = field.scattered(body, fineness)?;
        Ok(field)
    }

    /// Mean signal of each cell, over that of the open beam below the focal spot; glandularity is that
    /// of the body and this much more.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn signal(&self, chain: &Chain, more_gland: f64) -> Result<Vec<f64>, ChainError> {
        let gland = self.glandularity + more_gland;
        let nodes = (self.longest / STEP_MM).ceil() as usize + 2;
        let mut lines = Vec::new();
        let share = chain.beam_spectrum;
        for (beam, part) in [(&self.beams.mono, 1.0 - share), (&self.beams.tube, share)] {
            for line in beam.lines.iter().filter(|_| part != 0.0) {
                lines.push((part * line.share, attenuation(gland, line.energy_kev)?));
            }
        }
        let through = |n: usize| {
            let path = n as f64 * STEP_MM;
            let sum: f64 = lines.iter().map(|(share, mu)| share * (-mu * path).exp()).sum();
            sum.max(1e-12).ln()
        };
        let passed: Vec<f64> = (0..nodes).map(through).collect();
        let mut sums = vec![(0.0, 0.0); self.centers.len()];
        for &(cell, path, fluence, y) in &self.pixels {
            let at = f64::from(path) / STEP_MM;
            let (n, part) = (at as usize, at.fract());
            let log = passed[n] + part * (passed[n + 1] - passed[n]);
            let heel = 1.0 - chain.heel * f64::from(y) / 100.0;
            let (sum, count) = &mut sums[cell as usize];
            *sum += log.exp() * f64::from(fluence) * heel;
            *count += 1.0;
        }
        let add =
            |(&(sum, count), scatter): (&(f64, f64), &f64)| sum / count + chain.scatter * scatter;
        Ok(sums.iter().zip(&self.scatter).map(add).collect())
    }

    /// Scatter behind a grid by Monte Carlo, smoothed, in the unit of primary signals: both are compared
    /// behind thick tissue.
    fn scattered(&self, body: &Body, fineness: Fineness) -> Result<Vec<f64>, ChainError> {
        if fineness.histories.photons == 0 {
            return Ok(self.scatter.clone());
        }
        let tissue = Material::breast(body.glandularity)?;
        let setup = Setup {
            paddle_mm: 0.0,
            gap_mm: 1.0,
            skin: tissue.clone(),
            grid: true,
            cells: Some(CELLS),
            ..Setup::usual(body.glandularity)?
        };
        let closed = Closed::new(&body.surface, fineness.step_mm, SKIN_MM, MEDIA)?;
        // Collimated to the cells.
        let [columns, rows] = CELLS;
        let geometry = Geometry { columns, rows, ..Geometry::pristina(CELL_MM) };
        let exam = examine(closed, &setup, &geometry, &self.beams.mono, fineness.histories)?;
        let primary = self.signal(&Chain::default(), 0.0)?;
        let thick = self.beams.mono.transmission(&tissue, THICK_MM)?;
        let behind: Vec<usize> = (0..self.centers.len()).filter(|&c| primary[c] < thick).collect();
        let of =
            |smooth: bool, at: [f64; 2]| sample(&exam, smooth.then_some(fineness.smooth_mm), at);
        let ours: f64 = behind.iter().map(|&c| primary[c]).sum();
        let theirs: f64 = behind.iter().map(|&c| of(false, self.centers[c])).sum();
        let unit = ours / theirs;
        Ok(self.centers.iter().map(|&at| unit * of(true, at)).collect())
    }
}

/// Attenuation (1/mm) of breast tissue; beyond pure fat and pure gland on the line through both, so that a
/// fit may pass there.
fn attenuation(gland: f64, energy_kev: f64) -> Result<f64, ChainError> {
    if (0.0..=1.0).contains(&gland) {
        return Ok(Material::breast(gland)?.attenuation_per_mm(energy_kev)?);
    }
    let [fat, pure] = [Material::breast(0.0)?, Material::breast(1.0)?];
    let (low, high) = (fat.attenuation_per_mm(energy_kev)?, pure.attenuation_per_mm(energy_kev)?);
    Ok((low + gland * (high - low)).max(0.0))
}

/// Energy per cell behind the grid around a place: scattered and smoothed, or the primary of the nearest
/// cell.
fn sample(exam: &Exam, smooth_mm: Option<f64>, at: [f64; 2]) -> f64 {
    let Some(receptor) = exam.receptor else { return 0.0 };
    let image = &exam.tally.behind_grid;
    let Some(smooth_mm) = smooth_mm else {
        return receptor.cell(at[0], at[1]).map_or(0.0, |cell| image.primary[cell].mean);
    };
    let (mut sum, mut weights) = (0.0, 0.0);
    for (cell, energy) in image.scatter.iter().enumerate() {
        let there: Vec3 = {
            let [x, y] = receptor.center(cell);
            Vec3::new(x - at[0], y - at[1], 0.0)
        };
        let weight = (-0.5 * there.norm_squared() / (smooth_mm * smooth_mm)).exp();
        sum += weight * energy.mean;
        weights += weight;
    }
    sum / weights
}
