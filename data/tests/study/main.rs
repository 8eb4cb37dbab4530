//! Studies that are accepted, and what is said of those that are not.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod compress;

use mammotwin_data::{
    labels::Tissue,
    study::{
        InterfaceKind, InterfaceRegion, PaddleName, ReceptorName, StressFree, Study, designs, parse,
    },
};
use proptest::{
    prelude::Rng,
    test_runner::{RngAlgorithm, TestRng},
};

const GOOD: &str = r#"schema = 1
[subject]
id = "dv-small-7"
[poses.supine]
image = "supine.nii.gz"
posture = "supine"
landmarks = "supine_landmarks.csv"
[poses.prone]
image = "prone.nii.gz"
posture = "prone"
[poses.tilted]
image = "tilted.nii.gz"
gravity_in_image = [-0.744, -0.667, 0.023]
use = "validate"
[records.right]
force_n = 22.0
thickness_mm = 46.0
[model]
reference_pose = "supine"
breast = { law = "neo_hookean", young_right_kpa = 0.3, young_left_kpa = 0.2, poisson = 0.49 }
skin = { law = "neo_hookean", young_kpa = 4.0, thickness_mm = 2.0 }
fascia = { law = "neo_hookean", young_kpa = 120.0, thickness_mm = 0.1 }
muscle = { rigid = true }
ligaments = { young_kpa = 500.0, names = ["inframammary", "deep_medial"] }
interface = { kind = "no_separation", friction = 0.1 }
effects = { limit_chain = 0.5 }
[mesh]
size_mm = 8.0
[calibrate]
parameters = ["breast.young_right_kpa", "breast.young_left_kpa"]
stress_free = "fixed_point"
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
calcifications = { rows = 7, columns = 3, pitch_mm = 10.0, diameter_mm = [0.2, 0.3] }
"#;

/// The study with one thing replaced is refused with a text that has all of `says`.
#[track_caller]
fn refused(from: &str, to: &str, says: &[&str]) {
    assert!(GOOD.contains(from), "{from:?} is not in the good study");
    let text = parse(&GOOD.replacen(from, to, 1)).expect_err("accepted").to_string();
    for part in says {
        assert!(text.contains(part), "{text:?} does not say {part:?}");
    }
    assert!(!text.contains('\n'), "{text:?} has more than one line");
}

#[test]
fn a_good_study_is_accepted_whatever_its_order_and_comments() {
    let study = parse(GOOD).unwrap();
    let shuffled = GOOD.replace("schema = 1\n", "# a comment\n\nschema   =  1\n");
    let posture = "posture = \"supine\"\n";
    let shuffled = shuffled.replacen(posture, "", 1);
    let table = "[poses.supine]\n";
    assert_eq!(study, parse(&shuffled.replacen(table, &format!("{table}{posture}"), 1)).unwrap());
}

#[test]
fn a_study_written_by_the_program_reads_back() {
    let study = parse(GOOD).unwrap();
    let again: Study = parse(&toml::to_string(&study).unwrap()).unwrap();
    assert_eq!(study, again);
}

#[test]
fn wrong_units_are_named() {
    refused(
        "young_kpa = 4.0",
        "young_pa = 4000.0",
        &["line 21", "model.skin.young_pa", "convert it from pa to kpa", "`young_kpa`"],
    );
    refused("force_n = 22.0", "force_kg = 2.2", &["records.right.force_kg", "from kg to n"]);
    refused("size_mm", "size", &["mesh.size:", "from no unit to mm", "`size_mm`"]);
    refused("young_kpa = 500.0", "young_kpa = 500000.0", &["model.ligaments.young_kpa", "500000"]);
}

#[test]
fn unknown_words_are_named() {
    refused(
        "posture = \"supine\"",
        "posture = \"sitting\"",
        &["line 6", "poses.supine.posture", "\"sitting\" is not known", "upright"],
    );
    refused("[mesh]", "[meshes]", &["meshes", "did you mean `mesh`?"]);
    refused("thickness_mm = 2.0", "tickness_mm = 2.0", &["model.skin.tickness_mm", "did you mean"]);
    refused(
        "\"inframammary\"",
        "\"cooper\"",
        &["model.ligaments.names[0]", "\"cooper\"", "cranial"],
    );
    refused("limit_chain", "wind", &["model.effects.wind", "limit_chain"]);
    refused("limit_chain = 0.5", "limit_chain = 1e9", &["model.effects.limit_chain"]);
    refused(
        "breast.young_left_kpa\"]",
        "breast.poisson\"]",
        &["calibrate.parameters[1]", "breast.young_left_kpa"],
    );
    refused(
        "reference_pose = \"supine\"",
        "reference_pose = \"standing\"",
        &["line 19", "model.reference_pose", "\"standing\"", "prone, supine, tilted"],
    );
    let arms = |pose: &str, radius_mm: &str| {
        let arm = format!(
            "{{ from_mm = [-200.0, 40.0, -80.0], to_mm = [-190.0, 20.0, 140.0], radius_mm = {radius_mm} }}"
        );
        format!("[model]\narms = {{ {pose} = [{arm}] }}")
    };
    refused("[model]", &arms("sitting", "45.0"), &["model.arms.sitting", "no such pose"]);
    refused("[model]", &arms("supine", "45.0"), &["model.arms.supine", "reference_pose"]);
    refused("[model]", &arms("prone", "4.0"), &["model.arms.prone", "radius_mm", "from 5 to 200"]);
    refused("schema = 1", "schema = 2", &["line 1", "schema", "reads 1"]);
}

#[test]
fn the_chest_wall_has_a_contact_for_each_region() {
    let with = |interface: &str| {
        let from = "interface = { kind = \"no_separation\", friction = 0.1 }";
        assert!(GOOD.contains(from));
        parse(&GOOD.replacen(from, interface, 1))
    };
    let mixed = "interface = { kind = \"frictional\", friction = 0.3, regions = { \
                 inframammary = { kind = \"bonded\" }, base = { kind = \"no_separation\" } } }";
    let plan = with(mixed).unwrap().model.interface;
    let of = |region| (plan.of(region).kind, plan.of(region).coefficient());
    assert_eq!(of(None), (InterfaceKind::Frictional, 0.3));
    assert_eq!(of(Some(InterfaceRegion::Lateral)), (InterfaceKind::Frictional, 0.3));
    assert_eq!(of(Some(InterfaceRegion::Base)), (InterfaceKind::NoSeparation, 0.1));
    assert_eq!(of(Some(InterfaceRegion::Inframammary)), (InterfaceKind::Bonded, 0.0));
    assert!(!plan.is_bonded());
    assert!(with("interface = { kind = \"bonded\" }").unwrap().model.interface.is_bonded());
    for kind in ["rough", "frictionless", "bonded", "frictional", "no_separation"] {
        assert!(with(&format!("interface = {{ kind = \"{kind}\", friction = 0.0 }}")).is_ok());
    }
    for (interface, says) in [
        ("{ kind = \"rough\", friction = 0.2 }", "model.interface.friction: a rough contact"),
        ("{ kind = \"glued\" }", "model.interface.kind"),
        ("{ regions = { axilla = { kind = \"bonded\" } } }", "model.interface.regions"),
        ("{ regions = { base = { friction = 0.2 } } }", "kind"),
        (
            "{ regions = { base = { kind = \"bonded\", friction = 0.2 } } }",
            "model.interface.regions.base.friction",
        ),
    ] {
        let text = with(&format!("interface = {interface}")).expect_err(interface).to_string();
        assert!(text.contains(says), "{text:?} does not say {says:?}");
    }
    refused("paddle = \"rigid\"", "friction = -0.1", &["compress.friction"]);
    refused("paddle = \"rigid\"", "hinge = { axis_mm = 50.0 }", &["compress.hinge", "flex"]);
    let measured = "paddle = \"flex\"\nhinge = { axis_mm = 50.0, file = \"hinge.csv\" }";
    let plan = parse(&GOOD.replacen("paddle = \"rigid\"", measured, 1)).unwrap().compress.unwrap();
    assert!(plan.hinge.clone().unwrap().file.is_some());
    assert!(plan.without_files().hinge.unwrap().file.is_none());
    let both = measured.replace("axis_mm = 50.0", "linear_n_mm_per_rad = 9e4");
    refused("paddle = \"rigid\"", &both, &["compress.hinge.file", "has the torques"]);
    let fold = "paddle = \"rigid\"\nreceptor = \"fold\"";
    let plan = parse(&GOOD.replacen("paddle = \"rigid\"", fold, 1)).unwrap().compress.unwrap();
    assert_eq!(plan.receptor, ReceptorName::Fold);
    let kept = "start_pose = \"prone\"\nprestress = true";
    let plan = parse(&GOOD.replacen("paddle = \"rigid\"", kept, 1)).unwrap().compress.unwrap();
    assert!(plan.prestress && plan.stress_free_pose().is_none());
    refused("paddle = \"rigid\"", "prestress = true", &["compress.prestress", "start_pose"]);
    let twice = format!("{kept}\ngravity_share = 0.5");
    refused("paddle = \"rigid\"", &twice, &["compress.gravity_share", "prestress"]);
    let oblique = "view = \"mlo\"\nreceptor = \"fold\"";
    refused("view = \"cc\"", oblique, &["compress.receptor", "cranio-caudal"]);
    let soft = "paddle = \"flex\"\nhinge = { linear_n_mm_per_rad = 0.0 }";
    refused("paddle = \"rigid\"", soft, &["compress.hinge.linear_n_mm_per_rad"]);
    let flex = GOOD.replace("paddle = \"rigid\"", "paddle = \"flex\"");
    assert!(parse(&flex).unwrap().compress.unwrap().hinge.is_none());
}

#[test]
fn numbers_that_cannot_be_meant_are_refused() {
    for number in ["nan", "inf", "-inf", "-1.0", "0.0"] {
        let with = |key: &str| format!("{key} = {number}");
        for (key, path) in [
            ("young_right_kpa = 0.3", "model.breast.young_right_kpa"),
            ("young_kpa = 4.0", "model.skin.young_kpa"),
            ("thickness_mm = 0.1", "model.fascia.thickness_mm"),
            ("size_mm = 8.0", "mesh.size_mm"),
            ("jm = 1.0", "compress.law.jm"),
            ("poisson = 0.499", "compress.law.poisson"),
            ("energy_kev = 24.0", "mammogram.energy_kev"),
            ("force_n = 22.0", "records.right.force_n"),
        ] {
            refused(key, &with(key.split(' ').next().unwrap()), &["line ", &format!("{path}: ")]);
        }
    }
    refused("poisson = 0.49 }", "poisson = 0.5 }", &["model.breast.poisson", "between 0 and 0.5"]);
    refused("0.2, 0.3]", "0.2, nan]", &["mammogram.calcifications.diameter_mm[1]"]);
    refused("friction = 0.1", "friction = nan", &["model.interface.friction"]);
    refused("-0.744,", "nan,", &["poses.tilted.gravity_in_image", "finite"]);
    refused(
        "[-0.744, -0.667, 0.023]",
        "[0, 0, 0]",
        &["poses.tilted.gravity_in_image", "no length"],
    );
    refused("rows = 7", "rows = -7", &["mammogram.calcifications.rows"]);
}

#[test]
fn mammograms_that_cannot_be_are_refused() {
    let key = "energy_kev = 24.0";
    for (with, parts) in [
        ("energy_kev = 60.0", &["mammogram.energy_kev", "5 to 50"][..]),
        ("beam = { target_filter = \"Rh/Ag\", kv = 30 }", &["mammogram.beam", "Rh/Ag at 34 kV"]),
        ("gland = \"random\"", &["mammogram.gland", "uniform, segmented"]),
        ("unit = { heel_per_100mm = 2.0 }", &["mammogram.unit.heel_per_100mm", "0 to 0.3"]),
        ("unit = { lag = -0.1 }", &["mammogram.unit.lag"]),
        ("unit = { electronic_noise_quanta = nan }", &["electronic_noise_quanta"]),
        ("unit = { focal_spot = { width_mm = 30.0 } }", &["mammogram.unit.focal_spot.width_mm"]),
        ("unit = { field_mm = [0.0, 100.0] }", &["mammogram.unit.field_mm[0]"]),
        (
            "unit = { paddle = { material = \"glass\", thickness_mm = 2.5 } }",
            &["mammogram.unit.paddle.material", "polycarbonate"],
        ),
        ("masses = [{ radii_mm = [5, 5, 5] }]", &["mammogram.masses[0]", "center_share"]),
        (
            "masses = [{ radii_mm = [5, 5, 0], center_mm = [0, 50, 25] }]",
            &["mammogram.masses[0].radii_mm[2]"],
        ),
        (
            "masses = [{ radii_mm = [5, 5, 5], center_share = [0.5, 1.5, 0.5] }]",
            &["mammogram.masses[0].center_share[1]"],
        ),
        (
            "masses = [{ material = \"cheese\", radii_mm = [5, 5, 5], center_mm = [0, 5, 5] }]",
            &["mammogram.masses[0].material", "hydroxyapatite"],
        ),
    ] {
        refused(key, with, parts);
    }
    let all = "beam = { target_filter = \"W/Rh\", kv = 28 }\ngland = \"segmented\"\n\
               masses = [{ radii_mm = [5, 5, 5], center_mm = [0, 50, 25] }]\n\
               unit = { focal_spot = { width_mm = 0.3 }, lag = 0.01 }";
    let plan = parse(&GOOD.replacen(key, all, 1)).unwrap().mammogram.unwrap();
    assert_eq!(plan.masses[0].material, "glandular_hammerstein");
    assert_eq!(plan.unit.source_height_mm, 660.0);
}

#[test]
fn the_search_for_moduli_may_be_repeated_and_the_fixed_point_be_plain() {
    let plain = "stress_free = \"plain_fixed_point\"\nsecond_start = true";
    let study = parse(&GOOD.replacen("stress_free = \"fixed_point\"", plain, 1)).unwrap();
    assert!(study.calibrate.second_start);
    // A study that does not ask for it has the key that it always had.
    let text = toml::to_string(&parse(GOOD).unwrap()).unwrap();
    assert!(!text.contains("second_start"), "{text}");
    let fitted = "parameters = [\"breast.young_right_kpa\", \"breast.young_left_kpa\"]";
    refused(
        fitted,
        "parameters = []\nsecond_start = true",
        &["calibrate.second_start", "nothing is fitted"],
    );
    refused("\"fixed_point\"", "\"fixed\"", &["calibrate.stress_free", "plain_fixed_point"]);
    for (name, method) in [
        ("prediction_correction", StressFree::PredictionCorrection),
        ("damped_prediction_correction", StressFree::DampedPredictionCorrection),
    ] {
        let named = GOOD.replacen("\"fixed_point\"", &format!("\"{name}\""), 1);
        let unfitted = named.replacen(fitted, "parameters = []", 1);
        let study = parse(&unfitted).unwrap();
        assert_eq!(study.calibrate.stress_free, method);
        let why = |text: &str| parse(text).unwrap_err().to_string();
        assert!(why(&named).contains("whatever the moduli are"), "{}", why(&named));
        let image = "image = \"prone.nii.gz\"\n";
        let alone = unfitted.replacen(image, &format!("{image}use = \"validate\"\n"), 1);
        assert!(why(&alone).contains("towards a second pose"), "{}", why(&alone));
    }
}

#[test]
fn labels_of_other_programs_have_names_and_scribbles_have_no_labels_beside_them() {
    let image = "image = \"prone.nii.gz\"\n";
    let with = |more: &str| GOOD.replacen(image, &format!("{image}{more}\n"), 1);
    let map = "labels = \"p.nii\"\nlabel_map = { 1 = \"adipose\", 65535 = \"skin\" }";
    let study = parse(&with(map)).unwrap();
    let known = study.poses["prone"].label_map.as_ref().unwrap();
    assert_eq!(known["1"].tissue(true), Tissue::AdiposeRight);
    assert_eq!((known["1"].tissue(false), known.len()), (Tissue::AdiposeLeft, 2));
    assert_eq!(parse(&toml::to_string(&study).unwrap()).unwrap(), study);
    let study = parse(&with("scribbles = \"p.nii\"")).unwrap();
    assert_eq!(study.without_files().poses["prone"].scribbles, None);
    let bad = |more: &str, says: &[&str]| refused(image, &format!("{image}{more}\n"), says);
    bad(
        "labels = \"p.nii\"\nscribbles = \"q.nii\"",
        &["line 11: poses.prone.scribbles: ", "remove one of the two keys"],
    );
    bad("scribbles = \"\"", &["poses.prone.scribbles: ", "not the name of a file"]);
    bad("label_map = { 1 = \"skin\" }", &["line 10: poses.prone.label_map: ", "add labels"]);
    let labels = "labels = \"p.nii\"\nlabel_map";
    bad(&format!("{labels} = {{ fat = \"skin\" }}"), &["label_map.fat: ", "0 to 65535"]);
    bad(&format!("{labels} = {{ 1 = \"fat\" }}"), &["line 11", "\"fat\" is not known", "adipose"]);
}

#[test]
fn missing_parts_are_named() {
    refused("posture = \"prone\"\n", "", &["poses.prone", "gravity is not given"]);
    refused("jm = 1.0, ", "", &["compress.law.jm", "needs jm"]);
    refused(
        "law = \"neo_hookean\", young_kpa = 4.0",
        "law = \"gent\", young_kpa = 4.0",
        &["model.skin.jm"],
    );
    refused("image = \"prone.nii.gz\"\n", "", &["poses.prone", "`image` is missing"]);
    refused(", thickness_mm = 0.1", "", &["model.fascia", "`thickness_mm` is missing"]);
    refused("id = \"dv-small-7\"", "", &["subject", "`id` is missing"]);
    refused("reference_pose = \"supine\"", "reference_pose = \"tilted\"", &["validate"]);
    let two = "posture = \"prone\"\nuse = \"validate\"\n";
    refused("posture = \"prone\"\n", two, &["calibrate.parameters", "two poses"]);
}

/// A Jₘ is of a Gent law, and a fascia between a bonded breast and a rigid wall carries nothing.
#[test]
fn what_no_pose_tells_is_not_fitted() {
    let fitted = "parameters = [\"breast.young_right_kpa\", \"breast.young_left_kpa\"]";
    refused(
        fitted,
        "parameters = [\"skin.jm\"]",
        &["calibrate.parameters", "skin.jm is of the Gent law", "model.skin.law = \"gent\""],
    );
    let fascia = GOOD.replacen(fitted, "parameters = [\"fascia.young_kpa\"]", 1);
    assert!(parse(&fascia).is_ok());
    let sliding = "interface = { kind = \"no_separation\", friction = 0.1 }";
    let bonded = fascia.replacen(sliding, "interface = { kind = \"bonded\" }", 1);
    let text = parse(&bonded).expect_err("accepted").to_string();
    assert!(text.contains("no pose tells of fascia.young_kpa"), "{text}");
    let soft = bonded.replacen("rigid = true", "rigid = false", 1);
    assert!(parse(&soft).is_ok(), "on a muscle that gives way the fascia bears");
}

#[test]
fn every_law_is_accepted_with_its_constants_alone() {
    let skin = |rest: &str| {
        let from = "skin = { law = \"neo_hookean\"";
        parse(&GOOD.replacen(from, &format!("skin = {{ {rest}"), 1)).map_err(|e| e.to_string())
    };
    for (law, constants) in [
        ("mooney_rivlin", "{ second_share = 0.2 }"),
        ("ogden", "{ terms = [[0.4, 2.0], [0.6, -3.5]] }"),
        ("yeoh", "{ ratios = [-0.1, 0.2] }"),
        ("exponential", "{ exponent = 5.0 }"),
    ] {
        let study = skin(&format!("law = {law:?}, constants = {constants}")).unwrap();
        assert_eq!(study.model.skin.law.name(), law);
        let again: Study = toml::from_str(&toml::to_string(&study).unwrap()).unwrap();
        assert_eq!(again, study);
        let missing = skin(&format!("law = {law:?}")).unwrap_err();
        assert!(
            missing.contains("model.skin.constants.") && missing.contains("needs"),
            "{missing}"
        );
        let foreign = skin(&format!("law = \"linear\", constants = {constants}")).unwrap_err();
        assert!(foreign.contains("\"linear\" has none"), "{foreign}");
    }
    assert!(skin("law = \"linear\"").is_ok());
    for (law, constants, says) in [
        ("mooney_rivlin", "{ second_share = 1.1 }", "model.skin.constants.second_share: 1.1"),
        ("yeoh", "{ ratios = [-1.0, 0.2] }", "soften"),
        ("yeoh", "{ ratios = [0.0, nan] }", "soften"),
        ("ogden", "{ terms = [] }", "one to three"),
        ("ogden", "{ terms = [[0.4, 2.0]] }", "sum to 1"),
        ("ogden", "{ terms = [[1.0, 0.0]] }", "exponent"),
        ("exponential", "{ exponent = nan }", "model.skin.constants.exponent"),
        ("exponential", "{ exponents = 3.0 }", "did you mean `exponent`"),
    ] {
        let text = skin(&format!("law = {law:?}, constants = {constants}")).unwrap_err();
        assert!(text.contains(says), "{text}");
    }
}

#[test]
fn names_that_would_leave_the_output_folder_are_refused() {
    for id in ["../x", "a/b", "", "a b", ".", "é", "a\\\\b"] {
        refused("\"dv-small-7\"", &format!("{id:?}").replace("\\\\\\\\", "\\\\"), &["subject.id"]);
    }
    refused("[poses.prone]", "[poses.\"../prone\"]", &["poses.../prone", "letters, digits"]);
}

#[test]
fn torn_toml_says_its_line() {
    refused("id = \"dv-small-7\"", "id = \"dv-small-7", &["line 3"]);
    refused("size_mm = 8.0", "size_mm = 8.0\nsize_mm = 9.0", &["line ", "duplicate key"]);
    refused("size_mm = 8.0", "size_mm = \"8\"", &["line ", "mesh.size_mm"]);
}

/// Every damaged study gives a study or one line; none panics.
#[test]
fn three_hundred_mutations_never_panic() {
    let mut random = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut refused = 0;
    for _ in 0..300 {
        let mut bytes = GOOD.as_bytes().to_vec();
        for _ in 0..1 + random.next_u32() % 4 {
            let at = random.next_u32() as usize % bytes.len();
            match random.next_u32() % 4 {
                0 => bytes[at] ^= 1 << (random.next_u32() % 8),
                1 => drop(bytes.drain(at..(at + 7).min(bytes.len()))),
                2 => bytes.insert(at, b"=[]{}\".,-#\n\0n"[random.next_u32() as usize % 13]),
                _ => {
                    let piece = bytes[at..(at + 30).min(bytes.len())].to_vec();
                    let to = random.next_u32() as usize % bytes.len();
                    bytes.splice(to..to, piece);
                }
            }
        }
        if let Err(error) = parse(&String::from_utf8_lossy(&bytes)) {
            let text = error.to_string();
            assert!(!text.is_empty() && !text.contains('\n'), "{text:?}");
            refused += 1;
        }
    }
    assert!(refused > 200, "only {refused} of 300 refused");
}
