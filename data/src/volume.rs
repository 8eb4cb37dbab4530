//! A 3-D image in right-anterior-superior millimetres.

use crate::{Mat3, Vec3};

/// Where the voxels of an image are.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Grid {
    /// Number of voxels along i, j, k.
    pub shape: [usize; 3],
    /// World step of one voxel along i, j, k, as columns (mm).
    pub axes: Mat3,
    /// World position of the centre of voxel (0, 0, 0) (mm).
    pub origin: Vec3,
}

impl Grid {
    /// A grid along the world axes. `origin` is the centre of voxel (0, 0, 0).
    pub fn aligned(shape: [usize; 3], spacing_mm: [f64; 3], origin: Vec3) -> Self {
        Self { shape, axes: Mat3::from_diagonal(&spacing_mm.into()), origin }
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there is no voxel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Mean edge of a voxel (mm).
    pub fn mean_edge_mm(&self) -> f64 {
        self.spacing_mm().iter().sum::<f64>() / 3.0
    }

    /// Position of voxel (i, j, k) in the values: i runs fastest.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.shape[1] + j) * self.shape[0] + i
    }

    /// Voxel at a position in the values.
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        let [ni, nj, _] = self.shape;
        [index % ni, index / ni % nj, index / (ni * nj)]
    }

    /// World position (mm) of a continuous voxel coordinate.
    pub fn world(&self, voxel: &Vec3) -> Vec3 {
        self.axes * voxel + self.origin
    }

    /// World position (mm) of the centre of voxel (i, j, k).
    pub fn center(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.world(&Vec3::new(i as f64, j as f64, k as f64))
    }

    /// Maps world to continuous voxel coordinates; keep it outside of loops.
    ///
    /// A grid that came through [`crate::io`] has an invertible `axes`.
    pub fn to_voxel(&self) -> ToVoxel {
        let inverse = self.axes.try_inverse().unwrap_or_else(Mat3::zeros);
        ToVoxel { inverse, origin: self.origin }
    }

    /// Distance (mm) between neighbouring voxels along i, j, k.
    pub fn spacing_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.axes.column(axis).norm())
    }

    /// The axis of storage that runs most along a world axis (0 x, 1 y, 2 z); of equal ones the first.
    pub fn axis_along(&self, world: usize) -> usize {
        let spacing = self.spacing_mm();
        let share = |axis: usize| self.axes[(world, axis)].abs() / spacing[axis];
        (1..3).fold(0, |most, axis| if share(axis) > share(most) { axis } else { most })
    }

    /// Volume of one voxel (mm³).
    pub fn voxel_mm3(&self) -> f64 {
        self.axes.determinant().abs()
    }
}

/// From world millimetres to continuous voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub struct ToVoxel {
    inverse: Mat3,
    origin: Vec3,
}

impl ToVoxel {
    /// Continuous voxel coordinates of a world point (mm).
    pub fn apply(&self, world: &Vec3) -> Vec3 {
        self.inverse * (world - self.origin)
    }

    /// Voxel coordinates per mm, as a matrix.
    pub fn linear(&self) -> &Mat3 {
        &self.inverse
    }
}

/// An image: one value for each voxel of a grid, i fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume<T> {
    /// Where the voxels are.
    pub grid: Grid,
    /// One value a voxel, i fastest.
    pub values: Vec<T>,
}

impl<T: Copy> Volume<T> {
    /// An image of one value.
    pub fn filled(grid: Grid, value: T) -> Self {
        let values = vec![value; grid.len()];
        Self { grid, values }
    }

    /// Value of voxel (i, j, k).
    pub fn at(&self, voxel: [usize; 3]) -> T {
        self.values[self.grid.index(voxel)]
    }

    /// The same grid with each value changed by `f`.
    pub fn map<U>(&self, f: impl Fn(T) -> U) -> Volume<U> {
        Volume { grid: self.grid.clone(), values: self.values.iter().map(|&v| f(v)).collect() }
    }

    /// Value of the voxel nearest to continuous voxel coordinates; `None` outside.
    pub fn nearest(&self, voxel: &Vec3) -> Option<T> {
        let mut at = [0; 3];
        for axis in 0..3 {
            let rounded = voxel[axis].round();
            if !(rounded >= 0.0 && rounded < self.grid.shape[axis] as f64) {
                return None;
            }
            at[axis] = rounded as usize;
        }
        Some(self.at(at))
    }
}

impl Volume<f32> {
    /// Trilinear value at continuous voxel coordinates; `None` outside of the voxel centres.
    pub fn linear(&self, voxel: &Vec3) -> Option<f32> {
        let mut low = [0usize; 3];
        let mut part = [0f64; 3];
        for axis in 0..3 {
            let (v, n) = (voxel[axis], self.grid.shape[axis]);
            if !(v >= 0.0 && v <= (n - 1) as f64) {
                return None;
            }
            low[axis] = (v as usize).min(n.saturating_sub(2));
            part[axis] = v - low[axis] as f64;
        }
        let step = |axis: usize| usize::from(self.grid.shape[axis] > 1);
        let mut sum = 0.0;
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut at = low;
            for axis in 0..3 {
                let up = corner >> axis & 1;
                weight *= if up == 1 { part[axis] } else { 1.0 - part[axis] };
                at[axis] += up * step(axis);
            }
            sum += weight * f64::from(self.at(at));
        }
        Some(sum as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_storage_are_told_by_their_direction_not_their_spacing() {
        let ras = Grid::aligned([2; 3], [0.5, 3.0, 1.0], Vec3::zeros());
        assert_eq!([0, 1, 2].map(|world| ras.axis_along(world)), [0, 1, 2]);
        // Posterior-inferior-right, turned by 20 degrees about x.
        let [sin, cos] = [0.342, 0.940];
        let axes = Mat3::from_columns(&[
            Vec3::new(0.0, -cos, -sin),
            3.0 * Vec3::new(0.0, sin, -cos),
            Vec3::new(0.7, 0.0, 0.0),
        ]);
        let pir = Grid { axes, ..ras };
        assert_eq!([0, 1, 2].map(|world| pir.axis_along(world)), [2, 0, 1]);
    }

    #[test]
    fn linear_interpolation_reproduces_a_linear_image_on_an_oblique_grid() {
        let axes = Mat3::new(0.9, 0.2, 0.0, -0.2, 1.1, 0.1, 0.0, 0.3, 2.0);
        let grid = Grid { shape: [5, 6, 7], axes, origin: Vec3::new(-3.0, 4.0, 5.0) };
        let plane = |p: &Vec3| 0.5 * p.x - 0.25 * p.y + 0.125 * p.z + 1.0;
        let values = (0..grid.len()).map(|n| plane(&grid.center(grid.voxel(n))) as f32).collect();
        let image = Volume { grid, values };
        let to_voxel = image.grid.to_voxel();
        let point = image.grid.world(&Vec3::new(1.3, 4.9, 5.5));
        let got = image.linear(&to_voxel.apply(&point)).unwrap();
        assert!((f64::from(got) - plane(&point)).abs() < 1e-5);
        assert!(image.linear(&Vec3::new(-0.01, 0.0, 0.0)).is_none());
        assert!(image.linear(&Vec3::new(4.0, 5.0, 6.0)).is_some());
    }
}
