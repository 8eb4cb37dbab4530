//! Files that cannot be what the study says: one line that names file, key and remedy, exit code 65,
//! and nothing written.

use mammotwin_data::{
    Vec3,
    io::nifti::{self, Version, VoxelType},
    labels::Tissue,
    volume::{Grid, Volume},
};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

const STUDY: &str = r#"
schema = 1
subject = { id = "x" }
[poses.prone]
image = "prone.nii"
posture = "prone"
landmarks = "prone.csv"
labels = "labels.nii"
"#;

/// Bytes of a NIfTI-1 header.
const QFORM_CODE: usize = 252;
const QUATERN_B: usize = 256;
const SROW_X: usize = 280;

/// A study with a picture of 20 x 20 x 20 voxels of 8 mm, landmarks and labels: all sound.
struct Inputs(tempfile::TempDir);

impl Inputs {
    fn new() -> Self {
        let inputs = Self(tempfile::tempdir().unwrap());
        inputs.text("study.toml", STUDY);
        inputs
            .text("prone.csv", "name,x_mm,y_mm,z_mm\nnipple_right,40,60,0\nnipple_left,-40,60,0\n");
        let grid = Grid::aligned([20; 3], [8.0; 3], Vec3::repeat(-76.0));
        let values = (0..grid.len()).map(|n| (n % 7) as f32).collect();
        let image = Volume { grid, values };
        nifti::write(&inputs.path("prone.nii"), &image, VoxelType::F32, Version::One).unwrap();
        inputs.labels(|[i, j, _]| match (i, j) {
            (0..20, 12..14) if i < 10 => Tissue::AdiposeLeft,
            (0..20, 12..14) => Tissue::AdiposeRight,
            (_, 0..12) => Tissue::Thorax,
            _ => Tissue::Background,
        });
        inputs
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn labels(&self, tissue: impl Fn([usize; 3]) -> Tissue) {
        let grid = Grid::aligned([20; 3], [8.0; 3], Vec3::repeat(-76.0));
        let values = (0..grid.len()).map(|n| tissue(grid.voxel(n))).collect();
        nifti::write_labels(&self.path("labels.nii"), &Volume { grid, values }, Version::One)
            .unwrap();
    }

    /// Overwrites bytes of the image.
    fn patch(&self, at: usize, bytes: &[u8]) {
        let mut all = fs::read(self.path("prone.nii")).unwrap();
        all[at..at + bytes.len()].copy_from_slice(bytes);
        fs::write(self.path("prone.nii"), all).unwrap();
    }

    fn files(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }

    /// `run` and `check` refuse with 65, in one line that says `parts`, and write nothing.
    #[track_caller]
    fn refused(&self, parts: &[&str]) {
        let before = self.files();
        for command in ["run", "check"] {
            let (code, error) = mammotwin(command, self.0.path());
            assert_eq!(code, Some(65), "{command}: {error}");
            assert_eq!(error.lines().count(), 1, "{command}: {error}");
            for part in parts {
                assert!(error.contains(part), "{command}: {error:?} does not say {part:?}");
            }
            assert_eq!(self.files(), before, "{command} wrote something");
        }
    }
}

fn mammotwin(command: &str, folder: &Path) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_mammotwin"))
        .args([command, "study.toml"])
        .current_dir(folder)
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn sound_inputs_pass_the_check() {
    let (code, error) = mammotwin("check", Inputs::new().0.path());
    assert_eq!((code, error.as_str()), (Some(0), ""));
}

#[test]
fn missing_files() {
    for (file, key) in
        [("prone.nii", "image"), ("prone.csv", "landmarks"), ("labels.nii", "labels")]
    {
        let inputs = Inputs::new();
        fs::remove_file(inputs.path(file)).unwrap();
        inputs.refused(&[&format!("poses.prone.{key}"), file, "relative to the study"]);
    }
}

#[test]
fn truncated_and_torn_images() {
    let inputs = Inputs::new();
    let bytes = fs::read(inputs.path("prone.nii")).unwrap();
    fs::write(inputs.path("prone.nii"), &bytes[..bytes.len() / 2]).unwrap();
    inputs.refused(&["poses.prone.image", "prone.nii"]);
    fs::write(inputs.path("prone.nii"), b"no image").unwrap();
    inputs.refused(&["poses.prone.image", "prone.nii"]);
}

#[test]
fn an_affine_that_is_no_number() {
    let inputs = Inputs::new();
    inputs.patch(SROW_X, &f32::NAN.to_le_bytes());
    inputs.refused(&["poses.prone.image", "prone.nii", "srow"]);
}

#[test]
fn a_header_whose_two_forms_are_mirrored() {
    let inputs = Inputs::new();
    inputs.patch(SROW_X, &(-8.0f32).to_le_bytes());
    // The qform is not mirrored: its code is set, and no turn is given.
    inputs.patch(QFORM_CODE, &1i16.to_le_bytes());
    inputs.patch(QUATERN_B, &[0; 12]);
    inputs.refused(&["poses.prone.image", "prone.nii", "left and right", "viewer"]);
}

#[test]
fn mirrored_landmarks_and_landmarks_outside_of_the_image() {
    let inputs = Inputs::new();
    inputs.text("prone.csv", "name,x_mm,y_mm,z_mm\nnipple_right,-40,60,0\nnipple_left,40,60,0\n");
    inputs.refused(&["poses.prone.landmarks", "nipple_right", "mirrored"]);
    inputs.text("prone.csv", "name,x_mm,y_mm,z_mm\nchest_1,400,60,0\n");
    inputs.refused(&["poses.prone.landmarks", "chest_1", "outside of the image", "RAS mm"]);
}

#[test]
fn labels_without_a_breast_or_with_a_cut_one() {
    let inputs = Inputs::new();
    inputs.labels(|_| Tissue::Background);
    inputs.refused(&["poses.prone.labels", "a breast is missing"]);
    inputs.labels(|[i, ..]| if i < 10 { Tissue::AdiposeLeft } else { Tissue::AdiposeRight });
    inputs.refused(&["poses.prone.labels", "a breast is cut by the left border"]);
}

#[test]
fn unknown_keys_and_wrong_units() {
    let inputs = Inputs::new();
    inputs.text("study.toml", &STUDY.replace("posture", "position"));
    inputs.refused(&["study.toml", "line 6", "poses.prone.position", "there are"]);
    inputs.text("study.toml", &format!("{STUDY}[mesh]\nsize_cm = 0.8\n"));
    inputs.refused(&["study.toml", "mesh.size_cm", "size_mm"]);
    inputs.text("study.toml", &format!("{STUDY}[mesh]\nsize_mm = 0.008\n"));
    inputs.refused(&["study.toml", "mesh.size_mm", "write a number from"]);
}

/// A mammogram whose dose or attenuation has no table, or whose contents have no place.
#[test]
fn mammograms_beyond_the_tables() {
    let inputs = Inputs::new();
    let compress = "[compress]\nside = \"right\"\nchest_wall_distance_mm = 20.0\n\
                    law = { name = \"neo_hookean\" }\n";
    for (stop, mammogram, parts) in [
        (15.0, "", &["compress.stop.thickness_mm", "Dance's tables", "20 - 110 mm"][..]),
        (115.0, "", &["compress.stop.thickness_mm", "Dance's tables"]),
        (46.0, "energy_kev = 55.0", &["mammogram.energy_kev", "from 5 to 50"]),
        (46.0, "energy_kev = 4.0", &["mammogram.energy_kev", "from 5 to 50"]),
        (
            46.0,
            "beam = { target_filter = \"W/Al\", kv = 28 }",
            &["mammogram.beam", "there are", "W/Rh at 28 kV"],
        ),
        (46.0, "masses = [{ radii_mm = [5, 5, 5] }]", &["mammogram.masses[0]", "center_mm"]),
        (46.0, "unit = { lag = 0.9 }", &["mammogram.unit.lag"]),
    ] {
        let stop = format!("stop = {{ thickness_mm = {stop:.1} }}\n");
        let text = format!("{STUDY}{compress}{stop}[mammogram]\n{mammogram}\n");
        inputs.text("study.toml", &text);
        inputs.refused(&[&["study.toml", "line "], parts].concat());
    }
}
