//! Reads a study and refuses what cannot be meant.

use super::{
    ComfortPlan, CompressPlan, Elements, InterfaceKind, LawConstants, LawName, LayerPlan,
    ModelPlan, Pose, ReceptorName, RegionPlan, Scan, Study, Use, View, locate::Places,
    validate_calibrate, validate_clamp, validate_mammogram, validate_paddles, wording,
};
use crate::Vec3;
use std::ops::Range;

/// Ligaments that the model knows.
pub const LIGAMENTS: [&str; 4] = ["inframammary", "deep_medial", "cranial", "lateral"];
/// Effects that `model.effects` may name.
pub const EFFECTS: [&str; 19] = [
    "limit_chain",
    "fascia_limit",
    "cranial_ligament",
    "lateral_ligament",
    "inframammary_slack",
    "skin_region",
    "skin_thickness",
    "skin_prestress",
    "skin_limit",
    "gland_inclusion",
    "compressible",
    "cooper_anisotropy",
    "friction",
    "bond_region",
    "left_right",
    "gravity_dir",
    "pectoral_shift",
    "viscosity",
    "density",
];
/// Study keys that `calibrate.parameters` may name.
pub const CALIBRATED: [&str; 8] = [
    "breast.young_right_kpa",
    "breast.young_left_kpa",
    "skin.young_kpa",
    "fascia.young_kpa",
    "ligaments.young_kpa",
    "breast.jm",
    "skin.jm",
    "fascia.jm",
];

/// Why a study is refused; the text names the key and says how to mend it.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
pub struct StudyError {
    /// `line 12: model.skin.young_kpa: WHY`.
    pub text: String,
    /// The line of the study with a mark under the key; empty when no line is to blame.
    pub excerpt: String,
}

impl StudyError {
    /// What is wrong with the key at `path`, of a study that reads `text`.
    pub fn at_key(text: &str, path: &str, why: &str) -> Self {
        let places = Places::of(text);
        Self::new(path, places.span_of(path), why, &places, text)
    }

    /// What is wrong with a piece of the text.
    pub(super) fn new(
        path: &str,
        span: Option<Range<usize>>,
        why: &str,
        places: &Places,
        text: &str,
    ) -> Self {
        let line = span.as_ref().map(|span| places.line_at(span.start));
        let line = line.map(|line| format!("line {line}: ")).unwrap_or_default();
        let path = if path.is_empty() { String::new() } else { format!("{path}: ") };
        let excerpt = span.map(|span| places.excerpt(text, span)).unwrap_or_default();
        Self { text: format!("{line}{path}{why}"), excerpt }
    }
}

/// Parses the text of a study file.
///
/// Image paths may point anywhere that can be read; names become parts of file names and may not.
pub fn parse(text: &str) -> Result<Study, StudyError> {
    let study: Study = toml::from_str(text).map_err(|error| wording::refused(&error, text))?;
    check(&study).map_err(|Refusal { path, why }| StudyError::at_key(text, &path, &why))?;
    Ok(study)
}

pub(super) struct Refusal {
    pub path: String,
    pub why: String,
}

pub(super) type Checked = Result<(), Refusal>;

pub(super) fn refuse(path: impl Into<String>, why: impl Into<String>) -> Checked {
    Err(Refusal { path: path.into(), why: why.into() })
}

fn check(study: &Study) -> Checked {
    if study.schema != 1 {
        return refuse("schema", format!("{} is not known; this program reads 1", study.schema));
    }
    plain_name("subject.id", &study.subject.id)?;
    poses(study)?;
    for (name, scan) in &study.scans {
        one_scan(study, name, scan)?;
    }
    for (side, record) in &study.records {
        let path = format!("records.{}", side.name());
        within(&format!("{path}.force_n"), record.force_n, 0.1, 500.0)?;
        within(&format!("{path}.thickness_mm"), record.thickness_mm, 5.0, 200.0)?;
    }
    model(&study.model)?;
    muscle(study)?;
    arms(study)?;
    within("mesh.size_mm", study.mesh.size_mm, 0.5, 50.0)?;
    validate_calibrate::calibrate(study)?;
    study.compress.as_ref().map_or(Ok(()), compress)?;
    start(study)?;
    comfort(&study.comfort)?;
    study.mammogram.as_ref().map_or(Ok(()), validate_mammogram::mammogram)?;
    match (&study.mammogram, &study.compress) {
        (Some(_), None) => {
            refuse("mammogram", "needs a compressed breast; add a table [compress]")?;
        }
        (Some(_), Some(plan)) => validate_mammogram::thickness(plan.stop.thickness_mm)?,
        (None, _) => {}
    }
    Ok(())
}

fn poses(study: &Study) -> Checked {
    if study.poses.is_empty() {
        return refuse("poses", "no pose; add a table such as [poses.prone] with an image");
    }
    for (name, pose) in &study.poses {
        let path = format!("poses.{name}");
        plain_name(&path, name)?;
        one_pose(&path, pose)?;
    }
    let Some(reference) = &study.model.reference_pose else {
        if study.poses.len() > 1 && !study.poses.contains_key("supine") {
            let why = "missing, and no pose is called supine; name the pose to make the mesh of";
            return refuse("model.reference_pose", why);
        }
        return Ok(());
    };
    match study.poses.get(reference) {
        Some(pose) if pose.usage == Use::Validate => {
            refuse("model.reference_pose", format!("poses.{reference} has use = \"validate\""))
        }
        Some(_) => Ok(()),
        None => {
            let names: Vec<_> = study.poses.keys().map(String::as_str).collect();
            let why = format!("no pose {reference:?}; there are: {}", names.join(", "));
            refuse("model.reference_pose", why)
        }
    }
}

fn one_pose(path: &str, pose: &Pose) -> Checked {
    let files = [("image", Some(&pose.image)), ("landmarks", pose.landmarks.as_ref())];
    let drawn = [("labels", pose.labels.as_ref()), ("scribbles", pose.scribbles.as_ref())];
    for (key, file) in files.into_iter().chain(drawn) {
        let text = file.map(|file| file.as_os_str().as_encoded_bytes());
        if text.is_some_and(|text| text.is_empty() || text.contains(&0)) {
            return refuse(format!("{path}.{key}"), "not the name of a file");
        }
    }
    if pose.labels.is_some() && pose.scribbles.is_some() {
        let why = "labels are finished and leave nothing to teach; remove one of the two keys";
        return refuse(format!("{path}.scribbles"), why);
    }
    for number in pose.label_map.iter().flat_map(|map| map.keys()) {
        let path = format!("{path}.label_map");
        if pose.labels.is_none() {
            return refuse(path, "names the values of labels, and there are none; add labels");
        }
        if number.parse::<u16>().is_err() {
            let why = "is not the value of a label; write a whole number from 0 to 65535";
            return refuse(format!("{path}.{number}"), why);
        }
    }
    direction(path, "gravity_in_image", pose.gravity_in_image, pose.gravity())
}

fn one_scan(study: &Study, name: &str, scan: &Scan) -> Checked {
    let path = format!("scans.{name}");
    plain_name(&path, name)?;
    if study.poses.contains_key(name) {
        return refuse(
            path,
            "there is an image of this name in [poses]; give the scan another one",
        );
    }
    for (key, file) in [("surface", &scan.surface), ("landmarks", &scan.landmarks)] {
        let text = file.as_os_str().as_encoded_bytes();
        if text.is_empty() || text.contains(&0) {
            return refuse(format!("{path}.{key}"), "not the name of a file");
        }
    }
    let ending = scan.surface.extension().map(|e| e.to_ascii_lowercase());
    if !ending.is_some_and(|ending| ending == "stl" || ending == "ply") {
        return refuse(format!("{path}.surface"), "is no STL or PLY file; export the scan as one");
    }
    direction(&path, "gravity_in_scan", scan.gravity_in_scan, scan.gravity())
}

/// A direction of gravity, given by name or as a vector under `key`.
fn direction(path: &str, key: &str, given: Option<[f64; 3]>, unit: Option<Vec3>) -> Checked {
    if let Some(direction) = given {
        let path = format!("{path}.{key}");
        if !direction.iter().all(|x| x.is_finite()) {
            return refuse(path, "must be three finite numbers");
        }
        if unit.is_none() {
            return refuse(path, "has no length; give the direction in which things fall");
        }
    }
    if unit.is_none() {
        let why = format!(
            "gravity is not given; add posture = \"supine\", \"prone\" or \"upright\", or {key} = [x, y, z]"
        );
        return refuse(path, why);
    }
    Ok(())
}

fn model(model: &ModelPlan) -> Checked {
    let breast = &model.breast;
    modulus("model.breast.young_right_kpa", breast.young_right_kpa)?;
    modulus("model.breast.young_left_kpa", breast.young_left_kpa)?;
    poisson("model.breast.poisson", breast.poisson)?;
    law("model.breast", breast.law, breast.jm, &breast.constants)?;
    layer("model.skin", &model.skin)?;
    layer("model.fascia", &model.fascia)?;
    modulus("model.muscle.young_kpa", model.muscle.young_kpa)?;
    modulus("model.ligaments.young_kpa", model.ligaments.young_kpa)?;
    known("model.ligaments.names", &model.ligaments.names, &LIGAMENTS)?;
    contact("model.interface", &model.interface.of(None))?;
    for (region, plan) in &model.interface.regions {
        contact(&format!("model.interface.regions.{}", region.name()), plan)?;
    }
    within("model.density_g_per_cm3", model.density_g_per_cm3, 0.1, 5.0)?;
    for (name, amplitude) in &model.effects {
        let path = format!("model.effects.{name}");
        if !EFFECTS.contains(&name.as_str()) {
            return refuse(&path, format!("not known; there are: {}", EFFECTS.join(", ")));
        }
        within(&path, *amplitude, -100.0, 100.0)?;
    }
    Ok(())
}

/// Arms are beside poses that the stress-free shape is loaded into.
fn arms(study: &Study) -> Checked {
    for (pose, arms) in &study.model.arms {
        let path = format!("model.arms.{pose}");
        if study.usage(pose).is_none() {
            return refuse(&path, "there is no such pose");
        }
        if pose == study.reference_pose() {
            return refuse(
                &path,
                "the stress-free shape is sought from this pose without an arm; choose another model.reference_pose",
            );
        }
        for arm in arms {
            let ends = arm.from_mm.iter().chain(&arm.to_mm);
            ends.into_iter().try_for_each(|mm| within(&path, *mm, -2000.0, 2000.0))?;
            within(&format!("{path}.radius_mm"), arm.radius_mm, 5.0, 200.0)?;
        }
    }
    Ok(())
}

/// A deformable muscle has linear elements, and no friction.
fn muscle(study: &Study) -> Checked {
    if study.model.muscle.rigid {
        return Ok(());
    }
    if study.mesh.elements != Elements::Linear {
        let why = "a deformable muscle has linear elements; set mesh.elements to \"linear\", or this to true";
        return refuse("model.muscle.rigid", why);
    }
    let interface = &study.model.interface;
    let regions = interface.regions.values().copied();
    for plan in regions.chain([interface.of(None)]) {
        let glides = plan.kind == InterfaceKind::NoSeparation && plan.coefficient() == 0.0;
        if plan.kind != InterfaceKind::Bonded && !glides {
            let why = format!(
                "on a deformable muscle a breast is bonded or slides without friction and separation, not {} with a \
                 friction of {}; set model.interface.kind to \"bonded\", or to \"no_separation\" with friction = 0.0, \
                 or this to true",
                plan.kind.name(),
                plan.coefficient()
            );
            return refuse("model.muscle.rigid", why);
        }
    }
    Ok(())
}

fn contact(path: &str, plan: &RegionPlan) -> Checked {
    let (path, friction) = (format!("{path}.friction"), plan.friction.unwrap_or(0.0));
    within(&path, friction, 0.0, 2.0)?;
    if friction > 0.0 && !plan.kind.has_friction() {
        let kind = plan.kind.name();
        let why = format!("a {kind} contact has none; set it to 0, or name another kind");
        return refuse(path, why);
    }
    Ok(())
}

fn layer(path: &str, layer: &LayerPlan) -> Checked {
    modulus(&format!("{path}.young_kpa"), layer.young_kpa)?;
    within(&format!("{path}.thickness_mm"), layer.thickness_mm, 0.001, 20.0)?;
    law(path, layer.law, layer.jm, &layer.constants)
}

fn compress(plan: &CompressPlan) -> Checked {
    within("compress.chest_wall_distance_mm", plan.chest_wall_distance_mm, 0.0, 200.0)?;
    let stop = &plan.stop;
    let limits = [
        ("thickness_mm", stop.thickness_mm, 5.0, 200.0),
        ("force_n", stop.force_n, 0.001, 500.0),
        ("mean_pressure_kpa", stop.mean_pressure_kpa, 0.001, 200.0),
        ("peak_pressure_kpa", stop.peak_pressure_kpa, 0.001, 500.0),
        ("least_gain_mm_per_n", stop.least_gain_mm_per_n, 0.001, 100.0),
    ];
    if limits.iter().all(|limit| limit.1.is_none()) {
        let names = limits.map(|limit| limit.0).join(", ");
        return refuse("compress.stop", format!("says nothing; give one or more of: {names}"));
    }
    for (key, limit, low, high) in limits {
        within(&format!("compress.stop.{key}"), limit.unwrap_or(low), low, high)?;
    }
    within("compress.friction", plan.friction, 0.0, 2.0)?;
    within("compress.gravity_share", plan.gravity_share, 0.0, 1.0)?;
    within("compress.rate_stiffening", plan.rate_stiffening, -0.9, 10.0)?;
    within("compress.receptor_lift_mm", plan.receptor_lift_mm, -100.0, 100.0)?;
    if plan.receptor == ReceptorName::Fold && plan.view != View::Cc {
        let why = "the fold lies under the breast in a cranio-caudal view only; remove it";
        return refuse("compress.receptor", why);
    }
    if let Some(angle) = plan.view_angle_deg {
        if plan.view != View::Mlo {
            let why = "only an oblique view has one; remove it, or write view = \"mlo\"";
            return refuse("compress.view_angle_deg", why);
        }
        within("compress.view_angle_deg", angle, 20.0, 90.0)?;
    }
    validate_paddles::paddle(plan)?;
    plan.clamp.as_ref().map_or(Ok(()), validate_clamp::clamp)?;
    poisson("compress.law.poisson", plan.law.poisson)?;
    law("compress.law", plan.law.name, plan.law.jm, &plan.law.constants)
}

/// A pose to start from is one that the calibration simulates.
fn start(study: &Study) -> Checked {
    let Some(plan) = &study.compress else { return Ok(()) };
    let Some(name) = &plan.start_pose else {
        let why = "needs compress.start_pose, the pose whose stress and weight are kept; name it, or remove this";
        return if plan.prestress { refuse("compress.prestress", why) } else { Ok(()) };
    };
    if plan.prestress && plan.gravity_share > 0.0 {
        let why = "is the weight of an upright person, whom compress.prestress leaves lying; remove one of the two";
        return refuse("compress.gravity_share", why);
    }
    match study.poses.get(name) {
        Some(pose) if pose.usage == Use::Fit => Ok(()),
        Some(_) => {
            let why = format!("poses.{name} has use = \"validate\"; name one that is fitted");
            refuse("compress.start_pose", why)
        }
        None => {
            let names: Vec<_> = study.poses.keys().map(String::as_str).collect();
            let why = format!("no pose {name:?}; there are: {}", names.join(", "));
            refuse("compress.start_pose", why)
        }
    }
}

fn comfort(plan: &ComfortPlan) -> Checked {
    within("comfort.juxtathoracic_mm", plan.juxtathoracic_mm, 1.0, 100.0)?;
    within("comfort.mat_pitch_mm", plan.mat_pitch_mm, 1.0, 100.0)?;
    within("comfort.mat_threshold_kpa", plan.mat_threshold_kpa, 0.0, 100.0)?;
    within("comfort.jm_sd_percent", plan.jm_sd_percent, 0.0, 100.0)?;
    within("comfort.placement_sd_mm", plan.placement_sd_mm, 0.0, 20.0)
}

/// Young's modulus (kPa). Tissues have 0.1 to 1 000; a larger number is mostly one in Pa.
fn modulus(path: &str, kpa: f64) -> Checked {
    if kpa > 0.0 && kpa <= 10_000.0 {
        return Ok(());
    }
    refuse(path, format!("{kpa} is not a modulus in kPa; write one above 0 and up to 10000"))
}

fn poisson(path: &str, ratio: f64) -> Checked {
    if ratio > 0.0 && ratio < 0.5 {
        return Ok(());
    }
    refuse(
        path,
        format!("{ratio} is not a Poisson ratio; write one between 0 and 0.5, both excluded"),
    )
}

fn law(path: &str, law: LawName, jm: Option<f64>, constants: &LawConstants) -> Checked {
    constants.check(law, jm).or_else(|bad| refuse(format!("{path}.{}", bad.key), bad.why))
}

pub(super) fn within(path: &str, value: f64, low: f64, high: f64) -> Checked {
    if value >= low && value <= high {
        return Ok(());
    }
    refuse(path, format!("{value} cannot be meant; write a number from {low} to {high}"))
}

pub(super) fn known(path: &str, names: &[String], known: &[&str]) -> Checked {
    for (n, name) in names.iter().enumerate() {
        let path = format!("{path}[{n}]");
        if !known.contains(&name.as_str()) {
            let list = if known.is_empty() { "none yet".into() } else { known.join(", ") };
            return refuse(path, format!("{name:?} is not known; there are: {list}"));
        }
        if names[..n].contains(name) {
            return refuse(path, format!("{name:?} stands there twice"));
        }
    }
    Ok(())
}

/// A name that becomes part of a file's name.
pub(super) fn plain_name(path: &str, name: &str) -> Checked {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    if !name.is_empty() && name.len() <= 64 && name.chars().all(plain) {
        return Ok(());
    }
    refuse(path, format!("{name:?} is not a name; use up to 64 letters, digits, `-` and `_`"))
}

#[cfg(test)]
mod tests {
    use super::super::parse;

    #[test]
    fn a_deformable_muscle_wants_linear_elements_and_no_friction() {
        let with = |interface: &str, elements: &str| {
            let text = format!(
                "schema = 1\nsubject = {{ id = \"x\" }}\n[poses.prone]\nimage = \"x.nii\"\nposture = \"prone\"\n\
                 [model]\nmuscle = {{ rigid = false, young_kpa = 12.0 }}\n{interface}\n\
                 [mesh]\nsize_mm = 12.0\nelements = \"{elements}\"\n"
            );
            parse(&text).map(|study| study.model.muscle)
        };
        let bonded = "interface = { kind = \"bonded\" }";
        let found = with(bonded, "linear").unwrap();
        assert_eq!((found.rigid, found.young_kpa), (false, 12.0));
        let sliding = "interface = { kind = \"no_separation\", friction = 0.0 }";
        assert!(with(sliding, "linear").is_ok());
        let part = "interface = { kind = \"bonded\", regions = { base = { kind = \"rough\" } } }";
        for (interface, elements, says) in [
            (bonded, "quadratic", "linear elements"),
            ("", "linear", "not no_separation with a friction of 0.1"),
            (part, "linear", "not rough"),
        ] {
            let text = with(interface, elements).unwrap_err().to_string();
            assert!(text.contains("model.muscle.rigid") && text.contains(says), "{text}");
        }
    }
}
