//! The chest wall: the front of the pectoral muscle (its rear: `rear`).

use super::body::{self, Body};
use super::filter;
use super::frame::sample_clamped;
use super::polar::Polar;
use super::rear::{self, Rear};
use super::scribble::{Bounds, Marks};
use super::search::{Columns, optimal_surface, smooth_map};
use super::shading::Shaded;
use mammotwin_data::Vec3;
use mammotwin_data::rigid::RigidTransform;
use mammotwin_data::surface::TriMesh;
use mammotwin_data::volume::{Grid, Volume};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Tissue darker than a fraction of fat is not fat. Between these two the image decides: muscle
/// and liver have a tenth to a quarter of fat's brightness in a T2 weighted image, two fifths to
/// three fifths in a T1 weighted one.
const FAT_ABOVE: [f32; 2] = [0.55, 0.75];
/// Heart, lungs and liver are looked at within this distance of the thorax' axis (mm).
const ORGANS_WITHIN_MM: f64 = 60.0;
/// Height (mm) of the part of the body in which they are: the liver fills only its lower end.
const ORGANS_HEIGHT_MM: f64 = 30.0;
/// Quantile of their brightness that stands for the brighter ones.
const BRIGHTER_ORGANS: f64 = 0.75;
/// Half width (rad) of the sector in front of the sternum: there lies no gland ...
const STERNAL: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// ... and the wall not deeper than this under the surface (mm), or else a breast lies there.
const DEEPEST_STERNUM_MM: f32 = 35.0;
/// Where brightness falls below this fraction of the fat in front of it, fat ends.
const FAT_ENDS: f32 = 0.7;
/// Brightest fat beside the wall: where the shading is a little off, fat is brighter than 1, and the
/// half-way level has to know how bright it is.
const BRIGHTEST_FAT: f32 = 1.5;
/// Skin and fat in front of the wall are at least this thick (mm).
const THINNEST_COVER_MM: f32 = 3.0;
/// The wall is hardly ever further inside than this from its first approximation (mm).
const COVER_OF_PRIOR_MM: f64 = 8.0;
/// Half width (mm) of the band around the prior in which the wall is searched.
const BAND_MM: f64 = 24.0;
/// Cost of passing a mark on its wrong side: several times what the image has to say.
const WRONG_SIDE: f32 = 6.0;
/// Weight of a mark over that of a clear edge.
pub(super) const MARKED: f32 = 10.0;
/// Step (mm) of the search.
const STEP_MM: f64 = 1.0;

/// Radii (mm) about the thorax' axis, one for each column of the map.
#[derive(Debug, Clone)]
pub(super) struct Wall {
    pub polar: Polar,
    /// Front of the muscle.
    pub front: Vec<f32>,
    pub rear: Rear,
    /// Outermost radius at which there is body.
    pub surface: Vec<f32>,
    /// How clearly the front was seen, 0..=1.
    pub contrast: Vec<f32>,
    /// Whether the image shows the back of the body.
    pub whole_back: bool,
}

impl Wall {
    /// The front of the muscle where y exceeds `least_y`, moved by `motion`.
    pub(super) fn front_patch(&self, least_y: f64, motion: &RigidTransform) -> TriMesh {
        let [n_u, n_v] = self.polar.shape;
        let radius = |column: usize| f64::from(self.front[column]);
        let points: Vec<Vec3> =
            (0..self.polar.len()).map(|c| self.polar.point(c, radius(c))).collect();
        let mut triangles = Vec::new();
        for v in 1..n_v {
            for u in 1..n_u {
                let [a, b] = [(v - 1) * n_u + u - 1, (v - 1) * n_u + u];
                let [c, d] = [b + n_u, a + n_u];
                if [a, b, c, d].iter().all(|&n| points[n].y > least_y) {
                    triangles.push([a as u32, b as u32, c as u32]);
                    triangles.push([a as u32, c as u32, d as u32]);
                }
            }
        }
        let points = points.iter().map(|p| motion.point(p)).collect();
        TriMesh { points, triangles }.compacted().0
    }
}

/// Finds the wall. `work` is brightness in units of fat on the work grid, `fine` on the image.
/// `None` if hardly any dark tissue lies under the fat.
pub(super) fn find(work: &Volume<f32>, fine: &Shaded, body: &Body, marks: &Marks) -> Option<Wall> {
    let Map { polar, surface, tissue } = Map::new(&work.grid, body);
    let bounds = marks.bounds(&polar);
    let fat_above = fat_above(work, body);
    let core = dark_core(work, &tissue, &fat_above, marks);
    let mut outer_dark = outermost(&polar, &core);
    // Bridges the gaps between ribs, where thin muscle is lost.
    let [n_u, n_v] = polar.shape;
    filter::maximum(&mut outer_dark, [n_u, n_v, 1], 3);
    // The marrow of the sternum is as bright as fat: there the core is behind it.
    for column in 0..polar.len() {
        if (polar.angle(column) - std::f64::consts::FRAC_PI_2).abs() < STERNAL
            && let Some(radius) = end_of_fat(&polar, work, column, surface[column])
        {
            outer_dark[column] = radius;
        }
    }
    for column in (0..polar.len()).filter(|&column| bounds.tells(column)) {
        outer_dark[column] = bounds.front(column, outer_dark[column]);
    }
    let prior = near_elliptic(&polar, &outer_dark, &surface, &bounds)?;
    let map = Map { polar, surface, tissue };
    Some(near(map, &prior, work, fine, &fat_above, &bounds, body.whole_back))
}

/// The map that a wall is looked for in.
pub(super) struct Map {
    pub polar: Polar,
    /// Outermost radius (mm) at which there is body, one for each column.
    pub surface: Vec<f32>,
    /// 1 in the body, on the work grid.
    pub tissue: Volume<f32>,
}

impl Map {
    pub(super) fn new(grid: &Grid, body: &Body) -> Self {
        let spacing = grid.spacing_mm()[0];
        let high_z = grid.origin.z + (grid.shape[2] - 1) as f64 * spacing;
        let polar = Polar::new(body.axis, grid.origin.z, high_z);
        let values = body.mask.iter().map(|&b| f32::from(u8::from(b))).collect();
        let tissue = Volume { grid: grid.clone(), values };
        let surface = outermost(&polar, &tissue);
        Self { polar, surface, tissue }
    }
}

/// The wall near a first approximation of its front.
pub(super) fn near(
    map: Map,
    prior: &[f32],
    work: &Volume<f32>,
    fine: &Shaded,
    fat_above: &[f32],
    bounds: &Bounds,
    whole_back: bool,
) -> Wall {
    let Map { polar, surface, mut tissue } = map;
    fill_inside(&mut tissue, &polar, prior, COVER_OF_PRIOR_MM);
    let rough = search_front(&polar, work, &tissue, prior, &surface, fat_above, bounds);
    let (mut front, contrast) = refine(&polar, fine, &rough, bounds);
    // Columns that leave the image inside of the body show no surface.
    for (front, surface) in front.iter_mut().zip(&surface).filter(|(_, surface)| **surface > 0.0) {
        *front = front.min(surface - THINNEST_COVER_MM).max(1.0);
    }
    let rear = rear::search(&polar, fine, &front, &contrast, bounds);
    Wall { polar, front, rear, surface, contrast, whole_back }
}

/// Sets to one what lies more than `margin` (mm) inside of a map of radii: whatever has leaked
/// into the thorax is no air.
pub(super) fn fill_inside(mask: &mut Volume<f32>, polar: &Polar, radius: &[f32], margin: f64) {
    for n in 0..mask.grid.len() {
        let (r, at) = polar.locate(&mask.grid.center(mask.grid.voxel(n)));
        if polar.holds(at) && r < f64::from(polar.value(radius, at)) - margin {
            mask.values[n] = 1.0;
        }
    }
}

/// Largest radius (mm) at which `mask` exceeds one half, in each column; 0 where it never does.
fn outermost(polar: &Polar, mask: &Volume<f32>) -> Vec<f32> {
    let to_voxel = mask.grid.to_voxel();
    let spacing = mask.grid.spacing_mm()[0];
    let reach = mask.grid.shape[0].max(mask.grid.shape[1]) as f64 * spacing;
    let of_column = |column: usize| {
        let mut radius = reach;
        while radius > 0.0 {
            let voxel = to_voxel.apply(&polar.point(column, radius));
            if mask.linear(&voxel).is_some_and(|v| v > 0.5) {
                return radius as f32;
            }
            radius -= 0.5;
        }
        0.0
    };
    (0..polar.len()).into_par_iter().map(of_column).collect()
}

/// What parts fat and darker tissue, in units of fat, in each slice of the work grid: a third of the
/// way from the brighter organs behind the wall to fat.
pub(super) fn fat_above(work: &Volume<f32>, body: &Body) -> Vec<f32> {
    let grid = &work.grid;
    let slice = grid.shape[0] * grid.shape[1];
    let near_axis = |n: &usize| {
        let p = grid.center(grid.voxel(*n));
        body.mask[*n] && (p.x - body.axis[0]).hypot(p.y - body.axis[1]) < ORGANS_WITHIN_MM
    };
    let around = (0.5 * ORGANS_HEIGHT_MM / grid.spacing_mm()[2]) as usize;
    let of_slice = |k: usize| {
        let slices = k.saturating_sub(around)..(k + around + 1).min(grid.shape[2]);
        let voxels = slices.start * slice..slices.end * slice;
        let mut organs: Vec<f64> =
            voxels.filter(near_axis).map(|n| f64::from(work.values[n])).collect();
        let bright = body::quantile(&mut organs, BRIGHTER_ORGANS).unwrap_or(0.0) as f32;
        (bright + (1.0 - bright) / 3.0).clamp(FAT_ABOVE[0], FAT_ABOVE[1])
    };
    (0..grid.shape[2]).into_par_iter().map(of_slice).collect()
}

/// Radius at which the fat under the skin of a column ends; `None` when it is too thick for the
/// sternum to lie behind it.
fn end_of_fat(polar: &Polar, work: &Volume<f32>, column: usize, surface: f32) -> Option<f32> {
    const STEP_MM: f32 = 0.5;
    let to_voxel = work.grid.to_voxel();
    let mut brightest = 0.0f32;
    let steps = (DEEPEST_STERNUM_MM / STEP_MM) as usize;
    let radii = (0..steps).map(|n| surface - n as f32 * STEP_MM).take_while(|r| *r > 0.0);
    for radius in radii {
        let value = sample_clamped(work, &to_voxel.apply(&polar.point(column, f64::from(radius))));
        brightest = brightest.max(value);
        if brightest > FAT_ABOVE[1] && value < FAT_ENDS * brightest {
            return Some(radius);
        }
    }
    None
}

/// Dark tissue that hangs together with the inside of the thorax, or with what is marked there, through
/// more than thin bridges: neither skin nor gland behind a layer of fat.
fn dark_core(
    work: &Volume<f32>,
    tissue: &Volume<f32>,
    fat_above: &[f32],
    marks: &Marks,
) -> Volume<f32> {
    let shape = work.grid.shape;
    let mut smooth = work.values.clone();
    filter::box_blur(&mut smooth, shape, [1; 3]);
    let mut near_air: Vec<f32> = tissue.values.iter().map(|b| 1.0 - b).collect();
    filter::maximum(&mut near_air, shape, 2);
    let dark: Vec<bool> = (0..smooth.len())
        .map(|n| near_air[n] < 0.5 && smooth[n] < fat_above[n / (shape[0] * shape[1])])
        .collect();
    let mut light: Vec<f32> = dark.iter().map(|&d| f32::from(u8::from(!d))).collect();
    filter::maximum(&mut light, shape, 1);
    let eroded: Vec<bool> = light.iter().map(|&l| l < 0.5).collect();
    let to_voxel = work.grid.to_voxel();
    let seeds: Vec<usize> = marks
        .behind()
        .map(|p| to_voxel.apply(p).map(f64::round))
        .filter(|v| (0..3).all(|axis| v[axis] >= 0.0 && v[axis] < shape[axis] as f64))
        .map(|v| work.grid.index([0, 1, 2].map(|axis| v[axis] as usize)))
        .collect();
    let marked = body::reached(&eroded, shape, &seeds);
    let mut core: Vec<f32> = body::largest_component(&eroded, shape)
        .unwrap_or(eroded)
        .iter()
        .zip(&marked)
        .map(|(largest, marked)| *largest || *marked)
        .map(|c| f32::from(u8::from(c)))
        .collect();
    // Grown back within the dark tissue: over what the erosion took, and thin muscle beside it.
    for _ in 0..4 {
        filter::maximum(&mut core, shape, 1);
        core.iter_mut().zip(&dark).for_each(|(core, dark)| *core *= f32::from(u8::from(*dark)));
    }
    Volume { grid: work.grid.clone(), values: core }
}

/// A smooth wall of few degrees of freedom through most of the outer ends of the dark core.
///
/// Chebyshev polynomials of the angle and the height, fitted with Tukey's biweight: gland that
/// touches the muscle lies outside of the wall and loses its weight.
pub(super) fn near_elliptic(
    polar: &Polar,
    outer_dark: &[f32],
    surface: &[f32],
    bounds: &Bounds,
) -> Option<Vec<f32>> {
    const DEGREE: [usize; 2] = [8, 6];
    let chebyshev = |order: usize, x: f64| (order as f64 * x.clamp(-1.0, 1.0).acos()).cos();
    let n_basis = (DEGREE[0] + 1) * (DEGREE[1] + 1);
    let basis = |column: usize| {
        let scaled = |n: usize, of: usize| 2.0 * n as f64 / (of.max(2) - 1) as f64 - 1.0;
        let u = scaled(column % polar.shape[0], polar.shape[0]);
        let v = scaled(column / polar.shape[0], polar.shape[1]);
        DVector::from_fn(n_basis, |b, _| {
            chebyshev(b % (DEGREE[0] + 1), u) * chebyshev(b / (DEGREE[0] + 1), v)
        })
    };
    let known: Vec<usize> =
        (0..polar.len()).filter(|&c| outer_dark[c] > 20.0 && surface[c] > 20.0).collect();
    if known.len() * 3 < polar.len() {
        return None;
    }
    let bases: Vec<DVector<f64>> = (0..polar.len()).map(basis).collect();
    // What is marked weighs as much as all the rest, and is no outlier.
    let marked = known.iter().filter(|&&column| bounds.tells(column)).count();
    let of_mark = known.len() as f64 / marked.max(1) as f64;
    let full = |column: usize| if bounds.tells(column) { of_mark } else { 1.0 };
    let mut weight: Vec<f64> = known.iter().map(|&column| full(column)).collect();
    let mut fit = vec![0.0f32; polar.len()];
    for pass in 0..10 {
        let mut normal = DMatrix::<f64>::identity(n_basis, n_basis) * (1e-4 * known.len() as f64);
        let mut right = DVector::<f64>::zeros(n_basis);
        for (&column, &w) in known.iter().zip(&weight) {
            normal.ger(w, &bases[column], &bases[column], 1.0);
            right.axpy(w * f64::from(outer_dark[column]), &bases[column], 1.0);
        }
        let coefficients = normal.cholesky()?.solve(&right);
        for column in 0..polar.len() {
            fit[column] = bases[column].dot(&coefficients) as f32;
        }
        // The scale shrinks, so that the first pass can be far off.
        let scale = [40.0, 30.0, 25.0, 20.0, 15.0][pass.min(4)];
        for (&column, w) in known.iter().zip(weight.iter_mut()) {
            let ratio = f64::from(outer_dark[column] - fit[column]) / scale;
            let outlier = (1.0 - ratio * ratio).max(0.0).powi(2);
            *w = if bounds.tells(column) { of_mark } else { outlier };
        }
    }
    Some(fit)
}

/// How much a brightness (in units of fat) is muscle rather than gland or fat: 1 at none.
fn muscle_like(brightness: f32, fat_above: f32) -> f32 {
    (1.0 - brightness / fat_above).max(0.0)
}

/// The surface from bright outside to dark inside that is smoothest, near the prior.
fn search_front(
    polar: &Polar,
    work: &Volume<f32>,
    tissue: &Volume<f32>,
    prior: &[f32],
    surface: &[f32],
    fat_above: &[f32],
    bounds: &Bounds,
) -> Vec<f32> {
    let n_offset = (2.0 * BAND_MM / STEP_MM) as usize + 1;
    let (inner, outer) = (5usize, 17usize);
    let to_voxel = work.grid.to_voxel();
    let mut cost = vec![0.0f32; polar.len() * n_offset];
    cost.par_chunks_mut(n_offset).enumerate().for_each(|(column, cost)| {
        let start = f64::from(prior[column]) - BAND_MM;
        let slice = (polar.height(column) - work.grid.origin.z) / work.grid.spacing_mm()[2];
        let fat_above = fat_above[(slice.max(0.0) as usize).min(fat_above.len() - 1)];
        // Brightness along the ray; outside of the body it counts as fat, to bear thin layers.
        let profile: Vec<f32> = (0..n_offset + inner + outer)
            .map(|n| {
                let radius = start + (n as f64 - inner as f64) * STEP_MM;
                let voxel = to_voxel.apply(&polar.point(column, radius.max(0.0)));
                let in_body = sample_clamped(tissue, &voxel) > 0.5;
                if in_body { sample_clamped(work, &voxel).clamp(0.0, 1.0) } else { 1.0 }
            })
            .collect();
        let mean = |range: std::ops::Range<usize>| {
            profile[range.clone()].iter().sum::<f32>() / range.len() as f32
        };
        for (n, cost) in cost.iter_mut().enumerate() {
            let at = n + inner;
            let edge = mean(at + 1..at + 5) - mean(at - 4..at);
            let muscle_outside =
                profile[at + 1..at + outer].iter().map(|b| muscle_like(*b, fat_above));
            let dark_outside = muscle_outside.sum::<f32>() / (outer - 1) as f32;
            let radius = start + n as f64 * STEP_MM;
            let off = ((radius - f64::from(prior[column])).abs() / BAND_MM) as f32;
            *cost = 1.0 - edge.max(0.0) + 1.2 * dark_outside + 0.3 * off;
            if radius > f64::from(surface[column]) - 4.0 {
                *cost += 1.0;
            }
            if bounds.front(column, radius as f32) != radius as f32 {
                *cost += WRONG_SIDE;
            }
        }
    });
    let [n_u, n_v] = polar.shape;
    let offsets = optimal_surface(&Columns { n_u, n_v, n_offset, cost }, 0.12);
    let radius = |(column, &offset): (usize, &usize)| {
        prior[column] + (offset as f64 * STEP_MM - BAND_MM) as f32
    };
    offsets.iter().enumerate().map(radius).collect()
}

/// Half-way crossing between fat and muscle on the image itself, then a smooth surface through
/// the columns that show one. Returns radii and contrasts (0..=1).
fn refine(polar: &Polar, fine: &Shaded, rough: &[f32], bounds: &Bounds) -> (Vec<f32>, Vec<f32>) {
    const STEP: f64 = 0.25;
    const HALF: usize = 24;
    let crossing = |column: usize| {
        let at = |n: usize| f64::from(rough[column]) + (n as f64 - HALF as f64) * STEP;
        let raw: Vec<f32> = (0..=2 * HALF)
            .map(|n| {
                fine.at(&polar.point(column, at(n).max(0.0))).unwrap_or(0.0).min(BRIGHTEST_FAT)
            })
            .collect();
        let mean = |range: std::ops::Range<usize>| {
            raw[range.clone()].iter().sum::<f32>() / range.len() as f32
        };
        let (dark, bright) = (mean(HALF - 18..HALF - 4), mean(HALF + 5..HALF + 19));
        let level = 0.5 * (dark + bright);
        let smooth: Vec<f32> =
            (0..=2 * HALF).map(|n| mean(n.saturating_sub(2)..(n + 3).min(raw.len()))).collect();
        let mut best: Option<f64> = None;
        for n in 0..2 * HALF {
            if smooth[n] < level && smooth[n + 1] >= level {
                let part = f64::from((level - smooth[n]) / (smooth[n + 1] - smooth[n]));
                let radius = at(n) + part * STEP;
                let distance = |r: f64| (r - f64::from(rough[column])).abs();
                if best.is_none_or(|b| distance(radius) < distance(b)) {
                    best = Some(radius);
                }
            }
        }
        let contrast = ((bright - dark - 0.15) / 0.35).clamp(0.0, 1.0);
        best.map_or((rough[column], 0.0), |radius| (radius as f32, contrast))
    };
    let found: Vec<(f32, f32)> = (0..polar.len()).into_par_iter().map(crossing).collect();
    let mut data: Vec<f32> = found.iter().map(|f| f.0).collect();
    let contrast: Vec<f32> = found.iter().map(|f| f.1).collect();
    let mut weight: Vec<f32> = contrast.iter().map(|c| c.max(0.01)).collect();
    let mut front = data.clone();
    for scale_mm in [8.0, 5.0, 4.0] {
        front = smooth_map(&data, &weight, polar.shape, [4.0, 4.0]);
        for n in 0..weight.len() {
            let ratio = (data[n] - front[n]) / scale_mm;
            weight[n] = contrast[n].max(0.01) * (1.0 - ratio * ratio).max(1e-3).powi(2);
            let held = bounds.front(n, front[n]);
            if held != front[n] {
                (data[n], weight[n]) = (held, MARKED);
            }
        }
    }
    for (n, front) in front.iter_mut().enumerate() {
        *front = bounds.front(n, *front);
    }
    (front, contrast)
}
