//! The body's own axes, and the image resampled along them.

use mammotwin_data::rigid::RigidTransform;
use mammotwin_data::volume::{Grid, Volume};
use mammotwin_data::{Mat3, Vec3};
use rayon::prelude::*;

/// `p -> linear * p + offset`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Affine {
    pub linear: Mat3,
    pub offset: Vec3,
}

impl Affine {
    pub(super) fn apply(&self, p: &Vec3) -> Vec3 {
        self.linear * p + self.offset
    }
}

/// How voxels of the image and millimetres of the body correspond.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub body_from_voxel: Affine,
    pub voxel_from_body: Affine,
    /// Box of the image in the body's axes (mm).
    pub low: Vec3,
    pub high: Vec3,
}

impl Frame {
    pub(super) fn new(grid: &Grid, body_frame: &RigidTransform) -> Option<Self> {
        let linear = body_frame.rotation * grid.axes;
        let offset = body_frame.point(&grid.origin);
        let inverse = linear.try_inverse()?;
        let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for corner in 0..8 {
            let end = |axis: usize| (corner >> axis & 1) as f64 * (grid.shape[axis] - 1) as f64;
            let p = linear * Vec3::new(end(0), end(1), end(2)) + offset;
            low = low.inf(&p);
            high = high.sup(&p);
        }
        Some(Self {
            body_from_voxel: Affine { linear, offset },
            voxel_from_body: Affine { linear: inverse, offset: -(inverse * offset) },
            low,
            high,
        })
    }

    /// A grid of cubes along the body's axes that covers the image.
    pub(super) fn work_grid(&self, spacing_mm: f64) -> Grid {
        let shape = [0, 1, 2]
            .map(|axis| ((self.high[axis] - self.low[axis]) / spacing_mm).ceil() as usize + 1);
        Grid::aligned(shape, [spacing_mm; 3], self.low)
    }
}

/// The image averaged onto a grid along the body's axes, and where that grid lies in the image.
pub(super) fn resample(image: &Volume<f32>, frame: &Frame, grid: Grid) -> (Volume<f32>, Vec<bool>) {
    let spacing = grid.spacing_mm()[0];
    let slice = grid.shape[0] * grid.shape[1];
    let mut values = vec![0.0f32; grid.len()];
    let mut inside = vec![false; grid.len()];
    values.par_chunks_mut(slice).zip(inside.par_chunks_mut(slice)).enumerate().for_each(
        |(k, (values, inside))| {
            for n in 0..slice {
                let center = grid.center([n % grid.shape[0], n / grid.shape[0], k]);
                let (mut sum, mut count) = (0.0f32, 0);
                for corner in 0..8 {
                    let side = |axis: usize| ((corner >> axis & 1) as f64 - 0.5) * 0.5 * spacing;
                    let p = center + Vec3::new(side(0), side(1), side(2));
                    if let Some(v) = sample(image, &frame.voxel_from_body.apply(&p)) {
                        sum += v;
                        count += 1;
                    }
                }
                if count > 0 {
                    values[n] = sum / count as f32;
                    inside[n] = true;
                }
            }
        },
    );
    (Volume { grid, values }, inside)
}

/// Trilinear value; half a voxel around the image counts as its border. `None` beyond.
pub(super) fn sample(image: &Volume<f32>, voxel: &Vec3) -> Option<f32> {
    let shape = image.grid.shape;
    for axis in 0..3 {
        if !(voxel[axis] >= -0.5 && voxel[axis] <= shape[axis] as f64 - 0.5) {
            return None;
        }
    }
    Some(sample_clamped(image, voxel))
}

/// Trilinear value at the nearest point of the image.
pub(super) fn sample_clamped(image: &Volume<f32>, voxel: &Vec3) -> f32 {
    let shape = image.grid.shape;
    let mut low = [0usize; 3];
    let mut part = [0f32; 3];
    for axis in 0..3 {
        let v = voxel[axis].clamp(0.0, (shape[axis] - 1) as f64);
        low[axis] = (v as usize).min(shape[axis].saturating_sub(2));
        part[axis] = (v - low[axis] as f64) as f32;
    }
    let step = |axis: usize, stride: usize| if shape[axis] > 1 { stride } else { 0 };
    let (dx, dy, dz) = (step(0, 1), step(1, shape[0]), step(2, shape[0] * shape[1]));
    let at = image.grid.index(low);
    let v = &image.values;
    let along_x = |n: usize| v[n] + part[0] * (v[n + dx] - v[n]);
    let along_y = |n: usize| {
        let (a, b) = (along_x(n), along_x(n + dy));
        a + part[1] * (b - a)
    };
    let (a, b) = (along_y(at), along_y(at + dz));
    a + part[2] * (b - a)
}
