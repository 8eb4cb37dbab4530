//! Registration on real prone images, where they are at hand.

use mammotwin_data::{
    Vec3, io::nifti, progress::Silent, rigid::RigidTransform, units::DEGREE, volume::Volume,
};
use mammotwin_imaging::mri::register::{Options, Search, register};
use std::path::{Path, PathBuf};

fn scans() -> Option<PathBuf> {
    let folder = std::env::var_os("MAMMOTWIN_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: no real data");
    }
    Some(folder?.join("data/mr_prone"))
}

fn image(folder: &Path, name: &str) -> Volume<f32> {
    nifti::read(&folder.join(name)).unwrap()
}

/// The thorax of this person, by eye: an elliptic cylinder.
fn chest(image: &Volume<f32>) -> Volume<bool> {
    let inside = |n: usize| {
        let p = image.grid.center(image.grid.voxel(n));
        (p.x / 132.0).hypot((p.y + 175.0) / 97.0) < 1.0
    };
    let values = (0..image.grid.len()).map(inside).collect();
    Volume { grid: image.grid.clone(), values }
}

/// The same scan in another place, under an added shading that does not move with it.
fn moved(image: &Volume<f32>, motion: &RigidTransform) -> Volume<f32> {
    let mut moved = image.clone();
    moved.grid.axes = motion.rotation * image.grid.axes;
    moved.grid.origin = motion.point(&image.grid.origin);
    for n in 0..moved.grid.len() {
        let p = moved.grid.center(moved.grid.voxel(n));
        moved.values[n] *= (0.006 * (p.x - 0.7 * p.y) + 0.2 * (p.z / 60.0).sin()).exp() as f32;
    }
    moved
}

#[test]
fn a_real_chest_is_found_under_other_shading() {
    let Some(folder) = scans() else { return };
    let fixed = image(&folder, "uta11_P13_t1tse_h2.nii.gz");
    let mask = chest(&fixed);
    let center = Vec3::new(0.0, -150.0, 0.0);
    for turn in [[2.0, -3.0, 4.0], [3.0, 2.0, 48.0]] {
        let turn = Vec3::from(turn) * DEGREE;
        let motion = RigidTransform::about(&center, &turn, &Vec3::new(8.0, -12.0, 6.0));
        let moving = moved(&fixed, &motion);
        let off = RigidTransform::about(&center, &Vec3::new(0.05, -0.06, 0.07), &Vec3::repeat(4.0));
        for (search, start) in [
            (Search::Near, motion.inverse().then(&off)),
            (Search::Wide, RigidTransform::identity()),
        ] {
            let options = Options { search, ..Options::default() };
            let found = register(&fixed, &mask, &moving, &start, &options, &Silent).unwrap();
            let twice = motion.then(&found.transform);
            let mm = (twice.point(&found.center) - found.center).norm();
            println!("{mm:.3} mm, {:.3} degrees, {found:?}", twice.angle() / DEGREE);
            assert!(mm < 0.5 && twice.angle() < 0.3 * DEGREE);
        }
    }
}

#[test]
fn two_contrasts_of_one_session_agree_from_any_start() {
    let Some(folder) = scans() else { return };
    let fixed = image(&folder, "uta11_P13_t1tse_h2.nii.gz");
    let moving = image(&folder, "uta11_P13_t2tse_h2.nii.gz");
    let mask = chest(&fixed);
    let center = Vec3::new(0.0, -150.0, 0.0);
    let run = |turn: [f64; 3], shift: [f64; 3]| {
        let start = RigidTransform::about(&center, &(Vec3::from(turn) * DEGREE), &shift.into());
        register(&fixed, &mask, &moving, &start, &Options::default(), &Silent).unwrap()
    };
    let (a, b) =
        (run([4.0, -3.0, 5.0], [8.0, -6.0, 7.0]), run([-5.0, 2.0, -4.0], [-7.0, 5.0, 5.0]));
    let apart = (a.transform.point(&a.center) - b.transform.point(&a.center)).norm();
    let moved = (a.transform.point(&a.center) - a.center).norm();
    println!(
        "{apart:.4} mm apart, {moved:.3} mm and {:.3} degrees from none; {a:?} {b:?}",
        a.transform.angle() / DEGREE
    );
    assert!(apart < 0.1 && moved < 2.0 && a.transform.angle() < DEGREE);
}
