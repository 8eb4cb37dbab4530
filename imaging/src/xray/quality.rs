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
         {background} around it on the detector; keep it on the detector"
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
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
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
    /// Estimate of d'², see [`detectability`].
    pub detectability2: f64,
}

/// Signal and contrast over noise.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NoiseQuality {
    /// SD of the background (eq. 5.3).
    pub sigma: f64,
    /// Contrast over noise (eq. 5.4).
    pub sdnr: f64,
    /// Signal over noise (eq. 5.5).
    pub snr: f64,
}

/// Distance (mm) from the rim of a calcification up to which its shadow is spread.
const HALO_MM: f64 = 0.3;

/// Detectability index d' of a known calcification in a known background of white noise, for an
/// observer who knows both (Barrett and Myers 2004, § 13.2): d'² = Σ Δsᵢ² / σ² over the pixels of
/// its shadow. Noise adds 1 to each term on average, which is taken away; a single region scatters
/// much, so that the mean of all regions is given. `None` without regions.
///
/// Pixels wider than a calcification make d' smaller than that of the same exposure on finer ones.
/// Where light spreads noise as well ([`Noise::BeforeLight`](crate::xray::detector::Noise)) the noise
/// is not white, and d' is that of an observer who does not know it.
pub fn detectability(regions: &[RoiQuality]) -> Option<f64> {
    summary(regions, |r| r.detectability2).map(|found| found.mean.max(0.0).sqrt())
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
/// the radius are calcification, the others background. The pixel that holds the centre (all of
/// them, when it lies on their border) is calcification in any case: pixels may be wider than it.
pub fn roi(
    picture: &Radiograph,
    site: Site,
    center_mm: [f64; 2],
    radius_mm: f64,
) -> Result<RoiQuality, QualityError> {
    let (inside, outside): (Vec<Pixel>, Vec<Pixel>) = square(picture, center_mm).partition(|p| {
        let holds_center = p.at.iter().all(|d| d.abs() <= 0.500001 * picture.pitch_mm);
        holds_center || p.at[0].hypot(p.at[1]) <= radius_mm
    });
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
    // The shadow lies in its halo; the noise is that of what is neither.
    let near = |p: &&Pixel| p.at[0].hypot(p.at[1]) <= radius_mm + HALO_MM;
    let far: Vec<Pixel> = outside.iter().filter(|p| !near(p)).copied().collect();
    let level = fit_plane(&far);
    let rest = |p: &Pixel| p.value - level[0] - level[1] * p.at[0] - level[2] * p.at[1];
    let white = mean(&far, |p| rest(p).powi(2));
    let shadow = inside.iter().chain(outside.iter().filter(near));
    let detectability2 = shadow.map(|p| rest(p).powi(2) / white - 1.0).sum();
    Ok(RoiQuality {
        site,
        center_mm,
        pixels: inside.len(),
        calcification,
        background,
        printed: noise(sd(&|p| p.value - background), background - calcification),
        detrended: noise(sd(&residual), -mean(&inside, residual)),
        detectability2,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xray::detector::draw;

    const SITE: Site = Site { row: 0, column: 0, center: Vec3::new(0.0, 0.0, 0.0) };

    fn detector() -> Geometry {
        Geometry { source_height_mm: 660.0, columns: 201, rows: 200, pitch_mm: 0.1 }
    }

    /// Value by (x, y) in mm.
    fn picture(value: impl Fn(f64, f64) -> f64) -> Radiograph {
        let detector = detector();
        let pixels = (0..detector.rows * detector.columns).map(|n| {
            let [x, y] = detector.pixel_mm(n / detector.columns, n % detector.columns);
            value(x, y) as f32
        });
        detector.picture(pixels.collect(), "signal")
    }

    /// A disc of contrast C in noise σ: SDNR = C/σ, SNR = S/σ.
    #[test]
    fn a_disc_in_noise_has_its_closed_form() {
        let center = [0.03, 10.02];
        let disc = |x: f64, y: f64| (x - center[0]).hypot(y - center[1]) <= 1.0;
        let quanta = |x, y| if disc(x, y) { 9_000.0 } else { 10_000.0 };
        let got = roi(&draw(&picture(quanta), 1), SITE, center, 1.0).unwrap();
        assert!(got.pixels.abs_diff(314) < 5, "{}", got.pixels);
        for noise in [got.printed, got.detrended] {
            assert!((noise.sdnr - 10.0).abs() < 0.3, "{noise:?}");
            assert!((noise.snr - 100.0).abs() < 2.0, "{noise:?}");
        }
    }

    /// n pixels of contrast C in noise σ: d'² = n C² / σ².
    #[test]
    fn detectability_has_its_closed_form() {
        let disc = |x: f64, y: f64| x.hypot(y - 10.0) <= 0.36;
        let level = picture(|x, y| 10_000.0 + 30.0 * y - if disc(x, y) { 150.0 } else { 0.0 });
        let regions: Vec<RoiQuality> = (0..200)
            .map(|seed| roi(&draw(&level, seed), SITE, [0.0, 10.0], 0.36).unwrap())
            .collect();
        let pixels = regions[0].pixels as f64;
        let exact = (pixels * 150.0 * 150.0 / 10_300.0).sqrt();
        let got = detectability(&regions).unwrap();
        // Each d'² scatters by √(4 d'² + 2 n).
        let error = ((4.0 * exact * exact + 300.0) / 200.0).sqrt() / (2.0 * exact);
        assert!((got - exact).abs() < 4.0 * error + 0.01 * exact, "{got} {exact}");
        let nothing: Vec<RoiQuality> = (0..200)
            .map(|seed| roi(&draw(&picture(|_, _| 1e4), seed), SITE, [0.0, 10.0], 0.36).unwrap())
            .collect();
        assert!(detectability(&nothing).unwrap() < 2.0);
        assert_eq!(detectability(&[]), None);
    }

    #[test]
    fn the_printed_sigma_holds_a_slope_and_the_detrended_does_not() {
        let (center, slope) = ([0.0, 10.0], 40.0);
        let checker = |x: f64, y: f64| {
            if ((x / 0.1).round() + (y / 0.1).round()).rem_euclid(2.0) < 0.5 { 5.0 } else { -5.0 }
        };
        let tilted = picture(|x, y| 10_000.0 + slope * (y - 10.0) + checker(x, y));
        let got = roi(&tilted, SITE, center, 0.15).unwrap();
        // 100 x 101 pixels: a slope over n steps of p has the variance (n² - 1) p² / 12.
        let ramp = slope * slope * (100.0f64.powi(2) - 1.0) * 0.01 / 12.0;
        assert!((got.printed.sigma / (ramp + 25.0).sqrt() - 1.0).abs() < 1e-3, "{got:?}");
        assert!((got.detrended.sigma - 5.0).abs() < 0.01, "{got:?}");
        assert!((got.detrended.snr / (10_000.0 / 5.0) - 1.0).abs() < 3e-3);
    }

    #[test]
    fn regions_are_cut_at_the_edge_of_the_detector_and_refused_beside_it() {
        let flat = picture(|x, _| if x > 9.0 { 3.0 } else { 1.0 });
        let cut = roi(&flat, SITE, [9.5, 1.0], 0.1).unwrap();
        assert_eq!((cut.calcification, cut.pixels), (3.0, 2));
        assert!((1.0..3.0).contains(&cut.background));
        let beside = roi(&flat, SITE, [40.0, 5.0], 0.1);
        assert!(matches!(beside, Err(QualityError::TooFew { background: 0, .. })));
    }

    #[test]
    fn mean_and_deviation() {
        let flat = picture(|x, y| 100.0 + x + y);
        let regions = [[-3.0, 10.0], [0.0, 10.0], [3.0, 10.0]]
            .map(|center| roi(&flat, SITE, center, 0.2).unwrap());
        let got = summary(&regions, |r| r.calcification).unwrap();
        assert!((got.mean - 110.0).abs() < 0.06 && (got.sd - 3.0).abs() < 0.06, "{got:?}");
        assert_eq!(summary(&[], |r| r.background), None);
    }
}
