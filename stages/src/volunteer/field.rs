//! A smooth vector field on a cubic lattice.

use mammotwin_data::Vec3;
use rayon::prelude::*;

/// Trilinear between lattice points; constant outside of the lattice.
#[derive(Debug, Clone)]
pub struct Field {
    low: Vec3,
    step_mm: f64,
    shape: [usize; 3],
    values: Vec<[f32; 3]>,
}

impl Field {
    /// Reads `value` on a lattice that covers the box from `low` to `high` (mm).
    pub fn sampled(
        low: Vec3,
        high: Vec3,
        step_mm: f64,
        value: impl Fn(&Vec3) -> Vec3 + Sync,
    ) -> Self {
        let shape = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / step_mm).ceil() as usize + 2);
        let mut field = Self { low, step_mm, shape, values: Vec::new() };
        field.values = (0..shape.iter().product())
            .into_par_iter()
            .map(|n| value(&field.place(n)).map(|v| v as f32).into())
            .collect();
        field
    }

    /// The field that is nothing everywhere.
    pub fn zero() -> Self {
        let values = vec![[0.0; 3]; 8];
        Self { low: Vec3::zeros(), step_mm: 1.0, shape: [2; 3], values }
    }

    /// Place (mm) of a lattice point.
    fn place(&self, n: usize) -> Vec3 {
        let [ni, nj, _] = self.shape;
        let at = [n % ni, n / ni % nj, n / (ni * nj)];
        self.low + Vec3::from(at.map(|i| i as f64)) * self.step_mm
    }

    /// Value at a place (mm).
    pub fn at(&self, place: &Vec3) -> Vec3 {
        let mut low = [0usize; 3];
        let mut part = [0f64; 3];
        for axis in 0..3 {
            let most = (self.shape[axis] - 1) as f64;
            let at = ((place[axis] - self.low[axis]) / self.step_mm).clamp(0.0, most - 1e-9);
            low[axis] = at as usize;
            part[axis] = at - low[axis] as f64;
        }
        let [ni, nj, _] = self.shape;
        let base = (low[2] * nj + low[1]) * ni + low[0];
        let mut sum = Vec3::zeros();
        for (dk, wk) in [(0, 1.0 - part[2]), (ni * nj, part[2])] {
            for (dj, wj) in [(0, 1.0 - part[1]), (ni, part[1])] {
                let weight = wk * wj;
                let a = &self.values[base + dk + dj];
                let b = &self.values[base + dk + dj + 1];
                for axis in 0..3 {
                    let value = f64::from(a[axis]) * (1.0 - part[0]) + f64::from(b[axis]) * part[0];
                    sum[axis] += weight * value;
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_field_is_reproduced() {
        let linear = |p: &Vec3| Vec3::new(0.1 * p.x - 0.2 * p.z, 0.05 * p.y, 1.0 + 0.3 * p.x);
        let (low, high) = (Vec3::new(-11.0, -7.0, 3.0), Vec3::new(12.0, 9.5, 20.0));
        let field = Field::sampled(low, high, 2.5, linear);
        for place in [Vec3::new(0.3, 1.2, 11.7), low, high, Vec3::new(-10.9, 9.4, 3.1)] {
            assert!((field.at(&place) - linear(&place)).norm() < 1e-5);
        }
    }
}
