//! How thick skin is: from the brightness along the inward normals of its surface.
//!
//! Skin is a layer between air and fat, brighter than the one and darker than the other. With t (mm)
//! inwards from the surface, T its thickness, s its brightness in units of the fat behind it, a what
//! the surface is off and σ the blur of the voxels,
//!
//! I(t) = f [ s Φ((t − a)/σ) + (1 − s) Φ((t − a − T)/σ) ],   Φ the normal distribution.
//!
//! f, a and T are fitted to each place by least squares; s and σ, which a layer as thin as a voxel does
//! not tell by itself, are those of one image that fit all of its skin best. The integral of the dip
//! f − I is f (1 − s) T there: partial volume blurs a thin layer, but takes nothing from it.

use crate::xray::statistics::two_sided;
use mammotwin_data::{Vec3, surface::TriMesh, volume::Volume};
use rayon::prelude::*;

/// Voxels up to this size (mm) tell skin from fat.
pub const RESOLVED_MM: f64 = 1.3;

/// Samples of a profile: their number, the first and the step (mm, inwards).
const SAMPLES: usize = 39;
const FIRST_MM: f64 = -3.0;
const STEP_MM: f64 = 0.25;
/// Thickest skin that is looked for (mm): the areola has 4 to 5.
const THICKEST_MM: f64 = 6.0;
/// What is thinner on the whole (mm) is no skin, which has 0.8 and more.
const THINNEST_MM: f64 = 0.5;
/// The surface is off by at most this (mm).
const OFF_MM: f64 = 1.5;
/// Brightnesses of skin, in units of fat, that are tried.
const BRIGHTNESS: [f64; 14] =
    [0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8];
/// Blurs, in voxel edges, that are tried: a voxel's own width, interpolated, is 0.5.
const BLUR: [f64; 7] = [0.35, 0.42, 0.5, 0.6, 0.72, 0.86, 1.0];
/// Places on which brightness and blur are chosen.
const CHOSEN_ON: usize = 1000;
/// Of these, so many fit worst and do not count: gland under the skin, the edge of the breast.
const WORST: f64 = 0.3;
/// A place whose misfit is this many times the median is none of skin on fat.
const MISFIT: f64 = 4.0;
/// Nor is one whose fat is darker than this part of that around it ...
const DARK_FAT: f64 = 0.7;
/// ... within so many millimetres.
const AROUND_MM: f64 = 15.0;
/// The thickness is the median of that within this distance (mm).
const SMOOTHED_MM: f64 = 6.0;

type Profile = [f32; SAMPLES];

/// Thickness of skin over the places of a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinMap {
    /// Thickness (mm) at each vertex; `None` where it was not asked for or could not be told.
    pub thickness_mm: Vec<Option<f64>>,
    /// Brightness of skin in units of that of the fat behind it.
    pub brightness: f64,
    /// Standard deviation of the blur, in voxel edges.
    pub blur: f64,
}

/// Why there is no thickness.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoSkin {
    /// The skin is thinner than the image shows.
    #[error(
        "voxels of {voxel_mm:.1} mm do not resolve skin (up to {RESOLVED_MM} mm do): no thickness"
    )]
    Coarse {
        /// Largest edge of a voxel (mm).
        voxel_mm: f64,
    },
    /// Skin and the tissue under it look alike.
    #[error("no skin that is darker than the fat under it is seen in this image: no thickness")]
    NoContrast,
}

/// Thickness of the skin at the vertices of a surface of the body that are `wanted`.
///
/// # Errors
/// When the voxels are too large, or skin has no contrast to fat.
pub fn thickness(image: &Volume<f32>, skin: &TriMesh, wanted: &[bool]) -> Result<SkinMap, NoSkin> {
    let voxel_mm = image.grid.spacing_mm().into_iter().fold(0.0, f64::max);
    if voxel_mm > RESOLVED_MM {
        return Err(NoSkin::Coarse { voxel_mm });
    }
    let normals = skin.vertex_normals();
    let web = Web::new(skin, wanted);
    let profiles = means(&web, &profiles(image, skin, &normals, wanted));
    let seen: Vec<usize> = (0..profiles.len()).filter(|&n| profiles[n].is_some()).collect();
    // Edge of a voxel as the normal meets it.
    let edge = |n: usize| {
        let along = |axis: usize| normals[n].dot(&image.grid.axes.column(axis));
        (0..3).map(|axis| along(axis).powi(2)).sum::<f64>().sqrt()
    };
    let (brightness, blur) = contrast(&profiles, &seen, &edge).ok_or(NoSkin::NoContrast)?;

    // One set of templates serves all places that meet voxels of about the same edge.
    let bin = |n: usize| (edge(n) / EDGE_BIN_MM).round() as usize;
    let mut bins: Vec<usize> = seen.iter().map(|&n| bin(n)).collect();
    bins.sort_unstable();
    bins.dedup();
    let mut fits: Vec<Option<Fit>> = vec![None; profiles.len()];
    for one in bins {
        let edge_mm = one as f64 * EDGE_BIN_MM;
        let templates = Templates::new(brightness, blur * edge_mm, 0.1);
        let here: Vec<usize> = seen.iter().copied().filter(|&n| bin(n) == one).collect();
        let found: Vec<Option<Fit>> = here
            .par_iter()
            .map(|&n| profiles[n].as_ref().map(|profile| templates.fit(profile)))
            .collect();
        for (n, fit) in here.into_iter().zip(found) {
            fits[n] = fit;
        }
    }
    let mut misfits: Vec<f64> = fits.iter().flatten().map(|fit| fit.misfit).collect();
    let allowed = MISFIT * median(&mut misfits).ok_or(NoSkin::NoContrast)?;
    let fat: Vec<Option<f64>> = fits.iter().map(|fit| fit.map(|fit| fit.fat)).collect();
    let around = web.medians(&fat, AROUND_MM);
    let sound = |n: usize| {
        let fit = fits[n]?;
        let on_fat = fit.fat > DARK_FAT * around[n]?;
        (on_fat && fit.misfit < allowed).then_some(fit.thickness_mm)
    };
    let single: Vec<Option<f64>> = (0..fits.len()).map(sound).collect();
    let mut all: Vec<f64> = single.iter().flatten().copied().collect();
    if median(&mut all).is_none_or(|middle| middle < THINNEST_MM) {
        return Err(NoSkin::NoContrast);
    }
    let thickness_mm = web.medians(&single, SMOOTHED_MM);
    let thickness_mm = single.iter().zip(thickness_mm).map(|(one, all)| one.and(all)).collect();
    Ok(SkinMap { thickness_mm, brightness, blur })
}

/// Edges of voxels (mm) that are taken for one.
const EDGE_BIN_MM: f64 = 0.05;

/// Brightness along the inward normals of the wanted vertices that lie in the image.
fn profiles(
    image: &Volume<f32>,
    skin: &TriMesh,
    normals: &[Vec3],
    wanted: &[bool],
) -> Vec<Option<Profile>> {
    let to_voxel = image.grid.to_voxel();
    let along = |n: usize| {
        let mut profile = [0.0; SAMPLES];
        for (m, value) in profile.iter_mut().enumerate() {
            let p = skin.points[n] - (FIRST_MM + m as f64 * STEP_MM) * normals[n];
            *value = image.linear(&to_voxel.apply(&p))?;
        }
        Some(profile)
    };
    (0..skin.points.len()).into_par_iter().map(|n| wanted[n].then(|| along(n)).flatten()).collect()
}

/// The mean of a place's profile and those of its neighbours: less noise, and no stairs.
fn means(web: &Web, profiles: &[Option<Profile>]) -> Vec<Option<Profile>> {
    let mean = |n: usize| {
        let mut sum = profiles[n]?;
        let mut count = 1.0;
        for profile in web.next[n].iter().filter_map(|&m| profiles[m as usize].as_ref()) {
            sum.iter_mut().zip(profile).for_each(|(sum, value)| *sum += value);
            count += 1.0;
        }
        Some(sum.map(|value| value / count))
    };
    (0..profiles.len()).into_par_iter().map(mean).collect()
}

/// Brightness of skin and blur (voxel edges) with which the skin of an image fits best; `None` when no
/// skin is seen, or when it looks like fat.
fn contrast(
    profiles: &[Option<Profile>],
    seen: &[usize],
    edge: &(impl Fn(usize) -> f64 + Sync),
) -> Option<(f64, f64)> {
    let step = seen.len().div_ceil(CHOSEN_ON).max(1);
    let some: Vec<usize> = seen.iter().copied().step_by(step).collect();
    let mean_edge = some.iter().map(|&n| edge(n)).sum::<f64>() / some.len().max(1) as f64;
    let misfit = |brightness: f64, blur: f64| {
        let templates = Templates::new(brightness, blur * mean_edge, 0.25);
        let misfit = |&n: &usize| Some(templates.fit(profiles[n].as_ref()?).misfit);
        let mut all: Vec<f64> = some.par_iter().filter_map(misfit).collect();
        all.sort_by(f64::total_cmp);
        let kept = ((1.0 - WORST) * all.len() as f64) as usize;
        all[..kept].iter().sum::<f64>() / kept.max(1) as f64
    };
    if some.len() < 20 {
        return None;
    }
    let mut best = (f64::INFINITY, 0, 0.0);
    let mut of_best = [0.0; BRIGHTNESS.len()];
    for blur in BLUR {
        let row = BRIGHTNESS.map(|brightness| misfit(brightness, blur));
        for (n, &value) in row.iter().enumerate() {
            if value < best.0 {
                (best, of_best) = ((value, n, blur), row);
            }
        }
    }
    let (_, n, blur) = best;
    if n + 1 == BRIGHTNESS.len() {
        return None;
    }
    let step = BRIGHTNESS[1] - BRIGHTNESS[0];
    let shift = if n > 0 { vertex([of_best[n - 1], of_best[n], of_best[n + 1]]) } else { 0.0 };
    Some((BRIGHTNESS[n] + shift * step, blur))
}

/// Where a parabola through three values at -1, 0, 1 is least, if between -1/2 and 1/2.
fn vertex([before, here, after]: [f64; 3]) -> f64 {
    let bend = before - 2.0 * here + after;
    if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// What fits a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    thickness_mm: f64,
    /// Brightness of the fat behind the skin.
    fat: f64,
    /// Sum of squares that is left, in units of fat.
    misfit: f64,
}

/// Profiles of skin of many thicknesses at many places, of brightness 1 in fat.
struct Templates {
    step_mm: f64,
    /// All offsets of one thickness after those of another.
    rows: Vec<Profile>,
    squares: Vec<f32>,
    offsets: usize,
}

impl Templates {
    fn new(brightness: f64, sigma_mm: f64, step_mm: f64) -> Self {
        // All places are multiples of a twentieth of a millimetre, and far fewer than templates.
        const PER_MM: f64 = 20.0;
        const REACH_MM: f64 = 12.0;
        let edge: Vec<f64> = (0..=(2.0 * REACH_MM * PER_MM) as usize)
            .map(|n| {
                let t = n as f64 / PER_MM - REACH_MM;
                let tail = 0.5 * two_sided(t / sigma_mm);
                if t < 0.0 { tail } else { 1.0 - tail }
            })
            .collect();
        let edge = |t: f64| edge[((t + REACH_MM) * PER_MM).round() as usize];
        let offsets = 2 * (OFF_MM / step_mm).round() as usize + 1;
        let thicknesses = (THICKEST_MM / step_mm).round() as usize + 1;
        let rows: Vec<Profile> = (0..thicknesses * offsets)
            .map(|row| {
                let thickness = (row / offsets) as f64 * step_mm;
                let off = (row % offsets) as f64 * step_mm - OFF_MM;
                std::array::from_fn(|n| {
                    let t = FIRST_MM + n as f64 * STEP_MM - off;
                    (brightness * edge(t) + (1.0 - brightness) * edge(t - thickness)) as f32
                })
            })
            .collect();
        let squares = rows.iter().map(|row| row.iter().map(|v| v * v).sum()).collect();
        Self { step_mm, rows, squares, offsets }
    }

    fn fit(&self, profile: &Profile) -> Fit {
        let square: f32 = profile.iter().map(|v| v * v).sum();
        // Of each thickness the best offset: the square that its best multiple explains, and that multiple.
        let explained = |row: usize| {
            let dot: f32 = self.rows[row].iter().zip(profile).map(|(a, b)| a * b).sum();
            (f64::from(dot * dot / self.squares[row]), f64::from(dot / self.squares[row]))
        };
        let best: Vec<(f64, f64)> = (0..self.rows.len() / self.offsets)
            .map(|thickness| {
                let rows = thickness * self.offsets..(thickness + 1) * self.offsets;
                rows.map(explained).fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
            })
            .collect();
        let n = (0..best.len()).fold(0, |n, m| if best[m].0 > best[n].0 { m } else { n });
        let inner = n > 0 && n + 1 < best.len();
        let shift = if inner { vertex([-best[n - 1].0, -best[n].0, -best[n + 1].0]) } else { 0.0 };
        let fat = best[n].1.max(1e-12);
        let misfit = (f64::from(square) - best[n].0).max(0.0) / (fat * fat);
        Fit { thickness_mm: (n as f64 + shift) * self.step_mm, fat, misfit }
    }
}

/// Which wanted vertices are neighbours.
struct Web<'a> {
    points: &'a [Vec3],
    next: Vec<Vec<u32>>,
}

impl<'a> Web<'a> {
    fn new(surface: &'a TriMesh, wanted: &[bool]) -> Self {
        let mut next = vec![Vec::new(); surface.points.len()];
        for corners in &surface.triangles {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b])) {
                if wanted[a as usize] && wanted[b as usize] {
                    next[a as usize].push(b);
                    next[b as usize].push(a);
                }
            }
        }
        for neighbours in &mut next {
            neighbours.sort_unstable();
            neighbours.dedup();
        }
        Self { points: &surface.points, next }
    }

    /// Medians of the values that are reached over the surface within `radius_mm`; `None` where none is.
    fn medians(&self, values: &[Option<f64>], radius_mm: f64) -> Vec<Option<f64>> {
        let blocks: Vec<usize> = (0..values.len()).collect();
        let of_block = |block: &[usize]| {
            let mut reached = vec![usize::MAX; values.len()];
            let (mut queue, mut found) = (Vec::new(), Vec::new());
            let of = |&n: &usize| {
                queue.clear();
                found.clear();
                queue.push(n);
                reached[n] = n;
                while let Some(m) = queue.pop() {
                    found.extend(values[m]);
                    for &to in &self.next[m] {
                        let to = to as usize;
                        let near = (self.points[to] - self.points[n]).norm() <= radius_mm;
                        if reached[to] != n && near {
                            reached[to] = n;
                            queue.push(to);
                        }
                    }
                }
                median(&mut found)
            };
            block.iter().map(of).collect::<Vec<_>>()
        };
        blocks.par_chunks(4096).flat_map_iter(of_block).collect()
    }
}

/// Median. `None` of nothing.
fn median(values: &mut [f64]) -> Option<f64> {
    let at = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(at, f64::total_cmp).1)
}
