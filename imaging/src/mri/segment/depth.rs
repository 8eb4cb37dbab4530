//! How deep a voxel lies under the surface of the body.

use mammotwin_data::volume::Grid;
use rayon::prelude::*;

/// Distance (mm) from each voxel to the nearest voxel that is not in `mask`, up to `cap_mm`.
///
/// Exact for grids with orthogonal axes: one lower envelope of parabolas a line and axis
/// (Felzenszwalb and Huttenlocher 2012, <https://doi.org/10.4086/toc.2012.v008a019>). Places
/// outside of the image are as the border is.
pub fn distance_to_outside(mask: &[bool], grid: &Grid, cap_mm: f64) -> Vec<f32> {
    let [ni, nj, nk] = grid.shape;
    let spacing = grid.spacing_mm();
    let cap = (cap_mm * cap_mm) as f32;
    let mut squared: Vec<f32> = mask.iter().map(|&m| if m { cap } else { 0.0 }).collect();
    squared.par_chunks_mut(ni * nj).for_each(|slice| {
        let mut line = Line::new(ni.max(nj));
        for j in 0..nj {
            line.run(slice, j * ni, 1, ni, spacing[0] as f32);
        }
        for i in 0..ni {
            line.run(slice, i, ni, nj, spacing[1] as f32);
        }
    });
    // Lines along k cross all slices: gather rows of i, one j at a time.
    let rows: Vec<Vec<f32>> = (0..nj)
        .into_par_iter()
        .map(|j| {
            let mut plane = vec![0.0; ni * nk];
            for k in 0..nk {
                let row = (k * nj + j) * ni;
                plane[k * ni..(k + 1) * ni].copy_from_slice(&squared[row..row + ni]);
            }
            let mut line = Line::new(nk);
            for i in 0..ni {
                line.run(&mut plane, i, ni, nk, spacing[2] as f32);
            }
            plane
        })
        .collect();
    squared.par_chunks_mut(ni * nj).enumerate().for_each(|(k, slice)| {
        for j in 0..nj {
            for i in 0..ni {
                slice[j * ni + i] = rows[j][k * ni + i].sqrt();
            }
        }
    });
    squared
}

/// Scratch of one line.
struct Line {
    values: Vec<f32>,
    apex: Vec<usize>,
    from: Vec<f32>,
}

impl Line {
    fn new(n: usize) -> Self {
        Self { values: vec![0.0; n], apex: vec![0; n], from: vec![0.0; n + 1] }
    }

    fn run(&mut self, data: &mut [f32], start: usize, stride: usize, n: usize, step: f32) {
        let square = step * step;
        let mut flat = true;
        for q in 0..n {
            self.values[q] = data[start + q * stride];
            flat &= self.values[q] == self.values[0];
        }
        if flat {
            return;
        }
        let values = &self.values;
        let meet = |p: usize, q: usize| {
            let (pf, qf) = (p as f32, q as f32);
            ((values[q] - values[p]) / square + qf * qf - pf * pf) / (2.0 * (qf - pf))
        };
        let mut last = 0;
        self.apex[0] = 0;
        self.from[0] = f32::NEG_INFINITY;
        for q in 1..n {
            let mut at = meet(self.apex[last], q);
            while at <= self.from[last] {
                last -= 1;
                at = meet(self.apex[last], q);
            }
            last += 1;
            self.apex[last] = q;
            self.from[last] = at;
        }
        let mut parabola = 0;
        for q in 0..n {
            while parabola < last && self.from[parabola + 1] < q as f32 {
                parabola += 1;
            }
            let apex = self.apex[parabola];
            let steps = q as f32 - apex as f32;
            data[start + q * stride] = values[apex] + square * steps * steps;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::Vec3;

    #[test]
    fn the_distance_to_one_voxel_is_euclidean() {
        let grid = Grid::aligned([9, 8, 7], [1.0, 1.5, 2.5], Vec3::zeros());
        let hole = grid.index([2, 5, 3]);
        let mask: Vec<bool> = (0..grid.len()).map(|n| n != hole).collect();
        let distance = distance_to_outside(&mask, &grid, 100.0);
        for n in 0..grid.len() {
            let exact = (grid.center(grid.voxel(n)) - grid.center([2, 5, 3])).norm();
            assert!((f64::from(distance[n]) - exact).abs() < 1e-4);
        }
    }
}
