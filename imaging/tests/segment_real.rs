//! The segmentation of a real scan.
//!
//! Without the scans that `MAMMOTWIN_DATA` names, this test says so and passes.

use mammotwin_data::{
    labels::{Side, Tissue},
    progress::Silent,
    volume::Volume,
};
use mammotwin_imaging::mri::{
    distance_field::{FieldPlan, level_field},
    segment::{Limits, Options, SegmentError, Segmentation, Warning, segment},
    smooth::project,
    surface::{crossings::crossings, surface},
};

/// A volume (mm³), and how much of it lies behind a voxel of the chest wall.
fn breast_and_behind_wall(labels: &Volume<Tissue>, side: Side, limits: &Limits) -> [f64; 2] {
    let grid = &labels.grid;
    let [ni, nj, nk] = grid.shape;
    let to_front = grid.axes[(1, 1)] > 0.0;
    let mut found = [0.0; 2];
    for (i, k) in (0..nk).flat_map(|k| (0..ni).map(move |i| (i, k))) {
        let mut wall_in_front = false;
        for step in 0..nj {
            let voxel = [i, if to_front { nj - 1 - step } else { step }, k];
            let tissue = labels.at(voxel);
            let across = (grid.center(voxel) - limits.sternal_point).dot(&limits.sternal_normal);
            wall_in_front |= tissue.is_chest_wall();
            if tissue.is_breast() && across * side.sign() > 0.0 {
                found[0] += grid.voxel_mm3();
                found[1] += if wall_in_front { grid.voxel_mm3() } else { 0.0 };
            }
        }
    }
    found
}

/// Reads a scan; `None` without the scans.
fn read(name: &str) -> Option<Volume<f32>> {
    let Some(data) = std::env::var_os("MAMMOTWIN_DATA") else {
        println!("skipped: no real data");
        return None;
    };
    let folder = std::path::Path::new(&data).join("data/mr_prone");
    Some(mammotwin_data::io::nifti::read(&folder.join(name)).unwrap())
}

/// Reads a scan and segments it; `None` without the scans.
fn segmented(name: &str) -> Option<Result<(Volume<f32>, Segmentation), SegmentError>> {
    let image = read(name)?;
    let found = segment(&image, &Options::default(), &Silent);
    Some(found.map(|found| (image, found)))
}

fn dice(a: &Volume<Tissue>, b: &Volume<Tissue>, of: impl Fn(Tissue) -> bool) -> f64 {
    let both = a.values.iter().zip(&b.values).filter(|(a, b)| of(**a) && of(**b)).count();
    let sum = a.values.iter().chain(&b.values).filter(|tissue| of(**tissue)).count();
    2.0 * both as f64 / sum as f64
}

/// Number of background voxels that no path of background joins to the border of the image.
fn enclosed_air(labels: &Volume<Tissue>) -> usize {
    let shape = labels.grid.shape;
    let mut outside = vec![false; labels.values.len()];
    let air = |n: usize| labels.values[n] == Tissue::Background;
    let at_border = |n: &usize| {
        let voxel = labels.grid.voxel(*n);
        (0..3).any(|axis| voxel[axis] == 0 || voxel[axis] + 1 == shape[axis])
    };
    let mut queue: Vec<usize> =
        (0..labels.values.len()).filter(at_border).filter(|&n| air(n)).collect();
    while let Some(n) = queue.pop() {
        if std::mem::replace(&mut outside[n], true) {
            continue;
        }
        let voxel = labels.grid.voxel(n);
        for axis in 0..3 {
            for to in [voxel[axis].wrapping_sub(1), voxel[axis] + 1] {
                let mut next = voxel;
                next[axis] = to;
                if to < shape[axis] && air(labels.grid.index(next)) {
                    queue.push(labels.grid.index(next));
                }
            }
        }
    }
    (0..outside.len()).filter(|&n| air(n) && !outside[n]).count()
}

/// What an adult's chest must show, whatever the contrast of the image.
#[track_caller]
fn check_anatomy(name: &str, image: &Volume<f32>, found: &Segmentation) {
    let [right, left] = [Side::Right, Side::Left]
        .map(|side| breast_and_behind_wall(&found.labels, side, &found.limits));
    println!("{name}: breast, behind wall (mm³) {right:?} {left:?}, {:?}", found.warnings);
    for [volume, behind] in [right, left] {
        assert!((600e3..1600e3).contains(&volume), "{volume}");
        assert!(behind < 0.01 * volume, "{behind} of {volume}");
    }
    assert!((right[0] / left[0]).ln().abs() < 0.25);
    let muscle = found.labels.values.iter().filter(|t| **t == Tissue::PectoralMuscle).count();
    let muscle_mm3 = muscle as f64 * image.grid.voxel_mm3();
    let wall = &found.chest_wall;
    let thickness = muscle_mm3 / wall.area_mm2();
    assert!((4.0..14.0).contains(&thickness), "muscle of {thickness} mm");
    assert!(found.wall_seen > 0.5, "{}", found.wall_seen);
    assert_eq!(enclosed_air(&found.labels), 0, "the body has holes");
    let normals = found.chest_wall.vertex_normals();
    let mut bends: Vec<f64> = found
        .chest_wall
        .triangles
        .iter()
        .map(|t| normals[t[0] as usize].angle(&normals[t[1] as usize]).to_degrees())
        .collect();
    bends.sort_by(f64::total_cmp);
    let bend = bends[bends.len() * 95 / 100];
    println!(
        "{name}: wall seen {:.2}, 95 % of it bends by less than {bend:.1} degrees a step, muscle \
         {thickness:.1} mm",
        found.wall_seen
    );
    assert!(bend < 20.0);
}

/// T1 and T2 weighted images of one person in one session, on one grid: two contrasts, one anatomy.
#[test]
fn two_contrasts_of_a_real_prone_chest_give_one_plausible_anatomy() {
    let names = ["uta11_P13_t2tse_h2.nii.gz", "uta11_P13_t1tse_h2.nii.gz"];
    let mut labels = Vec::new();
    for name in names {
        let Some(found) = segmented(name) else { return };
        let (image, found) = found.unwrap();
        check_anatomy(name, &image, &found);
        labels.push(found.labels);
    }
    let of = |part: fn(Tissue) -> bool| dice(&labels[0], &labels[1], part);
    let body = of(|tissue| tissue != Tissue::Background);
    let (breast, wall) = (of(Tissue::is_breast), of(Tissue::is_chest_wall));
    println!("T1 and T2 agree: body {body:.3}, breast {breast:.3}, chest wall {wall:.3}");
    assert!(body > 0.97 && breast > 0.95 && wall > 0.97);
}

/// The labels of the nearest voxels of another image of the same session; `None` outside of it.
fn on_grid_of(labels: &Volume<Tissue>, other: &Volume<Tissue>) -> Vec<Option<Tissue>> {
    let to_voxel = labels.grid.to_voxel();
    let nearest = |n: usize| {
        let at = to_voxel.apply(&other.grid.center(other.grid.voxel(n))).map(f64::round);
        let inside =
            (0..3).all(|axis| at[axis] >= 0.0 && at[axis] < labels.grid.shape[axis] as f64);
        inside.then(|| labels.at([0, 1, 2].map(|axis| at[axis] as usize)))
    };
    (0..other.values.len()).map(nearest).collect()
}

/// Suppressed fat in front of brighter muscle: two persons. The one's T2 image was taken in the same session; she
/// moved between, and to the side, where a thin layer covers the chest, the two contrasts agree less.
#[test]
fn images_with_fat_suppression_are_divided() {
    for name in ["uta11_P13_t1fs_pre_h2.nii.gz", "uta11_P02_t1fs_h2.nii.gz"] {
        let Some(found) = segmented(name) else { return };
        let (image, found) = found.unwrap();
        assert!(found.warnings.contains(&Warning::SuppressedFat), "{name}");
        let sides = [Side::Right, Side::Left];
        let volumes =
            sides.map(|side| breast_and_behind_wall(&found.labels, side, &found.limits)[0]);
        let muscle = found.labels.values.iter().filter(|t| **t == Tissue::PectoralMuscle).count();
        let thickness = muscle as f64 * image.grid.voxel_mm3() / found.chest_wall.area_mm2();
        println!(
            "{name}: breasts (mm³) {volumes:?}, wall seen {:.2}, muscle {thickness:.1} mm",
            found.wall_seen
        );
        assert!(volumes.iter().all(|volume| (600e3..2200e3).contains(volume)));
        assert!((volumes[0] / volumes[1]).ln().abs() < 0.25);
        assert!((4.0..14.0).contains(&thickness) && found.wall_seen > 0.5);
        assert_eq!(enclosed_air(&found.labels), 0, "the body has holes");
        if name.contains("P13") {
            let reference = segmented("uta11_P13_t2tse_h2.nii.gz").unwrap().unwrap().1.labels;
            let reference = on_grid_of(&reference, &found.labels);
            let agree = |of: fn(Tissue) -> bool| {
                let pairs = found.labels.values.iter().zip(&reference);
                let [mut both, mut sum] = [0, 0];
                for (a, b) in pairs.filter_map(|(a, b)| Some((of(*a), of((*b)?)))) {
                    both += usize::from(a && b);
                    sum += usize::from(a) + usize::from(b);
                }
                2.0 * both as f64 / sum as f64
            };
            let (breast, wall) = (agree(Tissue::is_breast), agree(Tissue::is_chest_wall));
            println!("{name}: breast {breast:.3} and chest wall {wall:.3} as in the T2 image");
            assert!(breast > 0.78 && wall > 0.93);
        }
    }
}

/// Skin and chest wall of the labels; and of every image what is brighter than air, as rough as it comes.
/// Without mending triangles of it do pass through each other, as those of one skin do.
#[test]
#[ignore = "minutes: four chests, each with and without mending"]
fn no_surface_of_a_real_chest_passes_through_itself() {
    let mut before = 0;
    for name in [
        "uta11_P13_t2tse_h2.nii.gz",
        "uta11_P13_t1tse_h2.nii.gz",
        "uta11_P13_t1fs_pre_h2.nii.gz",
        "uta11_P02_t1fs_h2.nii.gz",
    ] {
        let Some(image) = read(name) else { return };
        let mut sizes = image.values.clone();
        sizes.sort_by(f32::total_cmp);
        let air = 0.1 * sizes[sizes.len() * 95 / 100];
        let mut masks = vec![image.map(|value| value > air)];
        if let Ok(found) = segment(&image, &Options::default(), &Silent) {
            masks.push(found.labels.map(|tissue| tissue != Tissue::Background));
            masks.push(found.labels.map(Tissue::is_chest_wall));
        }
        for mask in masks {
            let field = level_field(&mask, &FieldPlan::of_spacing(1.5)).unwrap();
            let surface = surface(&field);
            let unmended = crossings(&project(&surface, &field)).len();
            println!("{name}: {} triangles, {unmended} pairs unmended", surface.triangles.len());
            assert!(crossings(&surface).is_empty());
            before += unmended;
        }
    }
    assert!(before > 0, "no surface had to be mended");
}
