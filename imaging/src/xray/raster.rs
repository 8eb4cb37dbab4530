//! Path lengths through closed surfaces by signed rasterisation.
//!
//! Each triangle of a closed surface is where rays enter or leave. Every pixel that a triangle
//! covers, seen from the source, gets the distance of the triangle with the sign + on exit and
//! - on entry; the sum is the path inside, for any shape, without sorting or search trees.
//!
//! No ray is lost or counted twice between neighbouring triangles: projected vertices are rounded
//! to 1/4096 pixel, coverage is decided in exact integers, and a pixel centre on a common edge
//! belongs to exactly one of its two triangles. Depth is interpolated between the rounded
//! vertices (1/depth is linear on the screen), so it is continuous across edges as well.

use mammotwin_data::{Vec3, surface::TriMesh};
use rayon::prelude::*;

/// Parts of a pixel in vertex positions.
const SUBPIXEL: f64 = 4096.0;
/// Products of two differences below twice this fit in 63 bits.
const MAX_COORDINATE: f64 = (1u64 << 30) as f64;
/// Rows that one task works on.
const BAND_ROWS: usize = 32;

/// Why a surface has no path lengths.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// Entry without exit.
    #[error(
        "the surface is not closed: {edges} edges lack their neighbour; rays would enter and \
         never leave"
    )]
    Open {
        /// Directed edges without an opposite one.
        edges: usize,
    },
    /// The shadow does not fit on the detector.
    #[error(
        "the breast's shadow is larger than the detector: it reaches from x = {:.0} to {:.0} mm and to \
         y = {:.0} mm, the detector from {:.0} to {:.0} mm and to {:.0} mm; take a larger detector \
         (mammogram.unit.field_mm)", shadow[0], shadow[1], shadow[2], field[0], field[1], field[2]
    )]
    Beyond {
        /// Smallest and largest x and largest y (mm) of the shadow.
        shadow: [f64; 3],
        /// The same of the detector.
        field: [f64; 3],
    },
    /// No triangle, or none where one looks.
    #[error("the surface has nothing inside of the box that is looked at")]
    Empty,
    /// A vertex at or above the source, or not finite, or much too far away.
    #[error(
        "vertex at ({}, {}, {}) mm cannot be seen from a source {source_height_mm} mm above the \
         detector", point.x, point.y, point.z
    )]
    OutOfView {
        /// Where (mm).
        point: Vec3,
        /// Height of the source (mm).
        source_height_mm: f64,
    },
}

/// A rectangle of sample points on the plane z = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// x (mm) of the samples in column 0.
    pub left_mm: f64,
    /// y (mm) of the samples in row 0.
    pub first_row_mm: f64,
    /// Distance of samples (mm), both ways.
    pub pitch_mm: f64,
    /// Samples along x.
    pub columns: usize,
    /// Samples along y.
    pub rows: usize,
}

/// Path length (mm) inside a closed surface along the rays from a source at (0, 0, height) to the
/// samples of a window; row by row. Parts of the surface below z = 0 lie behind the samples and
/// do not count.
pub fn path_lengths(
    surface: &TriMesh,
    source_height_mm: f64,
    window: &Window,
) -> Result<Vec<f32>, RasterError> {
    clipped(surface, source_height_mm, window, |_| 1.0)
}

/// The same on the first part of each ray: up to a share of the way to the sample, by sample.
pub fn path_lengths_before(
    surface: &TriMesh,
    source_height_mm: f64,
    window: &Window,
    share: &[f64],
) -> Result<Vec<f32>, RasterError> {
    clipped(surface, source_height_mm, window, |sample| share[sample].clamp(0.0, 1.0))
}

fn clipped(
    surface: &TriMesh,
    source_height_mm: f64,
    window: &Window,
    end: impl Fn(usize) -> f64 + Sync,
) -> Result<Vec<f32>, RasterError> {
    let edges = open_edges(surface);
    if edges > 0 {
        return Err(RasterError::Open { edges });
    }
    if window.rows * window.columns == 0 {
        return Ok(Vec::new());
    }
    let facets = facets(surface, source_height_mm, window)?;
    let bands = Bands::of(&facets, window.rows);
    let mut pixels = vec![0f32; window.rows * window.columns];
    pixels.par_chunks_mut(BAND_ROWS * window.columns).enumerate().for_each(|(band, out)| {
        let first = band * BAND_ROWS;
        let mut depth = vec![0f64; out.len()];
        for &facet in bands.facets(band) {
            facets[facet as usize].add(first, window.columns, &end, &mut depth);
        }
        for (n, (out, depth)) in out.iter_mut().zip(&depth).enumerate() {
            if *depth != 0.0 {
                let x = window.left_mm + (n % window.columns) as f64 * window.pitch_mm;
                let row = first + n / window.columns;
                let y = window.first_row_mm + row as f64 * window.pitch_mm;
                let ray = (x * x + y * y + source_height_mm * source_height_mm).sqrt();
                *out = (depth * ray) as f32;
            }
        }
    });
    Ok(pixels)
}

/// Number of directed edges that no opposite one closes.
pub(crate) fn open_edges(surface: &TriMesh) -> usize {
    let directed = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let mut there: Vec<(u32, u32)> = surface.triangles.iter().flat_map(directed).collect();
    let mut back: Vec<(u32, u32)> = there.iter().map(|&(a, b)| (b, a)).collect();
    there.par_sort_unstable();
    back.par_sort_unstable();
    let mut back = back.into_iter().peekable();
    let mut open = 0;
    for edge in there {
        while back.next_if(|&opposite| opposite < edge).is_some() {}
        open += usize::from(back.next_if_eq(&edge).is_none());
    }
    open
}

/// A vertex on the screen.
#[derive(Debug, Clone, Copy)]
struct Corner {
    /// Column and row in 1/4096 pixel.
    at: [i64; 2],
    /// Reciprocal of the depth, which is 0 in the source and 1 in the plane of the detector.
    nearness: f64,
}

/// A projected triangle, corners counter-clockwise on the screen.
#[derive(Debug, Clone, Copy)]
struct Facet {
    corners: [Corner; 3],
    /// Twice the area on the screen, positive.
    area: i64,
    /// +1 where rays leave, -1 where they enter.
    sign: f64,
    /// First and last row and column whose pixel centres may be covered.
    rows: [usize; 2],
    columns: [usize; 2],
}

/// Projects all triangles; keeps those that may cover a sample.
fn facets(
    surface: &TriMesh,
    source_height_mm: f64,
    window: &Window,
) -> Result<Vec<Facet>, RasterError> {
    let corner = |n: u32| {
        let point = surface.points[n as usize];
        let nearness = source_height_mm / (source_height_mm - point.z);
        let screen = |x: f64, first: f64| (x * nearness - first) / window.pitch_mm * SUBPIXEL;
        let [u, v] = [screen(point.x, window.left_mm), screen(point.y, window.first_row_mm)];
        if !(nearness > 0.0 && u.abs() < MAX_COORDINATE && v.abs() < MAX_COORDINATE) {
            return Err(RasterError::OutOfView { point, source_height_mm });
        }
        Ok(Corner { at: [u.round() as i64, v.round() as i64], nearness })
    };
    let facet = |t: &[u32; 3]| -> Result<Option<Facet>, RasterError> {
        let [a, b, c] = [corner(t[0])?, corner(t[1])?, corner(t[2])?];
        Ok(Facet::new([a, b, c], window))
    };
    let facets: Result<Vec<_>, _> = surface.triangles.par_iter().map(facet).collect();
    Ok(facets?.into_iter().flatten().collect())
}

/// Twice the signed area of the triangle a, b, p on the screen.
fn edge(a: [i64; 2], b: [i64; 2], p: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

impl Facet {
    /// `None` when it is seen edge-on or lies beside the window.
    fn new(mut corners: [Corner; 3], window: &Window) -> Option<Self> {
        let mut area = edge(corners[0].at, corners[1].at, corners[2].at);
        // Counter-clockwise from above: the outer side faces the source, rays enter.
        let sign = if area > 0 { -1.0 } else { 1.0 };
        if area < 0 {
            corners.swap(1, 2);
            area = -area;
        }
        let range = |axis: usize, count: usize| {
            let at = corners.map(|c| c.at[axis]);
            let unit = SUBPIXEL as i64;
            let first = at.iter().min()?.div_euclid(unit).max(0);
            let last = at.iter().max()?.div_euclid(unit).min(count as i64 - 1);
            (first <= last).then_some([first as usize, last as usize])
        };
        let (columns, rows) = (range(0, window.columns)?, range(1, window.rows)?);
        (area > 0).then_some(Self { corners, area, sign, rows, columns })
    }

    /// Adds its signed depth, at most where rays end, to the pixels that it covers in a band of rows.
    fn add(
        &self,
        first_row: usize,
        columns: usize,
        end: &impl Fn(usize) -> f64,
        depth: &mut [f64],
    ) {
        let unit = SUBPIXEL as i64;
        let at = self.corners.map(|c| c.at);
        let [from, to] = [[at[1], at[2], at[0]], [at[2], at[0], at[1]]];
        let step = [0, 1, 2].map(|k| -(to[k][1] - from[k][1]) * unit);
        // A centre on an edge belongs to the triangle on whose side the edge runs down or, when
        // level, to the right: the neighbour runs the other way.
        let shut = [0, 1, 2].map(|k| {
            let [du, dv] = [to[k][0] - from[k][0], to[k][1] - from[k][1]];
            i64::from(!(dv < 0 || (dv == 0 && du > 0)))
        });
        let scale = 1.0 / self.area as f64;
        let nearness = self.corners.map(|c| c.nearness * scale);
        let last_row = self.rows[1].min(first_row + depth.len() / columns - 1);
        for row in self.rows[0].max(first_row)..=last_row {
            let start = [self.columns[0] as i64 * unit, row as i64 * unit];
            let mut w = [0, 1, 2].map(|k| edge(from[k], to[k], start));
            let line = &mut depth[(row - first_row) * columns..][..columns];
            let number = row * columns + self.columns[0];
            for (n, pixel) in line[self.columns[0]..=self.columns[1]].iter_mut().enumerate() {
                if w[0] >= shut[0] && w[1] >= shut[1] && w[2] >= shut[2] {
                    let near = w[0] as f64 * nearness[0]
                        + w[1] as f64 * nearness[1]
                        + w[2] as f64 * nearness[2];
                    *pixel += self.sign * (1.0 / near).min(end(number + n));
                }
                for k in 0..3 {
                    w[k] += step[k];
                }
            }
        }
    }
}

/// Facets by band of rows, in their order.
struct Bands {
    start: Vec<usize>,
    facets: Vec<u32>,
}

impl Bands {
    fn of(facets: &[Facet], rows: usize) -> Self {
        let bands_of = |f: &Facet| f.rows[0] / BAND_ROWS..=f.rows[1] / BAND_ROWS;
        let mut start = vec![0; rows.div_ceil(BAND_ROWS) + 1];
        for band in facets.iter().flat_map(bands_of) {
            start[band + 1] += 1;
        }
        for band in 1..start.len() {
            start[band] += start[band - 1];
        }
        let mut next = start.clone();
        let mut sorted = vec![0; start[start.len() - 1]];
        for (n, facet) in facets.iter().enumerate() {
            for band in bands_of(facet) {
                sorted[next[band]] = n as u32;
                next[band] += 1;
            }
        }
        Self { start, facets: sorted }
    }

    fn facets(&self, band: usize) -> &[u32] {
        &self.facets[self.start[band]..self.start[band + 1]]
    }
}

#[cfg(test)]
mod tests;
