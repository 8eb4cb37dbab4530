//! The body against the air around it, and where its chest roughly is.

use super::filter;
use mammotwin_data::volume::{Grid, Volume};

/// Tissue is brighter than this fraction of fat at its place.
const AIR_BELOW: f32 = 0.2;
/// Averaged over neighbours, tissue is brighter than this fraction of fat at its place ...
const FAINT: f32 = 0.12;
/// ... and than this fraction of the brightest fat, or else it is noise.
const NOISE: f32 = 0.065;

/// The brightness that parts a single voxel of tissue from air; arguments as in [`faintest`].
pub(super) fn air_below(fat: f32, brightest: f32) -> f32 {
    // One voxel carries more noise than a mean of neighbours.
    AIR_BELOW.max(1.5 * NOISE * brightest / fat)
}

/// Brightness of the faintest tissue, where fat has the brightness `fat` and the brightest fat of
/// the image has `brightest`; in units of fat.
pub(super) fn faintest(fat: f32, brightest: f32) -> f32 {
    FAINT.max(NOISE * brightest / fat)
}
/// The flank of one slice lies at most so much further inside (mm) than that of most.
const FLANK_MM: f64 = 30.0;
/// Nominal depth (mm) of the thorax' axis behind the front of the body on the mid-line.
const AXIS_DEPTH_MM: f64 = 110.0;

/// The body on the work grid.
#[derive(Debug, Clone)]
pub(super) struct Body {
    /// Whether a voxel is in the body, lungs and other dark hollows included.
    pub mask: Vec<bool>,
    /// A line along z inside the thorax: x and y in the body's axes (mm).
    pub axis: [f64; 2],
    /// Whether the image shows the back of the body.
    pub whole_back: bool,
}

/// Separates body and air: tissue is brighter than `tissue_from` of its voxel. `None` if there is no body.
///
/// Slice by slice, air is what a path from the front or the sides reaches in front of the axis, and what a
/// straight line from the sides reaches behind it. Lungs that the rear border of the image cuts
/// open do not become air, nor does a back that is too far from the coils to be seen.
pub(super) fn find(
    brightness: &Volume<f32>,
    inside: &[bool],
    tissue_from: impl Fn(usize) -> f32,
) -> Option<Body> {
    let grid = &brightness.grid;
    let [ni, nj, nk] = grid.shape;
    let mut smooth = brightness.values.clone();
    filter::box_blur(&mut smooth, grid.shape, [1; 3]);
    let tissue: Vec<bool> =
        (0..grid.len()).map(|n| inside[n] && smooth[n] > tissue_from(n)).collect();
    let tissue = largest_component(&tissue, grid.shape)?;
    let axis = chest_axis(&tissue, brightness)?;

    let row = (axis[1] - grid.origin.y) / grid.axes[(1, 1)];
    let axis_j = row.round().clamp(0.0, nj as f64 - 1.0) as usize;
    let mut air = vec![false; grid.len()];
    let mut queue = Vec::new();
    for k in 0..nk {
        queue.extend((0..ni).map(|i| grid.index([i, nj - 1, k])));
        for j in axis_j..nj {
            queue.extend([grid.index([0, j, k]), grid.index([ni - 1, j, k])]);
        }
    }
    queue.retain(|&n| !tissue[n]);
    queue.iter().for_each(|&n| air[n] = true);
    while let Some(n) = queue.pop() {
        for m in neighbours(n, grid.shape) {
            let [_, j, k] = grid.voxel(m);
            if !air[m] && !tissue[m] && j >= axis_j && k == grid.voxel(n)[2] {
                air[m] = true;
                queue.push(m);
            }
        }
    }
    let whole_back = sees_back(&tissue, grid, axis_j);
    let beside_axis = air_beside(&tissue, grid, axis_j);
    for k in 0..nk {
        for (start, step) in [(0, 1isize), (ni - 1, -1)] {
            // Faint tissue far from the coils lets a line through, but flanks are alike in all
            // slices.
            let mut widest =
                beside_axis[usize::from(step < 0)] + (FLANK_MM / grid.axes[(0, 0)]) as usize;
            for j in (0..=axis_j).rev() {
                // Through a border of the image that is oblique to the body, or without a back
                // in sight, no line gets further than beside the axis.
                let oblique = !inside[grid.index([start.wrapping_add_signed(3 * step), j, k])];
                let reach = if oblique || !whole_back { widest } else { ni };
                let mut steps = 0;
                let mut i = start;
                while steps < reach && i < ni && !tissue[grid.index([i, j, k])] {
                    air[grid.index([i, j, k])] = true;
                    steps += 1;
                    i = i.wrapping_add_signed(step);
                }
                if j == axis_j {
                    widest = widest.min(steps);
                }
            }
        }
    }
    let mask: Vec<bool> = air.iter().map(|a| !a).collect();
    let mask = largest_component(&mask, grid.shape)?;
    Some(Body { mask, axis, whole_back })
}

/// Median over the slices of the number of voxels of air on the line from each side, at the height
/// of the axis.
fn air_beside(tissue: &[bool], grid: &Grid, axis_j: usize) -> [usize; 2] {
    let [ni, _, nk] = grid.shape;
    [false, true].map(|from_end| {
        let mut steps: Vec<f64> = (0..nk)
            .map(|k| {
                let row = &tissue[grid.index([0, axis_j, k])..][..ni];
                let air = if from_end {
                    row.iter().rev().position(|t| *t)
                } else {
                    row.iter().position(|t| *t)
                };
                air.unwrap_or(ni) as f64
            })
            .collect();
        median(&mut steps).unwrap_or(0.0) as usize
    })
}

/// Whether most slices show tissue on the mid-line far behind the axis: the back of the body.
fn sees_back(tissue: &[bool], grid: &Grid, axis_j: usize) -> bool {
    const FAR_MM: f64 = 50.0;
    let [ni, _, nk] = grid.shape;
    let spacing = grid.axes[(0, 0)];
    let far = axis_j.saturating_sub((FAR_MM / spacing) as usize);
    let near_middle = ni / 2 - ni / 10..ni / 2 + ni / 10 + 1;
    let seen = |k: &usize| {
        let of_row =
            |j: usize| near_middle.clone().filter(|&i| tissue[grid.index([i, j, *k])]).count();
        (0..far).any(|j| of_row(j) * 2 > near_middle.len())
    };
    2 * (0..nk).filter(seen).count() > nk
}

/// Indices of the up to six face neighbours.
pub(in crate::mri) fn neighbours(
    n: usize,
    [ni, nj, nk]: [usize; 3],
) -> impl Iterator<Item = usize> {
    let (i, j, k) = (n % ni, n / ni % nj, n / (ni * nj));
    [
        (i > 0).then(|| n - 1),
        (i + 1 < ni).then(|| n + 1),
        (j > 0).then(|| n - ni),
        (j + 1 < nj).then(|| n + ni),
        (k > 0).then(|| n - ni * nj),
        (k + 1 < nk).then(|| n + ni * nj),
    ]
    .into_iter()
    .flatten()
}

/// The largest set of face-connected voxels. `None` if there is no voxel.
///
/// Runs along i are joined where they touch (Rosenfeld & Pfaltz 1966, doi:10.1145/321356.321357).
pub(super) fn largest_component(mask: &[bool], [ni, nj, nk]: [usize; 3]) -> Option<Vec<bool>> {
    // Runs of all rows, and the first run of each row.
    let (mut runs, mut first) = (Vec::new(), Vec::with_capacity(nj * nk + 1));
    for row in mask.chunks(ni) {
        first.push(runs.len());
        let mut end = 0;
        while let Some(start) = row[end..].iter().position(|inside| *inside).map(|n| end + n) {
            end = row[start..].iter().position(|inside| !inside).map_or(ni, |n| start + n);
            runs.push([start, end]);
        }
    }
    first.push(runs.len());
    let mut parent: Vec<usize> = (0..runs.len()).collect();
    let root = |parent: &mut Vec<usize>, mut run: usize| {
        while parent[run] != run {
            parent[run] = parent[parent[run]];
            run = parent[run];
        }
        run
    };
    for row in 0..nj * nk {
        let before = [(row % nj > 0).then(|| row - 1), row.checked_sub(nj)];
        for other in before.into_iter().flatten() {
            let (mut a, mut b) = (first[row], first[other]);
            while a < first[row + 1] && b < first[other + 1] {
                if runs[a][0] < runs[b][1] && runs[b][0] < runs[a][1] {
                    let (p, q) = (root(&mut parent, a), root(&mut parent, b));
                    parent[p.max(q)] = p.min(q);
                }
                if runs[a][1] < runs[b][1] { a += 1 } else { b += 1 }
            }
        }
    }
    let mut size = vec![0; runs.len()];
    let roots: Vec<usize> = (0..runs.len()).map(|run| root(&mut parent, run)).collect();
    for (run, &root) in roots.iter().enumerate() {
        size[root] += runs[run][1] - runs[run][0];
    }
    // Of equally large ones the first.
    let best = (0..runs.len()).rev().max_by_key(|&run| size[run])?;
    let mut largest = vec![false; mask.len()];
    for row in 0..nj * nk {
        for run in (first[row]..first[row + 1]).filter(|&run| roots[run] == best) {
            largest[row * ni + runs[run][0]..row * ni + runs[run][1]].fill(true);
        }
    }
    Some(largest)
}

/// The voxels of `mask` that a path through it joins to one of the `seeds`.
pub(super) fn reached(mask: &[bool], shape: [usize; 3], seeds: &[usize]) -> Vec<bool> {
    let mut reached = vec![false; mask.len()];
    let mut queue: Vec<usize> = seeds.iter().copied().filter(|&n| mask[n]).collect();
    while let Some(n) = queue.pop() {
        if !std::mem::replace(&mut reached[n], true) {
            queue.extend(neighbours(n, shape).filter(|&m| mask[m] && !reached[m]));
        }
    }
    reached
}

/// Voxels of `air` that no path of air joins to the border of the grid, ascending.
pub(super) fn enclosed(air: &[bool], [ni, nj, nk]: [usize; 3]) -> Vec<usize> {
    // A layer of air around the grid joins whatever reaches its border.
    let padded = [ni + 2, nj + 2, nk + 2];
    let place = |n: usize| {
        let (i, j, k) = (n % ni, n / ni % nj, n / (ni * nj));
        ((k + 1) * padded[1] + j + 1) * padded[0] + i + 1
    };
    let mut around = vec![true; padded.iter().product()];
    for n in 0..air.len() {
        around[place(n)] = air[n];
    }
    let Some(outside) = largest_component(&around, padded) else { return Vec::new() };
    (0..air.len()).filter(|&n| air[n] && !outside[place(n)]).collect()
}

/// Mid-line between the sides, a nominal depth behind the front of the body there.
fn chest_axis(tissue: &[bool], brightness: &Volume<f32>) -> Option<[f64; 2]> {
    let grid = &brightness.grid;
    let [ni, nj, nk] = grid.shape;
    let spacing = grid.axes[(0, 0)];
    let mut middles = Vec::new();
    for k in 0..nk {
        for j in 0..nj {
            let row = &tissue[grid.index([0, j, k])..][..ni];
            if let (Some(low), Some(high)) =
                (row.iter().position(|t| *t), row.iter().rposition(|t| *t))
            {
                middles.push(0.5 * (low + high) as f64);
            }
        }
    }
    let middle = median(&mut middles)?;
    let near = (10.0 / spacing) as usize;
    let columns = (middle as usize).saturating_sub(near)..(middle as usize + near + 1).min(ni);
    let mut fronts = Vec::new();
    for k in 0..nk {
        for i in columns.clone() {
            let front = (0..nj).rev().find(|&j| tissue[grid.index([i, j, k])]);
            fronts.extend(front.map(|j| j as f64));
        }
    }
    let front = grid.origin.y + spacing * median(&mut fronts)?;
    let rear_most = grid.origin.y + 20.0;
    Some([grid.origin.x + spacing * middle, (front - AXIS_DEPTH_MM).max(rear_most)])
}

/// Median. `None` of nothing.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Value below which a `fraction` (0..=1) of the values lies. `None` of nothing.
pub(super) fn quantile(values: &mut [f64], fraction: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = (fraction * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(at.min(last), f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Sizes of all parts by flooding.
    fn largest_by_flooding(mask: &[bool], shape: [usize; 3]) -> usize {
        let mut seen: Vec<bool> = mask.iter().map(|inside| !inside).collect();
        let mut best = 0;
        for start in 0..mask.len() {
            let mut queue = vec![start];
            let mut size = 0;
            while let Some(n) = queue.pop() {
                if !std::mem::replace(&mut seen[n], true) {
                    size += 1;
                    queue.extend(neighbours(n, shape));
                }
            }
            best = best.max(size);
        }
        best
    }

    #[test]
    fn the_largest_component_is_that_of_flooding() {
        let shape = [9, 7, 8];
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for density in [0.2, 0.3, 0.4, 0.6] {
            let mask: Vec<bool> = (0..9 * 7 * 8).map(|_| random.random_bool(density)).collect();
            let found = largest_component(&mask, shape).unwrap();
            let size = found.iter().filter(|inside| **inside).count();
            assert_eq!(size, largest_by_flooding(&mask, shape));
            assert_eq!(size, largest_by_flooding(&found, shape), "in one piece");
            assert!(found.iter().zip(&mask).all(|(found, mask)| !found || *mask));
        }
        assert_eq!(largest_component(&[false; 8], [2; 3]), None);
    }
}
