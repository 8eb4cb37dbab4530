//! A sampled signed distance as a twice continuously differentiable function.
//!
//! Tricubic B-spline interpolation with natural ends (Unser, *IEEE Signal Process. Mag.* 16:6
//! (1999) 22); beyond the grid each axis continues straight on, which natural ends join with
//! continuous second derivatives.

use super::target::Target;
use mammotwin_data::{
    Mat3, Vec3,
    volume::{Grid, ToVoxel, Volume},
};

/// Spline through the samples of a signed distance (mm).
#[derive(Debug, Clone)]
pub struct GridDistance {
    grid: Grid,
    to_voxel: ToVoxel,
    coefficients: Vec<f64>,
}

impl GridDistance {
    /// Interpolates `distance` (mm). Axes with fewer than two samples are constant.
    pub fn new(distance: &Volume<f32>) -> Self {
        let grid = distance.grid.clone();
        let mut coefficients: Vec<f64> = distance.values.iter().map(|&v| f64::from(v)).collect();
        let [ni, nj, nk] = grid.shape;
        let mut line = Vec::new();
        for (axis, (count, stride)) in [(ni, 1), (nj, ni), (nk, ni * nj)].into_iter().enumerate() {
            for first in 0..grid.len() {
                if grid.voxel(first)[axis] == 0 {
                    line.clear();
                    line.extend((0..count).map(|n| coefficients[first + n * stride]));
                    natural_spline(&mut line);
                    for (n, &c) in line.iter().enumerate() {
                        coefficients[first + n * stride] = c;
                    }
                }
            }
        }
        Self { to_voxel: grid.to_voxel(), grid, coefficients }
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
    first: isize,
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
        Self { first: cell as isize - 1, weights: [value, slope, curve] }
    }
}

impl GridDistance {
    /// Coefficient at any index: beyond an end they continue straight on.
    fn coefficient(&self, at: [isize; 3]) -> f64 {
        for axis in 0..3 {
            let last = self.grid.shape[axis] as isize - 1;
            let step = |to: isize| {
                let mut next = at;
                next[axis] = to;
                next
            };
            if last == 0 && at[axis] != 0 {
                return self.coefficient(step(0));
            }
            if at[axis] < 0 {
                return 2.0 * self.coefficient(step(0)) - self.coefficient(step(1));
            }
            if at[axis] > last {
                return 2.0 * self.coefficient(step(last)) - self.coefficient(step(last - 1));
            }
        }
        self.coefficients[self.grid.index(at.map(|n| n as usize))]
    }
}

impl Target for GridDistance {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let voxel = self.to_voxel.apply(point);
        let axes = [0, 1, 2].map(|axis| Axis::at(voxel[axis], self.grid.shape[axis]));
        let inner = [0, 1, 2].map(|axis| {
            let first = axes[axis].first;
            first >= 0 && first + 4 <= self.grid.shape[axis] as isize
        }) == [true; 3];
        // Sums over (order along i, order along j, order along k), orders summing to at most 2.
        let mut value = 0.0;
        let mut gradient = Vec3::zeros();
        let mut hessian = Mat3::zeros();
        for c in 0..4 {
            for b in 0..4 {
                let mut row = [0.0; 3];
                for a in 0..4 {
                    let at = [
                        axes[0].first + a as isize,
                        axes[1].first + b as isize,
                        axes[2].first + c as isize,
                    ];
                    let coefficient = if inner {
                        self.coefficients[self.grid.index(at.map(|n| n as usize))]
                    } else {
                        self.coefficient(at)
                    };
                    for (order, sum) in row.iter_mut().enumerate() {
                        *sum += axes[0].weights[order][a] * coefficient;
                    }
                }
                let j = axes[1].weights.map(|w| w[b]);
                let k = axes[2].weights.map(|w| w[c]);
                value += row[0] * j[0] * k[0];
                gradient +=
                    Vec3::new(row[1] * j[0] * k[0], row[0] * j[1] * k[0], row[0] * j[0] * k[1]);
                let (ij, ik, jk) =
                    (row[1] * j[1] * k[0], row[1] * j[0] * k[1], row[0] * j[1] * k[1]);
                hessian += Mat3::new(
                    row[2] * j[0] * k[0],
                    ij,
                    ik,
                    ij,
                    row[0] * j[2] * k[0],
                    jk,
                    ik,
                    jk,
                    row[0] * j[0] * k[2],
                );
            }
        }
        let turn = self.to_voxel.linear();
        (value, turn.transpose() * gradient, turn.transpose() * hessian * turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
