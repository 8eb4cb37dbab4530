//! Where in the breast the matrix of microcalcifications goes.

use crate::xray::raster::{RasterError, Window, path_lengths};
use mammotwin_data::{Vec3, study::CalcificationPlan, surface::TriMesh};

/// Height (mm) of a source whose rays are vertical to 3 µm within the breast.
const FAR_AWAY_MM: f64 = 1e7;
/// Distance (mm) of the places that are tried.
const STEP_MM: f64 = 1.0;
/// The breast touches both plates where its thickness is the nominal one within this share.
const CONTACT: f64 = 0.15;
/// A calcification is dropped where the breast is thinner than this share of the nominal.
const TISSUE: f64 = 0.5;

/// Place of one microcalcification in the matrix.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Site {
    /// Row, away from the chest wall.
    pub row: usize,
    /// Column, along x.
    pub column: usize,
    /// Centre (mm).
    pub center: Vec3,
}

/// Centres of the matrix at half of the thickness, parallel to the detector.
///
/// The matrix goes where most of it lies between the plates, and there as far as possible from
/// where the breast leaves them: the smallest distance over its calcifications is as large as can
/// be, measured as the square regions of interest are (largest of |Δx|, |Δy|). What does not lie in
/// tissue is left out.
pub fn sites(
    surface: &TriMesh,
    thickness_mm: f64,
    plan: &CalcificationPlan,
) -> Result<Vec<Site>, RasterError> {
    let map = Map::of(surface, thickness_mm)?;
    let steps = |count: usize| (0..count).map(move |n| n as f64 - 0.5 * (count as f64 - 1.0));
    let offsets: Vec<(usize, usize, [f64; 2])> = steps(plan.rows)
        .enumerate()
        .flat_map(|(row, y)| {
            let place = move |(column, x): (usize, f64)| {
                (row, column, [x * plan.pitch_mm, y * plan.pitch_mm])
            };
            steps(plan.columns).enumerate().map(place)
        })
        .collect();
    let mut best = ((0, 0, 0), Vec::new());
    for n in 0..map.window.rows * map.window.columns {
        let [x, y] = map.place(n);
        let placed = offsets.iter().map(|&(row, column, [dx, dy])| (row, column, x + dx, y + dy));
        let clear = |x, y| map.at(x, y).map_or(0, |at| map.clearance[at]);
        let inside = placed.clone().map(|(_, _, x, y)| clear(x, y)).filter(|&c| c > 0);
        let merit = (inside.clone().count(), inside.clone().min().unwrap_or(0), inside.sum());
        if merit > best.0 {
            best = (merit, placed.collect());
        }
    }
    let in_tissue = |x, y| map.at(x, y).is_some_and(|at| map.depth[at] >= TISSUE * thickness_mm);
    let kept = best.1.into_iter().filter(|&(_, _, x, y)| in_tissue(x, y));
    Ok(kept
        .map(|(row, column, x, y)| Site {
            row,
            column,
            center: Vec3::new(x, y, 0.5 * thickness_mm),
        })
        .collect())
}

/// The breast from above.
struct Map {
    window: Window,
    /// Thickness (mm).
    depth: Vec<f64>,
    /// Steps to the next place without contact, 0 there; largest of the two directions.
    clearance: Vec<u32>,
}

impl Map {
    fn of(surface: &TriMesh, thickness_mm: f64) -> Result<Self, RasterError> {
        let used = surface.triangles.iter().flatten().map(|&n| surface.points[n as usize]);
        let (mut low, mut high) = (Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN));
        for point in used {
            low = low.inf(&point);
            high = high.sup(&point);
        }
        let count = |length: f64| (length / STEP_MM).ceil().clamp(0.0, 1000.0) as usize + 2;
        // Begins at the detector's edge: what lies behind is not in the picture.
        let window = Window {
            left_mm: low.x - STEP_MM,
            first_row_mm: -0.5 * STEP_MM,
            pitch_mm: STEP_MM,
            columns: count(high.x - low.x) + 1,
            rows: count(high.y) + 1,
        };
        let paths = path_lengths(surface, FAR_AWAY_MM, &window)?;
        let depth: Vec<f64> = paths.iter().map(|&p| f64::from(p)).collect();
        let touches =
            |n: usize| n >= window.columns && (depth[n] / thickness_mm - 1.0).abs() <= CONTACT;
        let clearance = clearance(&window, touches);
        Ok(Self { window, depth, clearance })
    }

    fn place(&self, n: usize) -> [f64; 2] {
        let w = &self.window;
        [
            w.left_mm + (n % w.columns) as f64 * STEP_MM,
            w.first_row_mm + (n / w.columns) as f64 * STEP_MM,
        ]
    }

    /// Sample nearest to a place; `None` beside the map.
    fn at(&self, x: f64, y: f64) -> Option<usize> {
        let w = &self.window;
        let [u, v] = [(x - w.left_mm) / STEP_MM, (y - w.first_row_mm) / STEP_MM];
        let [u, v] = [u.round(), v.round()];
        let inside = u >= 0.0 && v >= 0.0 && u < w.columns as f64 && v < w.rows as f64;
        inside.then(|| v as usize * w.columns + u as usize)
    }
}

/// Chessboard distance to the next sample that does not touch, or to the border: exact in two
/// passes.
fn clearance(window: &Window, touches: impl Fn(usize) -> bool) -> Vec<u32> {
    let (rows, columns) = (window.rows as isize, window.columns as isize);
    let mut steps: Vec<u32> =
        (0..window.rows * window.columns).map(|n| if touches(n) { u32::MAX } else { 0 }).collect();
    let mut pass = |n: isize, neighbours: [[isize; 2]; 4]| {
        let (row, column) = (n / columns, n % columns);
        for [dr, dc] in neighbours {
            let (r, c) = (row + dr, column + dc);
            let inside = (0..rows).contains(&r) && (0..columns).contains(&c);
            let there = if inside { steps[(r * columns + c) as usize] } else { 0 };
            steps[n as usize] = steps[n as usize].min(there.saturating_add(1));
        }
    };
    for n in 0..rows * columns {
        pass(n, [[0, -1], [-1, -1], [-1, 0], [-1, 1]]);
    }
    for n in (0..rows * columns).rev() {
        pass(n, [[0, 1], [1, 1], [1, 0], [1, -1]]);
    }
    for (n, steps) in steps.iter_mut().enumerate() {
        if !touches(n) {
            *steps = 0;
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xray::shapes::{cuboid, half_cylinder};

    fn plan(rows: usize, columns: usize) -> CalcificationPlan {
        CalcificationPlan { rows, columns, ..CalcificationPlan::default() }
    }

    #[test]
    fn the_matrix_is_in_the_middle_of_a_box_in_front_of_the_edge() {
        let block = cuboid([-30.0, -50.0, 0.0], [70.0, 90.0, 46.0]);
        let sites = sites(&block, 46.0, &plan(7, 3)).unwrap();
        assert_eq!(sites.len(), 21);
        // Rows span 60 of 90 mm, columns 20 of 100 mm: free by 15 mm along y, anywhere along x.
        let first = sites[0];
        assert_eq!((first.row, first.column), (0, 0));
        assert!((first.center.y - 15.0).abs() <= 1.0, "{first:?}");
        assert!(sites.iter().all(|s| s.center.z == 23.0 && (-15.0..=55.0).contains(&s.center.x)));
        let step = sites[20].center - first.center;
        assert_eq!(step, Vec3::new(20.0, 60.0, 0.0));
    }

    #[test]
    fn what_finds_no_tissue_is_left_out() {
        let breast = half_cylinder(50.0, 0.0, 46.0, 180);
        let sites = sites(&breast, 46.0, &plan(7, 3)).unwrap();
        assert!(!sites.is_empty() && sites.len() < 21, "{}", sites.len());
        assert!(sites.iter().all(|s| s.center.xy().norm() < 51.0 && s.center.y > 0.0));
        let behind = cuboid([-30.0, -90.0, 0.0], [30.0, -1.0, 46.0]);
        assert!(super::sites(&behind, 46.0, &plan(7, 3)).unwrap().is_empty());
        let thin = cuboid([-30.0, -90.0, 0.0], [30.0, 90.0, 20.0]);
        assert!(super::sites(&thin, 46.0, &plan(7, 3)).unwrap().is_empty());
    }
}
