//! What is counted on the way, and how sure it is.

use crate::xray::transport::scene::Bounds;

/// A mean and its standard error, from batches.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// Standard error of the mean.
    pub error: f64,
}

impl Estimate {
    /// Mean of the values of batches, each alike; its error is their SD over the root of their number.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Self { mean, error: (squares / (count * (count - 1.0).max(1.0))).sqrt() }
    }

    /// Standard error over mean.
    pub fn relative_error(&self) -> f64 {
        self.error / self.mean.abs()
    }

    /// The same in another unit.
    pub fn times(self, factor: f64) -> Self {
        Self { mean: factor * self.mean, error: factor.abs() * self.error }
    }
}

/// A rectangle that catches photons and ends their way, in cells.
///
/// What a real detector sends back is not followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receptor {
    /// Range (mm) along x.
    pub x: [f64; 2],
    /// Range (mm) along y.
    pub y: [f64; 2],
    /// Height (mm).
    pub z: f64,
    /// Cells along x and y.
    pub cells: [usize; 2],
}

impl Receptor {
    /// Cell at a place (mm), along x first; `None` beside the receptor.
    #[inline]
    pub fn cell(&self, x: f64, y: f64) -> Option<usize> {
        let place = |at: f64, [low, high]: [f64; 2], count: usize| {
            let place = (at - low) / (high - low) * count as f64;
            (place >= 0.0 && place < count as f64).then_some(place as usize)
        };
        let [i, j] = [place(x, self.x, self.cells[0])?, place(y, self.y, self.cells[1])?];
        Some(j * self.cells[0] + i)
    }

    /// Centre (mm) of a cell, along x and y.
    pub fn center(&self, cell: usize) -> [f64; 2] {
        let place = |n: usize, [low, high]: [f64; 2], count: usize| {
            low + (n as f64 + 0.5) * (high - low) / count as f64
        };
        [
            place(cell % self.cells[0], self.x, self.cells[0]),
            place(cell / self.cells[0], self.y, self.cells[1]),
        ]
    }
}

/// Boxes and a receptor to count in.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scoring {
    /// Boxes in the body whose absorbed energy is estimated.
    pub boxes: Vec<Bounds>,
    /// Receptor.
    pub receptor: Option<Receptor>,
    /// Gland and tissue count in front of this plane (mm) along y.
    pub from_y_mm: f64,
}

/// Sums (keV) of one batch of photons.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Batch {
    /// Photons.
    pub photons: u64,
    /// Photons that met tissue or skin.
    pub entered: u64,
    /// Emitted.
    pub emitted: f64,
    /// Absorbed in the body, by material.
    pub body: Vec<f64>,
    /// Absorbed in blocks and in air.
    pub elsewhere: f64,
    /// Left the world.
    pub lost: f64,
    /// Absorbed by gland.
    pub gland: f64,
    /// Absorbed in boxes, by collision estimator.
    pub boxes: Vec<f64>,
    /// Energy on the receptor, by cell: never scattered, scattered.
    pub primary: Vec<f64>,
    pub scatter: Vec<f64>,
    /// The same behind a grid.
    pub primary_behind: Vec<f64>,
    pub scatter_behind: Vec<f64>,
}

impl Batch {
    pub fn new(photons: u64, media: usize, scoring: &Scoring, grid: bool) -> Self {
        let cells = scoring.receptor.map_or(0, |r| r.cells[0] * r.cells[1]);
        let behind = if grid { cells } else { 0 };
        Self {
            photons,
            entered: 0,
            emitted: 0.0,
            body: vec![0.0; media],
            elsewhere: 0.0,
            lost: 0.0,
            gland: 0.0,
            boxes: vec![0.0; scoring.boxes.len()],
            primary: vec![0.0; cells],
            scatter: vec![0.0; cells],
            primary_behind: vec![0.0; behind],
            scatter_behind: vec![0.0; behind],
        }
    }
}

/// Energy on each cell of a receptor (keV per emitted photon).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    /// Of photons that never scattered.
    pub primary: Vec<Estimate>,
    /// Of scattered photons.
    pub scatter: Vec<Estimate>,
}

impl Image {
    /// Sums over the cells where `counts` holds; errors of cells are taken as independent.
    pub fn sum(cells: &[Estimate], counts: impl Fn(usize) -> bool) -> Estimate {
        let kept = || cells.iter().enumerate().filter(|(n, _)| counts(*n)).map(|(_, c)| c);
        let mean = kept().map(|c| c.mean).sum();
        Estimate { mean, error: kept().map(|c| c.error * c.error).sum::<f64>().sqrt() }
    }

    /// Scatter-to-primary ratio over the cells where `counts` holds.
    pub fn scatter_to_primary(&self, counts: impl Fn(usize) -> bool) -> Estimate {
        let primary = Self::sum(&self.primary, &counts);
        let scatter = Self::sum(&self.scatter, &counts);
        let mean = scatter.mean / primary.mean;
        Estimate { mean, error: mean * scatter.relative_error().hypot(primary.relative_error()) }
    }
}

/// Means per emitted photon.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    /// Photons that were followed.
    pub photons: u64,
    /// Photons that met tissue or skin.
    pub entered: u64,
    /// Energy (keV).
    pub emitted: Estimate,
    /// Energy absorbed in the body (keV), by material.
    pub body: Vec<Estimate>,
    /// Energy absorbed in blocks and air (keV).
    pub elsewhere: Estimate,
    /// Energy that left (keV).
    pub lost: Estimate,
    /// Energy absorbed by gland (keV).
    pub gland: Estimate,
    /// Energy absorbed in boxes (keV).
    pub boxes: Vec<Estimate>,
    /// On the receptor.
    pub bare: Image,
    /// On the receptor behind a grid; empty without one.
    pub behind_grid: Image,
}

impl Tally {
    /// Joins batches, in their order.
    pub(crate) fn of(batches: &[Batch]) -> Self {
        let one = |of: &dyn Fn(&Batch) -> f64| {
            let values: Vec<f64> = batches.iter().map(|b| of(b) / b.photons as f64).collect();
            Estimate::of(&values)
        };
        let many = |of: &dyn Fn(&Batch) -> &[f64]| -> Vec<Estimate> {
            let count = batches.first().map_or(0, |b| of(b).len());
            (0..count).map(|n| one(&|b| of(b)[n])).collect()
        };
        Self {
            photons: batches.iter().map(|b| b.photons).sum(),
            entered: batches.iter().map(|b| b.entered).sum(),
            emitted: one(&|b| b.emitted),
            body: many(&|b| &b.body),
            elsewhere: one(&|b| b.elsewhere),
            lost: one(&|b| b.lost),
            gland: one(&|b| b.gland),
            boxes: many(&|b| &b.boxes),
            bare: Image { primary: many(&|b| &b.primary), scatter: many(&|b| &b.scatter) },
            behind_grid: Image {
                primary: many(&|b| &b.primary_behind),
                scatter: many(&|b| &b.scatter_behind),
            },
        }
    }
}
