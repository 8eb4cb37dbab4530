//! Registration of two images over a mask.

use super::{
    Options, RegisterError, Registration, Search, Uncertainty, change,
    elastic::{Climbed, Elastic},
    mask,
    optimise::{Level, Optimum},
    pyramid,
    samples::samples,
    search,
};
use mammotwin_data::{
    Vec3,
    progress::Progress,
    rigid::RigidTransform,
    volume::{Grid, Volume},
};
use nalgebra::Matrix6;

/// Part of an image's mean below which its logarithm flattens.
const FLOOR: f32 = 0.5;
/// Least part of the mask that must lie in the moving image.
const LEAST_OVERLAP: f64 = 0.3;

/// Moves `moving` onto `reference` where `reference_mask` is set; `start` goes from the moving
/// image to the reference.
///
/// Mean local correlation is climbed by Levenberg-Marquardt on coarse to fine averages of the
/// images. Gives the same bits for any number of threads.
///
/// # Errors
/// When the mask does not belong to the reference, shows no structure, or lies for the most part
/// outside of the moving image.
pub fn register(
    reference: &Volume<f32>,
    reference_mask: &Volume<bool>,
    moving: &Volume<f32>,
    start: &RigidTransform,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Registration, RegisterError> {
    if !same_place(&reference_mask.grid, &reference.grid) {
        return Err(RegisterError::MaskGrid {
            mask: reference_mask.grid.shape,
            image: reference.grid.shape,
        });
    }
    let center = mask::center(reference_mask).ok_or(RegisterError::NoStructure)?;
    let prepare = Prepare { reference, mask: reference_mask, moving, options };
    let level = |spacing_mm: f64| prepare.level(spacing_mm, center);
    let mut motion = start.inverse();
    let mut iterations = 0;
    if let (Search::Wide, Some(&first_mm)) = (options.search, options.levels_mm.first()) {
        progress.report(0.0, "searching the position");
        let best = search::wide(&level(search::COARSE_MM)?, &level(first_mm)?, &motion);
        iterations += best.iterations;
        motion = best.motion;
    }
    let mut last = None;
    for (n, &spacing_mm) in options.levels_mm.iter().enumerate() {
        let done = (n + 1) as f64 / (options.levels_mm.len() + 1) as f64;
        progress.report(done, &format!("registering at {spacing_mm} mm"));
        let level = level(spacing_mm)?;
        let mut best = level.climb(&motion, options.iterations);
        if n == 0 && options.search == Search::Near {
            best = search::other_ribs(&level, best);
        }
        iterations += best.iterations;
        motion = best.motion;
        last = Some((level, best));
    }
    let Some((level, best)) = last else {
        let remedy = "give at least one level";
        return Err(RegisterError::Level { spacing_mm: f64::NAN, remedy });
    };
    if !(best.overlap >= LEAST_OVERLAP) {
        return Err(RegisterError::NoOverlap { percent: 100.0 * best.overlap });
    }
    Ok(Registration {
        transform: motion.inverse(),
        landmark_rms_mm: None,
        change_rms_mm: None,
        similarity_before: level.stay(&start.inverse()).evaluation.similarity,
        similarity_after: best.evaluation.similarity,
        overlap: best.overlap,
        iterations,
        center,
        uncertainty: uncertainty(&best).ok_or(RegisterError::NoStructure)?,
    })
}

/// Moves `moving` onto `reference` although the chest wall changes its shape: the rigid part, over
/// `places` (mm, reference), of a map that holds [`Options::changes`] too.
///
/// Starts from [`register`] on the coarser levels. Gives the same bits for any number of threads.
///
/// # Errors
/// As [`register`]; and when the places are less than three or in line.
pub fn register_changed(
    reference: &Volume<f32>,
    reference_mask: &Volume<bool>,
    places: &[Vec3],
    moving: &Volume<f32>,
    start: &RigidTransform,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Registration, RegisterError> {
    let changes = &options.changes;
    let coarsest = changes.levels_mm.iter().copied().fold(0.0, f64::max);
    if !(changes.spacing_mm > 0.0 && changes.deviation_mm > 0.0 && coarsest > 0.0) {
        let remedy = "spacing_mm, deviation_mm and levels_mm of the changes must be positive";
        return Err(RegisterError::Level { spacing_mm: coarsest, remedy });
    }
    let coarse: Vec<f64> =
        options.levels_mm.iter().copied().filter(|level| *level >= coarsest).collect();
    let rigid = Options { levels_mm: coarse, ..options.clone() };
    let mut found = register(reference, reference_mask, moving, start, &rigid, progress)?;
    progress.report(0.9, "change of the chest wall");
    let corners = mask::bounds(reference_mask).ok_or(RegisterError::NoStructure)?;
    let mut map = Elastic::rigid(&found.transform.inverse(), found.center, corners, changes);
    let prepare = Prepare { reference, mask: reference_mask, moving, options };
    for &spacing_mm in &changes.levels_mm {
        let level = prepare.level(spacing_mm, found.center)?;
        let climbed = map.climb(&level.samples, &level.moving, options.iterations);
        let fit = map.rigid_part(places)?;
        found = Registration {
            transform: fit.transform,
            change_rms_mm: Some(fit.rms_mm),
            similarity_after: climbed.similarity,
            overlap: climbed.overlap,
            iterations: found.iterations + climbed.iterations,
            uncertainty: uncertainty_of_changed(&map, &climbed, places, &found.center, fit.rms_mm)
                .ok_or(RegisterError::NoStructure)?,
            ..found
        };
    }
    Ok(found)
}

/// What the images leave open, and the rigid part that a change of this size may have itself.
fn uncertainty_of_changed(
    map: &Elastic,
    climbed: &Climbed,
    places: &[Vec3],
    center: &Vec3,
    change_rms_mm: f64,
) -> Option<Uncertainty> {
    let open = map.covariance(climbed, places)?;
    let own = change::covariance(places, center, change_rms_mm, map.spacing_mm())?;
    let variance = (open + own).diagonal();
    let deviation = |n: usize| variance[n].max(0.0).sqrt();
    Some(Uncertainty {
        rotation_rad: [3, 4, 5].map(deviation),
        translation_mm: [0, 1, 2].map(deviation),
    })
}

/// The images of a registration, and how they are compared.
struct Prepare<'a> {
    reference: &'a Volume<f32>,
    mask: &'a Volume<bool>,
    moving: &'a Volume<f32>,
    options: &'a Options,
}

impl Prepare<'_> {
    /// What is compared at a distance of points.
    fn level(&self, spacing_mm: f64, center: Vec3) -> Result<Level, RegisterError> {
        let refuse = |remedy| Err(RegisterError::Level { spacing_mm, remedy });
        if !(spacing_mm > 0.0 && self.options.block_mm > 0.0) {
            return refuse("levels_mm and block_mm must be positive");
        }
        let block_mm = self.options.block_mm.max(8.0 * spacing_mm);
        let floor = |image: &Volume<f32>| FLOOR * mask::mean(image);
        let reference = pyramid::level(self.reference, spacing_mm, floor(self.reference));
        let samples = samples(&reference, self.mask, block_mm, self.options.points)?;
        let moving = pyramid::level(self.moving, spacing_mm, floor(self.moving));
        if moving.grid.shape.iter().any(|&n| n < 2) {
            return refuse("the moving image is too thin: give a whole scan");
        }
        Ok(Level { samples, moving, center, spacing_mm })
    }
}

/// Equal up to the rounding of a file in single precision.
fn same_place(a: &Grid, b: &Grid) -> bool {
    let far = (a.axes - b.axes).amax().max((a.origin - b.origin).amax());
    a.shape == b.shape && far < 1e-3
}

/// Sandwich estimator H⁻¹ (Σ g gᵀ) H⁻¹ (Huber 1967), turned to the axes of the reference.
fn uncertainty(best: &Optimum) -> Option<Uncertainty> {
    let inverse = best.evaluation.curvature.cholesky()?.inverse();
    let covariance = inverse * best.evaluation.spread * inverse;
    // A turn and shift after the motion is the turned turn and shift before it.
    let back = best.motion.rotation.transpose();
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
    let variance = (turn * covariance * turn.transpose()).diagonal();
    let deviation = |n: usize| variance[n].max(0.0).sqrt();
    Some(Uncertainty {
        rotation_rad: [0, 1, 2].map(deviation),
        translation_mm: [3, 4, 5].map(deviation),
    })
}
