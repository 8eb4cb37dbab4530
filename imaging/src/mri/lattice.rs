//! Smooth displacements: cubic B-splines on a coarse lattice.

use mammotwin_data::Vec3;

/// Control points of a tensor product of uniform cubic B-splines (Rueckert et al. 1999,
/// <https://doi.org/10.1109/42.796284>), along the axes of the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    origin: Vec3,
    spacing_mm: f64,
    shape: [usize; 3],
}

/// A control point near a place.
#[derive(Debug, Clone, Copy)]
pub struct Support {
    /// Which one.
    pub index: usize,
    /// Its weight at the place.
    pub weight: f64,
    /// Derivative of the weight (1/mm).
    pub slope: Vec3,
}

impl Lattice {
    /// The lattice whose splines are complete over the box from `low` to `high` (mm).
    pub fn covering(low: &Vec3, high: &Vec3, spacing_mm: f64) -> Self {
        let cells = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / spacing_mm).ceil().max(1.0));
        let middle = 0.5 * (low + high);
        let origin = middle - Vec3::from(cells.map(|n| 0.5 * n + 1.0)) * spacing_mm;
        Self { origin, spacing_mm, shape: cells.map(|n| n as usize + 3) }
    }

    /// Distance of the control points (mm).
    pub fn spacing_mm(&self) -> f64 {
        self.spacing_mm
    }

    /// Number of control points.
    pub fn count(&self) -> usize {
        self.shape.iter().product()
    }

    /// The 64 control points about a place; those of the nearest covered place beyond.
    pub fn at(&self, p: &Vec3) -> Vec<Support> {
        let scaled = (p - self.origin) / self.spacing_mm;
        let mut low = [0usize; 3];
        let mut splines = [[[0.0; 2]; 4]; 3];
        for axis in 0..3 {
            let last = (self.shape[axis] - 3) as f64;
            let t = scaled[axis].clamp(1.0, last + 1.0);
            let cell = t.floor().min(last);
            low[axis] = cell as usize - 1;
            splines[axis] = cubic_spline(t - cell);
        }
        let mut support = Vec::with_capacity(64);
        for k in 0..4 {
            for j in 0..4 {
                for i in 0..4 {
                    let [x, y, z] = [splines[0][i], splines[1][j], splines[2][k]];
                    let slope =
                        Vec3::new(x[1] * y[0] * z[0], x[0] * y[1] * z[0], x[0] * y[0] * z[1]);
                    support.push(Support {
                        index: ((low[2] + k) * self.shape[1] + low[1] + j) * self.shape[0]
                            + low[0]
                            + i,
                        weight: x[0] * y[0] * z[0],
                        slope: slope / self.spacing_mm,
                    });
                }
            }
        }
        support
    }
}

/// Values and derivatives of the four splines that are not zero at `t` in 0..=1 of a cell.
fn cubic_spline(t: f64) -> [[f64; 2]; 4] {
    let s = 1.0 - t;
    [
        [s * s * s / 6.0, -0.5 * s * s],
        [(3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0, 1.5 * t * t - 2.0 * t],
        [(3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0, 2.0 * s - 1.5 * s * s],
        [t * t * t / 6.0, 0.5 * t * t],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_displacements_are_reproduced_with_their_slope() {
        let lattice =
            Lattice::covering(&Vec3::new(-70.0, 5.0, -40.0), &Vec3::new(85., 60., 40.), 50.0);
        let plane = |p: &Vec3| 0.3 * p.x - 0.2 * p.y + 0.1 * p.z + 2.0;
        let control = |n: usize| {
            let [ni, nj, _] = lattice.shape;
            let place = [n % ni, n / ni % nj, n / (ni * nj)].map(|v| v as f64);
            plane(&(lattice.origin + Vec3::from(place) * lattice.spacing_mm))
        };
        for p in [Vec3::new(-70.0, 5.0, -40.0), Vec3::new(85.0, 60.0, 40.0), Vec3::new(3., 44., 7.)]
        {
            let support = lattice.at(&p);
            let value: f64 = support.iter().map(|s| s.weight * control(s.index)).sum();
            let slope: Vec3 = support.iter().map(|s| s.slope * control(s.index)).sum();
            assert!((value - plane(&p)).abs() < 1e-12);
            assert!((slope - Vec3::new(0.3, -0.2, 0.1)).norm() < 1e-12);
            assert!((support.iter().map(|s| s.weight).sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(support.iter().all(|s| s.index < lattice.count()));
        }
    }
}
