//! `study stiffening --poses`: whether one material explains poses under gravity and a compression.

#![allow(clippy::unwrap_used)] // a test may fail at once

use std::{fs, path::Path, process::Command};

fn printed(arguments: &[&str]) -> String {
    let run = Command::new(env!("CARGO_BIN_EXE_mammotwin")).args(arguments).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    String::from_utf8(run.stdout).unwrap()
}

/// Writes the study of a volunteer again, with elements of a size, pressed from the prone shape.
fn meshed(study: &Path, size_mm: f64, name: &str) -> String {
    let text = fs::read_to_string(study).unwrap();
    let text = text.replace("size_mm = 15.0", &format!("size_mm = {size_mm:.1}"));
    let text = text.replace("paddle = \"rigid\"", "paddle = \"rigid\"\nstart_pose = \"prone\"");
    let path = study.with_file_name(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
#[ignore = "minutes: seven calibrations with compressions"]
fn one_material_is_told_from_two() {
    let folder = tempfile::tempdir().unwrap();
    let volunteer = folder.path().join("volunteer");
    let out = volunteer.to_str().unwrap();
    let hide = ["--hide", "limit_chain=0.7", "--voxel-mm", "1.5"];
    printed(&[&["synth", "--preset", "tiny", "--seed", "7", "--out", out][..], &hide].concat());
    let study = volunteer.join("study.toml");
    let truth = meshed(&study, 12.0, "truth.toml");
    let model = meshed(&study, 15.0, "model.toml");
    let asked = folder.path().join("asked.csv");
    fs::write(&asked, "thickness_mm,force_n\n52,1\n").unwrap();
    let [far, near] = ["truth", "model"].map(|name| folder.path().join(name));
    let run = |study: &str, out: &Path, record: &Path, jm: &str| {
        let (out, record) = (out.to_str().unwrap(), record.to_str().unwrap());
        let errors = ["--force-error-n", "0.005", "--thickness-error-mm", "0.3"];
        let what = ["--poses", "--distances", "13", "--jm", jm, "--record", record];
        printed(&[&["study", "stiffening", study, "--out", out][..], &errors, &what].concat())
    };
    // Records of a person of one material, and of one who is stiffer in compression than her poses say.
    run(&truth, &far, &asked, "1.4,30");
    let table = fs::read_to_string(far.join("studies/stiffening/curves.csv")).unwrap();
    let course = |jm: &str| -> Vec<[f64; 2]> {
        let cells = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        let rows = table.lines().skip(1).map(cells).filter(|row| row[0] == jm);
        rows.map(|row| [row[2].parse().unwrap(), row[3].parse().unwrap()]).collect()
    };
    let said = |jm: &str| {
        let course = course(jm);
        let at = |h: f64| {
            let n = course.windows(2).position(|pair| pair[0][0] >= h && pair[1][0] <= h).unwrap();
            let [from, to] = [course[n], course[n + 1]];
            from[1] + (from[0] - h) / (from[0] - to[0]) * (to[1] - from[1])
        };
        let errors = [0.03, -0.02, 0.01, -0.03, 0.02, 0.0, -0.01];
        let thicknesses = [70.0, 66.0, 62.0, 59.0, 56.0, 53.5, 52.5];
        let rows = thicknesses.into_iter().zip(errors);
        let rows = rows.map(|(h, error)| format!("{h},{:.5}\n", at(h) * (1.0 + error)));
        let record = folder.path().join(format!("record_{jm}.csv"));
        fs::write(&record, format!("thickness_mm,force_n\n{}", rows.collect::<String>())).unwrap();
        run(&model, &near, &record, "0.8,1.2,1.8,3,8,30")
    };
    let one = said("1.4");
    assert!(one.contains("One material may explain both"), "{one}");
    let two = said("30");
    assert!(two.contains("No one Jₘ explains poses and record"), "{two}");
    assert!(near.join("studies/stiffening/both.svg").is_file());
    let gravity = fs::read_to_string(near.join("studies/stiffening/gravity.csv")).unwrap();
    assert!(gravity.starts_with("jm,right_kpa,left_kpa,misfit_mm,independent_errors\n"));
    assert_eq!(gravity.lines().count(), 7);
}
