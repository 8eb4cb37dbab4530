//! The whole segmentation against chests whose truth is known.

use crate::phantom;

use mammotwin_data::Vec3;
use mammotwin_data::labels::{Side, Tissue};
use mammotwin_data::progress::Silent;
use mammotwin_data::rigid::RigidTransform;
use mammotwin_data::volume::{Grid, Volume};
use mammotwin_imaging::mri::segment::{Border, Options, SegmentError, Segmentation, segment};
use phantom::{Gland, dice, from_wall, is_gland, picture};

/// Voxels (mm) of the tests' pictures.
const VOXEL_MM: f64 = 2.5;

/// 95th percentile of the distance (mm) of the found wall to the true one, before the breasts.
fn wall_error(found: &Segmentation, to_body: &RigidTransform) -> f64 {
    let mut errors: Vec<f64> = found
        .chest_wall
        .points
        .iter()
        .map(|p| to_body.point(p))
        .filter(|p| p.y > 30.0 && p.z.abs() < 75.0)
        .map(|p| from_wall(&p).abs())
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 2000);
    errors[errors.len() * 95 / 100]
}

#[track_caller]
fn check(gland: Gland, pose: &RigidTransform, options: &Options, least_body: f64) {
    let (image, truth) = picture(VOXEL_MM, gland, pose);
    let found = segment(&image, options, &Silent).unwrap();
    let breast = dice(&found.labels, &truth, Tissue::is_breast);
    let body = dice(&found.labels, &truth, |t| t != Tissue::Background);
    let glands = dice(&found.labels, &truth, is_gland);
    let muscle = dice(&found.labels, &truth, |t| t == Tissue::PectoralMuscle);
    let wall = wall_error(&found, &pose.inverse());
    let right = dice(&found.labels, &truth, |t| t == Tissue::AdiposeRight);
    println!(
        "breast {breast:.3} right fat {right:.3} body {body:.4} gland {glands:.3} muscle \
         {muscle:.3} wall p95 {wall:.2} mm, {:?}",
        found.limits
    );
    assert!(wall < 0.5 * VOXEL_MM && breast > 0.94 && right > 0.9 && muscle > 0.9);
    assert!(body > least_body);
    assert!(glands > 0.8);
}

#[test]
fn a_chest_is_divided_as_it_was_made() {
    check(Gland::Retracted, &RigidTransform::identity(), &Options::default(), 0.99);
}

#[test]
fn gland_that_touches_the_muscle_stays_in_front_of_the_wall() {
    check(Gland::TouchesMuscle, &RigidTransform::identity(), &Options::default(), 0.99);
}

#[test]
fn a_turned_body_is_divided_in_its_own_frame() {
    let turn = Vec3::new(0.05, -0.04, 0.5);
    let pose = RigidTransform::about(&Vec3::zeros(), &turn, &Vec3::new(3.0, -8.0, 5.0));
    let options = Options { body_frame: pose.inverse(), ..Options::default() };
    // The oblique rear border of the image leaves some air that no line reaches.
    check(Gland::Retracted, &pose, &options, 0.9);
}

#[test]
fn equal_images_give_equal_labels_for_any_number_of_threads() {
    let (image, _) = picture(4.0, Gland::Retracted, &RigidTransform::identity());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| segment(&image, &Options::default(), &Silent).unwrap())
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.labels, three.labels);
    assert_eq!(one.chest_wall, three.chest_wall);
}

/// The voxels of `image` from `low` to before `high`.
fn cropped(image: &Volume<f32>, low: [usize; 3], high: [usize; 3]) -> Volume<f32> {
    let shape = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let grid = Grid { shape, axes: image.grid.axes, origin: image.grid.center(low) };
    let values = (0..grid.len())
        .map(|n| {
            let at = grid.voxel(n);
            image.at([0, 1, 2].map(|axis| at[axis] + low[axis]))
        })
        .collect();
    Volume { grid, values }
}

#[test]
fn images_that_cut_a_breast_or_hold_none_are_refused() {
    let (image, _) = picture(4.0, Gland::Retracted, &RigidTransform::identity());
    let [ni, nj, nk] = image.grid.shape;
    let run = |image: &Volume<f32>| match segment(image, &Options::default(), &Silent) {
        Ok(found) => panic!("segmented: {:?}", found.limits),
        Err(refusal) => refusal,
    };
    let front = run(&cropped(&image, [0; 3], [ni, nj - 15, nk]));
    assert_eq!(front, SegmentError::BreastCut { side: Side::Right, border: Border::Anterior });
    let above = run(&cropped(&image, [0; 3], [ni, nj, nk / 2 + 2]));
    assert_eq!(above, SegmentError::BreastCut { side: Side::Right, border: Border::Superior });
    // A unilateral scan: from the mid-line to her right.
    let one = run(&cropped(&image, [ni / 2, 0, 0], [ni, nj, nk]));
    assert_eq!(one, SegmentError::BreastCut { side: Side::Left, border: Border::Lateral });
    assert_eq!(run(&Volume::filled(image.grid.clone(), 3.0)), SegmentError::Empty);
    assert!(matches!(run(&cropped(&image, [0; 3], [ni, nj, 4])), SegmentError::Grid { .. }));
    let mut broken = image;
    broken.values[17] = f32::NAN;
    assert!(matches!(run(&broken), SegmentError::NotFinite { voxel: [17, 0, 0], .. }));
}
