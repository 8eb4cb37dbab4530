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
/// Nominal depth (mm) of the thorax' axis behind the front of the body on the mid-line.
const AXIS_DEPTH_MM: f64 = 110.0;

/// The body on the work grid.
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
    for k in 0..nk {
        for (start, step) in [(0, 1isize), (ni - 1, -1)] {
            let mut widest = ni;
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
                    widest = steps;
                }
            }
        }
    }
    let mask: Vec<bool> = air.iter().map(|a| !a).collect();
    let mask = largest_component(&mask, grid.shape)?;
    Some(Body { mask, axis, whole_back })
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
pub(super) fn neighbours(n: usize, [ni, nj, nk]: [usize; 3]) -> impl Iterator<Item = usize> {
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
pub(super) fn largest_component(mask: &[bool], shape: [usize; 3]) -> Option<Vec<bool>> {
    let mut component = vec![0u32; mask.len()];
    let (mut best, mut count) = ((0, 0), 0);
    let mut queue = Vec::new();
    for start in 0..mask.len() {
        if !mask[start] || component[start] != 0 {
            continue;
        }
        count += 1;
        component[start] = count;
        queue.push(start);
        let mut size = 0;
        while let Some(n) = queue.pop() {
            size += 1;
            for m in neighbours(n, shape) {
                if mask[m] && component[m] == 0 {
                    component[m] = count;
                    queue.push(m);
                }
            }
        }
        if size > best.0 {
            best = (size, count);
        }
    }
    (best.0 > 0).then(|| component.iter().map(|&c| c == best.1).collect())
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
