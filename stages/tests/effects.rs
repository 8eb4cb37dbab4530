//! What effects do to a digital volunteer: breasts hang less far, or elsewhere, in the poses that they act in.

use mammotwin_data::{
    Vec3,
    mesh::Patch,
    progress::Silent,
    study::{Elements, MeshPlan},
};
use mammotwin_solver::{Options, solve};
use mammotwin_stages::model::Moduli;
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

const LINEAR: MeshPlan = MeshPlan { size_mm: 15.0, elements: Elements::Linear };

struct Volunteer {
    torso: Torso,
    body: TruthBody,
}

impl Volunteer {
    fn new() -> Self {
        let torso = Torso::new(Preset::named("tiny").unwrap(), 1);
        let body = TruthBody::new(&torso, LINEAR, &Silent).unwrap();
        Self { torso, body }
    }

    /// How far (mm) the nodes went from the stress-free shape, with an effect.
    fn moved(&self, pose: PoseName, effect: Option<(&str, f64)>) -> Vec<Vec3> {
        let mut plan = model_plan(&self.torso.person);
        plan.effects.extend(effect.map(|(name, amplitude)| (name.to_string(), amplitude)));
        let body = self.body.body(&plan);
        let rest = &self.body.mesh.points;
        let moduli = Moduli::new(0.5, 0.5);
        let model = body.model(rest, moduli, pose.gravity(), None).unwrap();
        let found = solve(&model, rest, &Options::default(), &Silent).unwrap();
        found.points.iter().zip(rest).map(|(p, rest)| p - rest).collect()
    }

    /// The same in the mean of the skin within 25 mm of the nipples, along the normals of the bases: away from the chest is positive.
    fn hanging(&self, pose: PoseName, effect: Option<(&str, f64)>) -> f64 {
        let plan = model_plan(&self.torso.person);
        let body = self.body.body(&plan);
        let moved = self.moved(pose, effect);
        let mut ways = Vec::new();
        for node in body.mesh.patch_nodes(Patch::Skin) {
            let place = &body.mesh.points[node as usize];
            for base in &body.anatomy.breasts {
                if (base.nipple - place).norm() < 25.0 {
                    ways.push(moved[node as usize].dot(&base.normal));
                }
            }
        }
        assert!(ways.len() > 4);
        ways.iter().sum::<f64>() / ways.len() as f64
    }
}

#[test]
fn tissue_that_still_creeps_hangs_less_far_on_the_front_alone() {
    let volunteer = Volunteer::new();
    let of = |pose, amplitude| volunteer.hanging(pose, Some(("viscosity", amplitude)));
    let [plain, stiff] = [0.0, 0.5].map(|amplitude| of(PoseName::Prone, amplitude));
    // Small strains hang in proportion to 1 / 1.5; large ones are not far from it.
    let part = stiff / plain;
    println!("prone {plain:.2} mm, {stiff:.2} mm");
    assert!(plain > 2.0 && (part * 1.5 - 1.0).abs() < 0.1, "{part}");
    let [before, after] = [0.0, 0.5].map(|amplitude| of(PoseName::Upright, amplitude));
    assert_eq!(before, after);
}

#[test]
fn fibres_hold_a_breast_that_hangs_from_them_and_not_one_that_lies_on_them() {
    let volunteer = Volunteer::new();
    let of =
        |pose| [0.0, 1.0].map(|part| volunteer.hanging(pose, Some(("cooper_anisotropy", part))));
    let [free, held] = of(PoseName::Prone);
    let [lying, beside] = of(PoseName::Supine);
    println!("prone {free:.2} to {held:.2} mm, supine {lying:.2} to {beside:.2} mm");
    assert!(held > 0.0 && held < 0.85 * free);
    assert!((lying - beside).abs() < 0.2 * (free - held));
}

#[test]
fn a_muscle_that_stands_out_takes_the_breast_with_it() {
    let volunteer = Volunteer::new();
    let shift = Some(("pectoral_shift", 5.0));
    let [before, after] = [None, shift].map(|effect| volunteer.hanging(PoseName::Prone, effect));
    println!("{before:.2} to {after:.2} mm");
    assert!((3.0..6.0).contains(&(after - before)), "{before} {after}");
    // The wall itself goes as far as it was told, most behind the middle of a base.
    let [plain, moved] = [None, shift].map(|effect| volunteer.moved(PoseName::Prone, effect));
    let plan = model_plan(&volunteer.torso.person);
    let body = volunteer.body.body(&plan);
    let wall = body.mesh.patch_nodes(Patch::ChestWall);
    let ways = wall.iter().map(|&n| (moved[n as usize] - plain[n as usize]).norm());
    let longest = ways.fold(0.0, f64::max);
    assert!((4.5..5.0 + 1e-9).contains(&longest), "{longest}");
    let upright = [None, shift].map(|effect| volunteer.hanging(PoseName::Upright, effect));
    assert_eq!(upright[0], upright[1]);
}
