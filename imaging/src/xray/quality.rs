//! Signal, contrast and noise of microcalcifications (Mîra 2018, eq. 5.1 - 5.5).

use crate::xray::{geometry::Geometry, phantom::Phantom, placement::Site};
use mammotwin_data::{Mat3, Vec3, radiograph::Radiograph};

/// Side (mm) of the square region of interest around a calcification.
pub const ROI_MM: f64 = 10.0;

/// Why a region has no quality.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum QualityError {
    /// Too few pixels.
    #[error(
        "microcalcification in row {row}, column {column}: {calcification} pixels in it and \
         {background} around it on the detector; use smaller pixels or keep it on the detector"
    )]
    TooFew {
        /// Row in the matrix.
        row: usize,
        /// Column in the matrix.
        column: usize,
        /// Pixels of the calcification.
        calcification: usize,
        /// Pixels of the background.
        background: usize,
    },
}

/// One region of interest.
///
/// The thesis' σ (eq. 5.3) counts a slope of the background as noise; `detrended` values have
/// the plane that fits the background best taken away, and σ is what is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoiQuality {
    /// Place in the matrix and in the breast.
    pub site: Site,
    /// Centre (mm) on the detector.
    pub center_mm: [f64; 2],
    /// Pixels of the calcification.
    pub pixels: usize,
    /// ⟨SI_µcalc⟩ (eq. 5.1).
    pub calcification: f64,
    /// ⟨SI_back⟩ (eq. 5.2).
    pub background: f64,
    /// As printed.
    pub printed: NoiseQuality,
    /// Without the slope of the background.
    pub detrended: NoiseQuality,
}

/// Signal and contrast over noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseQuality {
    /// SD of the background (eq. 5.3).
    pub sigma: f64,
    /// Contrast over noise (eq. 5.4).
    pub sdnr: f64,
    /// Signal over noise (eq. 5.5).
    pub snr: f64,
}

/// Quality around each calcification of a phantom. Regions are cut at the detector's edges.
pub fn quality(
    picture: &Radiograph,
    phantom: &Phantom,
    geometry: &Geometry,
) -> Result<Vec<RoiQuality>, QualityError> {
    let regions = phantom.calcifications.iter().map(|c| {
        let center_mm = geometry.shadow_mm(&c.site.center);
        roi(picture, c.site, center_mm, 0.5 * c.diameter_mm)
    });
    regions.collect()
}

/// A pixel of a region.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    /// Place (mm) from the centre.
    at: [f64; 2],
    value: f64,
}

/// Quality of the square around a centre (mm on the detector): pixels whose centre lies within
/// the radius are calcification, the others background.
pub fn roi(
    picture: &Radiograph,
    site: Site,
    center_mm: [f64; 2],
    radius_mm: f64,
) -> Result<RoiQuality, QualityError> {
    let (inside, outside): (Vec<Pixel>, Vec<Pixel>) =
        square(picture, center_mm).partition(|p| p.at[0].hypot(p.at[1]) <= radius_mm);
    // A plane needs three.
    if inside.is_empty() || outside.len() < 4 {
        return Err(QualityError::TooFew {
            row: site.row,
            column: site.column,
            calcification: inside.len(),
            background: outside.len(),
        });
    }
    let value = |p: &Pixel| p.value;
    let (calcification, background) = (mean(&inside, value), mean(&outside, value));
    let plane = fit_plane(&outside);
    let residual = |p: &Pixel| p.value - plane[0] - plane[1] * p.at[0] - plane[2] * p.at[1];
    let noise = |sigma: f64, contrast: f64| NoiseQuality {
        sigma,
        sdnr: contrast / sigma,
        snr: background / sigma,
    };
    let sd = |of: &dyn Fn(&Pixel) -> f64| mean(&outside, |p| of(p).powi(2)).sqrt();
    Ok(RoiQuality {
        site,
        center_mm,
        pixels: inside.len(),
        calcification,
        background,
        printed: noise(sd(&|p| p.value - background), background - calcification),
        detrended: noise(sd(&residual), -mean(&inside, residual)),
    })
}

/// Pixels of the region that are on the detector.
fn square(picture: &Radiograph, [x, y]: [f64; 2]) -> impl Iterator<Item = Pixel> {
    let pitch = picture.pitch_mm;
    let range = |center: f64, first: f64, count: usize| {
        let low = ((center - 0.5 * ROI_MM - first) / pitch).ceil().max(0.0) as usize;
        let end = ((center + 0.5 * ROI_MM - first) / pitch).floor() + 1.0;
        low..(end.max(0.0) as usize).min(count)
    };
    let columns = range(x, picture.left_mm, picture.columns);
    range(y, picture.first_row_mm, picture.rows).flat_map(move |row| {
        let dy = picture.first_row_mm + row as f64 * pitch - y;
        columns.clone().map(move |column| {
            let dx = picture.left_mm + column as f64 * pitch - x;
            Pixel { at: [dx, dy], value: f64::from(picture.at(row, column)) }
        })
    })
}

fn mean(pixels: &[Pixel], of: impl Fn(&Pixel) -> f64) -> f64 {
    pixels.iter().map(of).sum::<f64>() / pixels.len() as f64
}

/// Least squares: value at the centre, slopes along x and y. Flat when the pixels span no plane.
fn fit_plane(pixels: &[Pixel]) -> Vec3 {
    let basis = |p: &Pixel| Vec3::new(1.0, p.at[0], p.at[1]);
    let mut normal = Mat3::zeros();
    let mut right = Vec3::zeros();
    for pixel in pixels {
        let b = basis(pixel);
        normal += b * b.transpose();
        right += b * pixel.value;
    }
    let flat = Vec3::new(mean(pixels, |p| p.value), 0.0, 0.0);
    normal.try_inverse().map_or(flat, |inverse| inverse * right)
}

/// Mean and SD (n - 1) over regions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Standard deviation; 0 for one region.
    pub sd: f64,
}

/// Mean and SD of a quantity over regions; `None` without regions.
pub fn summary(regions: &[RoiQuality], of: impl Fn(&RoiQuality) -> f64) -> Option<Summary> {
    if regions.is_empty() {
        return None;
    }
    let count = regions.len() as f64;
    let mean = regions.iter().map(&of).sum::<f64>() / count;
    let squares: f64 = regions.iter().map(|r| (of(r) - mean).powi(2)).sum();
    Some(Summary { mean, sd: (squares / (count - 1.0).max(1.0)).sqrt() })
}
