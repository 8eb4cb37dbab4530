//! A paddle from CAD: a closed surface, of which the lower side presses.
//!
//! The lower side is read along vertical lines through a grid and becomes a bicubic spline, which is
//! twice continuously differentiable, so that contact sees no edges of facets. Where it is steeper
//! than `STEEPEST` it is an edge and no face: the plate ends there, with the rounded edge of all
//! plates. The face must be a rectangle with round corners, without holes.

use super::{AT_REST, Bend, Lift, Outline, Place, Pose, RoundedRectangle};
use mammotwin_data::{Vec3, surface::TriMesh};
use std::collections::BTreeMap;

/// Least vertical share of the normal of a facet that belongs to the face: cosine of 45 degrees.
const STEEPEST: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Width and depth (mm) that a paddle has.
const LEAST_MM: f64 = 30.0;
const MOST_MM: f64 = 500.0;
/// Distance (mm) of the lines along which the surface is read, at most.
const SPACING_MM: f64 = 4.0;
/// How far (mm) lines are beside the grid, so that none runs along the edge of a facet.
const BESIDE_MM: [f64; 2] = [0.0137, 0.0211];
/// How far a face may stand out of the rectangle with round corners, in radii of the plate's edges:
/// corners that are sharper, even square ones, become as round as the edges.
const OUTLINE: f64 = 0.5;

/// Why a surface is no paddle. Places are those of the file (mm).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CadError {
    /// Too small or too large to be in millimetres.
    #[error(
        "its lower face is {:.4} x {:.4} in the file's units, which are taken for millimetres; a paddle is \
         {LEAST_MM:.0} to {MOST_MM:.0} mm wide and deep: export it in millimetres (is it in metres, \
         centimetres or inches?)", .size[0], .size[1]
    )]
    Units {
        /// Width and depth.
        size: [f64; 2],
    },
    /// Facets without a neighbour.
    #[error(
        "the surface is not closed: {edges} edges of facets have no neighbour that is turned alike, one at \
         ({:.1}, {:.1}, {:.1}) mm; export a closed solid", .place.x, .place.y, .place.z
    )]
    Open {
        /// Edges without a neighbour.
        edges: usize,
        /// One of them.
        place: Vec3,
    },
    /// A lower side that hides another one.
    #[error(
        "it has an overhang: above ({:.1}, {:.1}) mm there is a lower side at z = {:.1} and another one at z = \
         {:.1} mm; only what is seen from below can press: remove brackets and folds",
        .place[0], .place[1], .heights[0], .heights[1]
    )]
    Overhang {
        /// Where.
        place: Place,
        /// Of both lower sides (mm).
        heights: [f64; 2],
    },
    /// A hole, or an outline that is none of ours.
    #[error(
        "it has a hole, or its face is no rectangle with round corners: nothing is above ({:.1}, {:.1}) mm; \
         close the hole", .place[0], .place[1]
    )]
    Hole {
        /// Where.
        place: Place,
    },
    /// A part of the face that is too steep.
    #[error(
        "its face is steeper than 45 degrees at ({:.1}, {:.1}) mm, {:.1} mm from its border; only edges may be",
        .place[0], .place[1], .inside_mm
    )]
    Steep {
        /// Where.
        place: Place,
        /// Distance from the border of the face (mm).
        inside_mm: f64,
    },
    /// Something sticks out of the outline.
    #[error(
        "its face is no rectangle with round corners: it has a corner at ({:.1}, {:.1}) mm where one of {:.0} mm \
         would end", .place[0], .place[1], .corner_mm
    )]
    Corner {
        /// Where.
        place: Place,
        /// Radius (mm) that fits the area of the face.
        corner_mm: f64,
    },
    /// Facets that are turned the wrong way.
    #[error("the surface is inside out: turn its facets over")]
    InsideOut,
    /// No facet that looks down.
    #[error("no facet looks down (-z); z must point from the breast into the paddle")]
    NoFace,
}

/// The paddle that a surface describes.
#[derive(Debug, Clone, PartialEq)]
pub struct CadPaddle {
    /// Its lower side over the plate, zero where it is lowest.
    pub field: HeightField,
    /// Where it ends.
    pub outline: Outline,
}

impl CadPaddle {
    /// Reads a closed surface (mm): x along the chest-wall edge, y away from it, z from the breast
    /// into the paddle. The chest-wall edge is where the face begins along y, the middle that of its
    /// width. Corners are at least `edge_mm` round, the radius of the plate's edges.
    ///
    /// # Errors
    /// See [`CadError`].
    pub fn new(surface: &TriMesh, edge_mm: f64) -> Result<Self, CadError> {
        let Face { low, size, area } = Face::of(surface)?;
        // Units before all else: nothing that follows means anything in wrong ones.
        if size.iter().any(|length| !(LEAST_MM..=MOST_MM).contains(length)) {
            return Err(CadError::Units { size });
        }
        closed(surface)?;
        if !(surface.volume_mm3() > 0.0) {
            return Err(CadError::InsideOut);
        }
        // Four corners of radius c leave out (4 - π) c².
        let left_out = (size[0] * size[1] - area).max(0.0) / (4.0 - std::f64::consts::PI);
        let most = 0.5 * size[0].min(size[1]);
        let corner_mm = left_out.sqrt().max(edge_mm).min(most);
        let plate = RoundedRectangle::new(size, corner_mm, 0.0, 0.0);
        let scan = Scan { origin: [low[0] + 0.5 * size[0], low[1]], lines: Lines::of(surface) };
        let steps = size.map(|length| (length / SPACING_MM).ceil());
        let spacing = [size[0] / steps[0], size[1] / steps[1]];
        let count = steps.map(|n| n as usize + 1);
        let mut heights = vec![None; count[0] * count[1]];
        // A hole makes the corners seem round: it is told before them.
        let mut sharp = None;
        for j in 0..count[1] {
            for i in 0..count[0] {
                let place = [i as f64 * spacing[0] - 0.5 * size[0], j as f64 * spacing[1]];
                let height = scan.height(&plate, place, edge_mm)?;
                if height.is_some() && plate.distance(place).value > OUTLINE * edge_mm {
                    let place = [0, 1].map(|n| place[n] + scan.origin[n]);
                    sharp = sharp.or(Some(CadError::Corner { place, corner_mm }));
                }
                heights[j * count[0] + i] = height;
            }
        }
        if let Some(corner) = sharp {
            return Err(corner);
        }
        let lowest = heights.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let values = filled(heights, count).ok_or(CadError::NoFace)?;
        let values = values.iter().map(|height| height - lowest).collect();
        let field = HeightField::through([-0.5 * size[0], 0.0], spacing, count, values);
        Ok(Self { field, outline: Outline { plate: Some(plate), window: None } })
    }
}

/// The part of a surface that looks down.
struct Face {
    low: Place,
    size: [f64; 2],
    /// As seen from below (mm²).
    area: f64,
}

impl Face {
    fn of(surface: &TriMesh) -> Result<Self, CadError> {
        let (mut low, mut high, mut area) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], 0.0);
        for t in 0..surface.triangles.len() {
            let vector = surface.area_vector(t);
            if -vector.z < STEEPEST * vector.norm() || vector.z == 0.0 {
                continue;
            }
            area -= vector.z;
            for corner in surface.corners(t) {
                for axis in 0..2 {
                    low[axis] = low[axis].min(corner[axis]);
                    high[axis] = high[axis].max(corner[axis]);
                }
            }
        }
        let size = [high[0] - low[0], high[1] - low[1]];
        if area > 0.0 { Ok(Self { low, size, area }) } else { Err(CadError::NoFace) }
    }
}

/// # Errors
/// An edge that does not run as often one way as the other.
fn closed(surface: &TriMesh) -> Result<(), CadError> {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for &[a, b, c] in &surface.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let turn = if from < to { 1 } else { -1 };
            *edges.entry([from.min(to), from.max(to)]).or_insert(0) += turn;
        }
    }
    let mut open = edges.iter().filter(|(_, turns)| **turns != 0);
    let Some((&[a, b], _)) = open.next() else { return Ok(()) };
    let place = 0.5 * (surface.points[a as usize] + surface.points[b as usize]);
    Err(CadError::Open { edges: 1 + open.count(), place })
}

/// The surface, ready for vertical lines.
struct Scan {
    /// Place of the file that is the middle of the chest-wall edge.
    origin: Place,
    lines: Lines,
}

impl Scan {
    /// Height (mm) of the lower side at a place of the plate; `None` where there is no face, which
    /// may be within `edge_mm` of the border only.
    fn height(
        &self,
        plate: &RoundedRectangle,
        place: Place,
        edge_mm: f64,
    ) -> Result<Option<f64>, CadError> {
        // The grid's border is that of the face: lines run just inside of it.
        let line = [0, 1].map(|n| {
            let offset = place[n] - plate.middle[n];
            let inside = plate.half[n] - 2.0 * BESIDE_MM[n];
            plate.middle[n] + offset.clamp(-inside, inside) + BESIDE_MM[n]
        });
        let beyond = plate.distance(line).value;
        let place = [line[0] + self.origin[0], line[1] + self.origin[1]];
        let crossings = self.lines.crossings(place);
        if let [(first, _, _), _, (second, _, _), ..] = crossings[..] {
            return Err(CadError::Overhang { place, heights: [first, second] });
        }
        let Some(&(height, _, facing)) = crossings.first() else {
            let hole = || Err(CadError::Hole { place });
            return if beyond < -edge_mm { hole() } else { Ok(None) };
        };
        if facing < STEEPEST {
            let steep = || Err(CadError::Steep { place, inside_mm: -beyond });
            return if beyond < -edge_mm { steep() } else { Ok(None) };
        }
        Ok(Some(height))
    }
}

/// Facets by where they are seen from below.
struct Lines {
    corner: Place,
    count: [usize; 2],
    cells: Vec<Vec<u32>>,
    triangles: Vec<[Vec3; 3]>,
}

impl Lines {
    fn of(surface: &TriMesh) -> Self {
        let triangles: Vec<_> = (0..surface.triangles.len()).map(|t| surface.corners(t)).collect();
        let ends = |axis: usize| {
            let all = triangles.iter().flatten().map(|p| p[axis]);
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x), h.max(x)])
        };
        let [x, y] = [ends(0), ends(1)];
        let corner = [x[0], y[0]];
        let count = [x, y].map(|[low, high]| ((high - low) / SPACING_MM) as usize + 1);
        let mut cells = vec![Vec::new(); count[0] * count[1]];
        let cell = |axis: usize, x: f64| {
            (((x - corner[axis]) / SPACING_MM).max(0.0) as usize).min(count[axis] - 1)
        };
        for (t, corners) in triangles.iter().enumerate() {
            let range = |axis: usize| {
                let all = corners.map(|p| cell(axis, p[axis]));
                all[0].min(all[1]).min(all[2])..=all[0].max(all[1]).max(all[2])
            };
            for j in range(1) {
                for i in range(0) {
                    cells[j * count[0] + i].push(t as u32);
                }
            }
        }
        Self { corner, count, cells, triangles }
    }

    /// Heights at which a vertical line crosses the surface, from below, with the sense and the
    /// vertical share of the facet's normal.
    fn crossings(&self, place: Place) -> Vec<(f64, bool, f64)> {
        let mut cell = [0; 2];
        for axis in 0..2 {
            let along = (place[axis] - self.corner[axis]) / SPACING_MM;
            if !(along >= 0.0) || along as usize >= self.count[axis] {
                return Vec::new();
            }
            cell[axis] = along as usize;
        }
        let mut found: Vec<_> = self.cells[cell[1] * self.count[0] + cell[0]]
            .iter()
            .filter_map(|&t| crossing(&self.triangles[t as usize], place))
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }
}

fn crossing(corners: &[Vec3; 3], place: Place) -> Option<(f64, bool, f64)> {
    let [a, b, c] = corners.map(|p| [p.x - place[0], p.y - place[1]]);
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let shares = [cross(b, c), cross(c, a), cross(a, b)];
    let whole: f64 = shares.iter().sum();
    let inside = whole != 0.0 && shares.iter().all(|share| share * whole > 0.0);
    inside.then(|| {
        let height = (0..3).map(|n| shares[n] / whole * corners[n].z).sum();
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        (height, whole < 0.0, normal.z.abs() / normal.norm())
    })
}

/// Heights at all nodes of a grid: those that are missing go on straight from their neighbours.
/// `None` when there are too few to go on from.
fn filled(mut heights: Vec<Option<f64>>, count: [usize; 2]) -> Option<Vec<f64>> {
    let [columns, rows] = count.map(|n| n as i64);
    while heights.iter().any(Option::is_none) {
        let known = heights.clone();
        let at = |i: i64, j: i64| {
            let inside = (0..columns).contains(&i) && (0..rows).contains(&j);
            inside.then(|| known[(j * columns + i) as usize]).flatten()
        };
        let mut found = false;
        for (n, height) in heights.iter_mut().enumerate().filter(|(_, h)| h.is_none()) {
            let (i, j) = (n as i64 % columns, n as i64 / columns);
            let (mut sum, mut ways) = (0.0, 0.0);
            for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)] {
                if let (Some(near), Some(far)) = (at(i + di, j + dj), at(i + 2 * di, j + 2 * dj)) {
                    sum += 2.0 * near - far;
                    ways += 1.0;
                }
            }
            if ways > 0.0 {
                *height = Some(sum / ways);
                found = true;
            }
        }
        if !found {
            return None;
        }
    }
    Some(heights.into_iter().flatten().collect())
}

/// A bicubic spline over a plate; beyond its ends it goes on straight.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    corner: Place,
    spacing: [f64; 2],
    /// Nodes along the chest-wall edge and away from it.
    count: [usize; 2],
    /// Of the B-splines, one more than nodes at each end, along the edge running fastest.
    coefficients: Vec<f64>,
}

impl HeightField {
    /// The spline through heights (mm) at the nodes of a grid, four or more along each axis, that run
    /// fastest along the chest-wall edge. Its curvature does not change in the first and the last
    /// interval.
    pub fn through(corner: Place, spacing: [f64; 2], count: [usize; 2], heights: Vec<f64>) -> Self {
        let wide = count[0] + 2;
        let rows: Vec<f64> = heights.chunks(count[0]).flat_map(spline).collect();
        let mut coefficients = vec![0.0; wide * (count[1] + 2)];
        for i in 0..wide {
            let column: Vec<f64> = rows.iter().skip(i).step_by(wide).copied().collect();
            for (j, value) in spline(&column).into_iter().enumerate() {
                coefficients[j * wide + i] = value;
            }
        }
        Self { corner, spacing, count, coefficients }
    }

    /// First B-spline and what four of them contribute: values, first and second derivatives.
    fn weights(&self, axis: usize, at: f64) -> (usize, [[f64; 4]; 3]) {
        let step = self.spacing[axis];
        let along = (at - self.corner[axis]) / step;
        let last = self.count[axis] - 2;
        let cell = (along.max(0.0) as usize).min(last);
        let t = (along - cell as f64).clamp(0.0, 1.0);
        let beyond = along - cell as f64 - t;
        let s = 1.0 - t;
        let values =
            [s * s * s, (3.0 * t - 6.0) * t * t + 4.0, (3.0 * s - 6.0) * s * s + 4.0, t * t * t];
        let first = [-3.0 * s * s, (9.0 * t - 12.0) * t, -(9.0 * s - 12.0) * s, 3.0 * t * t];
        let second = [6.0 * s, 18.0 * t - 12.0, 18.0 * s - 12.0, 6.0 * t];
        let curved = if beyond == 0.0 { 1.0 / (6.0 * step * step) } else { 0.0 };
        let values = [0, 1, 2, 3].map(|n| (values[n] + beyond * first[n]) / 6.0);
        (cell, [values, first.map(|w| w / (6.0 * step)), second.map(|w| w * curved)])
    }
}

/// Coefficients of the cubic B-splines through values at even steps, one more than values at each
/// end. The first and last second differences are those of their neighbours.
fn spline(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    let mut inner = vec![0.0; n];
    // Gauss on c₀ - c₁ = z₀ - z₁, then cᵢ₋₁ + 4 cᵢ + cᵢ₊₁ = 6 zᵢ: cᵢ = inner - ratio cᵢ₊₁.
    let mut ratio = vec![0.0; n];
    (inner[0], ratio[0]) = (values[0] - values[1], -1.0);
    for i in 1..n - 1 {
        let pivot = 4.0 - ratio[i - 1];
        (inner[i], ratio[i]) = ((6.0 * values[i] - inner[i - 1]) / pivot, 1.0 / pivot);
    }
    // The last row: cₙ₋₁ - cₙ₋₂ = zₙ₋₁ - zₙ₋₂.
    let last = values[n - 1] - values[n - 2];
    inner[n - 1] = (last + inner[n - 2]) / (1.0 + ratio[n - 2]);
    for i in (0..n - 1).rev() {
        inner[i] -= ratio[i] * inner[i + 1];
    }
    let ghost = |a: f64, b: f64, c: f64| 3.0 * a - 3.0 * b + c;
    let mut all = vec![ghost(inner[0], inner[1], inner[2])];
    all.extend(&inner);
    all.push(ghost(inner[n - 1], inner[n - 2], inner[n - 3]));
    all
}

impl Lift for HeightField {
    fn coordinates(&self) -> usize {
        0
    }

    fn bend(&self, [along, away]: Place, _: &Pose) -> Bend {
        let (i, x) = self.weights(0, along);
        let (j, y) = self.weights(1, away);
        let wide = self.count[0] + 2;
        let mut bend = Bend::default();
        for n in 0..4 {
            for m in 0..4 {
                let c = self.coefficients[(j + n) * wide + i + m];
                bend.value += c * x[0][m] * y[0][n];
                bend.slope[0] += c * x[1][m] * y[0][n];
                bend.slope[1] += c * x[0][m] * y[1][n];
                bend.curvature[0] += c * x[2][m] * y[0][n];
                bend.curvature[1] += c * x[1][m] * y[1][n];
                bend.curvature[2] += c * x[0][m] * y[2][n];
            }
        }
        bend
    }

    fn weights(&self, _: Place) -> Pose {
        AT_REST
    }

    fn resistance(&self, _: &Pose) -> (Pose, Pose) {
        (AT_REST, AT_REST)
    }
}
