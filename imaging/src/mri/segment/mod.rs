//! Fully automatic segmentation of a breast MRI, without or with fat suppression.
//!
//! One file a step: `frame` turns the image into the body's own axes, `body` finds the air
//! around it, `shading` learns how bright fat is at each place, `wall` finds the chest wall as
//! a smooth optimal surface (`search`) over a map about the thorax' axis (`polar`),
//! `limits` says where the breasts end, `tissue` parts gland and fat, and `label` writes it
//! all on the image's own grid. What a person marked teaches and binds them (`scribble`). Where no wall of bright
//! fat before dark muscle is found, one of dark fat before brighter muscle is looked for (`suppressed`).
//!
//! The breasts end by convention: at the sternal plane of symmetry, at the lateral plane through
//! the thorax' mid-depth (mid-axillary line), and 12 mm above and below where the tissue in front of
//! the chest wall stops protruding, which is between clavicle and costal margin (Mira 2018, § 1.1.2:
//! sternal to mid-axillary line, clavicle to costal margin). The limits are planes of the chest.

mod body;
mod border;
mod depth;
mod error;
mod filter;
mod frame;
mod label;
mod limits;
mod plausible;
mod polar;
mod rear;
mod scribble;
mod search;
mod shading;
mod suppressed;
mod tissue;
mod wall;

pub(super) use body::neighbours;
pub(super) use depth::distance_to_outside;
pub use error::{Border, SegmentError, Warning};
pub use tissue::Classes;

use frame::Frame;
use mammotwin_data::Vec3;
use mammotwin_data::labels::{LabelMap, Scribbles, Side};
use mammotwin_data::progress::Progress;
use mammotwin_data::rigid::RigidTransform;
use mammotwin_data::surface::TriMesh;
use mammotwin_data::volume::{Grid, Volume};
use scribble::Marks;
use shading::Shaded;

/// How to segment.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Carries image millimetres into axes in which z runs along the body and y to its front.
    /// Identity suits poses turned by less than about 15 degrees; else the rigid motion between
    /// fiducials.
    pub body_frame: RigidTransform,
    /// Nominal thickness (mm) of the layer under the surface that is labelled skin.
    pub skin_mm: f64,
    /// Spacing (mm) of the grid on which body and wall are looked for before they are refined on
    /// the image itself.
    pub work_spacing_mm: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { body_frame: RigidTransform::identity(), skin_mm: 2.0, work_spacing_mm: 2.0 }
    }
}

/// Labels, and what they rest on.
#[derive(Debug, Clone)]
pub struct Segmentation {
    /// One tissue a voxel, on the image's own grid.
    pub labels: LabelMap,
    /// Where the breasts end.
    pub limits: Limits,
    /// Brightness of fat at each place, in the image's units, on a coarse grid of the image's
    /// millimetres: dividing by it takes the coils' shading away.
    pub shading: Volume<f32>,
    /// Front of the pectoral muscle (and of the sternum between the muscles): an open patch in
    /// front of the lateral plane, in the image's millimetres, normals to the front.
    pub chest_wall: TriMesh,
    /// Brightness of gland and fat relative to the shading.
    pub classes: Classes,
    /// Part of the chest wall behind the breasts on which fat and muscle were told apart, 0..=1.
    pub wall_seen: f64,
    /// Part of the chest wall on which the rear of the muscle was seen, 0..=1.
    pub muscle_rear_seen: f64,
    /// What to look at.
    pub warnings: Vec<Warning>,
}

/// Where the breasts end, in the body's axes (mm): image millimetres after
/// [`Options::body_frame`].
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// A point of the sternal plane, in the image's millimetres.
    pub sternal_point: Vec3,
    /// Unit normal of the sternal plane to the person's right, in the image's millimetres.
    pub sternal_normal: Vec3,
    /// y of the lateral (mid-axillary) plane.
    pub lateral_y_mm: f64,
    /// Lowest and highest z of the right breast.
    pub right_z_mm: [f64; 2],
    /// Lowest and highest z of the left breast.
    pub left_z_mm: [f64; 2],
}

/// A wall that is seen on less than this part of it is a guess.
const LEAST_SEEN: f64 = 0.35;
/// The same where fat is suppressed: a surface that is none is seen in part, too.
const LEAST_SEEN_SUPPRESSED: f64 = 0.5;

/// Segments a scan. Deterministic; the image needs bright fat and dark muscle (T2 or T1 weighted,
/// without fat suppression), or suppressed fat that is darker than muscle and brighter than lung.
pub fn segment(
    image: &Volume<f32>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Segmentation, SegmentError> {
    segment_marked(image, None, options, progress)
}

/// As [`segment`], with what a person marked: the brightness of the tissues is learnt from it, which
/// other contrasts need, and it holds.
pub fn segment_marked(
    image: &Volume<f32>,
    scribbles: Option<&Scribbles>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Segmentation, SegmentError> {
    let shape = image.grid.shape;
    let grid_error = SegmentError::Grid { shape };
    if shape.iter().any(|&n| n < 8) {
        return Err(grid_error);
    }
    if let Some(n) = image.values.iter().position(|v| !v.is_finite()) {
        let voxel = image.grid.voxel(n);
        return Err(SegmentError::NotFinite { voxel, value: image.values[n] });
    }
    let frame = Frame::new(&image.grid, &options.body_frame).ok_or(grid_error)?;

    let marks = Marks::new(scribbles, image, &frame)?;
    let recoloured = marks.recoloured(image, &frame)?;
    let image = recoloured.as_ref().map_or(image, |found| &found.image);

    progress.report(0.0, "resampling along the body's axes");
    let grid = frame.work_grid(options.work_spacing_mm);
    let (work, inside) = frame::resample(image, &frame, grid);

    progress.report(0.2, "coil shading and body");
    let positive = work.values.iter().filter(|&&v| v > 0.0).map(|v| v.ln());
    let tissue_from = filter::otsu(positive).ok_or(SegmentError::Empty)?.exp();
    let mut body = body::find(&work, &inside, |_| tissue_from).ok_or(SegmentError::Empty)?;
    let mut field = None;
    let raw = work;
    let mut brightness_of_work = raw.clone();
    // The second time the shading is measured where the first one saw the body.
    for _ in 0..2 {
        let found = shading::estimate(&raw, &body.mask, tissue_from).ok_or(SegmentError::Empty)?;
        let grid = &raw.grid;
        let fat: Vec<f32> =
            (0..grid.len()).map(|n| found.fat(&grid.center(grid.voxel(n)))).collect();
        for n in 0..fat.len() {
            brightness_of_work.values[n] = raw.values[n] / fat[n];
        }
        let tissue_from = |n: usize| body::faintest(fat[n], found.brightest);
        body = body::find(&brightness_of_work, &inside, tissue_from).ok_or(SegmentError::Empty)?;
        field = Some(found);
    }
    let field = field.ok_or(SegmentError::Empty)?;
    let work = brightness_of_work;
    let shaded = Shaded { image, frame: &frame, field: &field };

    progress.report(0.5, "chest wall");
    let usual = wall::find(&work, &shaded, &body, &marks)
        // What a person marked may have another contrast, and holds.
        .filter(|wall| scribbles.is_some() || plausible::muscle_behind_fat(wall, &shaded));
    let suppressed = match (&usual, scribbles) {
        (None, None) => suppressed::find(image, &frame, &raw, &inside, &body, &field),
        _ => None,
    };
    let suppressed = suppressed.as_ref();
    let wall =
        usual.as_ref().or(suppressed.map(|found| &found.wall)).ok_or(SegmentError::NoChestWall)?;

    progress.report(0.7, "breast limits");
    let limits = limits::find(wall).ok_or(SegmentError::NoBreast)?;
    if suppressed.is_some() && !plausible::mid_axillary(wall, &limits) {
        return Err(SegmentError::NoChestWall);
    }
    let mut warnings = border::check_heights(&limits)?;

    progress.report(0.75, "labels");
    // The body is told in the image itself, tissues in one of the known contrast.
    let brightness = label::brightness(&shaded);
    let (mask, breast) = match suppressed {
        Some(found) => {
            let air_below = |p: &Vec3| found.air.voxel_from(p, &field) / field.fat(p);
            let mask = label::body_mask(&shaded, &brightness, &work, &found.body, air_below);
            (mask, Some(&found.breast))
        }
        None => {
            let air_below = |p: &Vec3| body::air_below(field.fat(p), field.brightest);
            let mask = label::body_mask(&shaded, &brightness, &work, &body, air_below);
            (mask, recoloured.as_ref().map(|found| &found.breast))
        }
    };
    let brightness = breast.unwrap_or(&brightness);
    let shaded = match suppressed {
        Some(found) => Shaded { image: &found.image, frame: &frame, field: &found.flat },
        None => shaded,
    };
    let field = suppressed.map_or(&field, |found| &found.fat);
    let (labels, classes) =
        label::assign(&shaded, brightness, &mask, wall, &limits, &marks, options.skin_mm);

    border::check_faces(&labels, &frame, &limits)?;

    let wall_seen =
        wall.contrast.iter().filter(|c| **c > 0.3).count() as f64 / wall.contrast.len() as f64;
    let least_seen = if suppressed.is_some() { LEAST_SEEN_SUPPRESSED } else { LEAST_SEEN };
    if wall_seen < least_seen || (suppressed.is_some() && !plausible::both_breasts(&labels)) {
        return Err(SegmentError::NoChestWall);
    }
    if suppressed.is_some() {
        warnings.push(Warning::SuppressedFat);
    }
    if wall_seen < 0.6 {
        warnings.push(Warning::FaintWall { percent: 100.0 * wall_seen });
    }
    if wall.rear.seen < 0.5 {
        let (percent, belly_mm) = (100.0 * wall.rear.seen, wall.rear.belly_mm);
        warnings.push(Warning::NominalMuscle { percent, belly_mm });
    }
    let voxel_mm = image.grid.spacing_mm().into_iter().fold(0.0, f64::max);
    if voxel_mm > options.skin_mm {
        warnings.push(Warning::CoarseSkin { voxel_mm, skin_mm: options.skin_mm });
    }
    let image_from_body = options.body_frame.inverse();
    let [x, slope] = limits.sternum;
    progress.report(1.0, "segmented");
    Ok(Segmentation {
        labels,
        limits: Limits {
            sternal_point: image_from_body.point(&Vec3::new(x, limits.lateral_y, 0.0)),
            sternal_normal: image_from_body.direction(&Vec3::new(1.0, 0.0, -slope).normalize()),
            lateral_y_mm: limits.lateral_y,
            right_z_mm: limits.z[limits::slot(Side::Right)],
            left_z_mm: limits.z[limits::slot(Side::Left)],
        },
        shading: Volume {
            grid: Grid {
                shape: field.log.grid.shape,
                axes: image_from_body.rotation * field.log.grid.axes,
                origin: image_from_body.point(&field.log.grid.origin),
            },
            values: field.log.values.iter().map(|v| v.exp()).collect(),
        },
        chest_wall: wall.front_patch(limits.lateral_y, &image_from_body),
        classes,
        wall_seen,
        muscle_rear_seen: wall.rear.seen,
        warnings,
    })
}
