//! Standard deviations of comfort on the tiny volunteer of `all_stages`, recomputed by hand.

use crate::all_stages::{computed, planned};
use mammotwin_data::{
    io::hdf5,
    labels::Side,
    metric::Metric,
    progress::Silent,
    store::{Artifact, Stage},
    study::{self, ComfortPlan, CompressLaw, CompressPlan},
};
use mammotwin_stages::{
    calibrate::Calibration, comfort::Comfort, compress::Compress, mesh::BreastMesh,
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Each is the root of the sum of squares of what three compressions by hand differ by, to 1e-9.
pub fn comfort_has_its_deviations(study: &Path, text: &str) {
    let text_with = format!("{text}\n[comfort]\nuncertainty = true\nplacement_sd_mm = 1.5\n");
    fs::write(study, &text_with).unwrap();
    let planned = planned(study);
    // The map has pressed stiffer breasts already.
    assert_eq!(planned[..4], ["comfort:moduli", "compress:jm", "comfort:jm", "compress:place"]);
    assert!(!planned.iter().any(|name| name == "stiffer" || name == "compress"), "{planned:?}");
    assert_eq!(computed(study, "2"), planned.len());
    let out = study.with_file_name("out");
    let file = hdf5::Reader::open(out.join("results.h5")).unwrap();
    let names = file.texts("metrics/name").unwrap();
    let [values, deviations] =
        ["metrics/value", "metrics/sd"].map(|name| file.get::<f64>(name).unwrap());
    let of = |name: &str| {
        let n = names.iter().position(|known| known == name).unwrap();
        (values[n], deviations[n])
    };
    let by_hand = varied_by_hand(&out, &text_with);
    for name in [
        "peak_pressure_kpa",
        "pressure_p95_kpa",
        "paddle_pressure_p95_kpa",
        "force_n",
        "von_mises_p95_kpa",
    ] {
        let (value, sd) = of(name);
        let others = by_hand
            .each_ref()
            .map(|found| found.iter().find(|metric| metric.name == name).unwrap().value - value);
        let [moduli, jm, place] = others;
        println!("{name}: {value:.4} ± {sd:.4} of {moduli:+.4} {jm:+.4} {place:+.4}");
        let want = (moduli * moduli + jm * jm + place * place).sqrt();
        assert!(sd > 0.0 && (sd - want).abs() <= 1e-9 * want, "{name}: ± {sd}, by hand {want}");
        // What locks later bears less. Of the moduli no sign is known: with them the stress-free shape changes.
        assert!(name != "force_n" || jm < 0.0, "{others:?}");
    }
    // The thickness is given; the dose rests on nothing that was changed here.
    assert!(of("thickness_mm").1 < 0.01 && of("agd_mgy").1.is_nan());
    drop(file);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("Jₘ (25 %), place of the plates (1.5 mm)"));
    fs::write(study, text).unwrap();
    assert_eq!(computed(study, "2"), 0);
}

/// Comfort with each number one standard deviation higher, from the kept mesh and fits alone: moduli, Jₘ, place.
fn varied_by_hand(out: &Path, text: &str) -> [Vec<Metric>; 3] {
    let only = |stage: &str| {
        let folders = fs::read_dir(out.join("cache").join(stage)).unwrap().flatten();
        let folders: Vec<PathBuf> = folders.map(|e| e.path()).filter(|p| p.is_dir()).collect();
        assert_eq!(folders.len(), 1, "{folders:?}");
        folders[0].join("result.h5")
    };
    let mesh = BreastMesh::load(&only("mesh")).unwrap();
    let [best, stiffer] =
        ["calibrate", "stiffer"].map(|stage| Calibration::load(&only(stage)).unwrap());
    let study = study::parse(text).unwrap();
    let plan = study.compress.clone().unwrap();
    assert_eq!(plan.side, Side::Right);
    let up = best.precision.of_side(Side::Right).unwrap().exp();
    let [low, high] = [&best, &stiffer].map(|fit| fit.after.moduli.right_kpa);
    assert!(up > 1.0 && (high / low / up - 1.0).abs() < 1e-12, "{low} {high} kPa, {up} times");
    let jm = plan.law.jm.map(|jm| 1.25 * jm);
    let soft = CompressPlan { law: CompressLaw { jm, ..plan.law.clone() }, ..plan.clone() };
    let chest_wall_distance_mm = plan.chest_wall_distance_mm + 1.5;
    let far = CompressPlan { chest_wall_distance_mm, ..plan.clone() };
    [(plan, &stiffer), (soft, &best), (far, &best)].map(|(plan, fit)| {
        let compress = Compress { model: study.model.clone(), plan };
        let made = compress.run(&(mesh.clone(), fit.clone(), None), &Silent).unwrap();
        Comfort { plan: ComfortPlan::default() }.run(&made, &Silent).unwrap().metrics
    })
}
