//! Shapes of digital volunteers as labels, and how far a place is from them.

use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Side, Tissue},
    mesh::{Patch, TetMesh},
    volume::{Grid, Volume},
};
use mammotwin_stages::volunteer::{Preset, Torso};
use rayon::prelude::*;

/// The stress-free person of a seed.
pub fn torso(preset: &str, seed: u64) -> Torso {
    Torso::new(Preset::named(preset).unwrap().person(seed), seed)
}

/// Labels at the voxels' centres; all of a breast is fat.
pub fn labels(torso: &Torso, grid: &Grid) -> LabelMap {
    let tissue = |n: usize| {
        let p = grid.center(grid.voxel(n));
        match torso.nearer(&p).side {
            _ if torso.rib_cage(&p) <= 0.0 => Tissue::Thorax,
            _ if torso.chest_wall(&p) <= 0.0 => Tissue::PectoralMuscle,
            _ if torso.skin(&p) > 0.0 => Tissue::Background,
            _ if !torso.limits.contain(&p) => Tissue::Other,
            Side::Right => Tissue::AdiposeRight,
            Side::Left => Tissue::AdiposeLeft,
        }
    };
    Volume { values: (0..grid.len()).into_par_iter().map(tissue).collect(), grid: grid.clone() }
}

/// The field of view of her preset, to some air before the nipples.
pub fn field_of_view(torso: &Torso, voxel_mm: [f64; 3]) -> Grid {
    let image = &torso.person.image;
    let front = torso.breasts.iter().map(|breast| breast.apex.y).fold(f64::MIN, f64::max);
    let high = [image.high_mm[0], front + image.front_mm, image.high_mm[2]];
    covering(image.low_mm.into(), high.into(), voxel_mm)
}

/// A box around the right breast that the chest leaves on all sides but the front.
pub fn around_right_breast(torso: &Torso, voxel_mm: [f64; 3]) -> Grid {
    let (breast, frame) = (&torso.person.breast, &torso.breasts[0]);
    let half = Vec3::new(breast.base_x_mm, 0.0, breast.base_z_mm).add_scalar(20.0);
    // Part of a voxel aside: not on a plane of symmetry.
    let aside = Vec3::new(0.31, 0.17, 0.43).component_mul(&Vec3::from(voxel_mm));
    let low = frame.base - half - Vec3::y() * 30.0 + aside;
    let high = Vec3::new(frame.base.x + half.x, frame.apex.y + 25.0, half.z);
    covering(low, high, voxel_mm)
}

fn covering(low: Vec3, high: Vec3, voxel_mm: [f64; 3]) -> Grid {
    let count = |axis: usize| ((high[axis] - low[axis]) / voxel_mm[axis]).ceil() as usize + 1;
    Grid::aligned([count(0), count(1), count(2)], voxel_mm, low)
}

/// The same image as posterior-inferior-right (PIR): -y, -z, +x.
pub fn as_pir<T: Copy>(image: &Volume<T>) -> Volume<T> {
    let old = &image.grid;
    let [ni, nj, nk] = old.shape;
    let back = |[a, b, c]: [usize; 3]| [c, nj - 1 - a, nk - 1 - b];
    let mut grid = old.clone();
    grid.shape = [nj, nk, ni];
    grid.origin = old.center(back([0; 3]));
    grid.axes.set_column(0, &-old.axes.column(1));
    grid.axes.set_column(1, &-old.axes.column(2));
    grid.axes.set_column(2, &old.axes.column(0));
    let values = (0..grid.len()).map(|n| image.at(back(grid.voxel(n)))).collect();
    Volume { grid, values }
}

fn gradient(function: impl Fn(&Vec3) -> f64, p: &Vec3) -> Vec3 {
    const STEP_MM: f64 = 1e-3;
    Vec3::from_fn(|axis, _| {
        let mut step = Vec3::zeros();
        step[axis] = STEP_MM;
        (function(&(p + step)) - function(&(p - step))) / (2.0 * STEP_MM)
    })
}

/// Distance (mm) of a place from a zero level near it, positive on the positive side, and the level's
/// normal there: Newton's steps to the level alternate with steps back to below the place.
pub fn from_zero(function: impl Fn(&Vec3) -> f64, p: &Vec3) -> (f64, Vec3) {
    let mut foot = *p;
    let mut normal = Vec3::zeros();
    for _ in 0..12 {
        let slope = gradient(&function, &foot);
        normal = slope.normalize();
        let on = foot - slope * (function(&foot) / slope.norm_squared());
        let along = (p - on) - normal * normal.dot(&(p - on));
        foot = on + 0.7 * along;
    }
    ((p - foot).dot(&normal), normal)
}

/// Distances (mm) of a patch's faces from a zero level, at ten places of each face.
pub fn faces_off(mesh: &TetMesh, patch: Patch, level: &(impl Fn(&Vec3) -> f64 + Sync)) -> Vec<f64> {
    let thirds = (0..4).flat_map(|i| (0..4 - i).map(move |j| [i, j].map(|n| f64::from(n) / 3.0)));
    let weights: Vec<[f64; 2]> = thirds.collect();
    let off = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|n| mesh.points[n as usize]);
        let at = |[u, v]: &[f64; 2]| a * (1.0 - u - v) + b * *u + c * *v;
        weights.iter().map(|weight| from_zero(level, &at(weight)).0).collect::<Vec<_>>()
    };
    mesh.patch(patch).par_iter().flat_map_iter(off).collect()
}

/// What 95 % of the sizes do not exceed, and the largest.
pub fn p95_and_max(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let mut sizes: Vec<f64> = values.into_iter().map(f64::abs).collect();
    sizes.sort_by(f64::total_cmp);
    [sizes[sizes.len() * 95 / 100], sizes[sizes.len() - 1]]
}
