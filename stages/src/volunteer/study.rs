//! The study file of a digital volunteer, ready to run.

use super::{PoseName, Preset, Torso, Truth};
use mammotwin_data::study::{
    BreastPlan, InterfacePlan, LayerPlan, LigamentPlan, ModelPlan, MusclePlan,
};
use std::{collections::BTreeMap, fmt::Write};

/// The model of the truth, which the study describes too.
pub fn model_plan(person: &Preset) -> ModelPlan {
    let (fixed, stiffness) = (&person.fixed, &person.stiffness);
    ModelPlan {
        reference_pose: Some(PoseName::Supine.name().into()),
        breast: BreastPlan {
            young_right_kpa: stiffness.breast_right_kpa,
            young_left_kpa: stiffness.breast_left_kpa,
            poisson: fixed.poisson,
            ..BreastPlan::default()
        },
        skin: LayerPlan::neo_hookean(stiffness.skin_kpa, fixed.skin_mm),
        fascia: LayerPlan::neo_hookean(stiffness.fascia_kpa, fixed.fascia_mm),
        muscle: MusclePlan { rigid: true, young_kpa: fixed.muscle_kpa },
        ligaments: LigamentPlan { young_kpa: fixed.ligaments_kpa, ..LigamentPlan::default() },
        interface: InterfacePlan::uniform(fixed.interface, Some(fixed.friction)),
        skin_contact: false,
        arms: BTreeMap::new(),
        density_g_per_cm3: fixed.density_g_per_cm3,
        effects: person.effects.clone(),
    }
}

/// Young's modulus (kPa) of the breast that a study begins with (Mîra 2018, § 5.1.2).
const LITERATURE_KPA: f64 = 0.5;

/// Text of `study.toml`. It states the truth's model, but a breast as stiff as the literature has
/// it: the calibration is to find how stiff it is.
pub fn text(torso: &Torso, truth: &Truth, poses: &[PoseName], seed: u64) -> String {
    let person = &torso.person;
    let (fixed, stiffness, compression) = (&person.fixed, &person.stiffness, &person.compression);
    let [right, left] = [LITERATURE_KPA; 2];

    let mut poses_text = String::new();
    let mut fitted = 0;
    for pose in poses {
        let name = pose.name();
        let gravity = match (pose.gravity_of_posture(), truth.poses.get(name)) {
            (None, Some(pose)) => {
                let v = &pose.gravity_in_image;
                format!("gravity_in_image = [{:.9}, {:.9}, {:.9}]", v.x, v.y, v.z)
            }
            _ => format!("posture = \"{name}\""),
        };
        let usage = match pose {
            PoseName::Supine | PoseName::Prone => "fit",
            PoseName::Tilted | PoseName::Upright => "validate",
        };
        fitted += usize::from(usage == "fit");
        // Writing to a string cannot fail.
        let _ = write!(
            poses_text,
            r#"
[poses.{name}]
image = "{name}.nii.gz"
{gravity}
landmarks = "{name}_landmarks.csv"
use = "{usage}"
"#
        );
    }
    let parameters = match fitted {
        // Stiffness is what two poses differ by.
        0 | 1 => {
            "# One pose to fit tells no stiffness: moduli stay those of [model].\nparameters = []"
        }
        _ => r#"parameters = ["breast.young_right_kpa", "breast.young_left_kpa"]"#,
    };
    format!(
        r#"# A digital volunteer: a synthetic subject. What is true of her is in truth/, which no stage
# reads. The breast starts at a stiffness from the literature; everything else of the model is true.
schema = 1

[subject]
id = "dv-{name}-{seed}"
{poses_text}
[model]
reference_pose = "supine"
density_g_per_cm3 = {density}
breast = {{ law = "neo_hookean", young_right_kpa = {right:.6}, young_left_kpa = {left:.6}, poisson = {poisson} }}
skin = {{ law = "neo_hookean", young_kpa = {skin}, thickness_mm = {skin_mm} }}
fascia = {{ law = "neo_hookean", young_kpa = {fascia}, thickness_mm = {fascia_mm} }}
muscle = {{ rigid = true, young_kpa = {muscle} }}
ligaments = {{ young_kpa = {ligaments}, names = ["inframammary", "deep_medial", "cranial", "lateral"] }}
interface = {{ kind = "{interface}", friction = {friction} }}

[mesh]
size_mm = {size}
elements = "{elements}"

[calibrate]
{parameters}

[compress]
side = "right"
view = "cc"
paddle = "rigid"
chest_wall_distance_mm = {distance}
stop = {{ thickness_mm = {thickness} }}
law = {{ name = "gent", jm = {jm}, poisson = 0.499 }}

[mammogram]
energy_kev = 24.0
exposure = "automatic"
calcifications = {{ rows = 7, columns = 3, pitch_mm = 10.0, diameter_mm = [0.2, 0.3] }}
"#,
        name = truth.preset,
        density = fixed.density_g_per_cm3,
        poisson = fixed.poisson,
        skin = stiffness.skin_kpa,
        skin_mm = float(fixed.skin_mm),
        fascia = float(stiffness.fascia_kpa),
        fascia_mm = fixed.fascia_mm,
        muscle = float(fixed.muscle_kpa),
        ligaments = float(fixed.ligaments_kpa),
        interface = fixed.interface.name(),
        friction = float(fixed.friction),
        size = float(person.study_mesh.size_mm),
        elements = person.study_mesh.elements.name(),
        distance = float(compression.chest_wall_distance_mm),
        thickness = float(compression.thickness_right_mm),
        jm = float(compression.jm),
    )
}

/// A number that TOML reads as a float.
fn float(value: f64) -> String {
    format!("{value:?}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volunteer::{Motion, truth::PoseTruth};
    use mammotwin_data::landmarks::Landmarks;

    #[test]
    fn moduli_are_fitted_where_two_poses_are() {
        let torso = Torso::new(Preset::named("tiny").unwrap().person(3), 3);
        let truth = Truth::of(&torso, "tiny", 3);
        let fitted = |poses: &[PoseName]| {
            // Supine and prone need no truth for their gravity.
            let text = text(&torso, &truth, poses, 3);
            mammotwin_data::study::parse(&text).unwrap().calibrate.parameters.len()
        };
        assert_eq!(fitted(&[PoseName::Supine, PoseName::Prone]), 2);
        assert_eq!(fitted(&[PoseName::Supine]), 0);
        assert_eq!(fitted(&[PoseName::Supine, PoseName::Upright]), 0, "one to fit, one held out");
    }

    #[test]
    fn the_study_is_valid_and_its_gravity_is_the_true_one_in_the_common_frame() {
        for name in ["tiny", "small", "large", "sliding"] {
            let torso = Torso::new(Preset::named(name).unwrap().person(3), 3);
            let mut truth = Truth::of(&torso, name, 3);
            for pose in PoseName::ALL {
                let motion = Motion::drawn(&torso, pose, 3);
                let known = PoseTruth::of(pose, &motion, Landmarks::default());
                truth.poses.insert(pose.name().into(), known);
            }
            let text = text(&torso, &truth, &PoseName::ALL, 3);
            let study = mammotwin_data::study::parse(&text).unwrap();
            for (name, pose) in &study.poses {
                let known = &truth.poses[name];
                let gravity = known.to_common.direction(&pose.gravity().unwrap());
                assert!((gravity - known.gravity_in_common).norm() < 1e-8, "{name}: {gravity}");
            }
            let mut described = study.model.clone();
            let known = model_plan(&torso.person);
            described.breast.young_right_kpa = known.breast.young_right_kpa;
            described.breast.young_left_kpa = known.breast.young_left_kpa;
            assert_eq!(described, known);
            let start = &study.model.breast;
            assert_eq!([start.young_right_kpa, start.young_left_kpa], [LITERATURE_KPA; 2]);
        }
    }
}
