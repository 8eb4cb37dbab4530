//! Coil shading: how bright fat is at each place.

use super::body::quantile;
use super::filter;
use super::frame::{self, Frame};
use mammotwin_data::Vec3;
use mammotwin_data::volume::{Grid, Volume};

/// Spacing (mm) of the grid on which shading is estimated.
const SPACING_MM: f64 = 4.0;
/// Width (mm) of the smoothing that makes it a slowly varying field.
const SIGMA_MM: f64 = 16.0;
/// Radius (mm) in which some fat is expected around any place near the breasts.
const FAT_WITHIN_MM: f64 = 20.0;
/// Depth (mm) below the surface of the body to which fat is looked for.
const SHELL_MM: f64 = 32.0;
/// Voxels this much darker than fat at their place are not fat; pass by pass.
const FAT_FRACTION: [f32; 5] = [0.6, 0.6, 0.65, 0.7, 0.75];

/// Where fat is suppressed, it lies between these fractions of the field; pass by pass. The first field is a mean of
/// all tissue, so that the first passes take what is darker.
const SUPPRESSED_FRACTION: [[f32; 2]; 6] =
    [[0.4, 1.0], [0.4, 1.0], [0.5, 1.05], [0.6, 1.1], [0.65, 1.15], [0.65, 1.2]];
/// The same in further passes.
const FOLLOWING_FRACTION: [f32; 2] = [0.65, 1.3];

/// Fat far from the coils is at least this fraction of the brightest fat; fainter is noise.
const FAINTEST_FAT: f32 = 0.15;
/// The field is nowhere below this fraction of the brightest fat, so that noise far from the coils
/// does not become tissue.
const FAINTEST_FIELD: f32 = 0.15;

/// Brightness of fat.
pub(super) struct Field {
    /// ln(brightness of fat), on a coarse grid along the body's axes.
    pub log: Volume<f32>,
    /// Brightness of the brightest fat of the image.
    pub brightest: f32,
}

/// Natural logarithm of the brightness of fat, on a coarse grid along the body's axes.
///
/// Fat is what shading shows in: it is the brightest tissue without fat suppression and lies
/// everywhere around the breast. A first envelope (largest value nearby) says which voxels are
/// fat; a normalised convolution of their logarithms gives the field, which selects fat anew.
///
/// Only the shell of the body that is close to air counts: deep in the thorax there is hardly any
/// fat to measure, and the field of the shell is continued there.
///
/// `None` if the body has no tissue brighter than `tissue_from`.
pub(super) fn estimate(work: &Volume<f32>, body: &[bool], tissue_from: f32) -> Option<Field> {
    let coarse = shrink(work);
    let shape = coarse.grid.shape;
    let mut near_air = shrink(&Volume {
        grid: work.grid.clone(),
        values: body.iter().map(|&b| f32::from(u8::from(!b))).collect(),
    });
    let no_air: Vec<bool> = near_air.values.iter().map(|&air| air < 0.1).collect();
    filter::maximum(&mut near_air.values, shape, (SHELL_MM / SPACING_MM) as usize);
    let mut bright: Vec<f64> = (0..work.values.len())
        .filter(|&n| body[n] && work.values[n] > tissue_from)
        .map(|n| f64::from(work.values[n]))
        .collect();
    let brightest = quantile(&mut bright, 0.98)? as f32;
    let fat_from = (FAINTEST_FAT * brightest).max(tissue_from);
    let usable = |n: usize| no_air[n] && near_air.values[n] > 0.5 && coarse.values[n] > fat_from;
    let mut envelope = coarse.values.clone();
    filter::maximum(&mut envelope, shape, (FAT_WITHIN_MM / SPACING_MM) as usize);
    let first: Vec<f32> = envelope.iter().map(|v| v.max(tissue_from).ln()).collect();
    let passes = FAT_FRACTION.map(|darkest| [darkest, 1.0 / darkest]);
    let mut field = settled(&coarse, usable, first, &passes)?;
    let floor = (FAINTEST_FIELD * brightest).ln();
    field.iter_mut().for_each(|f| *f = f.max(floor));
    Some(Field { log: Volume { grid: coarse.grid, values: field }, brightest })
}

/// The same where fat is suppressed: the darkest tissue among voxels of the work grid that are `usable`, which
/// hold fat, gland and vessels but neither air nor lung. With `following` passes more the field climbs where fat gets
/// brighter within millimetres, near a coil, and a thin layer of muscle draws it up as well. `None` if there are none.
pub(super) fn estimate_suppressed(
    work: &Volume<f32>,
    usable: &[bool],
    following: usize,
) -> Option<Field> {
    let coarse = shrink(work);
    let all = wholly(work, &coarse, usable);
    let usable = |n: usize| all[n] > 0.0;
    let first = smooth_logs(&coarse.values, &all, coarse.grid.shape)?;
    let mut passes = SUPPRESSED_FRACTION.to_vec();
    passes.resize(passes.len() + following, FOLLOWING_FRACTION);
    let log = settled(&coarse, usable, first, &passes)?;
    let mut bright: Vec<f64> =
        (0..log.len()).filter(|&n| usable(n)).map(|n| f64::from(log[n].exp())).collect();
    let brightest = quantile(&mut bright, 0.98)? as f32;
    Some(Field { log: Volume { grid: coarse.grid, values: log }, brightest })
}

/// Brightness of what `is` air on the work grid, everywhere. `None` if there is none.
pub(super) fn estimate_air(work: &Volume<f32>, is: &[bool]) -> Option<Field> {
    let coarse = shrink(work);
    let values = smooth_logs(&coarse.values, &wholly(work, &coarse, is), coarse.grid.shape)?;
    Some(Field { log: Volume { grid: coarse.grid, values }, brightest: 0.0 })
}

/// 1 where a coarse voxel is not dark and all of it is what `is` says of the work grid, else 0.
fn wholly(work: &Volume<f32>, coarse: &Volume<f32>, is: &[bool]) -> Vec<f32> {
    let values = is.iter().map(|&is| f32::from(u8::from(is))).collect();
    let share = shrink(&Volume { grid: work.grid.clone(), values });
    let whole = share.values.iter().zip(&coarse.values);
    whole.map(|(share, value)| f32::from(u8::from(*share > 0.99 && *value > 0.0))).collect()
}

/// A field of fat from a `first` guess: pass by pass, fat are those `usable` voxels that lie between two fractions
/// of it.
fn settled(
    coarse: &Volume<f32>,
    usable: impl Fn(usize) -> bool,
    first: Vec<f32>,
    passes: &[[f32; 2]],
) -> Option<Vec<f32>> {
    let mut field = first;
    for [least, greatest] in passes {
        let is_fat = |n: usize| {
            let ratio = coarse.values[n] / field[n].exp();
            usable(n) && ratio > *least && ratio < *greatest
        };
        let weight: Vec<f32> = (0..field.len()).map(|n| f32::from(u8::from(is_fat(n)))).collect();
        field = smooth_logs(&coarse.values, &weight, coarse.grid.shape)?;
    }
    Some(field)
}

/// Normalised convolution of ln(values): wide, and narrow where there is enough fat.
fn smooth_logs(values: &[f32], weight: &[f32], shape: [usize; 3]) -> Option<Vec<f32>> {
    let total: f64 = weight.iter().map(|&w| f64::from(w)).sum();
    if total == 0.0 {
        return None;
    }
    let log = |n: usize| if weight[n] > 0.0 { values[n].ln() } else { 0.0 };
    let mean = (0..values.len()).map(|n| f64::from(log(n))).sum::<f64>() / total;
    let mut field = vec![mean as f32; values.len()];
    for sigma_mm in [4.0 * SIGMA_MM, 2.0 * SIGMA_MM, SIGMA_MM, 0.625 * SIGMA_MM] {
        // What little weight the wider field keeps decides only where there is no fat nearby.
        let mut sum: Vec<f32> =
            (0..values.len()).map(|n| weight[n] * (log(n) - field[n])).collect();
        let mut near = weight.to_vec();
        filter::gaussian_blur(&mut sum, shape, sigma_mm / SPACING_MM);
        filter::gaussian_blur(&mut near, shape, sigma_mm / SPACING_MM);
        for n in 0..field.len() {
            field[n] += sum[n] / (near[n] + 0.01);
        }
    }
    Some(field)
}

/// Mean over blocks, at about [`SPACING_MM`].
fn shrink(work: &Volume<f32>) -> Volume<f32> {
    let spacing = work.grid.spacing_mm()[0];
    let block = ((SPACING_MM / spacing).round() as usize).max(1);
    let shape = work.grid.shape.map(|n| n.div_ceil(block));
    let origin = work.grid.origin.add_scalar(0.5 * (block - 1) as f64 * spacing);
    let grid = Grid::aligned(shape, [block as f64 * spacing; 3], origin);
    let mut values = vec![0.0; grid.len()];
    for (n, value) in values.iter_mut().enumerate() {
        let low = grid.voxel(n).map(|v| v * block);
        let high = [0, 1, 2].map(|axis| (low[axis] + block).min(work.grid.shape[axis]));
        let mut count = 0;
        for k in low[2]..high[2] {
            for j in low[1]..high[1] {
                for i in low[0]..high[0] {
                    *value += work.at([i, j, k]);
                    count += 1;
                }
            }
        }
        *value /= count as f32;
    }
    Volume { grid, values }
}

impl Field {
    /// The same brightness everywhere; `low` is any corner (mm, body's axes).
    pub(super) fn flat(fat: f32, low: &Vec3) -> Self {
        let grid = Grid::aligned([2; 3], [SPACING_MM; 3], *low);
        let values = vec![fat.ln(); grid.len()];
        Self { log: Volume { grid, values }, brightest: fat }
    }

    /// Brightness of fat at a point (mm, body's axes).
    pub(super) fn fat(&self, p: &Vec3) -> f32 {
        let grid = &self.log.grid;
        let voxel = (p - grid.origin) / grid.axes[(0, 0)];
        frame::sample_clamped(&self.log, &voxel).exp()
    }
}

/// The image in units of fat: 1 is fat at its place.
pub(super) struct Shaded<'a> {
    pub image: &'a Volume<f32>,
    pub frame: &'a Frame,
    pub field: &'a Field,
}

impl Shaded<'_> {
    /// Brightness in units of fat at a point (mm, body's axes); `None` outside of the image.
    pub(super) fn at(&self, p: &Vec3) -> Option<f32> {
        let value = frame::sample(self.image, &self.frame.voxel_from_body.apply(p))?;
        Some(value / self.field.fat(p))
    }
}
