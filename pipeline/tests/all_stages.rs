//! The whole graph on the tiny volunteer, from outside: what is computed again, and with which bits.

use crate::deviations;
use mammotwin_data::{
    io::{hdf5, nifti},
    labels::{Side, Tissue},
};
use mammotwin_stages::volunteer::Truth;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs,
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::Duration,
};

fn mammotwin(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mammotwin"));
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs the program and returns what it printed.
#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let output = mammotwin(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a study; returns how many stages were computed.
#[track_caller]
pub fn computed(study: &Path, threads: &str) -> usize {
    let text = printed(&["run", study.to_str().unwrap(), "--threads", threads]);
    let line = text.lines().find(|line| line.ends_with("stages computed")).unwrap();
    line.split(' ').next().unwrap().parse().unwrap()
}

/// What `run --dry-run` would compute for sure.
pub fn planned(study: &Path) -> Vec<String> {
    let text = printed(&["run", study.to_str().unwrap(), "--dry-run"]);
    let lines = text.lines().filter(|line| !line.ends_with("  reuse"));
    lines.filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
}

/// All results of a run, by their place; records and locks hold times, and are left out.
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![out.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                folders.push(path);
            // What a map adds to a run is no part of the run: stiffer breasts, compressed.
            } else if !path
                .components()
                .map(|part| part.as_os_str().to_string_lossy())
                .any(|part| part.starts_with("stiffer") || part.starts_with("moduli-"))
                && (name.starts_with("result") || name.ends_with(".png"))
            {
                let bytes = fs::read(&path).unwrap();
                found.insert(path.strip_prefix(out).unwrap().to_owned(), bytes);
            }
        }
    }
    found
}

/// Stages that have a result while a run is at work.
fn kept(cache: &Path) -> usize {
    let inside = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
    let results = inside(cache).flat_map(|stage| inside(&stage.path()));
    results.filter(|result| result.path().join("record.json").exists()).count()
}

#[track_caller]
fn same(a: &Path, b: &Path) {
    let (a, b) = (results(a), results(b));
    assert!(a.len() > 20, "{:?}", a.keys());
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    let differ: Vec<_> = a.iter().filter(|(path, bytes)| b[*path] != **bytes).collect();
    assert!(differ.is_empty(), "{:?}", differ.iter().map(|(path, _)| path).collect::<Vec<_>>());
}

/// Copies the inputs of a study, without its results.
fn copy_inputs(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
        }
    }
}

#[test]
fn the_tiny_volunteer_runs_again_only_where_it_must_and_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let volunteer = at("volunteer");
    // Three poses suffice here.
    printed(&[
        "synth",
        "--preset",
        "tiny",
        "--poses",
        "supine,prone,tilted",
        "--out",
        volunteer.to_str().unwrap(),
    ]);
    mark_header(&volunteer.join("supine.nii.gz"));
    let text = fs::read_to_string(volunteer.join("study.toml")).unwrap();
    let [killed, two] = ["killed", "two threads"].map(at);
    copy_inputs(&volunteer, &killed);
    copy_inputs(&volunteer, &two);

    let study = volunteer.join("study.toml");
    let ask = ["map", study.to_str().unwrap(), "--from", "prone", "--point", "0,0,0"];
    let early = mammotwin(&ask).output().unwrap();
    let said = String::from_utf8_lossy(&early.stderr);
    assert_eq!(early.status.code(), Some(65), "{said}");
    assert!(said.contains("run it first: mammotwin run"), "{said}");

    // One thread; then all is there.
    let stages = computed(&study, "1");
    assert!(stages > 20, "{stages}");
    assert_eq!(computed(&study, "2"), 0);
    no_file_has_the_mark(&volunteer.join("out"));
    measures_come_near_the_truth(&volunteer);

    places_of_tissue_are_carried(&study, &volunteer.join("truth/truth.json"));

    // Two threads, killed on the way and run again, from another folder: the same bits.
    let mut child = mammotwin(&["run", killed.join("study.toml").to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while kept(&killed.join("out/cache")) < 6 && child.try_wait().unwrap().is_none() {
        thread::sleep(Duration::from_millis(50));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let left = computed(&killed.join("study.toml"), "2");
    assert!(left > 0 && left < stages, "{left} of {stages}: killed too early or too late");
    same(&volunteer.join("out"), &killed.join("out"));

    // A moved folder computes nothing.
    fs::remove_dir_all(&two).unwrap();
    fs::rename(&killed, &two).unwrap();
    assert_eq!(computed(&two.join("study.toml"), "1"), 0);

    // One number of the compression: compression and what follows it, nothing before.
    let (old, new) = ("chest_wall_distance_mm = 15", "chest_wall_distance_mm = 16");
    assert!(text.contains(old));
    fs::write(&study, text.replace(old, new)).unwrap();
    let planned = planned(&study);
    assert_eq!(planned[0], "compress", "{planned:?}");
    let before = ["segment", "surface", "register", "mesh", "calibrate", "validate"];
    let of = |name: &String| before.iter().any(|stage| name.starts_with(stage));
    assert!(!planned.iter().any(of), "{planned:?}");
    assert_eq!(computed(&study, "2"), planned.len());
    // Plates farther apart than the breast is thick: one line, and the results stay.
    let old = "stop = { thickness_mm = ";
    assert!(text.contains(old));
    // Without its dose, whose tables would be said to end first.
    let (mechanics, _) = text.split_once("[mammogram]").unwrap();
    fs::write(&study, mechanics.replace(old, "stop = { thickness_mm = 1")).unwrap();
    let held = results(&volunteer.join("out"));
    let wide = mammotwin(&["run", study.to_str().unwrap()]).output().unwrap();
    assert_eq!(wide.status.code(), Some(65));
    let said = String::from_utf8_lossy(&wide.stderr);
    let last = said.lines().last().unwrap();
    assert!(last.contains("compress.stop.thickness_mm: 146 mm is more than"), "{said}");
    assert_eq!(results(&volunteer.join("out")), held);
    // And back again: all is still there.
    fs::write(&study, &text).unwrap();
    assert_eq!(computed(&study, "2"), 0);
    deviations::comfort_has_its_deviations(&study, &text);
    a_tilt_to_the_other_side_is_refused(&study, &text);
    effects_are_not_sought_beside_a_skin_that_is_fitted(&study, &text);
    what_is_held_out_is_read_by_no_fit(&study);
    what_has_no_place_in_the_breast_is_refused(&study, &text);
    gland_follows_the_labels(&study, &text);
}

/// Breasts moved to the other side than the stated gravity of the tilted pose: its measures are of no pose.
fn a_tilt_to_the_other_side_is_refused(study: &Path, text: &str) {
    let stated = "gravity_in_image = [-";
    assert_eq!(text.matches(stated).count(), 1);
    fs::write(study, text.replace(stated, "gravity_in_image = [")).unwrap();
    let run = mammotwin(&["run", study.to_str().unwrap()]).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(65), "{said}");
    assert!(said.contains("tilted: the breasts moved against the change of gravity"), "{said}");
    fs::write(study, text).unwrap();
    assert_eq!(computed(study, "2"), 0);
}

/// What a fitted skin takes of an effect, the signatures of `discover` know nothing of.
fn effects_are_not_sought_beside_a_skin_that_is_fitted(study: &Path, text: &str) {
    let fitted = "parameters = [";
    assert_eq!(text.matches(fitted).count(), 1);
    let skin = text.replace(fitted, "parameters = [\"skin.young_kpa\", ");
    fs::write(study, skin).unwrap();
    let asked = mammotwin(&["discover", study.to_str().unwrap()]).output().unwrap();
    let said = String::from_utf8_lossy(&asked.stderr);
    assert_eq!(asked.status.code(), Some(65), "{said}");
    assert!(said.contains("leave skin.young_kpa out"), "{said}");
    fs::write(study, text).unwrap();
    assert_eq!(computed(study, "2"), 0);
}

/// Markers of the skin land where the truth has them, as nearly as is said; a point between the plates and its
/// shadow belong together.
fn places_of_tissue_are_carried(study: &Path, truth: &Path) {
    let study = study.to_str().unwrap();
    let ask = |arguments: &[&str]| -> Value {
        let text = printed(&[&["map", study, "--json"], arguments].concat());
        serde_json::from_str(&text).unwrap()
    };
    let vector = |value: &Value| -> [f64; 3] { serde_json::from_value(value.clone()).unwrap() };
    let off = |a: [f64; 3], b: [f64; 3]| {
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
    };
    let row = |mapped: &Value, shape: &str| -> Value {
        let rows = mapped["rows"].as_array().unwrap();
        rows.iter().find(|row| row["shape"] == shape).unwrap().clone()
    };
    let truth: Value = serde_json::from_str(&fs::read_to_string(truth).unwrap()).unwrap();
    let markers = truth["poses"]["prone"]["landmarks"].as_object().unwrap();
    let mut squares = Vec::new();
    let marks = Path::new(study).with_file_name("prone_landmarks.csv");
    let file = marks.with_file_name("places.csv");
    fs::write(&file, fs::read_to_string(&marks).unwrap() + "table,0,900,0\n").unwrap();
    let found = ask(&["--from", "prone", "--points", file.to_str().unwrap()]);
    let [placed, unplaced] =
        ["points", "unplaced"].map(|part| found[part].as_array().unwrap().clone());
    assert_eq!(placed.len() + unplaced.len(), markers.len() + 1, "{found}");
    let table = unplaced.iter().find(|place| place["name"] == "table").unwrap();
    assert!(table["why"].as_str().unwrap().contains("outside of the meshed breasts"), "{table}");
    for point in placed
        .iter()
        .filter(|point| point["name"].as_str().is_some_and(|name| name.starts_with("breast_")))
    {
        let (name, mapped) = (point["name"].as_str().unwrap(), &point["places"]);
        let given = vector(&markers[name]);
        assert!(off(vector(&row(mapped, "prone")["mm"]), given) < 5.0);
        assert!(row(mapped, "prone")["spread"]["moduli_mm"].is_null());
        for pose in ["supine", "tilted"] {
            let there = row(mapped, pose);
            let away = off(vector(&there["mm"]), vector(&truth["poses"][pose]["landmarks"][name]));
            let sd = there["spread"]["total_mm"].as_f64().unwrap();
            println!("{name} to {pose}: {away:.2} mm off, sd {sd:.2} mm, {}", there["spread"]);
            squares.push((away / sd).powi(2));
        }
    }
    // And one of them back.
    let mapped =
        &placed.iter().find(|point| point["name"] == "breast_right_upper").unwrap()["places"];
    let supine = vector(&row(mapped, "supine")["mm"]).map(|mm| mm.to_string()).join(",");
    let back = ask(&["--quick", "--from", "supine", "--point", &supine]);
    let back = vector(&row(&back["points"][0]["places"], "prone")["mm"]);
    let away = off(back, vector(&row(mapped, "prone")["mm"]));
    assert!(away < 1e-3, "it comes back {away} mm off");
    let count = squares.len();
    assert!(count >= 8, "{count}");
    let ratio = (squares.iter().sum::<f64>() / count as f64).sqrt();
    println!("errors over their standard deviations, root mean square of {count}: {ratio:.2}");
    // Stated too small or too large by a factor of two would be a wrong statement.
    assert!((0.5..2.0).contains(&ratio), "{ratio}");

    let inside = ["--quick", "--from", "compressed", "--point", "3,8,20"];
    let found = ask(&inside);
    let mapped = &found["points"][0]["places"];
    let pixel = [0, 1].map(|n| mapped["mammogram"]["pixel"][n].as_f64().unwrap());
    let line = ask(&[
        "--quick",
        "--from",
        "mammogram",
        "--step-mm",
        "1",
        "--pixel",
        &format!("{},{}", pixel[0], pixel[1]),
    ]);
    let points = line["points"].as_array().unwrap();
    assert!(points.len() > 10, "{}", points.len());
    let mut nearest = f64::INFINITY;
    for point in points {
        let shadow = &point["places"]["mammogram"]["pixel"];
        for (n, given) in pixel.iter().enumerate() {
            assert!((shadow[n].as_f64().unwrap() - given).abs() < 1e-6, "{shadow}");
        }
        nearest = nearest.min(off(vector(&point["given_mm"]), [3.0, 8.0, 20.0]));
    }
    assert!(nearest < 0.51, "the line passes {nearest} mm beside the point");

    for (arguments, code, says) in [
        (&["--from", "prone", "--point", "0,900,0"][..], 65, "mm outside of the meshed breasts"),
        (
            &["--from", "sitting", "--point", "0,0,0"],
            2,
            "there are: prone, supine, tilted, compressed",
        ),
        (&["--from", "mammogram", "--pixel", "-9,0"], 2, "columns"),
        (&["--from", "prone", "--landmark", "nose"], 2, "there are: breast_"),
        (&["--from", "prone", "--point", "1,2"], 2, "give 3 numbers"),
    ] {
        let output = mammotwin(&[&["map", study], arguments].concat()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(says), "{said}");
    }
    let text = printed(&[&["map", study], &inside[..]].concat());
    assert!(text.contains("mammogram     column") && text.contains("stress_free"), "{text}");
}

/// Another image and other landmarks of the held-out pose change what is made of that pose, and nothing that was fitted.
fn what_is_held_out_is_read_by_no_fit(study: &Path) {
    let files = ["tilted.nii.gz", "tilted_landmarks.csv"].map(|name| study.with_file_name(name));
    let kept = files.each_ref().map(|file| fs::read(file).unwrap());
    fs::copy(study.with_file_name("prone.nii.gz"), &files[0]).unwrap();
    fs::copy(study.with_file_name("prone_landmarks.csv"), &files[1]).unwrap();
    let anew = planned(study);
    let has = |name: &str| anew.iter().any(|stage| stage == name);
    let own = ["align", "segment", "surface", "register", "validate", "fiducials"];
    assert!(own.iter().all(|stage| has(&format!("{stage}:tilted"))), "{anew:?}");
    assert!(
        !anew.iter().any(|stage| stage.ends_with(":supine") || stage.ends_with(":prone")),
        "{anew:?}"
    );
    let fitted = ["mesh", "calibrate", "compress", "phantom", "mammogram", "quality"];
    assert!(!fitted.iter().any(|stage| has(stage)), "{anew:?}");
    for (file, bytes) in files.iter().zip(kept) {
        fs::write(file, bytes).unwrap();
    }
    assert!(planned(study).is_empty());
}

/// What somebody may have written about a person into the texts of a header.
const MARK: &str = "DOE^JANE1970";

fn unzipped(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    let file = fs::File::open(path).unwrap();
    flate2::read::MultiGzDecoder::new(file).read_to_end(&mut bytes).unwrap();
    bytes
}

/// Writes [`MARK`] into all texts of the header of a NIfTI-1 image, and into an extension.
fn mark_header(path: &Path) {
    let mut bytes = unzipped(path);
    assert_eq!(bytes[..4], [0x5c, 1, 0, 0], "no little-endian NIfTI-1");
    // db_name, descrip, aux_file, intent_name.
    for at in [14, 148, 228, 328] {
        bytes[at..at + MARK.len()].copy_from_slice(MARK.as_bytes());
    }
    // An extension of 32 bytes: its size, code 6 (a comment), its text.
    let mut extension = vec![0; 32];
    extension[0] = 32;
    extension[4] = 6;
    extension[8..8 + MARK.len()].copy_from_slice(MARK.as_bytes());
    bytes[348] = 1;
    bytes[108..112].copy_from_slice(&384f32.to_le_bytes());
    bytes.splice(352..352, extension);
    let mut zip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    zip.write_all(&bytes).unwrap();
    fs::write(path, zip.finish().unwrap()).unwrap();
}

/// The texts of a header do not travel: no file of a run holds them, compressed ones neither.
fn no_file_has_the_mark(out: &Path) {
    let (mut folders, mut files) = (vec![out.to_owned()], 0);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let zipped = path.extension().is_some_and(|ending| ending == "gz");
            let bytes = if zipped { unzipped(&path) } else { fs::read(&path).unwrap() };
            let holds = bytes.windows(MARK.len()).any(|part| part == MARK.as_bytes());
            assert!(!holds, "{} holds a text of the image's header", path.display());
            files += 1;
        }
    }
    assert!(files > 60, "{files} files");
    assert!(out.join("results.h5").exists() && out.join("report.html").exists());
}

/// Measures of the results beside those of the true labels, between the true limits of the chest.
fn measures_come_near_the_truth(volunteer: &Path) {
    let truth = Truth::load(&volunteer.join("truth/truth.json")).unwrap();
    let file = hdf5::Reader::open(volunteer.join("out/results.h5")).unwrap();
    let (names, values) =
        (file.texts("metrics/name").unwrap(), file.get::<f64>("metrics/value").unwrap());
    for pose in ["supine", "prone", "tilted"] {
        let path = volunteer.join(format!("truth/{pose}_labels.nii.gz"));
        let labels = nifti::read_labels(&path).unwrap();
        let breast = truth.breast(pose, &labels);
        let motion = truth.poses[pose].to_common;
        for side in [Side::Right, Side::Left] {
            let group = format!("poses/{pose}/breasts/{}", side.name());
            let number = |name: &str| file.scalar::<f64>(&format!("{group}/{name}")).unwrap();
            let metric = |name: &str| {
                let name = format!("{pose}_{}_{name}", side.name());
                values[names.iter().position(|n| *n == name).unwrap()]
            };
            let count = |of: &dyn Fn(Tissue) -> bool| {
                let here = |n: usize| motion.point(&labels.grid.center(labels.grid.voxel(n))).x;
                let own = (0..breast.len())
                    .filter(|&n| breast[n] && of(labels.values[n]) && here(n) * side.sign() > 0.0);
                own.count() as f64 * labels.grid.voxel_mm3() / 1000.0
            };
            let [volume, gland] = [count(&|_| true), count(&Tissue::is_gland)];
            let ratio = number("volume_cm3") / volume;
            let gland_ratio = number("gland_volume_cm3") / gland;
            let nipple: Vec<f64> = file.get(&format!("{group}/nipple_mm")).unwrap();
            let exact = &truth.poses[pose].landmarks.0[&format!("nipple_{}", side.name())];
            let off =
                (mammotwin_data::Vec3::from_column_slice(&nipple) - motion.point(exact)).norm();
            println!(
                "{pose} {}: volume {:.3} and gland {gland_ratio:.3} of the true {volume:.0} and \
                 {gland:.0} cm3, share of gland {:.3}, protrusion {:.1} mm, nipple {off:.1} mm off",
                side.name(),
                ratio,
                number("gland_share"),
                number("protrusion_mm"),
            );
            assert!((0.9..1.1).contains(&ratio) && (0.7..1.4).contains(&gland_ratio));
            // Marked by hand, moved by the registration.
            assert!(off < 4.0, "{off} mm");
            assert_eq!(metric("breast_volume_cm3"), number("volume_cm3"));
            assert_eq!(metric("protrusion_mm"), number("protrusion_mm"));
            // Voxels of 2.5 mm show no skin: no number is better than a made-up one.
            assert!(!file.has(&format!("{group}/skin_median_mm")));
        }
    }
    assert!(!names.iter().any(|name| name.contains("skin")));
}

/// Errors that are known only when the breast is compressed: 65 and one line, as for all others.
fn what_has_no_place_in_the_breast_is_refused(study: &Path, text: &str) {
    let calcifications = "pitch_mm = 10.0,";
    let picture = "energy_kev = 24.0";
    for (from, to, says) in [
        (
            picture,
            "masses = [{ radii_mm = [5, 5, 5], center_mm = [0, 300, 20] }]",
            "mammogram.masses[0]: at (0.0, 300.0, 20.0) mm it stands out of the breast",
        ),
        (
            calcifications,
            "pitch_mm = 10.0, center_mm = [150, 10],",
            "mammogram.calcifications.center_mm: the microcalcification in row 0, column 0",
        ),
        (picture, "unit = { field_mm = [30, 20] }", "larger than the detector"),
    ] {
        assert!(text.contains(from));
        fs::write(study, text.replace(from, to)).unwrap();
        let output = mammotwin(&["run", study.to_str().unwrap()]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{said}");
        assert!(said.lines().last().unwrap().contains(says), "{said}");
    }
}

/// With gland where the labels have it the share is counted, and photons are followed through it.
fn gland_follows_the_labels(study: &Path, text: &str) {
    let picture = "energy_kev = 24.0";
    let more = "gland = \"segmented\"\nmonte_carlo = { photons = 200000 }\n\
                masses = [{ radii_mm = [3, 3, 3], center_share = [0.5, 0.5, 0.5] }]";
    fs::write(study, text.replace(picture, &format!("{picture}\n{more}"))).unwrap();
    let stages = computed(study, "2");
    assert!(stages >= 6, "{stages}");
    let file = hdf5::Reader::open(study.parent().unwrap().join("out/results.h5")).unwrap();
    let (names, values) =
        (file.texts("metrics/name").unwrap(), file.get::<f64>("metrics/value").unwrap());
    let metric = |name: &str| values[names.iter().position(|n| n == name).unwrap()];
    let [mass, volume] = ["glandularity", "gland_volume_share"].map(metric);
    let over = metric("mc_over_dance");
    println!("gland {mass:.3} by mass, {volume:.3} by volume; Monte Carlo over Dance {over:.3}");
    // Gland is denser; the preset has a fifth, of which less lies in front of the plates' edge.
    assert!(mass > volume && (0.05..0.6).contains(&volume), "{mass} {volume}");
    assert!((0.7..1.4).contains(&over), "{over}");
}
