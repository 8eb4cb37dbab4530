//! Moduli of digital volunteers, found from their true labels and motions: what mesh, stress-free
//! shape, equilibria and search leave of them.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::{
    io::nifti,
    labels::Side,
    progress::Silent,
    store::Stage,
    study::{self, CalibratePlan, Elements},
};
use mammotwin_stages::{
    calibrate::{Calibrate, Calibration},
    mesh::Mesh,
    register::Registered,
    surface::Surface,
    volunteer::{PoseName, Preset, Settings, Truth, synthesize},
};

/// Both moduli, as studies name them.
const BOTH: [&str; 2] = ["breast.young_right_kpa", "breast.young_left_kpa"];

/// Moduli of volunteer `tiny` over her true ones, right and left, with elements of her study's size.
fn calibrated(seed: u64, elements: Elements, fitted: &[&str]) -> (Calibration, [f64; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let settings = Settings {
        preset: "tiny".into(),
        seed,
        voxel_mm: None,
        poses: vec![PoseName::Supine, PoseName::Prone],
        hidden: std::collections::BTreeMap::new(),
        still: true,
        elements: Some(elements),
        truth_mm: None,
        out_dir: folder.path().into(),
    };
    let written = synthesize(&settings, &Silent).unwrap();
    let truth = Truth::load(&written.truth.join("truth.json")).unwrap();
    let study = study::parse(&std::fs::read_to_string(&written.study).unwrap()).unwrap();
    let labels = |pose: &str| {
        nifti::read_labels(&written.truth.join(format!("{pose}_labels.nii.gz"))).unwrap()
    };
    let surfaces = |pose: &str| Surface::default().run(&labels(pose), &Silent).unwrap();
    let known = &truth.poses["prone"];
    let mut motion = Registered::reference(known.gravity_in_common);
    motion.transform = known.to_common;
    let mesh = Mesh(study.mesh).run(&labels("supine"), &Silent).unwrap();
    let stage = Calibrate {
        model: study.model.clone(),
        plan: CalibratePlan {
            parameters: fitted.iter().map(|&key| key.into()).collect(),
            ..study.calibrate
        },
        gravity: PoseName::Supine.gravity(),
        reference: "supine".into(),
        poses: vec!["prone".into()],
    };
    let input = (mesh, surfaces("supine"), vec![motion], vec![surfaces("prone")]);
    let found = stage.run(&input, &Silent).unwrap();
    let stiffness = Preset::named("tiny").unwrap().person(seed).stiffness;
    let over = [
        found.after.moduli.right_kpa / stiffness.breast_right_kpa,
        found.after.moduli.left_kpa / stiffness.breast_left_kpa,
    ];
    println!("{seed} {elements:?}: {over:.3?}, {:?}, {:?}", found.precision, found.trials);
    (found, over)
}

#[test]
fn quadratic_elements_find_the_moduli() {
    let (found, over) = calibrated(3, Elements::Quadratic, &BOTH);
    assert!(found.converged);
    for (side, over) in [Side::Right, Side::Left].into_iter().zip(over) {
        // Voxels of 2.5 mm leave a few per cent.
        assert!((over - 1.0).abs() < 0.05, "{side:?}: {over}");
        let sd = found.precision.of_side(side).unwrap();
        assert!(over.ln().abs() < 3.0 * sd, "{side:?}: {over}, {sd}");
    }
    assert!(found.after.poses[1].distances.modified_hausdorff < 0.6);
}

#[test]
#[ignore = "minutes: more people, and linear elements"]
fn so_do_they_for_others_and_linear_ones_come_out_soft() {
    for seed in [4, 5, 6, 7] {
        let (_, over) = calibrated(seed, Elements::Quadratic, &BOTH);
        assert!(over.iter().all(|over| (over - 1.0).abs() < 0.1), "{over:?}");
        let (_, linear) = calibrated(seed, Elements::Linear, &BOTH);
        // Too stiff a mesh asks for too soft a tissue.
        assert!(linear.iter().zip(over).all(|(linear, over)| *linear < over), "{linear:?}");
    }
}

#[test]
#[ignore = "a minute: one breast alone is fitted"]
fn one_modulus_may_be_fitted_alone() {
    let (found, over) = calibrated(3, Elements::Quadratic, &BOTH[..1]);
    assert!(found.converged && found.precision.right.is_some());
    assert_eq!((found.precision.left, found.precision.correlation), (None, None));
    assert_eq!(found.after.moduli.left_kpa, found.before.moduli.left_kpa);
    // The other breast, 2.5 times too stiff, turns the pose a little; the stated precision knows of it.
    let sd = found.precision.right.unwrap();
    assert!(over[0].ln().abs() < 2.0 * sd && sd < 0.25, "{over:?} {sd}");
}
