//! From surfaces and limits to one label a voxel, on the image's own grid.

use super::body::{self, Body};
use super::depth;
use super::limits::{BodyLimits, height_range};
use super::scribble::Marks;
use super::shading::Shaded;
use super::tissue::{self, Classes};
use super::wall::Wall;
use crate::mri::skin::RESOLVED_MM;
use mammotwin_data::labels::Tissue;
use mammotwin_data::volume::{Grid, Volume};
use mammotwin_data::{Vec3, labels::LabelMap};
use rayon::prelude::*;

/// Where a voxel is; `Breast` is divided into tissues afterwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Air,
    Muscle,
    Thorax,
    Other,
    Breast,
}

/// The image's voxels in units of fat.
pub(super) fn brightness(shaded: &Shaded) -> Volume<f32> {
    let grid = &shaded.image.grid;
    let slice = grid.shape[0] * grid.shape[1];
    let mut values = shaded.image.values.clone();
    values.par_chunks_mut(slice).enumerate().for_each(|(k, values)| {
        for (n, value) in values.iter_mut().enumerate() {
            let voxel = Vec3::new((n % grid.shape[0]) as f64, (n / grid.shape[0]) as f64, k as f64);
            *value /= shaded.field.fat(&shaded.frame.body_from_voxel.apply(&voxel));
        }
    });
    Volume { grid: grid.clone(), values }
}

/// The body on the image's grid: decided by the voxel itself near the surface, where tissue is brighter than
/// `air_below` of its place (in units of fat), else by `body`.
pub(super) fn body_mask(
    shaded: &Shaded,
    brightness: &Volume<f32>,
    work: &Volume<f32>,
    body: &Body,
    air_below: impl Fn(&Vec3) -> f32 + Sync,
) -> Vec<bool> {
    // Voxels of the work grid within this distance of the surface are looked at closely.
    const NEAR: usize = 2;
    let mut inner: Vec<f32> = body.mask.iter().map(|&b| f32::from(u8::from(!b))).collect();
    super::filter::maximum(&mut inner, work.grid.shape, NEAR);
    let mut outer: Vec<f32> = body.mask.iter().map(|&b| f32::from(u8::from(b))).collect();
    super::filter::maximum(&mut outer, work.grid.shape, NEAR);
    let grid = &brightness.grid;
    let slice = grid.shape[0] * grid.shape[1];
    let mut mask = vec![false; grid.len()];
    mask.par_chunks_mut(slice).enumerate().for_each(|(k, mask)| {
        for (n, inside) in mask.iter_mut().enumerate() {
            let voxel = Vec3::new((n % grid.shape[0]) as f64, (n / grid.shape[0]) as f64, k as f64);
            let p = shaded.frame.body_from_voxel.apply(&voxel);
            let at = nearest(work, &p);
            *inside = inner[at] < 0.5
                || (outer[at] > 0.5 && brightness.values[k * slice + n] > air_below(&p));
        }
    });
    // Noise beside the body: the majority of a neighbourhood in the slice decides, and what does not
    // hang together with the body is none.
    let plane = slice_axes(grid);
    let noisy = mask.clone();
    mask.par_chunks_mut(slice).enumerate().for_each(|(k, mask)| {
        for (n, inside) in mask.iter_mut().enumerate() {
            let n = k * slice + n;
            let voxel = grid.voxel(n);
            if plane.iter().all(|&(axis, _)| voxel[axis] > 0 && voxel[axis] + 1 < grid.shape[axis])
            {
                let [(_, a), (_, b)] = plane;
                let row = |middle: usize| [middle - a, middle, middle + a];
                let around = [row(n - b), row(n), row(n + b)];
                *inside = around.iter().flatten().filter(|&&m| noisy[m]).count() > 4;
            }
        }
    });
    body::largest_component(&mask, grid.shape).unwrap_or(mask)
}

/// The two axes along a slice, with the way in the values from a voxel to its neighbour. Slices are
/// across the axis of the longest voxel edge; of equal edges, the one most along the body.
fn slice_axes(grid: &Grid) -> [(usize, usize); 2] {
    let spacing = grid.spacing_mm();
    let longest = spacing.into_iter().fold(0.0, f64::max);
    let upright = |axis: usize| grid.axes[(2, axis)].abs() / spacing[axis];
    let long = (0..3).filter(|&axis| spacing[axis] > 0.999 * longest);
    let across = long.max_by(|&a, &b| upright(a).total_cmp(&upright(b))).unwrap_or(2);
    let [ni, nj, _] = grid.shape;
    [(across + 1) % 3, (across + 2) % 3].map(|axis| (axis, [1, ni, ni * nj][axis]))
}

/// Index of the nearest voxel of a grid along the body's axes.
fn nearest<T>(volume: &Volume<T>, p: &Vec3) -> usize {
    let grid = &volume.grid;
    let scaled = (p - grid.origin) / grid.axes[(0, 0)];
    let at =
        [0, 1, 2].map(|axis| (scaled[axis].round().max(0.0) as usize).min(grid.shape[axis] - 1));
    grid.index(at)
}

/// All labels, and the classes that gland and fat were told apart with.
pub(super) fn assign(
    shaded: &Shaded,
    brightness: &Volume<f32>,
    mask: &[bool],
    wall: &Wall,
    limits: &BodyLimits,
    marks: &Marks,
    skin_mm: f64,
) -> (LabelMap, Classes) {
    let grid = &brightness.grid;
    let slice = grid.shape[0] * grid.shape[1];
    let rows = height_range(&wall.polar);
    let place = |inside: bool, p: &Vec3| {
        let (radius, at) = wall.polar.locate(p);
        let seen = !wall.whole_back || wall.polar.holds(at);
        let behind = radius < f64::from(wall.polar.value(&wall.front, at));
        if !(inside || (seen && behind)) {
            return Place::Air;
        }
        if behind {
            let rear = f64::from(wall.polar.value(&wall.rear.radii, at));
            let muscle = radius >= rear && p.y > limits.lateral_y;
            return if muscle { Place::Muscle } else { Place::Thorax };
        }
        let side = usize::from(limits.right_of_sternum(p.x, p.z) < 0.0);
        let [low, high] = limits.z[side];
        let within = p.z >= low.max(rows[0]) && p.z <= high && p.y > limits.lateral_y;
        if within { Place::Breast } else { Place::Other }
    };
    let body_point = |n: usize| {
        let [i, j, k] = grid.voxel(n);
        shaded.frame.body_from_voxel.apply(&Vec3::new(i as f64, j as f64, k as f64))
    };
    let mut places = vec![Place::Air; grid.len()];
    places.par_chunks_mut(slice).enumerate().for_each(|(k, places)| {
        for (n, slot) in places.iter_mut().enumerate() {
            let n = k * slice + n;
            *slot = place(mask[n], &body_point(n));
        }
    });
    // A dark spot that no path of air leads to is a vessel.
    let air: Vec<bool> = places.iter().map(|place| *place == Place::Air).collect();
    for n in body::enclosed(&air, grid.shape) {
        places[n] = place(true, &body_point(n));
    }
    let depth = depth::distance_to_outside(mask, grid, skin_mm + 12.0);
    let half_voxel = 0.5 * grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    let skin_depth = (skin_mm + half_voxel) as f32;
    let deep = (0..grid.len())
        .filter(|&n| places[n] == Place::Breast && depth[n] > skin_depth + 2.0)
        .map(|n| brightness.values[n]);
    let classes = marks.classes(brightness, tissue::classify(deep));
    // Fine voxels show how thick skin is: under the first layer, only what is darker than fat.
    let coarsest = grid.spacing_mm().into_iter().fold(0.0, f64::max);
    let resolved = coarsest <= RESOLVED_MM;
    let first_layer = 1.01 * coarsest as f32;
    let is_skin = |n: usize, classes: &Classes| {
        let dark = f64::from(brightness.values[n]) < 0.75 * classes.fat;
        depth[n] <= skin_depth && (!resolved || dark || depth[n] <= first_layer)
    };
    // A voxel that shares in the muscle is as dark as gland, and beyond a thin layer of fat the skin is,
    // too: what is fat a little further out is fat.
    let finest = 2.0 * half_voxel;
    let beside_wall = |p: &Vec3, value: f32| {
        let (radius, at) = wall.polar.locate(p);
        let ahead = radius - f64::from(wall.polar.value(&wall.front, at));
        if ahead >= 1.2 * finest {
            return value;
        }
        let outwards = Vec3::new(p.x - wall.polar.axis[0], p.y - wall.polar.axis[1], 0.0);
        let further = |voxels: f64| p + outwards * (voxels * finest / radius.max(1.0));
        let seen = [0.75, 1.5].into_iter().filter_map(|voxels| shaded.at(&further(voxels)));
        seen.fold(value, f32::max)
    };
    let mut labels = vec![Tissue::Background; grid.len()];
    labels.par_chunks_mut(slice).enumerate().for_each(|(k, labels)| {
        for (n, label) in labels.iter_mut().enumerate() {
            let n = k * slice + n;
            *label = match places[n] {
                Place::Air => Tissue::Background,
                Place::Muscle => Tissue::PectoralMuscle,
                Place::Thorax => Tissue::Thorax,
                Place::Other => Tissue::Other,
                Place::Breast if is_skin(n, &classes) => Tissue::Skin,
                Place::Breast => {
                    let p = body_point(n);
                    let value = beside_wall(&p, brightness.values[n]);
                    let gland = f64::from(value) < classes.threshold;
                    match (gland, limits.right_of_sternum(p.x, p.z) >= 0.0) {
                        (false, true) => Tissue::AdiposeRight,
                        (false, false) => Tissue::AdiposeLeft,
                        (true, true) => Tissue::FibroglandularRight,
                        (true, false) => Tissue::FibroglandularLeft,
                    }
                }
            };
        }
    });
    marks.hold(&mut labels);
    (Volume { grid: grid.clone(), values: labels }, classes)
}
