//! What lies between the focal spot and each pixel.

use crate::xray::{
    geometry::Geometry,
    phantom::{Form, Phantom},
    raster::{RasterError, Window, path_lengths, path_lengths_before},
    shapes::Ellipsoid,
};
use mammotwin_data::{Vec3, radiograph::Radiograph, surface::TriMesh};
use rayon::prelude::*;

/// Samples along the side of a pixel for microcalcifications, which are as small as pixels.
const FINE: usize = 8;

/// Path lengths, independent of photon energy.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    /// Where source and pixels are.
    pub geometry: Geometry,
    /// Where photons leave the target, beside the middle of the focal spot (mm).
    pub spot_mm: [f64; 2],
    /// Path length (mm) inside the breast to the pixel's centre, all that is in it included.
    pub breast: Radiograph,
    /// Path lengths in the inclusions, in their order, without what a later one replaces.
    pub regions: Vec<Region>,
    /// Path lengths in the calcifications, in their order.
    pub inserts: Vec<Insert>,
}

/// Path lengths (mm) in an inclusion on a part of the detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// The pixels that its shadow may touch.
    pub part: Part,
    /// Path lengths (mm) to the pixels' centres, row by row.
    pub path_mm: Vec<f32>,
}

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// First pixel row.
    pub row: usize,
    /// First pixel column.
    pub column: usize,
    /// Pixel rows.
    pub rows: usize,
    /// Pixel columns.
    pub columns: usize,
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

/// Refuses a breast whose shadow does not fit on the detector. What lies behind the detector's edge is not
/// looked at.
pub fn fits(surface: &TriMesh, geometry: &Geometry) -> Result<(), RasterError> {
    let half = 0.5 * geometry.columns as f64 * geometry.pitch_mm;
    let field = [-half, half, geometry.rows as f64 * geometry.pitch_mm];
    let mut shadow = [0.0f64; 3];
    let below = |p: &&Vec3| p.y > 0.0 && p.z < geometry.source_height_mm;
    for point in surface.points.iter().filter(below) {
        let [x, y] = geometry.shadow_mm(point);
        shadow = [shadow[0].min(x), shadow[1].max(x), shadow[2].max(y)];
    }
    let fits = shadow[0] >= field[0] && shadow[1] <= field[1] && shadow[2] <= field[2];
    if fits { Ok(()) } else { Err(RasterError::Beyond { shadow, field }) }
}

/// Path lengths through a phantom, from the middle of the focal spot.
pub fn project(phantom: &Phantom, geometry: &Geometry) -> Result<Projection, RasterError> {
    project_from(phantom, geometry, [0.0; 2])
}

/// Path lengths from a point (mm) beside the middle of the focal spot.
pub fn project_from(
    phantom: &Phantom,
    geometry: &Geometry,
    spot_mm: [f64; 2],
) -> Result<Projection, RasterError> {
    let view = View { geometry, spot_mm };
    let all = Part { row: 0, column: 0, rows: geometry.rows, columns: geometry.columns };
    let paths = view.paths(&phantom.surface, &all, 1)?;
    let breast = geometry.picture(paths, "path length (mm)");
    let mut regions: Vec<Region> = Vec::with_capacity(phantom.inclusions.len());
    for inclusion in &phantom.inclusions {
        let region = match &inclusion.form {
            Form::Surface(surface) => {
                let part = view.part(&surface.points);
                Region { part, path_mm: view.paths(surface, &part, 1)? }
            }
            Form::Ellipsoid(form) => {
                let (chords, region) = view.ellipsoid(form);
                for (earlier, before) in regions.iter_mut().zip(&phantom.inclusions) {
                    // Masses do not overlap: only a gland can be there.
                    if let Form::Surface(surface) = &before.form {
                        let shared = view.between(surface, &region.part, &chords)?;
                        earlier.take(&region.part, &shared);
                    }
                }
                region
            }
        };
        regions.push(region);
    }
    let inserts: Result<_, _> = phantom
        .calcifications
        .par_iter()
        .map(|c| {
            let part = view.part(&c.surface.points);
            let Part { row, column, rows, columns } = part;
            let path_mm = view.paths(&c.surface, &part, FINE)?;
            Ok(Insert { row, column, rows, columns, fine: FINE, path_mm })
        })
        .collect();
    Ok(Projection { geometry: geometry.clone(), spot_mm, breast, regions, inserts: inserts? })
}

impl Region {
    /// Row and column on the detector, and path length (mm), of each pixel.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let part = self.part;
        self.path_mm.iter().enumerate().map(move |(n, &path)| {
            (part.row + n / part.columns, part.column + n % part.columns, f64::from(path))
        })
    }

    /// Takes away path lengths on a part of the detector.
    fn take(&mut self, part: &Part, shared_mm: &[f32]) {
        for (n, &shared) in shared_mm.iter().enumerate() {
            let (row, column) = (part.row + n / part.columns, part.column + n % part.columns);
            let own = &self.part;
            if (own.row..own.row + own.rows).contains(&row)
                && (own.column..own.column + own.columns).contains(&column)
            {
                let at = (row - own.row) * own.columns + column - own.column;
                self.path_mm[at] = (self.path_mm[at] - shared).max(0.0);
            }
        }
    }
}

/// The detector as seen from one point.
struct View<'a> {
    geometry: &'a Geometry,
    spot_mm: [f64; 2],
}

impl View<'_> {
    /// The samples of a part, `fine` x `fine` for each pixel, seen from the point.
    fn window(&self, part: &Part, fine: usize) -> Window {
        let pitch_mm = self.geometry.pitch_mm / fine as f64;
        let [x, y] = self.geometry.pixel_mm(part.row, part.column);
        let corner = 0.5 * (self.geometry.pitch_mm - pitch_mm);
        Window {
            left_mm: x - corner - self.spot_mm[0],
            first_row_mm: y - corner - self.spot_mm[1],
            pitch_mm,
            columns: part.columns * fine,
            rows: part.rows * fine,
        }
    }

    /// The same surface seen from the point.
    fn seen(&self, surface: &TriMesh) -> TriMesh {
        let [x, y] = self.spot_mm;
        let points = surface.points.iter().map(|p| p - Vec3::new(x, y, 0.0)).collect();
        TriMesh { points, triangles: surface.triangles.clone() }
    }

    fn paths(&self, surface: &TriMesh, part: &Part, fine: usize) -> Result<Vec<f32>, RasterError> {
        let (height, window) = (self.geometry.source_height_mm, self.window(part, fine));
        if self.spot_mm == [0.0; 2] {
            return path_lengths(surface, height, &window);
        }
        path_lengths(&self.seen(surface), height, &window)
    }

    /// Path lengths (mm) in a surface between two shares of the way to each sample of a part.
    fn between(
        &self,
        surface: &TriMesh,
        part: &Part,
        chords: &[[f64; 2]],
    ) -> Result<Vec<f32>, RasterError> {
        let (surface, window) = (self.seen(surface), self.window(part, 1));
        let height = self.geometry.source_height_mm;
        let end = |k: usize| -> Vec<f64> { chords.iter().map(|chord| chord[k]).collect() };
        let enters = path_lengths_before(&surface, height, &window, &end(0))?;
        let leaves = path_lengths_before(&surface, height, &window, &end(1))?;
        Ok(leaves.iter().zip(&enters).map(|(leave, enter)| leave - enter).collect())
    }

    /// Pixels that the shadow of points touches; none when it falls beside the detector.
    fn part(&self, points: &[Vec3]) -> Part {
        let (geometry, [sx, sy]) = (self.geometry, self.spot_mm);
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for point in points {
            let [x, y] = geometry.shadow_mm(&(point - Vec3::new(sx, sy, 0.0)));
            let at = [x + sx - geometry.left_mm(), y + sy - geometry.first_row_mm()];
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis] / geometry.pitch_mm);
                high[axis] = high[axis].max(at[axis] / geometry.pitch_mm);
            }
        }
        let range = |axis: usize, count: usize| {
            let first = (low[axis].round().max(0.0) as usize).min(count);
            let end = ((high[axis].round() + 1.0).max(0.0) as usize).min(count);
            (first, end.max(first) - first)
        };
        let ((column, columns), (row, rows)) =
            (range(0, geometry.columns), range(1, geometry.rows));
        Part { row, column, rows, columns }
    }

    /// Where rays are in an ellipsoid, as shares of the way to the pixels, and their path lengths: closed
    /// forms.
    fn ellipsoid(&self, form: &Ellipsoid) -> (Vec<[f64; 2]>, Region) {
        let corner = |n: usize| {
            let side = Vec3::from_fn(|k, _| if n >> k & 1 == 1 { 1.0 } else { -1.0 });
            form.center + side.component_mul(&form.radii)
        };
        let part = self.part(&[0, 1, 2, 3, 4, 5, 6, 7].map(corner));
        let [sx, sy] = self.spot_mm;
        let source = Vec3::new(sx, sy, self.geometry.source_height_mm);
        let pixel = |n: usize| {
            let row = part.row + n / part.columns;
            let [x, y] = self.geometry.pixel_mm(row, part.column + n % part.columns);
            Vec3::new(x, y, 0.0)
        };
        let chord = |n: usize| form.chord(&source, &pixel(n)).unwrap_or([0.0; 2]);
        let chords: Vec<[f64; 2]> = (0..part.rows * part.columns).map(chord).collect();
        let path = |(n, [enter, leave]): (usize, &[f64; 2])| {
            ((leave - enter) * (pixel(n) - source).norm()) as f32
        };
        let path_mm = chords.iter().enumerate().map(path).collect();
        (chords, Region { part, path_mm })
    }
}
