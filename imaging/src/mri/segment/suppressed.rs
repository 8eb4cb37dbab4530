//! The chest wall where fat is suppressed: fat is dark, and muscle, gland and skin are brighter.
//!
//! The front of the muscle is looked for in such an image itself, as the surface at which dark fat gives way to
//! brighter muscle; a few passes tell fat's brightness from what lies before it. Then the image is recoloured to the
//! contrast that the rest of this folder knows, and the usual search refines the front and finds the rear.
//!
//! Lung is darker than fat here. That parts the wall from the heart, whose edge against lung is the clearest of
//! all, and it is drawn as dark as muscle: behind the wall everything is dark then, as in a T2 weighted image.

use super::body::{self, Body};
use super::depth;
use super::frame::{Frame, sample_clamped};
use super::plausible::FRONT;
use super::polar::Polar;
use super::scribble::Bounds;
use super::search::{Columns, optimal_surface};
use super::shading::{self, Field, Shaded};
use super::wall::{self, Map, Wall};
use mammotwin_data::Vec3;
use mammotwin_data::volume::{Grid, Volume};
use rayon::prelude::*;

/// Skin and its blur reach to this depth (mm).
const SKIN_MM: f32 = 4.5;
/// Before any wall is known, what lies between skin and this depth (mm) is mostly fat.
const UNDER_SKIN_MM: f32 = 15.0;
/// Fat is measured to this distance (mm) behind the axis: farther off it is noise.
const BEHIND_AXIS_MM: f64 = 20.0;
/// Fat is measured beyond this distance (mm) in front of the wall.
const BEFORE_WALL_MM: f64 = 4.0;
/// Quantile of the brightness of what is no fat in the breast that stands for gland.
const GLAND_QUANTILE: f64 = 0.75;
/// Passes more for the fat of the breast, in which gland is told.
const FOLLOWING: usize = 6;
/// Greater depths (mm) under the skin need not be told apart.
const DEEPEST_MM: f64 = 40.0;
/// First radius (mm) of the search, and its step (mm).
const FIRST_MM: f64 = 20.0;
const STEP_MM: f64 = 1.0;
/// Steps on each side of a place whose means are compared.
const BESIDE: usize = 5;
/// A step of this height, in units of fat, is as good as any.
const CLEAR: f32 = 0.8;
/// Tissue this much darker than fat is lung, where it lies deeper than so many mm under the skin.
const LUNG_BELOW: f32 = 0.55;
const LUNG_FROM_MM: f32 = 8.0;
/// So many mm of lung in front of a place are chance; so many more, proof.
const LUNG_MM: [f32; 2] = [3.0, 8.0];
/// What is this much brighter than fat is muscle or gland rather than fat: from here on, and surely.
const NOT_FAT: [f32; 2] = [1.25, 2.0];
/// Steps in front of a place in which there should be none of it.
const FREE: usize = 16;
/// The same distance (mm) off the first approximation costs this much, and the double as much at most.
const OFF_MM: f32 = 24.0;
const OFF: f32 = 0.3;
/// What a change of one step between neighbouring columns costs.
const STEP_COST: f32 = 0.12;
/// A step of this part of a clear one shows the wall.
const SEEN: f32 = 0.25;
/// Brightness of muscle in the recoloured image, in units of fat.
const MUSCLE: f32 = 0.25;
/// The same of gland of middle brightness.
const GLAND: f32 = 0.42;
/// Value of fat in the recoloured image.
const FAT: f32 = 1000.0;

/// An image with suppressed fat, and the wall that it shows.
pub(super) struct Suppressed {
    /// In the contrast that the segmentation knows.
    pub image: Volume<f32>,
    /// Between fat and gland alone, in units of fat.
    pub breast: Volume<f32>,
    /// Fat's brightness in the recoloured image.
    pub flat: Field,
    /// Fat's brightness in the image itself.
    pub fat: Field,
    /// The air around the body.
    pub air: Air,
    pub body: Body,
    pub wall: Wall,
}

/// What speaks for a wall behind suppressed fat, on the front of the chest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Evidence {
    /// Brightness of muscle in units of fat.
    muscle: f32,
    /// Part of the columns in which the step from fat to muscle shows.
    seen: f64,
    /// Part of the columns in which the surface of most evidence is the smooth one.
    smooth: f64,
    /// Brightness of fat over that of air.
    fat: f64,
}

/// Finds the wall; `work` is the image on the work grid, `inside` where that lies in the image, `body` and the brightness
/// of the brightest `tissue` what the usual way made of it. `None` where there is no wall to be found.
pub(super) fn find(
    image: &Volume<f32>,
    frame: &Frame,
    work: &Volume<f32>,
    inside: &[bool],
    body: &Body,
    tissue: &Field,
) -> Option<Suppressed> {
    let grid = &work.grid;
    let mut body = body.clone();
    let mut air = Air::of(work, inside, &body)?;
    for _ in 0..2 {
        let from = |n: usize| air.mean_from(&grid.center(grid.voxel(n)), tissue);
        body = body::find(work, inside, from)?;
        air = Air::of(work, inside, &body)?;
    }
    let depth = depth_in(&body, grid);
    let map = Map::new(grid, &body);
    let none = Bounds::none(map.polar.len());
    let fat_where = |is_breast: &dyn Fn(&Vec3, f32) -> bool, following: usize| {
        fat_where(work, &body, &depth, is_breast, following)
    };
    let mut fat = fat_where(&|_, depth| depth < UNDER_SKIN_MM, 0)?;
    let mut fat_of_breast = None;
    let mut breast_values = Vec::new();
    let mut prior: Option<Vec<f32>> = None;
    let mut seen = None;
    for _ in 0..2 {
        let even = evened(work, &fat);
        let rough = search(&map, &even, &depth, prior.as_deref());
        let known: Vec<f32> = rough
            .radii
            .iter()
            .zip(&rough.step)
            .map(|(radius, step)| if *step > SEEN { *radius } else { 0.0 })
            .collect();
        let smooth = wall::near_elliptic(&map.polar, &known, &map.surface, &none)?;
        let before = |p: &Vec3| {
            let (radius, at) = map.polar.locate(p);
            radius > f64::from(map.polar.value(&smooth, at)) + BEFORE_WALL_MM
        };
        fat = fat_where(&|p, _| before(p), 0)?;
        let of_breast = fat_where(&|p, _| before(p), FOLLOWING)?;
        let deep = |n: &usize| {
            let p = grid.center(grid.voxel(*n));
            depth.values[*n] > SKIN_MM + 2.0 && p.y > body.axis[1] && before(&p)
        };
        breast_values = (0..grid.len())
            .filter(deep)
            .map(|n| f64::from(work.values[n] / of_breast.fat(&grid.center(grid.voxel(n)))))
            .collect();
        fat_of_breast = Some(of_breast);
        prior = Some(smooth);
        seen = Some(rough);
    }
    let (prior, fat_of_breast, rough) = (prior?, fat_of_breast?, seen?);
    let fat_over_air = |p: &Vec3| fat.fat(p) / air.0.fat(p);
    let evidence = Evidence::of(&map.polar, &rough, &prior, fat_over_air)?;
    tracing::debug!(?evidence, "wall behind suppressed fat");
    if !evidence.is_enough() {
        return None;
    }

    // Of lobes many a voxel is shared with fat: what is brighter than most that is clearly no fat stands for gland.
    let half_way = 0.5 * (1.0 + f64::from(evidence.muscle));
    breast_values.retain(|value| *value > half_way);
    let gland = (body::quantile(&mut breast_values, GLAND_QUANTILE)? as f32).max(evidence.muscle);

    let recoloured = |value: f32, fat: f32| FAT * tone(value / fat, evidence.muscle);
    let mut work = work.clone();
    for n in 0..work.values.len() {
        let fat = fat.fat(&grid.center(grid.voxel(n)));
        work.values[n] = recoloured(work.values[n], fat) / FAT;
    }
    let slice = image.grid.shape[0] * image.grid.shape[1];
    let mut values = image.values.clone();
    let mut breast = image.values.clone();
    let slices = values.par_chunks_mut(slice).zip(breast.par_chunks_mut(slice)).enumerate();
    slices.for_each(|(k, (values, breast))| {
        for (n, (value, inner)) in values.iter_mut().zip(breast).enumerate() {
            let voxel = image.grid.voxel(k * slice + n).map(|v| v as f64);
            let p = frame.body_from_voxel.apply(&voxel.into());
            let share = (*value / fat_of_breast.fat(&p) - 1.0) / (gland - 1.0);
            *inner = 1.0 - share.clamp(-0.5, 1.5) * (1.0 - GLAND);
            *value = recoloured(*value, fat.fat(&p));
        }
    });
    let volume = |values| Volume { grid: image.grid.clone(), values };
    let (image, breast) = (volume(values), volume(breast));
    let flat = Field::flat(FAT, &frame.low);
    let fat_above = wall::fat_above(&work, &body);
    let fine = Shaded { image: &image, frame, field: &flat };
    let wall = wall::near(map, &prior, &work, &fine, &fat_above, &none, body.whole_back);
    Some(Suppressed { image, breast, flat, fat: fat_of_breast, air, body, wall })
}

/// The image in units of fat.
fn evened(work: &Volume<f32>, fat: &Field) -> Volume<f32> {
    let grid = &work.grid;
    let value = |n: usize| work.values[n] / fat.fat(&grid.center(grid.voxel(n)));
    Volume { grid: grid.clone(), values: (0..grid.len()).map(value).collect() }
}

/// Depth (mm) under the surface of the body, on the work grid.
fn depth_in(body: &Body, grid: &Grid) -> Volume<f32> {
    let values = depth::distance_to_outside(&body.mask, grid, DEEPEST_MM);
    Volume { grid: grid.clone(), values }
}

/// Fat's brightness, from what lies under the skin where `is_breast` of place and depth (mm).
fn fat_where(
    work: &Volume<f32>,
    body: &Body,
    depth: &Volume<f32>,
    is_breast: &dyn Fn(&Vec3, f32) -> bool,
    following: usize,
) -> Option<Field> {
    let grid = &work.grid;
    let usable = |n: usize| {
        let (p, depth) = (grid.center(grid.voxel(n)), depth.values[n]);
        p.y > body.axis[1] - BEHIND_AXIS_MM && depth > SKIN_MM && is_breast(&p, depth)
    };
    let usable: Vec<bool> = (0..grid.len()).map(usable).collect();
    shading::estimate_suppressed(work, &usable, following)
}

/// The air around the body: near to it ghosts and the coils' correction make it brighter than elsewhere.
pub(super) struct Air(Field);

impl Air {
    /// Tissue begins at this part of the way from air to the brightest tissue around, in a mean of neighbours: no
    /// more than fat has, so that the body does not end at a gap of the skin.
    const MEAN_PART: f32 = 0.25;
    /// The same of a single voxel: about half-way to thin skin.
    const VOXEL_PART: f32 = 0.35;
    /// The brightest tissue around is this much brighter than air, of air's brightness, or it is noise.
    const LEAST: f32 = 0.2;

    fn of(work: &Volume<f32>, inside: &[bool], body: &Body) -> Option<Self> {
        let air: Vec<bool> = inside.iter().zip(&body.mask).map(|(&i, &body)| i && !body).collect();
        shading::estimate_air(work, &air).map(Self)
    }

    /// The brightness that parts a mean of neighbours in the tissue from one in the air at a place (mm, body's
    /// axes), in the image's units, where the brightest tissue is as bright as the field tells.
    fn mean_from(&self, p: &Vec3, tissue: &Field) -> f32 {
        self.part(p, tissue, Self::MEAN_PART)
    }

    /// The same of a single voxel.
    pub(super) fn voxel_from(&self, p: &Vec3, tissue: &Field) -> f32 {
        self.part(p, tissue, Self::VOXEL_PART)
    }

    fn part(&self, p: &Vec3, tissue: &Field, part: f32) -> f32 {
        let (air, tissue) = (self.0.fat(p), tissue.fat(p));
        air + part * (tissue - air).max(Self::LEAST * air)
    }
}

/// Brightness in the recoloured image, in units of fat, of what has `value` in units of fat where muscle has
/// `muscle`.
fn tone(value: f32, muscle: f32) -> f32 {
    // Lung, and how far a voxel of fat may lie below the mean.
    const LUNG: [f32; 2] = [0.4, 0.7];
    let dark = if value < 1.0 {
        ((LUNG[1] - value) / (LUNG[1] - LUNG[0])).clamp(0.0, 1.0)
    } else {
        ((value - 1.0) / (muscle - 1.0)).min(1.0)
    };
    1.0 - (1.0 - MUSCLE) * dark
}

/// A surface, and how high the step from fat to muscle is in each column.
struct Rough {
    radii: Vec<f32>,
    /// Over a clear step, 0..=1.
    step: Vec<f32>,
    /// Brightness behind it, in units of fat.
    behind: Vec<f32>,
}

/// The surface from dark fat outside to brighter muscle inside that costs least. `even` is in units of fat; behind
/// lung or much that is no fat there is no wall.
fn search(map: &Map, even: &Volume<f32>, depth: &Volume<f32>, prior: Option<&[f32]>) -> Rough {
    let Map { polar, surface, .. } = map;
    let reach = f64::from(surface.iter().copied().fold(0.0, f32::max));
    let n_offset = ((reach - FIRST_MM) / STEP_MM).max(1.0) as usize;
    let to_voxel = even.grid.to_voxel();
    let radius = |n: usize| FIRST_MM + n as f64 * STEP_MM;
    let mut cost = vec![0.0f32; polar.len() * n_offset];
    let mut steps = vec![[0.0f32; 2]; cost.len()];
    let columns = cost.par_chunks_mut(n_offset).zip(steps.par_chunks_mut(n_offset)).enumerate();
    columns.for_each(|(column, (cost, steps))| {
        // Skin and what lies beyond count as fat, to bear thin layers.
        let mut lung = vec![0.0f32; n_offset + 1];
        let mut profile = vec![1.0f32; n_offset + FREE + 1];
        for n in (0..n_offset).rev() {
            let voxel = to_voxel.apply(&polar.point(column, radius(n)));
            let under = depth.linear(&voxel).unwrap_or(0.0);
            if under > SKIN_MM {
                profile[n] = sample_clamped(even, &voxel);
            }
            let is_lung = under > LUNG_FROM_MM && profile[n] < LUNG_BELOW;
            lung[n] = lung[n + 1] + if is_lung { STEP_MM as f32 } else { 0.0 };
            profile[n] = profile[n].clamp(0.0, NOT_FAT[1]);
        }
        let mean = |from: usize, to: usize| {
            profile[from..to].iter().sum::<f32>() / (to - from).max(1) as f32
        };
        for n in 0..n_offset {
            let behind = mean(n.saturating_sub(BESIDE), n.max(1));
            let before = mean(n + 1, n + 1 + BESIDE);
            let step = ((behind - before) / CLEAR).clamp(0.0, 1.0);
            let no_fat = |v: &f32| ((v - NOT_FAT[0]) / (NOT_FAT[1] - NOT_FAT[0])).max(0.0);
            let in_front =
                profile[n + 1..n + 1 + FREE].iter().map(no_fat).sum::<f32>() / FREE as f32;
            let through = ((lung[n] - LUNG_MM[0]) / LUNG_MM[1]).clamp(0.0, 1.0);
            cost[n] = 1.0 - step + through + in_front;
            if radius(n) > f64::from(surface[column]) - 4.0 {
                cost[n] += 1.0;
            }
            if let Some(prior) = prior {
                let off = (radius(n) as f32 - prior[column]).abs() / OFF_MM;
                cost[n] += OFF * off.min(2.0);
            }
            steps[n] = [step, behind];
        }
    });
    let [n_u, n_v] = polar.shape;
    let offsets = optimal_surface(&Columns { n_u, n_v, n_offset, cost }, STEP_COST);
    let of = |part: usize| {
        offsets.iter().enumerate().map(|(c, &n)| steps[c * n_offset + n][part]).collect()
    };
    let radii = offsets.iter().map(|&n| radius(n) as f32).collect();
    Rough { radii, step: of(0), behind: of(1) }
}

impl Evidence {
    /// Muscle is this much brighter than fat at least, and seen and smooth are such parts: sound walls of ten scans
    /// have 1.6, 0.83 and 0.64 at least, that of a scan which ends behind the sternum 0.63 and 0.56. Fat that is hardly
    /// brighter than air (in sound scans 4.7 times) cannot be told from lung.
    const LEAST: Self = Self { muscle: 1.3, seen: 0.75, smooth: 0.6, fat: 3.5 };
    /// A rough surface is smooth where it is so near (mm) to its smooth approximation.
    const NEAR_MM: f32 = 6.0;

    fn is_enough(&self) -> bool {
        let least = Self::LEAST;
        self.muscle >= least.muscle
            && self.seen >= least.seen
            && self.smooth >= least.smooth
            && self.fat >= least.fat
    }

    fn of(
        polar: &Polar,
        rough: &Rough,
        smooth: &[f32],
        fat_over_air: impl Fn(&Vec3) -> f32,
    ) -> Option<Self> {
        let front: Vec<usize> = (0..polar.len())
            .filter(|&c| (polar.angle(c) - std::f64::consts::FRAC_PI_2).abs() < FRONT)
            .collect();
        let part = |is: &dyn Fn(usize) -> bool| {
            front.iter().filter(|&&c| is(c)).count() as f64 / front.len().max(1) as f64
        };
        let mut behind: Vec<f64> = front
            .iter()
            .filter(|&&c| rough.step[c] > SEEN)
            .map(|&c| f64::from(rough.behind[c]))
            .collect();
        let muscle = body::median(&mut behind)? as f32;
        let before_wall = |c: usize| polar.point(c, f64::from(smooth[c]) + BEFORE_WALL_MM);
        let mut fat: Vec<f64> =
            front.iter().map(|&c| f64::from(fat_over_air(&before_wall(c)))).collect();
        Some(Self {
            muscle,
            seen: part(&|c| rough.step[c] > SEEN),
            smooth: part(&|c| (rough.radii[c] - smooth[c]).abs() < Self::NEAR_MM),
            fat: body::median(&mut fat)?,
        })
    }
}
