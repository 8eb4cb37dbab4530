//! What lies between the focal spot and each pixel.

use crate::xray::{
    geometry::Geometry,
    phantom::Phantom,
    raster::{RasterError, Window, path_lengths},
};
use mammotwin_data::{radiograph::Radiograph, surface::TriMesh};
use rayon::prelude::*;

/// Samples along the side of a pixel for microcalcifications, which are as small as pixels.
const FINE: usize = 8;

/// Path lengths, independent of photon energy.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    /// Where source and pixels are.
    pub geometry: Geometry,
    /// Path length (mm) inside the breast to the pixel's centre, calcifications included.
    pub breast: Radiograph,
    /// Path lengths in the calcifications, in their order.
    pub inserts: Vec<Insert>,
}

/// Path lengths in a microcalcification on a few pixels, finely sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Insert {
    /// First pixel row.
    pub row: usize,
    /// First pixel column.
    pub column: usize,
    /// Pixel rows.
    pub rows: usize,
    /// Pixel columns.
    pub columns: usize,
    /// Samples along the side of a pixel.
    pub fine: usize,
    /// Path lengths (mm): rows x fine lines of columns x fine samples.
    pub path_mm: Vec<f32>,
}

impl Insert {
    /// For each pixel its place (row, column) and the mean of a function of the path length.
    pub fn pixels(
        &self,
        of_path: impl Fn(f64) -> f64,
    ) -> impl Iterator<Item = (usize, usize, f64)> {
        let width = self.columns * self.fine;
        (0..self.rows * self.columns).map(move |n| {
            let (row, column) = (n / self.columns, n % self.columns);
            let lines = row * self.fine..(row + 1) * self.fine;
            let line = |l: usize| &self.path_mm[l * width + column * self.fine..][..self.fine];
            let sum: f64 = lines.flat_map(line).map(|&path| of_path(f64::from(path))).sum();
            (self.row + row, self.column + column, sum / (self.fine * self.fine) as f64)
        })
    }
}

/// Path lengths through a phantom.
pub fn project(phantom: &Phantom, geometry: &Geometry) -> Result<Projection, RasterError> {
    let window = Window {
        left_mm: geometry.left_mm(),
        first_row_mm: geometry.first_row_mm(),
        pitch_mm: geometry.pitch_mm,
        columns: geometry.columns,
        rows: geometry.rows,
    };
    let paths = path_lengths(&phantom.surface, geometry.source_height_mm, &window)?;
    let breast = geometry.picture(paths, "path length (mm)");
    let inserts: Result<_, _> =
        phantom.calcifications.par_iter().map(|c| insert(&c.surface, geometry)).collect();
    Ok(Projection { geometry: geometry.clone(), breast, inserts: inserts? })
}

fn insert(surface: &TriMesh, geometry: &Geometry) -> Result<Insert, RasterError> {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for point in &surface.points {
        let [x, y] = geometry.shadow_mm(point);
        let at = [x - geometry.left_mm(), y - geometry.first_row_mm()];
        for axis in 0..2 {
            low[axis] = low[axis].min(at[axis] / geometry.pitch_mm);
            high[axis] = high[axis].max(at[axis] / geometry.pitch_mm);
        }
    }
    // Pixels that the shadow touches; none when it falls beside the detector.
    let range = |axis: usize, count: usize| {
        let first = (low[axis].round().max(0.0) as usize).min(count);
        let end = ((high[axis].round() + 1.0).max(0.0) as usize).min(count);
        (first, end.max(first) - first)
    };
    let ((column, columns), (row, rows)) = (range(0, geometry.columns), range(1, geometry.rows));
    let pitch_mm = geometry.pitch_mm / FINE as f64;
    let [x, y] = geometry.pixel_mm(row, column);
    let corner = 0.5 * (geometry.pitch_mm - pitch_mm);
    let window = Window {
        left_mm: x - corner,
        first_row_mm: y - corner,
        pitch_mm,
        columns: columns * FINE,
        rows: rows * FINE,
    };
    let path_mm = path_lengths(surface, geometry.source_height_mm, &window)?;
    Ok(Insert { row, column, rows, columns, fine: FINE, path_mm })
}
