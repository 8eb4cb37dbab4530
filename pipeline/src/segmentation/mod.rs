//! How near the segmentation comes to the truth of digital volunteers, structure by structure.

pub mod overlay;
mod page;

pub use page::{markdown, page, table};

use crate::score::{Part, dice};
use mammotwin_data::{
    Failure, Vec3,
    labels::{LabelMap, Side, Tissue},
    progress::Silent,
    rigid::RigidTransform,
    surface::TriMesh,
    volume::Volume,
};
use mammotwin_imaging::mri::{
    distance_field::{FieldPlan, level_field},
    segment::{Options, segment},
    surface::surface,
};
use mammotwin_solver::distance::{DistanceError, SurfaceIndex};
use mammotwin_stages::volunteer::Truth;

/// Spacing (mm) of the vertices of the surfaces that are compared.
const SPACING_MM: f64 = 1.5;
/// Surfaces are compared this far (mm) inside of the breast limits: beyond, a cut is no surface.
const INSIDE_MM: f64 = 4.0;

/// Two surfaces of one thing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Mean over the found one (mm); positive where it lies outside of the true one.
    pub mean_mm: f64,
    /// 95 % of the vertices of both are nearer (mm) to the other one.
    pub p95_mm: f64,
}

/// How well one image was segmented.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Kind of volunteer.
    pub preset: String,
    /// Which person.
    pub seed: u64,
    /// How she lies.
    pub pose: String,
    /// Mean edge (mm) of the voxels.
    pub voxel_mm: f64,
    /// Dice of the breasts: truth between the breast limits of the chest.
    pub breast: f64,
    /// The same where both are cut at the true limits: what the limits alone do not cost.
    pub breast_within: f64,
    /// The same against the true labels as they are, whose limits move with the tissue.
    pub breast_material: f64,
    /// Dice of the pectoral muscle.
    pub muscle: f64,
    /// Dice of fibroglandular tissue.
    pub gland: f64,
    /// Dice of all behind the breasts.
    pub chest_wall: f64,
    /// Skin over the breasts.
    pub skin: Gap,
    /// Front of the muscle.
    pub front: Gap,
    /// Rear of the muscle.
    pub rear: Gap,
    /// 95 % of both surfaces of the muscle (mm).
    pub muscle_p95_mm: f64,
    /// Found less true limits (mm): lower and upper of the right breast, of the left one, lateral.
    pub limits_mm: [f64; 5],
}

/// Names of [`Measured::limits_mm`].
pub const LIMITS: [&str; 5] =
    ["right_lower_mm", "right_upper_mm", "left_lower_mm", "left_upper_mm", "lateral_mm"];

/// What was found in an image, and how near it is to the truth.
#[derive(Debug)]
pub struct Seen {
    /// How near it is.
    pub measured: Measured,
    /// What was found.
    pub labels: LabelMap,
}

/// One image of a volunteer, with what is true of it.
#[derive(Debug)]
pub struct Scanned<'a> {
    /// The image.
    pub image: &'a Volume<f32>,
    /// From the image to the reference pose, as landmarks or the images give it.
    pub start: RigidTransform,
    /// True labels.
    pub labels: &'a LabelMap,
    /// Truth of the volunteer.
    pub truth: &'a Truth,
    /// Which of her poses.
    pub pose: &'a str,
}

/// Segments an image without help and compares it with the truth.
///
/// # Errors
/// [`Failure::BadInput`] when the image is refused, or a structure has no surface.
pub fn measure(scanned: &Scanned) -> Result<Seen, Failure> {
    let Scanned { image, start, labels: known, truth, pose } = *scanned;
    let refuse = |cause: &dyn std::fmt::Display| {
        Failure::BadInput(format!("{} {} {pose}: {cause}", truth.preset, truth.seed))
    };
    let options = Options { body_frame: start, ..Options::default() };
    let found = segment(image, &options, &Silent).map_err(|cause| refuse(&cause))?;
    let labels = &found.labels;
    let same = |part: Part| {
        let [a, b] = [labels, known].map(|labels| labels.map(part));
        dice(&a.values, &b.values).unwrap_or(0.0)
    };
    let breast = labels.map(Tissue::is_breast);
    let true_breast = truth.breast(pose, known);
    let voxel_mm = image.grid.mean_edge_mm();
    let inside = truth.inside_limits(pose, INSIDE_MM);
    let surfaces = |part: Part| {
        let of = |labels: &LabelMap| {
            let field = level_field(&labels.map(part), &FieldPlan::of_spacing(SPACING_MM));
            field.map(|field| surface(&field)).map_err(|cause| refuse(&cause))
        };
        Ok::<_, Failure>([of(labels)?, of(known)?])
    };
    let apart = |part: Part| {
        let [found, known] = surfaces(part)?;
        let [to_known, to_found] =
            [distances(&found, &known, &inside), distances(&known, &found, &inside)];
        Ok::<_, Failure>([to_known.map_err(|c| refuse(&c))?, to_found.map_err(|c| refuse(&c))?])
    };
    let skin = apart(|tissue| tissue != Tissue::Background)?;
    let front = apart(Tissue::is_chest_wall)?;
    let rear = apart(|tissue| tissue == Tissue::Thorax)?;
    let both: Vec<f64> = front.iter().chain(&rear).flatten().copied().collect();
    let side = |side: Side| match side {
        Side::Right => found.limits.right_z_mm,
        Side::Left => found.limits.left_z_mm,
    };
    let [right, left] = [Side::Right, Side::Left].map(side);
    let [low, high] = [truth.limits.least_z_mm, truth.limits.greatest_z_mm];
    let measured = Measured {
        preset: truth.preset.clone(),
        seed: truth.seed,
        pose: pose.into(),
        voxel_mm,
        breast: dice(&breast.values, &true_breast).unwrap_or(0.0),
        breast_within: dice(&truth.breast(pose, labels), &true_breast).unwrap_or(0.0),
        breast_material: same(Tissue::is_breast),
        muscle: same(|tissue| tissue == Tissue::PectoralMuscle),
        gland: same(Tissue::is_gland),
        chest_wall: same(Tissue::is_chest_wall),
        skin: Gap::of(&skin),
        front: Gap::of(&front),
        rear: Gap::of(&rear),
        muscle_p95_mm: p95(both),
        limits_mm: [
            right[0] - low,
            right[1] - high,
            left[0] - low,
            left[1] - high,
            found.limits.lateral_y_mm - truth.limits.least_y_mm,
        ],
    };
    Ok(Seen { measured, labels: found.labels })
}

/// Signed distances (mm) of the vertices of `from` that lie `inside` to another surface; positive
/// outside of it.
fn distances(
    from: &TriMesh,
    to: &TriMesh,
    inside: &impl Fn(&Vec3) -> bool,
) -> Result<Vec<f64>, DistanceError> {
    let points: Vec<_> = from.points.iter().filter(|p| inside(p)).copied().collect();
    let closest = SurfaceIndex::new(to)?.closest_of(&points)?;
    Ok(points.iter().zip(&closest).map(|(p, closest)| closest.signed_mm(p)).collect())
}

impl Gap {
    /// From the distances of the found surface to the true one, and the other way.
    fn of([to_known, to_found]: &[Vec<f64>; 2]) -> Self {
        let mean_mm = to_known.iter().sum::<f64>() / to_known.len().max(1) as f64;
        Self { mean_mm, p95_mm: p95(to_known.iter().chain(to_found).copied().collect()) }
    }
}

/// What 95 % of the sizes do not exceed; not a number without any.
fn p95(mut values: Vec<f64>) -> f64 {
    values.iter_mut().for_each(|v| *v = v.abs());
    values.sort_by(f64::total_cmp);
    values.get(values.len() * 95 / 100).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::Grid;

    fn ball(radius: f64) -> TriMesh {
        let grid = Grid::aligned([40; 3], [1.0; 3], Vec3::repeat(-19.5));
        let values = (0..grid.len()).map(|n| grid.center(grid.voxel(n)).norm() < radius).collect();
        surface(&level_field(&Volume { grid, values }, &FieldPlan::of_spacing(1.0)).unwrap())
    }

    #[test]
    fn a_ball_lies_outside_of_a_smaller_one_by_the_difference_of_radii() {
        let (large, small) = (ball(14.0), ball(12.0));
        let upper = |p: &Vec3| p.z > 0.0;
        let gap = Gap::of(&[
            distances(&large, &small, &upper).unwrap(),
            distances(&small, &large, &upper).unwrap(),
        ]);
        assert!((gap.mean_mm - 2.0).abs() < 0.1 && (gap.p95_mm - 2.0).abs() < 0.3, "{gap:?}");
    }

    #[test]
    fn five_of_a_hundred_are_farther() {
        assert_eq!(p95((0..100).map(|n| -f64::from(n)).collect()), 95.0);
        assert!(p95(Vec::new()).is_nan());
    }
}
