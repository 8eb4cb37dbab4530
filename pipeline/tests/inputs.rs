//! What a person may give beside an image, in a study: finished labels and a few marked voxels.

use mammotwin_data::{
    Vec3,
    io::{
        hdf5,
        nifti::{self, Version, VoxelType},
    },
    labels::{LabelMap, Tissue},
    volume::Volume,
};
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

fn mammotwin(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mammotwin"));
    command.arg("-q").args(arguments).output().unwrap()
}

fn until(stage: &str, study: &Path) -> Output {
    mammotwin(&["run", study.to_str().unwrap(), "--until", stage])
}

/// Gland (cm³) of the right breast in the prone pose, of labels that a person drew.
fn gland_cm3(study: &Path, labels: &LabelMap) -> f64 {
    let folder = study.parent().unwrap();
    nifti::write_labels(&folder.join("drawn.nii.gz"), labels, Version::One).unwrap();
    let kept = folder.join("out/cache/measure");
    fs::remove_dir_all(&kept).ok();
    done(&until("measure:prone", study));
    let result = fs::read_dir(kept).unwrap().next().unwrap().unwrap().path().join("result.h5");
    let sides: serde_json::Value = hdf5::Reader::open(&result).unwrap().json("sides").unwrap();
    assert_eq!(sides[0]["side"], "right");
    sides[0]["gland_cm3"].as_f64().unwrap()
}

#[track_caller]
fn done(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The study with a line more in its prone pose.
fn with(study: &str, line: &str) -> String {
    let image = "image = \"prone.nii.gz\"\n";
    assert!(study.contains(image));
    study.replace(image, &format!("{image}{line}\n"))
}

/// Voxels amid one tissue, every so many of each, marked with its label; 10 for air.
fn marks(truth: &LabelMap) -> Volume<f32> {
    let shape = truth.grid.shape;
    let alone = |voxel: [usize; 3]| {
        (0..27).map(|n| [n % 3, n / 3 % 3, n / 9]).all(|d| {
            let at = [0, 1, 2].map(|axis| (voxel[axis] + d[axis]).wrapping_sub(1));
            (0..3).all(|axis| at[axis] < shape[axis]) && truth.at(at) == truth.at(voxel)
        })
    };
    let mut marks = Volume::filled(truth.grid.clone(), 0.0);
    for tissue in [
        Tissue::Background,
        Tissue::AdiposeRight,
        Tissue::AdiposeLeft,
        Tissue::FibroglandularRight,
        Tissue::FibroglandularLeft,
        Tissue::PectoralMuscle,
        Tissue::Thorax,
    ] {
        let inside: Vec<usize> = (0..truth.values.len())
            .filter(|&n| truth.values[n] == tissue && alone(truth.grid.voxel(n)))
            .collect();
        assert!(inside.len() > 20, "{tissue:?}: {}", inside.len());
        for &n in inside.iter().step_by((inside.len() / 150).max(1)) {
            marks.values[n] =
                if tissue == Tissue::Background { 10.0 } else { tissue.label().into() };
        }
    }
    marks
}

/// The middle (mm) of a tissue of the right side.
fn middle(labels: &LabelMap, tissue: Tissue) -> Vec3 {
    let places = (0..labels.values.len()).filter(|&n| labels.values[n] == tissue);
    let places: Vec<Vec3> = places.map(|n| labels.grid.center(labels.grid.voxel(n))).collect();
    places.iter().sum::<Vec3>() / places.len() as f64
}

fn dice(found: &LabelMap, truth: &LabelMap, of: impl Fn(Tissue) -> bool) -> f64 {
    let pairs = || found.values.iter().zip(&truth.values).map(|(f, t)| (of(*f), of(*t)));
    let both = pairs().filter(|(f, t)| *f && *t).count();
    let each: usize = pairs().map(|(f, t)| usize::from(f) + usize::from(t)).sum();
    2.0 * both as f64 / each as f64
}

#[test]
fn finished_labels_and_marks_are_what_a_study_goes_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let [volunteer, study] = ["dv", "dv/study.toml"].map(at);
    let synth = ["synth", "--preset", "tiny", "--seed", "5", "--poses", "supine,prone"];
    let out = ["--voxel-mm", "2.5", "--out", volunteer.to_str().unwrap()];
    done(&mammotwin(&[&synth[..], &out].concat()));
    let text = fs::read_to_string(&study).unwrap();
    let found = at("dv/out/labels/prone.nii.gz");
    let truth = nifti::read_labels(&at("dv/truth/prone_labels.nii.gz")).unwrap();

    // Labels of a person are taken as they are: gland that she draws is gland.
    fs::write(&study, with(&text, "labels = \"drawn.nii.gz\"")).unwrap();
    let before = gland_cm3(&study, &truth);
    let mut drawn = truth.clone();
    let middle = middle(&drawn, Tissue::FibroglandularRight);
    let fat = (0..drawn.values.len()).filter(|&n| drawn.values[n] == Tissue::AdiposeRight);
    let mut fat: Vec<usize> = fat.collect();
    let far = |n: usize| (drawn.grid.center(drawn.grid.voxel(n)) - middle).norm();
    fat.sort_by(|&a, &b| far(a).total_cmp(&far(b)));
    fat[..40].iter().for_each(|&n| drawn.values[n] = Tissue::FibroglandularRight);
    let more = gland_cm3(&study, &drawn) - before;
    let wanted = 40.0 * drawn.grid.voxel_mm3() / 1000.0;
    assert!((more - wanted).abs() < 1e-9 * before, "{more} for {wanted} cm³ of {before}");

    // An image with the contrast the other way round is refused alone, and divided with marks.
    let mut image = nifti::read(&at("dv/prone.nii.gz")).unwrap();
    let most = image.values.iter().copied().fold(0.0, f32::max);
    let body = image.values.iter_mut().zip(&truth.values);
    body.filter(|(_, tissue)| **tissue != Tissue::Background).for_each(|(v, _)| *v = most - *v);
    nifti::write(&at("dv/prone.nii.gz"), &image, VoxelType::F32, Version::One).unwrap();
    fs::write(&study, &text).unwrap();
    let refused = until("segment:prone", &study);
    let says = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(65), "{says}");
    assert!(says.contains("scribbles"), "{says}");
    nifti::write(&at("dv/marks.nii.gz"), &marks(&truth), VoxelType::U8, Version::One).unwrap();
    fs::write(&study, with(&text, "scribbles = \"marks.nii.gz\"")).unwrap();
    done(&until("segment:prone", &study));
    let labels = nifti::read_labels(&found).unwrap();
    let [breast, muscle, gland] = [
        dice(&labels, &truth, Tissue::is_breast),
        dice(&labels, &truth, |tissue| tissue == Tissue::PectoralMuscle),
        dice(&labels, &truth, Tissue::is_gland),
    ];
    println!("Dice of breast {breast:.3}, muscle {muscle:.3}, gland {gland:.3}");
    assert!(breast > 0.9 && muscle > 0.8 && gland > 0.6);
}
