//! A BIDS folder of two volunteers and one bad participant, from images to the table of the group.

use mammotwin_data::{
    io::{landmarks, nifti},
    labels::Tissue,
    progress::Silent,
};
use mammotwin_stages::volunteer::{self, PoseName, Settings};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// Coarse and quick: it shows that all works.
const TEMPLATE: &str = r#"
[mesh]
size_mm = 15.0
[model]
breast = { law = "neo_hookean", young_right_kpa = 0.5, young_left_kpa = 0.5, poisson = 0.49 }
skin = { law = "neo_hookean", young_kpa = 3.806, thickness_mm = 2.0 }
fascia = { law = "neo_hookean", young_kpa = 118.2, thickness_mm = 0.1 }
interface = { kind = "bonded", friction = 0.0 }
[compress]
side = "right"
view = "cc"
paddle = "rigid"
chest_wall_distance_mm = 15.0
stop = { thickness_mm = 46.0 }
law = { name = "gent", jm = 1.0, poisson = 0.499 }
[mammogram]
energy_kev = 24.0
exposure = "automatic"
pixel_mm = 0.3
calcifications = { rows = 7, columns = 3, pitch_mm = 10.0, diameter_mm = [0.3] }
"#;

fn bids(folder: &Path, rest: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .args(["bids", "data", "out"])
        .args(rest)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn error(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A volunteer's folder, to take images from.
fn volunteer(folder: &Path, seed: u64, poses: &[PoseName]) -> PathBuf {
    let out_dir = folder.join(format!("dv{seed}"));
    let settings = Settings {
        preset: "tiny".into(),
        seed,
        voxel_mm: Some([4.0; 3]),
        poses: poses.to_vec(),
        hidden: BTreeMap::new(),
        still: false,
        elements: None,
        truth_mm: None,
        out_dir: out_dir.clone(),
    };
    volunteer::synthesize(&settings, &Silent).unwrap();
    out_dir
}

fn anat(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join("data").join(name).join("anat");
    fs::create_dir_all(&path).unwrap();
    path
}

fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split('\t').map(String::from));
    let head: Vec<String> = lines.next().unwrap().collect();
    lines.map(|line| head.iter().cloned().zip(line).collect()).collect()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn two_volunteers_become_derivatives_and_a_group() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let both = volunteer(folder, 7, &[PoseName::Supine, PoseName::Prone]);
    let to = anat(folder, "sub-01");
    for pose in ["supine", "prone"] {
        let image = to.join(format!("sub-01_acq-{pose}_T1w.nii.gz"));
        fs::copy(both.join(format!("{pose}.nii.gz")), image).unwrap();
        let marks = to.join(format!("sub-01_acq-{pose}_landmarks.csv"));
        fs::copy(both.join(format!("{pose}_landmarks.csv")), marks).unwrap();
    }
    // The second one lies in a session; her landmarks are voxels in a sidecar, which holds for what is
    // below it.
    let one = volunteer(folder, 9, &[PoseName::Supine]);
    let to = anat(folder, "sub-02/ses-a");
    let image = to.join("sub-02_ses-a_acq-supine_T1w.nii.gz");
    fs::copy(one.join("supine.nii.gz"), &image).unwrap();
    let grid = nifti::read(&image).unwrap().grid;
    let inverse = grid.axes.try_inverse().unwrap();
    let marks = landmarks::read(&one.join("supine_landmarks.csv")).unwrap();
    let voxels: BTreeMap<&String, [f64; 3]> =
        marks.0.iter().map(|(name, p)| (name, (inverse * (p - grid.origin)).into())).collect();
    let told = serde_json::json!({ "AnatomicalLandmarkCoordinates": voxels });
    let above = to.parent().unwrap().join("sub-02_ses-a_acq-supine_T1w.json");
    fs::write(above, told.to_string()).unwrap();
    // Of the third one nobody knows how she sat.
    let to = anat(folder, "sub-03");
    fs::copy(&image, to.join("sub-03_acq-sitting_T1w.nii.gz")).unwrap();
    fs::write(folder.join("template.toml"), TEMPLATE).unwrap();

    let done = bids(folder, &["participant", "--template", "template.toml"]);
    let said = error(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(said.contains("1 of 3 participants failed: 03"), "{said}");
    assert!(said.contains("write GravityInImage (RAS) into"), "{said}");

    let out = folder.join("out");
    let told = json(&out.join("dataset_description.json"));
    assert_eq!(told["DatasetType"], "derivative");
    assert_eq!(told["GeneratedBy"][0]["Name"], "mammotwin");
    for name in [
        "README.md",
        "sub-01.html",
        "sub-01/anat/sub-01_acq-prone_desc-tissues_dseg.nii.gz",
        "sub-01/anat/sub-01_from-prone_to-supine_mode-image_xfm.txt",
        "sub-01/sub-01_desc-mammotwin_results.h5",
        "sub-02.html",
        "sub-02/anat/sub-02_acq-supine_desc-tissues_dseg.nii.gz",
        "sub-02/sub-02_desc-calcifications300um_mammogram.png",
        "sub-02/sub-02_desc-mammotwin_metrics.tsv",
        "sub-03/sub-03_status.json",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    assert!(!out.join("sub-03.html").exists());
    // Every segmentation says what it is of, and what its labels are.
    let told = json(&out.join("dataset_description.json"));
    assert_eq!(told["DatasetLinks"]["raw"], "../data");
    let supine = "sub-02/anat/sub-02_acq-supine_desc-tissues_dseg.json";
    let told = json(&out.join(supine));
    assert_eq!(told["Manual"], false);
    let image = "sub-02/ses-a/anat/sub-02_ses-a_acq-supine_T1w.nii.gz";
    assert_eq!(told["Sources"], serde_json::json!([format!("bids:raw:{image}")]));
    let told = json(&out.join("desc-tissues_dseg.json"));
    assert!(told["Description"].is_string() && told["SpatialReference"] == "orig");
    let labels = table(&out.join("desc-tissues_dseg.tsv"));
    let found = nifti::read_labels(&out.join(supine).with_extension("nii.gz")).unwrap();
    for tissue in &found.values {
        let index = tissue.label().to_string();
        let line = labels.iter().find(|line| line["index"] == index).unwrap();
        assert!(!line["name"].is_empty() && line["color"].len() == 7, "{line:?}");
    }
    // Landmarks came through voxels and back.
    let again = landmarks::read(&out.join("work/sub-02/supine_landmarks.csv")).unwrap();
    for (name, place) in &marks.0 {
        assert!((again.0[name] - place).norm() < 1e-6, "{name}");
    }

    let done = bids(folder, &["group"]);
    assert!(done.status.success(), "{}", error(&done));
    let rows = table(&out.join("group_metrics.tsv"));
    let of = |name: &str| -> Vec<&str> { rows.iter().map(|row| row[name].as_str()).collect() };
    assert_eq!(of("participant_id"), ["sub-01", "sub-02", "sub-03"]);
    assert_eq!(of("status"), ["done", "done", "failed"]);
    assert_eq!(of("thickness_mm"), ["46", "46", "n/a"]);
    assert_eq!(of("prone_modified_hausdorff_mm")[1..], ["n/a", "n/a"]);
    let forces: Vec<f64> = of("force_n")[..2].iter().map(|f| f.parse().unwrap()).collect();
    assert!(forces.iter().all(|force| *force > 0.0) && forces[0] != forces[1], "{forces:?}");
    // The table of the group says what those of its participants say.
    for (row, label) in rows.iter().zip(["01", "02"]) {
        let name = format!("sub-{label}/sub-{label}_desc-mammotwin_metrics.tsv");
        let own = &table(&out.join(name))[0];
        assert!(own.len() > 20 && own.iter().all(|(name, value)| row[name] == *value), "{label}");
    }
    let told = json(&out.join("group_metrics.json"));
    assert!(
        rows[0]
            .keys()
            .skip_while(|k| *k == "participant_id")
            .all(|name| { name == "participant_id" || told[name]["Units"].is_string() })
    );
    let page = fs::read_to_string(out.join("group.html")).unwrap();
    assert!(page.contains("href=\"sub-02.html\"") && page.contains("2 of 3 participants"));

    // All is there: asked again it is the same, and one participant can be asked alone.
    let first = fs::read(out.join("sub-02/sub-02_desc-mammotwin_results.h5")).unwrap();
    let alone = ["participant", "--participant-label", "02", "--template", "template.toml"];
    let done = bids(folder, &alone);
    // What the segmentation warned of is said again; what is computed has its seconds and megabytes.
    let computed =
        error(&done).lines().any(|line| line.contains("segment") && line.contains(" MB"));
    assert!(done.status.success() && !computed, "{}", error(&done));
    let again = fs::read(out.join("sub-02/sub-02_desc-mammotwin_results.h5")).unwrap();
    assert!(first == again, "the same bytes");

    // Labels that a person edits: the derivatives have hers, and say so.
    let edited = out.join("work/sub-02/out/labels/supine.nii.gz");
    let mut labels = found;
    let fat = labels.values.iter().position(|tissue| *tissue == Tissue::AdiposeRight).unwrap();
    labels.values[fat] = Tissue::FibroglandularRight;
    nifti::write_labels(&edited, &labels, nifti::Version::One).unwrap();
    let done = bids(folder, &alone);
    assert!(done.status.success(), "{}", error(&done));
    assert_eq!(json(&out.join(supine))["Manual"], true);
    let published = nifti::read_labels(&out.join(supine).with_extension("nii.gz")).unwrap();
    assert_eq!(published.values[fat], Tissue::FibroglandularRight);
}

#[test]
fn folders_that_cannot_be_meant_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let refused = |rest: &[&str], code: i32, says: &str| {
        let done = bids(folder, rest);
        assert_eq!(done.status.code(), Some(code), "{}", error(&done));
        assert!(error(&done).contains(says), "{} does not say {says}", error(&done));
    };
    refused(&["participant"], 65, "no such folder");
    fs::create_dir(folder.join("data")).unwrap();
    refused(&["participant"], 65, "a BIDS folder has folders sub-LABEL");
    let to = anat(folder, "sub-01");
    refused(&["participant", "--participant-label", "07"], 2, "there are: 01");
    refused(&["participant"], 65, "name it sub-LABEL_acq-POSE_T1w.nii.gz");
    refused(&["group"], 65, "run the level participant first");
    fs::write(to.join("sub-01_acq-supine_T1w.nii.gz"), "no image").unwrap();
    fs::write(to.join("sub-01_acq-supine_T2w.nii"), "no image").unwrap();
    refused(&["participant"], 65, "the pose supine has another image");
    fs::remove_file(to.join("sub-01_acq-supine_T2w.nii")).unwrap();
    refused(&["participant"], 65, "sub-01_acq-supine_T1w.nii.gz");
    fs::write(folder.join("t.toml"), "[subject]\nid = \"x\"\n").unwrap();
    let with = ["participant", "--template", "t.toml"];
    refused(&with, 65, "[subject] comes from the BIDS folder");
    fs::write(folder.join("t.toml"), "[bids]\nvalidates = []\n").unwrap();
    refused(&with, 65, "t.toml: [bids]");
    refused(&["everybody"], 2, "possible values: participant, group");
}
