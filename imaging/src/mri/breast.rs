//! What is measured of a breast in labels and surfaces: whose it is, its volumes, its nipple.

use super::segment::neighbours;
use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Side, Tissue},
    surface::TriMesh,
};

/// The breast that each voxel belongs to. Labels of fat and gland say it; skin, nipple and areola
/// belong to the breast that they lie on, by the shortest way through them. `None` for all else.
pub fn sides(labels: &LabelMap) -> Vec<Option<Side>> {
    let mut side: Vec<Option<Side>> = labels.values.iter().map(|tissue| tissue.side()).collect();
    let mut border: Vec<usize> = (0..side.len()).filter(|&n| side[n].is_some()).collect();
    while !border.is_empty() {
        let mut next = Vec::new();
        for n in border {
            for m in neighbours(n, labels.grid.shape) {
                if side[m].is_none() && covers(labels.values[m]) {
                    side[m] = side[n];
                    next.push(m);
                }
            }
        }
        border = next;
    }
    side
}

fn covers(tissue: Tissue) -> bool {
    matches!(tissue, Tissue::Skin | Tissue::NippleAreola)
}

/// Volumes of a breast (mm³).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Volumes {
    /// Adipose tissue.
    pub fat_mm3: f64,
    /// Fibroglandular tissue.
    pub gland_mm3: f64,
    /// Skin, nipple and areola.
    pub cover_mm3: f64,
}

impl Volumes {
    /// Volumes of the breast of a side; `sides` as [`sides`] gives them.
    pub fn of(labels: &LabelMap, sides: &[Option<Side>], side: Side) -> Self {
        let mut counts = [0usize; 3];
        for (tissue, here) in labels.values.iter().zip(sides) {
            if *here == Some(side) {
                counts[if covers(*tissue) { 2 } else { usize::from(tissue.is_gland()) }] += 1;
            }
        }
        let [fat_mm3, gland_mm3, cover_mm3] = counts.map(|n| n as f64 * labels.grid.voxel_mm3());
        Self { fat_mm3, gland_mm3, cover_mm3 }
    }

    /// All of the breast.
    pub fn total_mm3(&self) -> f64 {
        self.fat_mm3 + self.gland_mm3 + self.cover_mm3
    }

    /// Share of gland in the breast without its skin: the volumetric breast density. `None` without
    /// any of both.
    pub fn gland_share(&self) -> Option<f64> {
        let inside = self.fat_mm3 + self.gland_mm3;
        (inside > 0.0).then(|| self.gland_mm3 / inside)
    }
}

/// Standard deviation (mm) of the smoothing that a nipple stands out of.
const SMOOTH_MM: f64 = 8.0;
/// Height (mm) from which a bump is a nipple, over what the roundness of the breast's front makes.
const LEAST_BUMP_MM: f64 = 1.5;
/// A nipple lies at least this part of the breast's protrusion in front of the chest wall.
const LEAST_HEIGHT: f64 = 0.5;

/// How far each `wanted` vertex (mm) stands out of the smoothed surface, along its normal; 0 of others.
pub fn bumps(surface: &TriMesh, wanted: &[bool]) -> Vec<f64> {
    let mut edges = Vec::new();
    for corners in &surface.triangles {
        for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|pair| pair.map(|n| corners[n] as usize)) {
            if wanted[a] && wanted[b] {
                edges.push([a, b]);
            }
        }
    }
    let square = |[a, b]: &[usize; 2]| (surface.points[*a] - surface.points[*b]).norm_squared();
    let mean_square = edges.iter().map(square).sum::<f64>() / edges.len().max(1) as f64;
    // Half-way to the mean of the neighbours: a quarter of an edge's square more variance each time.
    let rounds = (SMOOTH_MM * SMOOTH_MM / (0.25 * mean_square).max(1e-3)).ceil() as usize;
    let mut points = surface.points.clone();
    let mut sums = vec![(Vec3::zeros(), 0.0); points.len()];
    for _ in 0..rounds {
        sums.fill((Vec3::zeros(), 0.0));
        for &[a, b] in &edges {
            // An edge is met from both of its triangles, or once at the rim: both ends alike.
            sums[a].0 += points[b];
            sums[b].0 += points[a];
            sums[a].1 += 1.0;
            sums[b].1 += 1.0;
        }
        for (p, (sum, count)) in points.iter_mut().zip(&sums).filter(|(_, sum)| sum.1 > 0.0) {
            *p = 0.5 * *p + 0.5 / count * sum;
        }
    }
    let normals = surface.vertex_normals();
    let height = |n: usize| {
        if wanted[n] { (surface.points[n] - points[n]).dot(&normals[n]) } else { 0.0 }
    };
    (0..points.len()).map(height).collect()
}

/// The vertex of a nipple: the greatest of the `bumps` in the front of the breast, `wall_mm` being each
/// vertex's distance to the chest wall. `None` when nothing stands out.
pub fn nipple(bumps: &[f64], wanted: &[bool], wall_mm: &[f64]) -> Option<usize> {
    let wanted = || (0..wanted.len()).filter(|&n| wanted[n]);
    let farthest = wanted().map(|n| wall_mm[n]).fold(0.0, f64::max);
    let mut front: Vec<usize> =
        wanted().filter(|&n| wall_mm[n] >= LEAST_HEIGHT * farthest).collect();
    front.sort_unstable_by(|&a, &b| bumps[a].total_cmp(&bumps[b]));
    let (best, middle) = (*front.last()?, front[front.len() / 2]);
    (bumps[best] - bumps[middle] >= LEAST_BUMP_MM).then_some(best)
}
