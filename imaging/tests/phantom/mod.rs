//! An analytic chest: its wall, its tissues and the shading of its images are known.

use mammotwin_data::Vec3;
use mammotwin_data::labels::Tissue;
use mammotwin_data::rigid::RigidTransform;
use mammotwin_data::volume::{Grid, Volume};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;

/// Half axes (mm) of the front of the muscle, an elliptic cylinder along z.
const WALL: [f64; 2] = [158.0, 113.0];
/// Fat and skin beside the breasts (mm).
const LAYER: f64 = 10.0;
/// Half axes (mm) of a breast along the wall, along z, and its height.
const BREAST: [f64; 3] = [60.0, 55.0, 45.0];
/// x (mm) of the breasts' centres.
const CENTER_X: f64 = 78.0;
/// Thickness (mm) of the skin.
const SKIN_MM: f64 = 2.0;
/// Limits of the truth in z (mm): 12 mm beyond where the breasts protrude by 3 mm.
const LIMITS_Z: [f64; 2] = [-75.0, 75.0];

/// Where gland lies in the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gland {
    /// Under the nipple, with fat behind.
    Retracted,
    /// Down to the muscle.
    TouchesMuscle,
}

/// How bright the tissues are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contrast {
    /// T2 weighted: fat is bright.
    BrightFat,
    /// The same, but gland is as dark as muscle.
    DarkGland,
    /// Fat suppressed: fat is darker than all but air and lung.
    FatSuppressed,
    /// The same with fat of so many per cent of the brightest tissue; muscle has 45.
    FatAt(u8),
}

/// Signed distance (mm, first order) to the front of the muscle; positive outside.
pub fn from_wall(p: &Vec3) -> f64 {
    let f = (p.x / WALL[0]).hypot(p.y / WALL[1]);
    let gradient = (p.x / WALL[0].powi(2)).hypot(p.y / WALL[1].powi(2)) / f;
    (f - 1.0) / gradient
}

/// Scaled distance from the centre of the breast on the side of x; 1 on its surface.
fn in_breast(p: &Vec3, size: [f64; 3]) -> f64 {
    let x = CENTER_X * p.x.signum();
    let y = WALL[1] * (1.0 - (x / WALL[0]).powi(2)).sqrt();
    let normal = Vec3::new(x / WALL[0].powi(2), y / WALL[1].powi(2), 0.0).normalize();
    let d = p - Vec3::new(x, y, 0.0);
    let (out, along) = (d.dot(&normal), d.dot(&normal.cross(&Vec3::z())));
    ((along / size[0]).powi(2) + (d.z / size[1]).powi(2) + (out / size[2]).powi(2)).sqrt()
}

/// Approximate depth (mm) under the skin; negative in air.
fn depth(p: &Vec3) -> f64 {
    let breast = (1.0 - in_breast(p, BREAST.map(|s| s + LAYER))) * (BREAST[2] + LAYER);
    breast.max(LAYER - from_wall(p))
}

/// What is at a place.
pub fn tissue(p: &Vec3, gland: Gland) -> Tissue {
    let (wall, depth) = (from_wall(p), depth(p));
    let right = p.x >= 0.0;
    if depth < 0.0 {
        Tissue::Background
    } else if wall < 0.0 {
        if wall > -9.0 && p.y > 0.0 { Tissue::PectoralMuscle } else { Tissue::Thorax }
    } else if p.y <= 0.0 || p.z < LIMITS_Z[0] || p.z > LIMITS_Z[1] {
        Tissue::Other
    } else if depth < SKIN_MM {
        Tissue::Skin
    } else {
        let from = if gland == Gland::TouchesMuscle { 0.0 } else { 12.0 };
        let lobes = (0.35 * p.x).sin() + (0.3 * p.z).sin() > -0.6;
        let is_gland = in_breast(p, [30.0, 28.0, 42.0]) < 1.0 && wall >= from && lobes;
        match (is_gland, right) {
            (false, true) => Tissue::AdiposeRight,
            (false, false) => Tissue::AdiposeLeft,
            (true, true) => Tissue::FibroglandularRight,
            (true, false) => Tissue::FibroglandularLeft,
        }
    }
}

/// Signal; 1 is the brightest tissue.
fn signal(p: &Vec3, gland: Gland, contrast: Contrast) -> f64 {
    let [fat, glandular, skin, muscle] = match contrast {
        Contrast::BrightFat => [1.0, 0.42, 0.36, 0.17],
        Contrast::DarkGland => [1.0, 0.2, 0.36, 0.17],
        Contrast::FatSuppressed => [0.18, 1.0, 0.55, 0.45],
        Contrast::FatAt(percent) => [f64::from(percent) / 100.0, 1.0, 0.55, 0.45],
    };
    match tissue(p, gland) {
        Tissue::Background => 0.0,
        Tissue::Skin => skin,
        Tissue::PectoralMuscle => muscle,
        Tissue::FibroglandularRight | Tissue::FibroglandularLeft => glandular,
        Tissue::Other if depth(p) < SKIN_MM => skin,
        Tissue::Thorax => thorax(p, fat, muscle),
        _ => fat,
    }
}

/// Chest wall muscle with fat behind and ribs in it, then lungs.
fn thorax(p: &Vec3, fat: f64, muscle: f64) -> f64 {
    let behind = -from_wall(p);
    let rib = (p.z / 24.0).fract().abs() < 0.4;
    match behind {
        b if b < 9.0 => muscle,
        b if b < 12.0 => 0.8 * fat,
        b if b < 14.0 => 0.1,
        b if b < 19.0 && rib => 0.7 * fat,
        b if b < 21.0 => 0.1,
        _ => 0.04,
    }
}

/// Image value of the brightest tissue under the coils, in the chest's own axes: falls off to the rear.
pub fn shading(p: &Vec3) -> f64 {
    700.0 * (0.3 + 0.9 / (1.0 + ((p.y - 130.0) / 90.0).powi(2)) + 0.001 * p.x)
}

/// [`picture_of`] in bright fat.
pub fn picture(
    spacing_mm: f64,
    gland: Gland,
    pose: &RigidTransform,
) -> (Volume<f32>, Volume<Tissue>) {
    picture_of(Contrast::BrightFat, spacing_mm, gland, pose)
}

/// Image of the chest after `pose`, with shading that falls off to the rear, and Rician noise.
/// With the tissue at each voxel's centre.
pub fn picture_of(
    contrast: Contrast,
    spacing_mm: f64,
    gland: Gland,
    pose: &RigidTransform,
) -> (Volume<f32>, Volume<Tissue>) {
    let low = Vec3::new(-186.0, -130.0, -105.0);
    let high = Vec3::new(186.0, 190.0, 105.0);
    let shape = [0, 1, 2].map(|a| ((high[a] - low[a]) / spacing_mm) as usize);
    let grid = Grid::aligned(shape, [spacing_mm; 3], low);
    let back = pose.inverse();
    let sample = |n: usize| {
        let center = back.point(&grid.center(grid.voxel(n)));
        let mut sum = 0.0;
        for corner in 0..8 {
            let side = |axis: usize| ((corner >> axis & 1) as f64 - 0.5) * 0.5 * spacing_mm;
            sum += signal(&(center + Vec3::new(side(0), side(1), side(2))), gland, contrast) / 8.0;
        }
        (tissue(&center, gland), shading(&center) * sum)
    };
    let samples: Vec<(Tissue, f64)> = (0..grid.len()).into_par_iter().map(sample).collect();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let noise = Normal::new(0.0, 12.0).expect("a positive deviation");
    let magnitude = |real: f64, random: &mut _| {
        (real + noise.sample(random)).hypot(noise.sample(random)) as f32
    };
    let values = samples.iter().map(|s| magnitude(s.1, &mut random)).collect();
    let labels = samples.iter().map(|s| s.0).collect();
    (Volume { grid: grid.clone(), values }, Volume { grid, values: labels })
}

/// Dice of a part of two label maps.
pub fn dice(a: &Volume<Tissue>, b: &Volume<Tissue>, of: impl Fn(Tissue) -> bool) -> f64 {
    let (mut both, mut sum) = (0.0, 0.0);
    for (&a, &b) in a.values.iter().zip(&b.values) {
        both += f64::from(u8::from(of(a) && of(b)));
        sum += f64::from(u8::from(of(a))) + f64::from(u8::from(of(b)));
    }
    2.0 * both / sum
}

pub fn is_gland(tissue: Tissue) -> bool {
    matches!(tissue, Tissue::FibroglandularRight | Tissue::FibroglandularLeft)
}
