//! The segmentation of a real scan.
//!
//! Without the scans that `MAMMOTWIN_DATA` names, this test says so and passes.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::{
    labels::{Side, Tissue},
    progress::Silent,
    volume::Volume,
};
use mammotwin_imaging::mri::segment::{Limits, Options, segment};

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

#[test]
fn a_real_prone_scan_gives_plausible_breasts_and_a_smooth_wall() {
    let Some(data) = std::env::var_os("MAMMOTWIN_DATA") else {
        println!("skipped: no real data");
        return;
    };
    let folder = std::path::Path::new(&data).join("data/mr_prone");
    let name = "uta11_P13_t2tse_h2.nii.gz";
    let image = mammotwin_data::io::nifti::read(&folder.join(name)).unwrap();
    let found = segment(&image, &Options::default(), &Silent).unwrap();
    let [right, left] = [Side::Right, Side::Left]
        .map(|side| breast_and_behind_wall(&found.labels, side, &found.limits));
    println!("{name}: breast, behind wall (mm³) {right:?} {left:?}, {:?}", found.warnings);
    for [volume, behind] in [right, left] {
        assert!((600e3..1600e3).contains(&volume), "{volume}");
        assert!(behind < 0.01 * volume, "{behind} of {volume}");
    }
    assert!((right[0] / left[0]).ln().abs() < 0.25);
    let muscle = found.labels.values.iter().filter(|t| **t == Tissue::PectoralMuscle).count();
    let muscle_ml = muscle as f64 * image.grid.voxel_mm3() / 1e3;
    assert!((100.0..900.0).contains(&muscle_ml), "{muscle_ml}");
    assert!(found.wall_seen > 0.6);
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
        "95 % of the wall bends by less than {bend:.1} degrees a step, muscle {muscle_ml:.0} ml"
    );
    assert!(bend < 20.0);
}
