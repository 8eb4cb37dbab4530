//! A sound pose, and one thing wrong with it at a time.

use super::*;
use mammotwin_data::{
    Vec3,
    io::nifti::{Version, VoxelType},
    study::parse,
};
use std::fs;

const STUDY: &str = r#"
schema = 1
subject = { id = "x" }
[poses.prone]
image = "prone.nii.gz"
posture = "prone"
landmarks = "prone.csv"
labels = "labels.nii.gz"
"#;

/// A folder with an image, landmarks and labels of 20 x 20 x 20 voxels of 8 mm.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.image(8.0);
        folder.landmarks("nipple_right,40,60,0\nnipple_left,-40,60,0\n");
        folder.labels([8, 10, 10]);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn grid(step: f64) -> Grid {
        Grid::aligned([20; 3], [step; 3], Vec3::repeat(-9.5 * step))
    }

    fn image(&self, step: f64) {
        let grid = Self::grid(step);
        let values = (0..grid.len()).map(|n| (n % 7) as f32).collect();
        let image = Volume { grid, values };
        nifti::write(&self.path("prone.nii.gz"), &image, VoxelType::F32, Version::One).unwrap();
    }

    fn landmarks(&self, rows: &str) {
        fs::write(self.path("prone.csv"), format!("name,x_mm,y_mm,z_mm\n{rows}")).unwrap();
    }

    /// One voxel of each breast; the left one is at `voxel`.
    fn labels(&self, voxel: [usize; 3]) {
        self.labels_of(voxel, |_| false);
    }

    /// The same, and more of the left breast.
    fn labels_of(&self, voxel: [usize; 3], more: impl Fn([usize; 3]) -> bool) {
        let mut labels = Volume::filled(Self::grid(8.0), Tissue::Background);
        for n in 0..labels.values.len() {
            if more(labels.grid.voxel(n)) {
                labels.values[n] = Tissue::AdiposeLeft;
            }
        }
        let right = labels.grid.index([12, 10, 10]);
        labels.values[right] = Tissue::AdiposeRight;
        let left = labels.grid.index(voxel);
        labels.values[left] = Tissue::FibroglandularLeft;
        nifti::write_labels(&self.path("labels.nii.gz"), &labels, Version::One).unwrap();
    }

    #[track_caller]
    fn says(&self, key: &str, weight: Weight, part: &str) {
        let found = findings(&parse(STUDY).unwrap(), self.0.path());
        let hit = |f: &Finding| f.key == key && f.weight == weight && f.text.contains(part);
        assert!(found.iter().any(hit), "{found:#?}");
    }
}

#[test]
fn a_sound_pose_is_good() {
    let found = findings(&parse(STUDY).unwrap(), Folder::new().0.path());
    assert!(found.iter().all(|finding| finding.weight == Weight::Good), "{found:#?}");
    assert_eq!(found.len(), 2);
}

#[test]
fn missing_and_torn_files_are_named() {
    let folder = Folder::new();
    fs::remove_file(folder.path("prone.csv")).unwrap();
    folder.says("poses.prone.landmarks", Weight::Wrong, "prone.csv");
    let bytes = fs::read(folder.path("prone.nii.gz")).unwrap();
    fs::write(folder.path("prone.nii.gz"), &bytes[..bytes.len() / 2]).unwrap();
    folder.says("poses.prone.image", Weight::Wrong, "prone.nii.gz");
}

#[test]
fn mirrored_names_are_found() {
    let folder = Folder::new();
    folder.landmarks("nipple_right,-40,60,0\nnipple_left,40,60,0\n");
    folder.says("poses.prone.landmarks", Weight::Wrong, "mirrored");
}

#[test]
fn landmarks_outside_of_the_image_are_found() {
    let folder = Folder::new();
    folder.landmarks("nipple_right,400,60,0\n");
    folder.says("poses.prone.landmarks", Weight::Wrong, "nipple_right (400.0, 60.0, 0.0) mm");
}

#[test]
fn an_image_in_metres_is_found() {
    let folder = Folder::new();
    folder.image(0.008);
    folder.says("poses.prone.image", Weight::Wrong, "pixdim[1]");
}

#[test]
fn labels_that_miss_or_cut_a_breast_or_lie_elsewhere_are_found() {
    let folder = Folder::new();
    folder.labels_of([8, 10, 10], |[i, j, _]| i == 0 && j > 5);
    folder.says("poses.prone.labels", Weight::Wrong, "left border");
    folder.labels_of([8, 10, 10], |[i, j, k]| j == 19 && i < 10 && k == 10);
    folder.says("poses.prone.labels", Weight::Wrong, "front border");
    folder.labels([12, 10, 10]);
    folder.says("poses.prone.labels", Weight::Wrong, "label 1 or 3");
    folder.image(7.0);
    folder.says("poses.prone.labels", Weight::Wrong, "another grid");
}

/// A compression of the study, with more in it.
fn compressed(more: &str, size_mm: f64) -> Study {
    let text = format!(
        "{STUDY}\n[mesh]\nsize_mm = {size_mm:.1}\n[compress]\nside = \"right\"\n{more}\n\
         chest_wall_distance_mm = 15.0\nstop = {{ force_n = 5.0 }}\nlaw = {{ name = \"neo_hookean\" }}\n"
    );
    parse(&text).unwrap()
}

#[test]
fn a_compression_on_coarse_elements_is_warned_of() {
    let folder = Folder::new();
    let coarse = |size_mm: f64| {
        let found = findings(&compressed("", size_mm), folder.0.path());
        found.into_iter().find(|f| f.key == "mesh.size_mm")
    };
    let warned = coarse(14.0).unwrap();
    assert!(warned.weight == Weight::Warning && warned.text.contains("up to twice"), "{warned:?}");
    assert_eq!(coarse(10.0), None);
    // Without a compression nothing is pressed.
    let text = format!("{STUDY}\n[mesh]\nsize_mm = 14.0\n");
    let found = findings(&parse(&text).unwrap(), folder.0.path());
    assert!(found.iter().all(|f| f.key != "mesh.size_mm"), "{found:#?}");
}

#[test]
fn a_measured_hinge_is_told_with_its_r_squared() {
    let folder = Folder::new();
    let study = compressed("paddle = \"flex\"\nhinge = { file = \"hinge.csv\" }", 8.0);
    let told = |rows: &str| {
        let text = format!("angle_deg,force_n,lever_mm\n{rows}");
        fs::write(folder.path("hinge.csv"), text).unwrap();
        let found = findings(&study, folder.0.path());
        found.into_iter().find(|f| f.key == "compress.hinge.file").unwrap()
    };
    let good = told("1,5,100\n2,10.5,100\n3,16.5,100\n4,23,100\n");
    assert!(good.weight == Weight::Good && good.text.contains("4 readings to 4.0°"), "{good:?}");
    assert!(good.text.contains("R² = 0.9999") || good.text.contains("R² = 1.0000"), "{good:?}");
    assert_eq!(told("1,5,100\n1,20,100\n2,6,100\n3,30,100\n").weight, Weight::Warning);
    let wrong = told("1,5,100\n2,ten,100\n");
    assert!(wrong.weight == Weight::Wrong && wrong.text.contains("line 3: force_n"), "{wrong:?}");
}

#[test]
fn poses_without_a_common_marker_on_the_breasts_are_warned_of() {
    let folder = Folder::new();
    fs::copy(folder.path("prone.nii.gz"), folder.path("supine.nii.gz")).unwrap();
    let study = format!(
        "{STUDY}[poses.supine]\nimage = \"supine.nii.gz\"\nposture = \"supine\"\nlandmarks = \"supine.csv\"\n"
    );
    let warned = |study: &str, rows: &str| {
        fs::write(folder.path("supine.csv"), format!("name,x_mm,y_mm,z_mm\n{rows}")).unwrap();
        let found = findings(&parse(study).unwrap(), folder.0.path());
        let about = found.into_iter().filter(|f| f.text.contains("breast_... and nipple_..."));
        about.map(|f| (f.key, f.weight)).collect::<Vec<_>>()
    };
    let warning = [("poses.prone.landmarks".to_owned(), Weight::Warning)];
    assert_eq!(warned(&study, "nipple_right,41,60,0\n"), []);
    assert_eq!(warned(&study, "chest_sternum_superior,0,60,0\n"), warning);
    let without = study.replace("landmarks = \"prone.csv\"\n", "");
    assert_eq!(warned(&without, "nipple_right,41,60,0\n"), warning);
    assert_eq!(warned(STUDY, ""), [], "one pose alone needs none");
}

#[test]
fn numbered_labels_and_scribbles_are_looked_at_too() {
    let folder = Folder::new();
    let study =
        |from: &str, to: &str| findings(&parse(&STUDY.replace(from, to)).unwrap(), folder.0.path());
    let said = |found: &[Finding], key: &str, weight: Weight| -> String {
        let own = found.iter().filter(|f| f.key == key && f.weight == weight);
        own.map(|finding| finding.text.clone()).collect::<Vec<_>>().join("; ")
    };
    // The same labels, numbered by another program.
    let labels = nifti::read_labels(&folder.path("labels.nii.gz")).unwrap();
    let numbered = labels.map(|tissue| 100 * u16::from(tissue.label()));
    let path = folder.path("numbered.nii.gz");
    nifti::write_raw_labels(&path, &numbered, Version::One).unwrap();
    let key = "labels = \"labels.nii.gz\"";
    let with = |map: &str| study(key, &format!("labels = \"numbered.nii.gz\"\nlabel_map = {map}"));
    let all = with("{ 100 = \"adipose\", 400 = \"fibroglandular\" }");
    assert_eq!(said(&all, "poses.prone.labels", Weight::Wrong), "");
    let few = with("{ 100 = \"adipose\" }");
    assert!(said(&few, "poses.prone.labels", Weight::Wrong).contains("does not name 400"));

    let mut marks = Volume::filled(Folder::grid(8.0), 0u16);
    let path = folder.path("marks.nii.gz");
    let scribbles = |marks: &Volume<u16>| {
        nifti::write_raw_labels(&path, marks, Version::One).unwrap();
        study(key, "scribbles = \"marks.nii.gz\"")
    };
    let none = scribbles(&marks);
    assert!(said(&none, "poses.prone.scribbles", Weight::Wrong).contains("no voxel is marked"));
    (marks.values[0], marks.values[1], marks.values[2]) = (10, 6, 6);
    let some = scribbles(&marks);
    let told = said(&some, "poses.prone.scribbles", Weight::Good);
    assert_eq!(told, "marked voxels: 1 of 10, 2 of 6");
    marks.values[3] = 11;
    assert!(said(&scribbles(&marks), "poses.prone.scribbles", Weight::Wrong).contains("hold 11"));
}
