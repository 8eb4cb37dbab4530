//! A sampled signed distance as a twice continuously differentiable function.
//!
//! Tricubic B-spline interpolation with natural ends (Unser, *IEEE Signal Process. Mag.* 16:6
//! (1999) 22); beyond the grid each axis continues straight on, which natural ends join with
//! continuous second derivatives.

use super::target::Target;
use mammotwin_data::{
    Mat3, Vec3,
    volume::{ToVoxel, Volume},
};

/// Spline through the samples of a signed distance (mm).
#[derive(Debug, Clone)]
pub struct GridDistance {
    to_voxel: ToVoxel,
    /// Number of samples along each axis.
    shape: [usize; 3],
    /// Distance in `coefficients` of neighbours along each axis.
    stride: [usize; 3],
    /// Of the samples and of the places beside the grid that the outermost cells need, where they
    /// continue straight on.
    coefficients: Vec<f64>,
}

impl GridDistance {
    /// Interpolates `distance` (mm). Axes with fewer than two samples are constant.
    pub fn new(distance: &Volume<f32>) -> Self {
        let grid = &distance.grid;
        let padded = grid.shape.map(|n| n.max(2) + 2);
        let stride = [1, padded[0], padded[0] * padded[1]];
        let place = |at: [usize; 3]| (0..3).map(|axis| at[axis] * stride[axis]).sum::<usize>();
        let mut coefficients = vec![0.0; padded.iter().product()];
        for (n, &value) in distance.values.iter().enumerate() {
            coefficients[place(grid.voxel(n).map(|v| v + 1))] = f64::from(value);
        }
        let mut line = Vec::new();
        for axis in 0..3 {
            // Lines along an axis begin beside the grid along those that are done.
            let begins = |other: usize| match other {
                other if other < axis => 0..padded[other],
                other if other == axis => 0..1,
                other => 1..grid.shape[other] + 1,
            };
            for (k, j) in begins(2).flat_map(|k| begins(1).map(move |j| (k, j))) {
                for first in begins(0).map(|i| place([i, j, k])) {
                    let at = |n: usize| first + n * stride[axis];
                    line.clear();
                    line.extend((1..=grid.shape[axis]).map(|n| coefficients[at(n)]));
                    natural_spline(&mut line);
                    let last = line.len() - 1;
                    coefficients[at(0)] = 2.0 * line[0] - line[last.min(1)];
                    for n in 1..padded[axis] {
                        coefficients[at(n)] = match line.get(n - 1) {
                            Some(&inside) => inside,
                            None => 2.0 * line[last] - line[last.saturating_sub(1)],
                        };
                    }
                }
            }
        }
        Self { to_voxel: grid.to_voxel(), shape: grid.shape, stride, coefficients }
    }
}

/// Turns samples into coefficients: (c₋ + 4c + c₊)/6 = f, and c = f at both ends.
fn natural_spline(line: &mut [f64]) {
    let n = line.len();
    if n < 3 {
        return;
    }
    let inner = n - 2;
    let mut factor = vec![0.0; inner];
    let (first, last) = (line[0], line[n - 1]);
    for m in 0..inner {
        let mut right = 6.0 * line[m + 1];
        if m == 0 {
            right -= first;
        }
        if m == inner - 1 {
            right -= last;
        }
        let below = if m == 0 { 0.0 } else { 1.0 };
        let pivot = 4.0 - below * if m == 0 { 0.0 } else { factor[m - 1] };
        factor[m] = 1.0 / pivot;
        line[m + 1] = (right - below * if m == 0 { 0.0 } else { line[m] }) / pivot;
    }
    for m in (0..inner - 1).rev() {
        line[m + 1] -= factor[m] * line[m + 2];
    }
}

/// The four coefficients of an axis that matter at a coordinate, with their weights and the
/// weights of the first and second derivative.
struct Axis {
    /// Place of the first coefficient, counted from beside the grid.
    first: usize,
    weights: [[f64; 4]; 3],
}

impl Axis {
    fn at(coordinate: f64, count: usize) -> Self {
        let end = count.saturating_sub(1) as f64;
        let inside = coordinate.clamp(0.0, end);
        let cell = inside.floor().min((count.max(2) - 2) as f64);
        let t = inside - cell;
        let s = 1.0 - t;
        let mut value = [
            s * s * s / 6.0,
            (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
            (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
            t * t * t / 6.0,
        ];
        let slope = [-0.5 * s * s, -2.0 * t + 1.5 * t * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t];
        let mut curve = [s, -2.0 + 3.0 * t, -2.0 + 3.0 * s, t];
        let beyond = coordinate - inside;
        if beyond != 0.0 {
            for n in 0..4 {
                value[n] += beyond * slope[n];
                curve[n] = 0.0;
            }
        }
        Self { first: cell as usize, weights: [value, slope, curve] }
    }
}

impl Target for GridDistance {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let voxel = self.to_voxel.apply(point);
        let [i, j, k] = [0, 1, 2].map(|axis| Axis::at(voxel[axis], self.shape[axis]));
        let first = i.first + j.first * self.stride[1] + k.first * self.stride[2];
        // Sums over orders of derivatives along i, j and k that sum to at most 2.
        let mut value = 0.0;
        let mut gradient = Vec3::zeros();
        let mut hessian = Mat3::zeros();
        for c in 0..4 {
            let (mut v, mut vi, mut vj) = (0.0, 0.0, 0.0);
            let (mut vii, mut vij, mut vjj) = (0.0, 0.0, 0.0);
            for b in 0..4 {
                let start = first + b * self.stride[1] + c * self.stride[2];
                let row = &self.coefficients[start..start + 4];
                let along_i =
                    i.weights.map(|w| w.iter().zip(row).map(|(w, row)| w * row).sum::<f64>());
                let along_j = j.weights.map(|w| w[b]);
                v += along_i[0] * along_j[0];
                vi += along_i[1] * along_j[0];
                vj += along_i[0] * along_j[1];
                vii += along_i[2] * along_j[0];
                vij += along_i[1] * along_j[1];
                vjj += along_i[0] * along_j[2];
            }
            let [w, wk, wkk] = k.weights.map(|w| w[c]);
            value += v * w;
            gradient += Vec3::new(vi * w, vj * w, v * wk);
            let (ij, ik, jk) = (vij * w, vi * wk, vj * wk);
            hessian += Mat3::new(vii * w, ij, ik, ij, vjj * w, jk, ik, jk, v * wkk);
        }
        let turn = self.to_voxel.linear();
        (value, turn.transpose() * gradient, turn.transpose() * hessian * turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::Grid;

    /// Samples of a distance to a sphere of radius 20 about (3, -2, 5), on a turned grid.
    fn sphere(spacing: f64) -> GridDistance {
        let turn = *nalgebra::Rotation3::from_euler_angles(0.2, -0.3, 0.5).matrix();
        let shape = [(60.0 / spacing) as usize + 1; 3];
        let axes = spacing * turn;
        let grid = Grid { shape, axes, origin: turn * Vec3::repeat(-30.0) };
        let distance = |p: &Vec3| (p - Vec3::new(3.0, -2.0, 5.0)).norm() - 20.0;
        let values =
            (0..grid.len()).map(|n| distance(&grid.center(grid.voxel(n))) as f32).collect();
        GridDistance::new(&Volume { grid, values })
    }

    #[test]
    fn interpolates_a_sphere_with_its_normal_and_curvature() {
        let target = sphere(2.0);
        let center = Vec3::new(3.0, -2.0, 5.0);
        for direction in [Vec3::x(), Vec3::new(0.6, -0.8, 0.0), Vec3::new(-0.48, 0.6, 0.64)] {
            let (distance, normal, hessian) = target.distance(&(center + 20.5 * direction));
            assert!((distance - 0.5).abs() < 2e-3, "{distance}");
            assert!((normal - direction).norm() < 1e-3, "{normal}");
            let want = (Mat3::identity() - direction * direction.transpose()) / 20.5;
            assert!((hessian - want).norm() < 3e-3, "{hessian}{want}");
        }
    }

    #[test]
    fn is_twice_differentiable_inside_at_the_border_and_beyond() {
        let target = sphere(4.0);
        let turn = *nalgebra::Rotation3::from_euler_angles(0.2, -0.3, 0.5).matrix();
        let places = [[1.0, 2.0, 22.0], [29.9, 3.0, -4.0], [30.0, 1.0, 2.0], [37.0, -35.0, 31.0]];
        for place in places {
            let p = turn * Vec3::from(place);
            let (_, gradient, hessian) = target.distance(&p);
            for axis in 0..3 {
                let h = 1e-4;
                let mut step = Vec3::zeros();
                step[axis] = h;
                let (up, down) = (target.distance(&(p + step)), target.distance(&(p - step)));
                assert!(((up.0 - down.0) / (2.0 * h) - gradient[axis]).abs() < 1e-7);
                let slope = (up.1 - down.1) / (2.0 * h);
                assert!((slope - hessian.column(axis)).norm() < 1e-4, "{place:?} {slope}");
            }
        }
    }
}
