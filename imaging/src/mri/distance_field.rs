//! From a mask of voxels to a smooth signed distance field.
//!
//! The mask is blurred until its staircase is gone, and the blur's inward pull at curved places is
//! undone to leading order: with a Gaussian `G`, `2 G - G²` leaves a sphere of radius R in place to
//! O(σ⁴/R³) instead of O(σ²/R). The surface is the level, close to one half, that leaves as many
//! voxels inside as the mask has; distances to it are exact to a tenth of the spacing.

use super::{
    blur::gaussian,
    nearest_seed::{NO_SEED, nearest_seeds},
};
use mammotwin_data::{
    Vec3,
    volume::{Grid, Volume},
};
use rayon::prelude::*;

/// How to make a distance field.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FieldPlan {
    /// Spacing (mm) of the field, along the world axes.
    pub spacing_mm: f64,
    /// Standard deviation (mm) of the blur. At least 1.5 voxels are taken along each voxel axis,
    /// and 0.6 of `spacing_mm`: less leaves stairs. Anything thinner than twice this is lost.
    pub smoothing_mm: f64,
    /// Room (mm) around the mask.
    pub margin_mm: f64,
}

impl FieldPlan {
    /// The least smoothing that leaves no stairs, and room for four voxels.
    pub fn of_spacing(spacing_mm: f64) -> Self {
        Self { spacing_mm, smoothing_mm: 0.0, margin_mm: 4.0 * spacing_mm }
    }
}

/// Why there is no distance field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// The mask is all of one value.
    #[error("the mask has {inside} of {all} voxels inside: there is no surface; check the labels")]
    NoSurface {
        /// Voxels inside.
        inside: usize,
        /// All voxels.
        all: usize,
    },
    /// A length or an axis is not usable.
    #[error("{0}")]
    BadInput(String),
}

/// Least standard deviation of the blur, in voxels: less leaves stairs.
const LEAST_SIGMA: f64 = 1.5;

/// Voxels that a field may have.
const MOST_VOXELS: f64 = 4e8;

/// Signed distance (mm) to the surface of a mask, negative inside, on a grid along the world axes
/// that holds the mask with a margin.
///
/// The mask may lie on any grid: anisotropic, flipped, oblique. Beyond the borders of its image it
/// goes on as at the border, so that a body that leaves the picture has no surface there.
pub fn distance_field(mask: &Volume<bool>, plan: &FieldPlan) -> Result<Volume<f32>, FieldError> {
    Ok(redistance(&level_field(mask, plan)?))
}

/// A smooth function whose zero is the surface of a mask, negative inside, on the grid of
/// [`distance_field`]: all that a surface needs. Far from its zero only its sign has a meaning.
pub fn level_field(mask: &Volume<bool>, plan: &FieldPlan) -> Result<Volume<f32>, FieldError> {
    let grid = field_grid(mask, plan)?;
    Ok(resample(&blurred_level(mask, plan), grid))
}

/// The field's grid: the box of the mask's voxels and the margin.
fn field_grid(mask: &Volume<bool>, plan: &FieldPlan) -> Result<Grid, FieldError> {
    let FieldPlan { spacing_mm, smoothing_mm, margin_mm } = *plan;
    let usable = spacing_mm > 0.0 && smoothing_mm >= 0.0 && margin_mm >= 0.0;
    if !usable || !(spacing_mm + smoothing_mm + margin_mm).is_finite() {
        return Err(FieldError::BadInput(format!(
            "spacing {spacing_mm}, smoothing {smoothing_mm} and margin {margin_mm} mm: give a \
             positive spacing and no negative length"
        )));
    }
    if !(mask.grid.voxel_mm3() > 0.0 && mask.grid.voxel_mm3().is_finite()) {
        return Err(FieldError::BadInput("the axes of the mask span no volume".into()));
    }
    let inside = mask.values.iter().filter(|&&v| v).count();
    if inside == 0 || inside == mask.values.len() {
        return Err(FieldError::NoSurface { inside, all: mask.values.len() });
    }
    let (low, high) = mask_box(mask);
    let low = low.add_scalar(-margin_mm);
    let cells = (high.add_scalar(margin_mm) - low) / spacing_mm;
    if cells.map(|n| n + 2.0).product() > MOST_VOXELS {
        return Err(FieldError::BadInput(format!(
            "spacing_mm {spacing_mm} gives too many voxels; take more"
        )));
    }
    let shape = cells.map(|n| n.ceil() as usize + 1).into();
    Ok(Grid::aligned(shape, [spacing_mm; 3], low))
}

/// World box (mm) of the centres of the voxels that are inside.
fn mask_box(mask: &Volume<bool>) -> (Vec3, Vec3) {
    let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    let length = mask.grid.shape[0];
    // Along a row of voxels the box is made by its ends.
    let ends = mask.values.chunks(length).enumerate().flat_map(|(row, values)| {
        let first = values.iter().position(|inside| *inside);
        let last = values.iter().rposition(|inside| *inside);
        [first, last].map(|end| end.map(|i| row * length + i))
    });
    ends.flatten().fold(none, |(low, high), n| {
        let p = mask.grid.center(mask.grid.voxel(n));
        (low.inf(&p), high.sup(&p))
    })
}

/// A smooth level function: negative in as many voxels as the mask has inside.
fn blurred_level(mask: &Volume<bool>, plan: &FieldPlan) -> Volume<f32> {
    let spacing = mask.grid.spacing_mm();
    let least = plan.smoothing_mm.max(0.6 * plan.spacing_mm);
    let sigmas = spacing.map(|step| (least / step).max(LEAST_SIGMA));
    let once = gaussian(mask.map(|inside| f32::from(u8::from(inside))), sigmas);
    let twice = gaussian(once.clone(), sigmas);
    let mut level = once;
    let pairs = level.values.par_iter_mut().zip(&twice.values);
    pairs.for_each(|(once, twice)| *once = 0.5 + twice - 2.0 * *once);
    let border = volume_keeping_level(&level, mask.values.iter().filter(|&&v| v).count());
    level.values.par_iter_mut().for_each(|value| *value -= border);
    level
}

/// The value of `level` (close to zero) below which the volume is `inside` voxels. Voxels near the
/// surface count in part, by a ramp about one voxel wide.
fn volume_keeping_level(level: &Volume<f32>, inside: usize) -> f32 {
    const MOST: f32 = 0.2;
    let part = |border: f32, value: &f32| f64::from((0.5 + 4.0 * (border - value)).clamp(0.0, 1.0));
    // All others are inside or outside for every border that is tried.
    let (mut near, mut whole) = (Vec::new(), 0.0);
    for value in &level.values {
        let [least, most] = [part(-MOST, value), part(MOST, value)];
        if least < most {
            near.push(*value);
        } else {
            whole += least;
        }
    }
    let volume = |border: f32| whole + near.iter().map(|value| part(border, value)).sum::<f64>();
    let (mut low, mut high) = (-MOST, MOST);
    for _ in 0..16 {
        let middle = 0.5 * (low + high);
        if volume(middle) < inside as f64 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Edge, in voxels, of the blocks that are sampled or not.
const BLOCK: usize = 8;
/// Cubics reach two voxels of the field, too: so far around a block there is no zero when it is not
/// sampled.
const AROUND: usize = 2;

/// Values of `image` at the points of another grid, by Catmull-Rom cubics; beyond the border the
/// value at the border. Blocks that are far from any zero have the value at their middle.
fn resample(image: &Volume<f32>, grid: Grid) -> Volume<f32> {
    let to_voxel = image.grid.to_voxel();
    let bricks = Bricks::of(image);
    let [ni, nj, nk] = grid.shape;
    let blocks = |n: usize| n.div_ceil(BLOCK);
    let mut values = vec![0.0; grid.len()];
    values.par_chunks_mut(ni * nj * BLOCK).enumerate().for_each(|(slab, values)| {
        let k = slab * BLOCK..((slab + 1) * BLOCK).min(nk);
        for block in 0..blocks(ni) * blocks(nj) {
            let [i, j] = [block % blocks(ni) * BLOCK, block / blocks(ni) * BLOCK];
            let (i, j) = (i..(i + BLOCK).min(ni), j..(j + BLOCK).min(nj));
            let alike = sign_of_block(image, &bricks, &grid, [&i, &j, &k]);
            for (k, j) in k.clone().flat_map(|k| j.clone().map(move |j| (k, j))) {
                let row = ((k - slab * BLOCK) * nj + j) * ni;
                for i in i.clone() {
                    values[row + i] = alike.unwrap_or_else(|| {
                        cubic(image, &to_voxel.apply(&grid.center([i, j, k]))).0
                    });
                }
            }
        }
    });
    Volume { grid, values }
}

/// Least and greatest values of an image in cubes of [`BRICK`] voxels.
struct Bricks {
    shape: [usize; 3],
    spans: Vec<[f32; 2]>,
}

/// Edge of a brick, in voxels.
const BRICK: usize = 4;
const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Bricks {
    fn of(image: &Volume<f32>) -> Self {
        let [ni, nj, _] = image.grid.shape;
        let shape = image.grid.shape.map(|n| n.div_ceil(BRICK));
        let mut spans = vec![NOTHING; shape.iter().product()];
        let slabs = spans.par_chunks_mut(shape[0] * shape[1]);
        slabs.zip(image.values.par_chunks(ni * nj * BRICK)).for_each(|(spans, slab)| {
            for (row, values) in slab.chunks(ni).enumerate() {
                let spans = &mut spans[row % nj / BRICK * shape[0]..][..shape[0]];
                for (span, values) in spans.iter_mut().zip(values.chunks(BRICK)) {
                    *span = values.iter().fold(*span, |[low, high], v| [low.min(*v), high.max(*v)]);
                }
            }
        });
        Self { shape, spans }
    }

    /// Least and greatest value in the bricks that hold a box of voxels.
    fn span(&self, voxels: [std::ops::Range<usize>; 3]) -> [f32; 2] {
        let [i, j, k] = voxels.map(|range| range.start / BRICK..range.end.div_ceil(BRICK));
        let rows = k.flat_map(|k| j.clone().map(move |j| (k * self.shape[1] + j) * self.shape[0]));
        rows.flat_map(|row| &self.spans[row..][i.clone()])
            .fold(NOTHING, |all, span| [all[0].min(span[0]), all[1].max(span[1])])
    }
}

/// A value of a block in which cubics have no zero, nor around it; `None` when they may have one.
fn sign_of_block(
    image: &Volume<f32>,
    bricks: &Bricks,
    grid: &Grid,
    block: [&std::ops::Range<usize>; 3],
) -> Option<f32> {
    let to_voxel = image.grid.to_voxel();
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for corner in 0..8 {
        let place = Vec3::from_fn(|axis, _| match corner >> axis & 1 {
            0 => block[axis].start as f64 - AROUND as f64,
            _ => (block[axis].end - 1 + AROUND) as f64,
        });
        let voxel = to_voxel.apply(&grid.world(&place));
        (low, high) = (low.inf(&voxel), high.sup(&voxel));
    }
    let range = |axis: usize| {
        let last = (image.grid.shape[axis] - 1) as f64;
        let [low, high] = [low[axis].floor() - 1.0, high[axis].floor() + 2.0];
        low.clamp(0.0, last) as usize..high.clamp(0.0, last) as usize + 1
    };
    let [least, most] = bricks.span([range(0), range(1), range(2)]);
    // The weights of a tricubic are at most 1.25³ in all, so at most 0.48 of it is negative:
    // no zero where the smallest size is above 0.48 / 1.48 of the largest.
    let [small, large] = [least.abs().min(most.abs()), least.abs().max(most.abs())];
    (least * most > 0.0 && small > 0.33 * large).then_some(0.5 * (least + most))
}

/// Catmull-Rom interpolation at voxel coordinates: the value and its derivatives by them.
pub(super) fn cubic(image: &Volume<f32>, at: &Vec3) -> (f32, [f32; 3]) {
    let shape = image.grid.shape;
    let mut places = [[0usize; 4]; 3];
    let mut weights = [[0f32; 4]; 3];
    let mut slopes = [[0f32; 4]; 3];
    for axis in 0..3 {
        let last = (shape[axis] - 1) as f64;
        let place = at[axis].clamp(0.0, last);
        let low = place.floor();
        let t = (place - low) as f32;
        let (t2, t3) = (t * t, t * t * t);
        weights[axis] = [
            0.5 * (2.0 * t2 - t - t3),
            0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
            0.5 * (4.0 * t2 + t - 3.0 * t3),
            0.5 * (t3 - t2),
        ];
        slopes[axis] = [
            0.5 * (4.0 * t - 1.0 - 3.0 * t2),
            0.5 * (9.0 * t2 - 10.0 * t),
            0.5 * (8.0 * t + 1.0 - 9.0 * t2),
            0.5 * (3.0 * t2 - 2.0 * t),
        ];
        for (n, place) in places[axis].iter_mut().enumerate() {
            *place = (low + n as f64 - 1.0).clamp(0.0, last) as usize;
        }
    }
    let (mut value, mut slope) = (0.0, [0.0; 3]);
    for c in 0..4 {
        let (mut v, mut vi, mut vj) = (0.0, 0.0, 0.0);
        for b in 0..4 {
            let start = (places[2][c] * shape[1] + places[1][b]) * shape[0];
            let (mut row, mut along) = (0.0, 0.0);
            for a in 0..4 {
                let voxel = image.values[start + places[0][a]];
                row += weights[0][a] * voxel;
                along += slopes[0][a] * voxel;
            }
            v += weights[1][b] * row;
            vi += weights[1][b] * along;
            vj += slopes[1][b] * row;
        }
        value += weights[2][c] * v;
        slope[0] += weights[2][c] * vi;
        slope[1] += weights[2][c] * vj;
        slope[2] += slopes[2][c] * v;
    }
    (value, slope)
}

/// Signed distance (mm) to the zero level of a smooth field on an isotropic grid along the world
/// axes. The signs stay; the values become distances.
///
/// Grid points beside the surface find their foot on it by Newton's method; all others measure to
/// the tangent plane of the nearest of these feet.
pub fn redistance(level: &Volume<f32>) -> Volume<f32> {
    let grid = &level.grid;
    let found: Vec<(usize, Foot)> = (0..grid.len())
        .into_par_iter()
        .filter_map(|n| foot(level, grid.voxel(n)).map(|foot| (n, foot)))
        .collect();
    let mut slots = vec![NO_SEED; grid.len()];
    (0..).zip(&found).for_each(|(slot, (n, _))| slots[*n] = slot);
    let nearest = nearest_seeds(grid.shape, |n| slots[n] != NO_SEED);
    let step = grid.axes[(0, 0)];
    let foot_of = |seed: usize| found.get(slots[seed] as usize).map(|(_, foot)| foot);
    let distance = |n: usize| {
        let at = grid.voxel(n).map(|v| v as f32);
        let square = |foot: &Foot| foot.from(&at).iter().map(|v| v * v).sum::<f32>();
        let mut seed = nearest[n] as usize;
        let Some(mut best) = (seed < grid.len()).then(|| foot_of(seed)).flatten() else {
            return f32::INFINITY.copysign(level.values[n]);
        };
        // The nearest foot may belong to a neighbour of the nearest seed.
        for _ in 0..WALK {
            let from = seed;
            for_neighbors(grid.shape, grid.voxel(from), |m| {
                if let Some(foot) = foot_of(m).filter(|foot| square(foot) < square(best)) {
                    (best, seed) = (foot, m);
                }
            });
            if seed == from {
                break;
            }
        }
        let size = best.distance(&at) * step as f32;
        if level.values[n] < 0.0 { -size } else { size }
    };
    let values = (0..grid.len()).into_par_iter().map(distance).collect();
    Volume { grid: grid.clone(), values }
}

/// A point of the surface, in voxel coordinates, and the unit normal there.
struct Foot {
    point: [f32; 3],
    normal: [f32; 3],
}

impl Foot {
    fn from(&self, at: &[f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| at[axis] - self.point[axis])
    }

    /// Distance to the tangent plane where `at` is straight above, else to the point.
    fn distance(&self, at: &[f32; 3]) -> f32 {
        let from = self.from(at);
        let square: f32 = from.iter().map(|v| v * v).sum();
        let height: f32 = from.iter().zip(&self.normal).map(|(v, n)| v * n).sum();
        if square - height * height < 1.0 { height.abs() } else { square.sqrt() }
    }
}

/// Steps from the nearest seed to the one with the nearest foot.
const WALK: usize = 4;

/// Calls `visit` with the index of each of up to 26 neighbours.
fn for_neighbors(shape: [usize; 3], voxel: [usize; 3], mut visit: impl FnMut(usize)) {
    let [i, j, k] = voxel.map(|v| v.saturating_sub(1));
    for kk in k..=(voxel[2] + 1).min(shape[2] - 1) {
        for jj in j..=(voxel[1] + 1).min(shape[1] - 1) {
            for ii in i..=(voxel[0] + 1).min(shape[0] - 1) {
                visit((kk * shape[1] + jj) * shape[0] + ii);
            }
        }
    }
}

/// Foot on the surface of a grid point that has a neighbour on the other side.
fn foot(level: &Volume<f32>, voxel: [usize; 3]) -> Option<Foot> {
    let here = level.at(voxel) < 0.0;
    let crosses = (0..3).any(|axis| {
        let last = level.grid.shape[axis] - 1;
        let other = |place: usize| {
            let mut other = voxel;
            other[axis] = place;
            (level.at(other) < 0.0) != here
        };
        other(voxel[axis].saturating_sub(1)) || other((voxel[axis] + 1).min(last))
    });
    if !crosses {
        return None;
    }
    let start = Vec3::from(voxel.map(|v| v as f64));
    let (mut at, mut normal) = (start, Vec3::zeros());
    for _ in 0..4 {
        let (value, gradient) = cubic(level, &at);
        let (value, gradient) = (f64::from(value), Vec3::from(gradient.map(f64::from)));
        let square = gradient.norm_squared();
        if square < 1e-20 {
            return None;
        }
        // Newton's step towards the level, then back to straight below the grid point.
        normal = gradient / square.sqrt();
        let below = at - gradient * (value / square);
        at = start - normal * normal.dot(&(start - below));
        if (at - start).norm() > 2.0 {
            return None;
        }
    }
    let single = |v: Vec3| [v.x as f32, v.y as f32, v.z as f32];
    Some(Foot { point: single(at), normal: single(normal) })
}

#[cfg(test)]
mod tests;
