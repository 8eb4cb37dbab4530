//! A pose that a scanner measured: the skin alone, placed by landmarks.

use mammotwin_data::{
    Vec3,
    io::{hdf5, landmarks, stl},
    labels::LabelMap,
    landmarks::Landmarks,
    progress::Silent,
    rigid::RigidTransform,
    store::{Artifact, Stage},
    study::parse,
    surface::TriMesh,
};
use mammotwin_stages::surface::Surface;
use std::{fs, path::Path, process::Command};

fn mammotwin(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Modified Hausdorff distances (mm) of the tilted pose, before and after the fit.
fn tilted(folder: &Path) -> [f64; 2] {
    let results = hdf5::Reader::open(folder.join("out/results.h5")).unwrap();
    ["before", "after"].map(|when| {
        let name = format!("poses/tilted/{when}/modified_hausdorff_mm");
        results.scalar::<f64>(&name).unwrap()
    })
}

/// From the frame of the tilted pose to the reference pose.
fn motion(folder: &Path) -> RigidTransform {
    let results = hdf5::Reader::open(folder.join("out/results.h5")).unwrap();
    let rows: Vec<Vec3> = results.get("poses/tilted/to_reference/rotation").unwrap();
    let shift: Vec<f64> = results.get("poses/tilted/to_reference/translation_mm").unwrap();
    RigidTransform {
        rotation: nalgebra::Matrix3::from_columns(&rows).transpose(),
        translation: Vec3::from_row_slice(&shift),
    }
}

/// The part of a skin in front of a plane (mm), as a scanner sees it.
fn front(skin: &TriMesh, least_y_mm: f64) -> TriMesh {
    let ahead =
        |corners: &&[u32; 3]| corners.iter().all(|n| skin.points[*n as usize].y > least_y_mm);
    let triangles = skin.triangles.iter().filter(ahead).copied().collect();
    TriMesh { points: skin.points.clone(), triangles }.compacted().0
}

/// What the segmentation warns of is said at each run, in the report and in the results, with how much it saw.
fn warnings_are_told(study: &str, out: &Path) {
    let again =
        Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(["run", study]).output().unwrap();
    let said = String::from_utf8_lossy(&again.stderr);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    let results = hdf5::Reader::open(out.join("results.h5")).unwrap();
    for pose in ["supine", "tilted"] {
        let warnings = results.texts(&format!("poses/{pose}/segmentation/warnings")).unwrap();
        assert!(warnings.iter().any(|w| w.contains("do not resolve skin")), "{warnings:?}");
        for warning in &warnings {
            assert!(said.contains(&format!("segment:{pose}: {warning}")), "{said}");
            assert!(report.contains(&format!("{pose}: {warning}")), "{warning}");
        }
        let seen: f64 = results.scalar(&format!("poses/{pose}/segmentation/wall_seen")).unwrap();
        assert!((0.35..=1.0).contains(&seen), "{seen}");
        assert!(report.contains(&format!("{:.0} %", 100.0 * seen)));
    }
}

/// A surface as a binary PLY file, as scanners write it.
fn write_ply(path: &Path, surface: &TriMesh) {
    let [points, faces] = [surface.points.len(), surface.triangles.len()];
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    for p in &surface.points {
        p.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
    }
    for corners in &surface.triangles {
        bytes.push(3);
        corners.iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    }
    fs::write(path, bytes).unwrap();
}

/// The tilted pose as a scan in metres in a frame of its own. With marks on what does not slide the model is as far from it as
/// from the image; marks on the skin, which slides over the chest, put it millimetres elsewhere.
#[test]
fn a_scan_may_stand_for_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let study = at("study.toml");
    let [out, file] = [folder.path(), &study].map(|path| path.to_str().unwrap().to_owned());
    mammotwin(&["synth", "--preset", "tiny", "--poses", "supine,tilted", "--out", &out]);
    let text = fs::read_to_string(&study).unwrap();
    // Poses alone: nothing is pressed.
    let (poses, _) = text.split_once("[compress]").unwrap();
    fs::write(&study, poses).unwrap();
    mammotwin(&["run", &file]);
    warnings_are_told(&file, &at("out"));
    let (imaged, moved) = (tilted(folder.path()), motion(folder.path()));

    let place = RigidTransform {
        rotation: *nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 1.1).matrix(),
        translation: Vec3::new(250.0, 900.0, 1200.0),
    };
    let metres = |p: &Vec3| 1e-3 * place.point(p);
    let labels = LabelMap::load(&at("out/labels/tilted.nii.gz")).unwrap();
    let skin = Surface::default().run(&labels, &Silent).unwrap().skin;
    let chest = skin.points.iter().map(|p| p.y).sum::<f64>() / skin.points.len() as f64;
    let seen = front(&skin, chest);
    let scan = TriMesh { points: seen.points.iter().map(metres).collect(), ..seen };
    stl::write(&at("tilted.stl"), &scan).unwrap();
    let sliding = landmarks::read(&at("tilted_landmarks.csv")).unwrap();
    // Where the chest's marks of the supine pose are in the tilted one, if they stay on the bone.
    let still = landmarks::read(&at("supine_landmarks.csv")).unwrap();
    let still = Landmarks(
        still.0.iter().map(|(name, p)| (name.clone(), moved.inverse().point(p))).collect(),
    );
    let mark = |marks: &Landmarks| {
        let own = marks.0.iter().map(|(name, p)| (name.clone(), place.point(p))).collect();
        landmarks::write_csv(&at("scan_landmarks.csv"), &Landmarks(own)).unwrap();
    };
    mark(&still);
    let known_place = sliding.0["nipple_right"];
    let known = parse(poses).unwrap();
    let [x, y, z] = place.direction(&known.poses["tilted"].gravity().unwrap()).into();

    let (first, rest) = poses.split_once("[poses.tilted]").unwrap();
    let (_, rest) = rest.split_once("\n[").unwrap();
    let scanned = format!(
        "{first}[scans.tilted]\nsurface = \"tilted.stl\"\nunit = \"m\"\nlandmarks = \"scan_landmarks.csv\"\n\
         gravity_in_scan = [{x}, {y}, {z}]\nuse = \"validate\"\n\n[{rest}"
    );
    fs::write(&study, scanned).unwrap();
    let checked = mammotwin(&["check", &file]);
    assert!(
        checked.contains("scans.tilted.surface") && checked.contains("triangles over"),
        "{checked}"
    );
    // The fit does not read it, and is kept.
    let planned = mammotwin(&["run", &file, "--dry-run"]);
    let anew: Vec<&str> = planned
        .lines()
        .filter(|line| !line.ends_with("  reuse"))
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    let has = |stage: &str| anew.contains(&stage);
    assert!(has("place_scan:tilted") && has("validate:tilted"), "{planned}");
    assert!(!has("calibrate") && !has("mesh"), "{planned}");
    mammotwin(&["run", &file]);
    let found = tilted(folder.path());
    println!(
        "modified Hausdorff distance, before and after: image {imaged:.2?}, scan {found:.2?} mm"
    );
    for (image, scan) in imaged.iter().zip(found) {
        assert!((image - scan).abs() < 0.1, "image {imaged:?}, scan {found:?}");
    }
    // The same as a PLY file: the same scan, but for the rounding of an STL file, which joins corners anew.
    write_ply(&at("tilted.ply"), &scan);
    let of_stl = fs::read_to_string(&study).unwrap();
    fs::write(&study, of_stl.replace("tilted.stl", "tilted.ply")).unwrap();
    assert!(mammotwin(&["check", &file]).contains("triangles over"));
    mammotwin(&["run", &file]);
    let as_ply = tilted(folder.path());
    println!("as a PLY file {as_ply:.4?}, as an STL file {found:.4?} mm");
    for (ply, stl) in as_ply.iter().zip(found) {
        assert!((ply - stl).abs() < 1e-3, "{as_ply:?} {found:?}");
    }
    fs::write(&study, of_stl).unwrap();
    mark(&sliding);
    mammotwin(&["run", &file]);
    let off = motion(folder.path()).point(&place.point(&known_place));
    let off = (off - moved.point(&known_place)).norm();
    println!(
        "marks on the skin: {:.2?} mm, placed {off:.1} mm off at the right nipple",
        tilted(folder.path())
    );
    // Seven millimetres: what docs/study.md warns of.
    assert!((2.0..10.0).contains(&off), "{off}");

    // One breast of it is not enough.
    let half = TriMesh {
        triangles: scan
            .triangles
            .iter()
            .filter(|t| {
                t.iter().all(|n| place.inverse().point(&(1e3 * scan.points[*n as usize])).x > 0.0)
            })
            .copied()
            .collect(),
        ..scan
    };
    stl::write(&at("tilted.stl"), &half.compacted().0).unwrap();
    let refused =
        Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(["run", &file]).output().unwrap();
    assert_eq!(refused.status.code(), Some(65));
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(said.contains("scans.tilted: the scan covers"), "{said}");
}
