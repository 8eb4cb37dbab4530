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

/// Where things can be put into a compressed breast.
pub struct Places {
    map: Map,
    thickness_mm: f64,
}

impl Places {
    /// Looks at a closed surface (mm) between plates of this distance (mm).
    pub fn of(surface: &TriMesh, thickness_mm: f64) -> Result<Self, RasterError> {
        Ok(Self { map: Map::of(surface, thickness_mm)?, thickness_mm })
    }

    /// Centres of the matrix at half of the thickness, parallel to the detector.
    ///
    /// Without a stated middle the matrix goes where most of it lies between the plates, and there as
    /// far as possible from where the breast leaves them: the smallest distance over its
    /// calcifications is as large as can be, measured as the square regions of interest are (largest of
    /// |Δx|, |Δy|), and what does not lie in tissue, or not so that `fits` says yes of its centre (mm), is left out. With
    /// one all are given.
    pub fn sites(&self, plan: &CalcificationPlan, fits: &dyn Fn(&Vec3) -> bool) -> Vec<Site> {
        let map = &self.map;
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
        let at = |[x, y]: [f64; 2]| {
            let placed = move |&(row, column, [dx, dy]): &(usize, usize, [f64; 2])| {
                (row, column, x + dx, y + dy)
            };
            offsets.iter().map(placed)
        };
        let site = |(row, column, x, y): (usize, usize, f64, f64)| Site {
            row,
            column,
            center: Vec3::new(x, y, 0.5 * self.thickness_mm),
        };
        if let Some(middle) = plan.center_mm {
            return at(middle).map(site).collect();
        }
        let mut best = ((0, 0, 0), Vec::new());
        for n in 0..map.window.rows * map.window.columns {
            let placed = at(map.place(n));
            let clear = |x, y| map.at(x, y).map_or(0, |at| map.clearance[at]);
            let inside = placed.clone().map(|(_, _, x, y)| clear(x, y)).filter(|&c| c > 0);
            let merit = (inside.clone().count(), inside.clone().min().unwrap_or(0), inside.sum());
            if merit > best.0 {
                best = (merit, placed.collect());
            }
        }
        let kept = best.1.into_iter().filter(|&(_, _, x, y)| self.is_tissue(x, y));
        kept.map(site).filter(|site| fits(&site.center)).collect()
    }

    fn is_tissue(&self, x: f64, y: f64) -> bool {
        let least = TISSUE * self.thickness_mm;
        self.map.at(x, y).is_some_and(|at| self.map.depth[at] >= least)
    }

    /// A place (mm) by shares: of the width of the breast there, of its extent from the detector's edge
    /// to its front, of its thickness.
    pub fn at_share(&self, [x, y, z]: [f64; 3]) -> Vec3 {
        let window = &self.map.window;
        let tissue = |n: &usize| {
            let [x, y] = self.map.place(*n);
            y >= 0.0 && self.is_tissue(x, y)
        };
        let all = || (0..window.rows * window.columns).filter(tissue);
        let front = all().map(|n| self.map.place(n)[1]).fold(0.0, f64::max);
        let y = y * front;
        let row = (y - window.first_row_mm) / STEP_MM;
        let row = (row.round().max(0.0) as usize).min(window.rows - 1);
        let width = all().filter(|n| n / window.columns == row).map(|n| self.map.place(n)[0]);
        let (low, high) = width
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (f64::min(l, x), f64::max(h, x)));
        let x = if low <= high { low + x * (high - low) } else { 0.0 };
        Vec3::new(x, y, z * self.thickness_mm)
    }
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

    fn sites(surface: &TriMesh, thickness_mm: f64, plan: &CalcificationPlan) -> Vec<Site> {
        Places::of(surface, thickness_mm).unwrap().sites(plan, &|_| true)
    }

    fn plan(rows: usize, columns: usize) -> CalcificationPlan {
        CalcificationPlan { rows, columns, ..CalcificationPlan::default() }
    }

    #[test]
    fn the_matrix_is_in_the_middle_of_a_box_in_front_of_the_edge() {
        let block = cuboid([-30.0, -50.0, 0.0], [70.0, 90.0, 46.0]);
        let sites = sites(&block, 46.0, &plan(7, 3));
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
        let sites = sites(&breast, 46.0, &plan(7, 3));
        assert!(!sites.is_empty() && sites.len() < 21, "{}", sites.len());
        assert!(sites.iter().all(|s| s.center.xy().norm() < 51.0 && s.center.y > 0.0));
        let behind = cuboid([-30.0, -90.0, 0.0], [30.0, -1.0, 46.0]);
        assert!(tests::sites(&behind, 46.0, &plan(7, 3)).is_empty());
        let thin = cuboid([-30.0, -90.0, 0.0], [30.0, 90.0, 20.0]);
        assert!(tests::sites(&thin, 46.0, &plan(7, 3)).is_empty());
    }

    #[test]
    fn a_stated_middle_and_shares_are_taken_as_they_are() {
        let block = cuboid([-30.0, -50.0, 0.0], [70.0, 90.0, 46.0]);
        let stated = CalcificationPlan { center_mm: Some([60.0, 80.0]), ..plan(3, 3) };
        let sites = sites(&block, 46.0, &stated);
        assert_eq!(sites.len(), 9);
        assert_eq!(sites[8].center, Vec3::new(70.0, 90.0, 23.0));
        let places = Places::of(&block, 46.0).unwrap();
        for (share, exact) in
            [([0.5; 3], [20.0, 45.0, 23.0]), ([0.1, 0.8, 0.25], [-20.0, 72.0, 11.5])]
        {
            let got = places.at_share(share);
            assert!((got - Vec3::from(exact)).norm() < 1.5, "{got}");
        }
    }
}
