//! Where the breasts end: sternal plane, lateral plane, upper and lower limits.

use super::body::{median, quantile};
use super::polar::{Polar, STEP_Z};
use super::wall::Wall;
use mammotwin_data::{Vec3, labels::Side};

/// Limits in the body's axes (mm).
#[derive(Debug, Clone)]
pub(super) struct BodyLimits {
    /// x of the sternal plane at z = 0, and its change per mm of z.
    pub sternum: [f64; 2],
    /// y of the plane through the thorax' mid-depth.
    pub lateral_y: f64,
    /// Lower and upper z of the right and the left breast.
    pub z: [[f64; 2]; 2],
    /// Size of each breast's cross-section at the lower and the upper border of the image,
    /// relative to its largest.
    pub at_border: [[f64; 2]; 2],
}

impl BodyLimits {
    /// Signed distance along x from the sternal plane; positive on the right.
    pub(super) fn right_of_sternum(&self, x: f64, z: f64) -> f64 {
        x - self.sternum[0] - self.sternum[1] * z
    }
}

/// Position of a side in arrays.
pub(super) fn slot(side: Side) -> usize {
    match side {
        Side::Right => 0,
        Side::Left => 1,
    }
}

/// A breast protrudes where a quarter of its front ...
const PART: f64 = 0.25;
/// ... lies so much (mm) beyond the layer of fat that is everywhere; ...
const PROTRUDES_MM: f64 = 3.0;
/// ... it ends so much (mm) above and below that: a band of flat tissue belongs to it, down towards
/// the costal margin and up towards the clavicle.
const MARGIN_MM: f64 = 12.0;
/// Half width (rad) of the front of the chest: further to the side tissue slides beyond the breast's
/// height when a body lies turned.
const FRONT: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// Measures the limits on the wall and on the tissue in front of it. `None` if nothing protrudes.
pub(super) fn find(wall: &Wall) -> Option<BodyLimits> {
    let sternum = sternal_line(wall);
    let lateral_y = mid_depth(wall, sternum);
    let mut limits = BodyLimits { sternum, lateral_y, z: [[0.0; 2]; 2], at_border: [[0.0; 2]; 2] };
    let areas = cross_sections(wall, &limits);
    let protrusions = protrusions(wall, &limits);
    let [_, n_z] = wall.polar.shape;
    let height = |row: f64| wall.polar.low_z + row * STEP_Z;
    for side in 0..2 {
        let area = &areas[side];
        let peak = (0..n_z).max_by(|&a, &b| area[a].total_cmp(&area[b]))?;
        if area[peak] <= 0.0 {
            return None;
        }
        let beyond = |row: usize| protrusions[side][row] - PROTRUDES_MM;
        let ended = |row: &usize| beyond(*row) < 0.0;
        // Between the rows on both sides of the end.
        let between = |inner: usize, outer: usize| {
            let part = beyond(inner) / (beyond(inner) - beyond(outer));
            inner as f64 + part.clamp(0.0, 1.0) * (outer as f64 - inner as f64)
        };
        let low = (0..peak).rev().find(ended).map_or(0.0, |row| between(row + 1, row));
        let high = (peak + 1..n_z).find(ended);
        let high = high.map_or((n_z - 1) as f64, |row| between(row - 1, row));
        limits.z[side] = [height(low) - MARGIN_MM, height(high) + MARGIN_MM];
        limits.at_border[side] = [area[0] / area[peak], area[n_z - 1] / area[peak]];
    }
    Some(limits)
}

/// Largest inclination of the sternum to the body's axis: what is more is the wall's asymmetry.
const STEEPEST: f64 = 0.1;

/// x at z = 0 and slope of the line of symmetry: the middles of chords of the wall.
fn sternal_line(wall: &Wall) -> [f64; 2] {
    let polar = &wall.polar;
    let [n_u, n_z] = polar.shape;
    let mut middles = Vec::new();
    for row in 0..n_z {
        let points: Vec<[f64; 3]> = (0..n_u)
            .map(|u| {
                let column = row * n_u + u;
                let p = polar.point(column, f64::from(wall.front[column]));
                [p.x, p.y, f64::from(wall.contrast[column])]
            })
            .collect();
        let front = points.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        let mut chords: Vec<f64> = (3..13)
            .filter_map(|step| {
                let y = front - 5.0 * f64::from(step);
                let crosses = |pair: &[[f64; 3]]| {
                    let part = (y - pair[0][1]) / (pair[1][1] - pair[0][1]);
                    pair[0][0] + part * (pair[1][0] - pair[0][0])
                };
                let up = points.windows(2).find(|w| w[0][1] < y && w[1][1] >= y)?;
                let down = points.windows(2).rev().find(|w| w[0][1] >= y && w[1][1] < y)?;
                if up[0][2].min(down[0][2]) < 0.5 {
                    return None;
                }
                Some(0.5 * (crosses(up) + crosses(down)))
            })
            .collect();
        if chords.len() >= 4
            && let Some(middle) = median(&mut chords)
        {
            middles.push([polar.height(row * n_u), middle]);
        }
    }
    let [x, slope] = robust_line(&middles).unwrap_or([polar.axis[0], 0.0]);
    [x, slope.clamp(-STEEPEST, STEEPEST)]
}

/// Value at 0 and slope, by Theil and Sen: medians, so that a few bad rows do not matter.
fn robust_line(points: &[[f64; 2]]) -> Option<[f64; 2]> {
    let mut slopes = Vec::new();
    for (n, a) in points.iter().enumerate() {
        for b in &points[..n] {
            slopes.push((a[1] - b[1]) / (a[0] - b[0]));
        }
    }
    let slope = median(&mut slopes).unwrap_or(0.0);
    let mut offsets: Vec<f64> = points.iter().map(|p| p[1] - slope * p[0]).collect();
    Some([median(&mut offsets)?, slope])
}

/// y of the centre of ellipses through the rear of the muscle, one a row: the belly of the muscle does
/// not count.
fn mid_depth(wall: &Wall, sternum: [f64; 2]) -> f64 {
    let polar = &wall.polar;
    let [n_u, n_z] = polar.shape;
    let mut centers = Vec::new();
    for row in 0..n_z {
        // x² + b y² + c y + d = 0, y from the axis, in units of 100 mm.
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        for column in row * n_u..(row + 1) * n_u {
            let p = polar.point(column, f64::from(wall.rear.radii[column]));
            let x = (p.x - sternum[0] - sternum[1] * p.z) / 100.0;
            let y = (p.y - polar.axis[1]) / 100.0;
            let terms = nalgebra::Vector3::new(y * y, y, 1.0);
            let weight = f64::from(wall.contrast[column]) + 1e-3;
            normal += weight * terms * terms.transpose();
            right -= weight * x * x * terms;
        }
        if let Some(found) = normal.cholesky().map(|c| c.solve(&right))
            && found[0] > 0.3
        {
            centers.push(polar.axis[1] - 50.0 * found[1] / found[0]);
        }
    }
    let center = median(&mut centers).unwrap_or(polar.axis[1]);
    center.clamp(polar.axis[1] - 60.0, polar.axis[1] + 30.0)
}

/// Columns further to the side than this (rad from the front) hold axilla and shoulder.
const SECTOR: f64 = 60.0 * std::f64::consts::PI / 180.0;

/// The place on the wall of a column in front of the lateral plane.
fn in_front(wall: &Wall, limits: &BodyLimits, column: usize) -> Option<Vec3> {
    let p = wall.polar.point(column, f64::from(wall.front[column]));
    (p.y > limits.lateral_y).then_some(p)
}

/// Thickness (mm) of the tissue in front of the wall.
fn thickness(wall: &Wall, column: usize) -> f64 {
    f64::from(wall.surface[column] - wall.front[column]).max(0.0)
}

/// Thickness (mm) of the layer of fat that is everywhere: a third of the columns have less.
fn layer(wall: &Wall, limits: &BodyLimits) -> f64 {
    let front = (0..wall.polar.len()).filter(|&c| in_front(wall, limits, c).is_some());
    let mut layers: Vec<f64> = front.map(|column| thickness(wall, column)).collect();
    quantile(&mut layers, 1.0 / 3.0).unwrap_or(0.0)
}

/// How far (mm) each side's tissue protrudes beyond the layer of fat, row by row: a [`PART`] of its
/// front does by more.
fn protrusions(wall: &Wall, limits: &BodyLimits) -> [Vec<f64>; 2] {
    let polar = &wall.polar;
    let [n_u, n_z] = polar.shape;
    let layer = layer(wall, limits);
    [0, 1].map(|side| {
        let of_row = |row: usize| {
            let columns = (row * n_u..(row + 1) * n_u).filter(|&column| {
                let from_front = (polar.angle(column) - std::f64::consts::FRAC_PI_2).abs();
                let here = in_front(wall, limits, column)
                    .map(|p| usize::from(limits.right_of_sternum(p.x, p.z) < 0.0));
                from_front < FRONT && here == Some(side)
            });
            let mut beyond: Vec<f64> = columns.map(|c| thickness(wall, c) - layer).collect();
            quantile(&mut beyond, 1.0 - PART).unwrap_or(0.0)
        };
        (0..n_z).map(of_row).collect()
    })
}

/// Area (mm²) of each side's tissue in front of the wall beyond the layer of fat that is
/// everywhere, row by row.
fn cross_sections(wall: &Wall, limits: &BodyLimits) -> [Vec<f64>; 2] {
    let polar = &wall.polar;
    let [n_u, n_z] = polar.shape;
    let layer = layer(wall, limits) + 4.0;
    let mut areas = [vec![0.0; n_z], vec![0.0; n_z]];
    for column in 0..polar.len() {
        let Some(p) = in_front(wall, limits, column) else { continue };
        if (polar.angle(column) - std::f64::consts::FRAC_PI_2).abs() > SECTOR {
            continue;
        }
        let side = usize::from(limits.right_of_sternum(p.x, p.z) < 0.0);
        let outer = f64::from(wall.surface[column]);
        let inner = (f64::from(wall.front[column]) + layer).min(outer);
        let sector = polar.steps_mm(1.0)[0];
        areas[side][column / n_u] += 0.5 * sector * (outer * outer - inner * inner);
    }
    areas
}

/// Rows of the map that lie in the image.
pub(super) fn height_range(polar: &Polar) -> [f64; 2] {
    [polar.low_z, polar.low_z + (polar.shape[1] - 1) as f64 * STEP_Z]
}
