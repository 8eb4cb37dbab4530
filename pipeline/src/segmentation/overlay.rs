//! Cuts through an image with the outlines of labels, put together to one picture.

use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Side, Tissue},
    volume::Volume,
};
use mammotwin_stages::report::{
    raster::Raster,
    slice::{Plane, slice},
};

const MM_PER_PIXEL: f64 = 1.0;
/// Pixels between the cuts.
const GAP: usize = 6;

/// How far (mm) behind its tip a breast is cut, and how much of its front counts as the tip.
const BEHIND_TIP_MM: f64 = 30.0;
const TIP_MM: f64 = 12.0;

/// Where to cut a breast (mm): behind the middle of what lies farthest to the front; `None` without a breast.
pub fn behind_tip(labels: &LabelMap, side: Side) -> Option<Vec3> {
    let of_breast = || {
        let of_side = |tissue: Tissue| tissue.side() == Some(side) && tissue.is_breast();
        let voxels = labels.values.iter().enumerate().filter(move |(_, tissue)| of_side(**tissue));
        voxels.map(|(n, _)| labels.grid.center(labels.grid.voxel(n)))
    };
    let front = of_breast().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
    let tip = of_breast().filter(|p| p.y > front - TIP_MM);
    let (sum, count) = tip.fold((Vec3::zeros(), 0.0), |(sum, count), p| (sum + p, count + 1.0));
    (count > 0.0).then(|| Vec3::new(sum.x / count, front - BEHIND_TIP_MM, sum.z / count))
}

/// A row of axial, coronal and sagittal cuts for each of `rows`: labels, and the point (mm) that is cut.
pub fn overlay(image: &Volume<f32>, rows: &[(&LabelMap, Vec3)]) -> Raster {
    let rows: Vec<[Raster; 3]> = rows
        .iter()
        .map(|(labels, point)| {
            Plane::ALL.map(|plane| slice(image, Some(labels), plane, point, MM_PER_PIXEL).picture)
        })
        .collect();
    let width = |row: &[Raster; 3]| row.iter().map(|cut| cut.width + GAP).sum::<usize>();
    let height = |row: &[Raster; 3]| row.iter().map(|cut| cut.height + GAP).max().unwrap_or(0);
    let (wide, high) =
        (rows.iter().map(width).max().unwrap_or(0), rows.iter().map(height).sum::<usize>());
    let mut all = Raster::filled(wide, high, [0; 3]);
    let mut top = 0;
    for row in &rows {
        let mut left = 0;
        for cut in row {
            for y in 0..cut.height {
                let at = (top + y) * wide + left;
                let from = &cut.pixels[y * cut.width..(y + 1) * cut.width];
                all.pixels[at..at + cut.width].copy_from_slice(from);
            }
            left += cut.width + GAP;
        }
        top += height(row);
    }
    all
}
