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
    /// Nothing everywhere, on a lattice that covers the box from `low` to `high` (mm).
    pub fn still(low: Vec3, high: Vec3, step_mm: f64) -> Self {
        let shape = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / step_mm).ceil() as usize + 2);
        Self { low, step_mm, shape, values: vec![[0.0; 3]; shape.iter().product()] }
    }

    /// Reads `value` on a lattice that covers the box from `low` to `high` (mm).
    pub fn sampled(
        low: Vec3,
        high: Vec3,
        step_mm: f64,
        value: impl Fn(&Vec3) -> Vec3 + Sync,
    ) -> Self {
        let mut field = Self::still(low, high, step_mm);
        let read = |n: usize| value(&field.place(n)).map(|v| v as f32).into();
        field.values = (0..field.len()).into_par_iter().map(read).collect();
        field
    }

    /// Number of lattice points.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Place (mm) of a lattice point.
    pub fn place(&self, n: usize) -> Vec3 {
        let [ni, nj, _] = self.shape;
        let at = [n % ni, n / ni % nj, n / (ni * nj)];
        self.low + Vec3::from(at.map(|i| i as f64)) * self.step_mm
    }

    /// Value of a lattice point.
    pub fn get(&self, n: usize) -> Vec3 {
        Vec3::from(self.values[n].map(f64::from))
    }

    /// Changes the value of a lattice point.
    pub fn set(&mut self, n: usize, value: &Vec3) {
        self.values[n] = value.map(|v| v as f32).into();
    }

    /// Lattice points in a box.
    pub fn points_within(&self, low: &Vec3, high: &Vec3) -> impl Iterator<Item = usize> + use<> {
        let range = |axis: usize| {
            let to_index = |x: f64| (x - self.low[axis]) / self.step_mm;
            let first = to_index(low[axis]).ceil().max(0.0) as usize;
            let end = (to_index(high[axis]).floor() + 1.0).max(0.0) as usize;
            first..end.min(self.shape[axis])
        };
        let [ri, rj, rk] = [range(0), range(1), range(2)];
        let [ni, nj, _] = self.shape;
        rk.flat_map(move |k| {
            let ri = ri.clone();
            rj.clone().flat_map(move |j| ri.clone().map(move |i| (k * nj + j) * ni + i))
        })
    }

    /// The six lattice points next to one; fewer at the border.
    pub fn neighbors(&self, n: usize) -> impl Iterator<Item = usize> + use<> {
        let [ni, nj, nk] = self.shape;
        let at = [n % ni, n / ni % nj, n / (ni * nj)];
        let stride = [1, ni, ni * nj];
        let last = [ni - 1, nj - 1, nk - 1];
        (0..6).filter_map(move |side| {
            let axis = side / 2;
            match side % 2 {
                0 => (at[axis] > 0).then(|| n - stride[axis]),
                _ => (at[axis] < last[axis]).then(|| n + stride[axis]),
            }
        })
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
