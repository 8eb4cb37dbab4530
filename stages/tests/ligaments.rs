//! What holds a digital volunteer: each ligament, and the ends of skin and fascia at the cuts.

#![allow(clippy::unwrap_used)] // a test may fail at once

use mammotwin_data::{
    mesh::Patch,
    progress::Silent,
    solution::Solution,
    study::{Elements, InterfaceKind, InterfacePlan, MeshPlan, ModelPlan},
};
use mammotwin_solver::{Options, solve};
use mammotwin_stages::model::{Ligament, Moduli, shared_nodes};
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

const LINEAR: MeshPlan = MeshPlan { size_mm: 13.0, elements: Elements::Linear, doublings: 0 };
const MODULI: Moduli = Moduli { right_kpa: 0.4, left_kpa: 0.4 };

fn volunteer() -> (TruthBody, ModelPlan) {
    let torso = Torso::new(Preset::named("tiny").unwrap(), 1);
    let body = TruthBody::new(&torso, LINEAR, &Silent).unwrap();
    let mut plan = model_plan(&torso.person);
    // On a chest wall that holds nothing along itself.
    plan.interface = InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(0.0));
    (body, plan)
}

fn posed(body: &TruthBody, plan: &ModelPlan, names: &[&str], pose: PoseName) -> Solution {
    let mut plan = plan.clone();
    plan.ligaments.names = names.iter().map(|name| (*name).to_owned()).collect();
    let rest = &body.mesh.points;
    let model = body.body(&plan).model(rest, MODULI, pose.gravity(), None).unwrap();
    solve(&model, rest, &Options::default(), &Silent).unwrap()
}

#[test]
fn each_ligament_changes_where_the_breast_is() {
    let (body, plan) = volunteer();
    let poses = [PoseName::Upright, PoseName::Supine];
    let free = poses.map(|pose| posed(&body, &plan, &[], pose));
    assert!(free.iter().all(|found| !found.forces.contains_key("ligaments")));
    for ligament in Ligament::ALL {
        let moved = [0, 1].map(|n| {
            let found = posed(&body, &plan, &[ligament.name()], poses[n]);
            let apart = free[n].points.iter().zip(&found.points).map(|(a, b)| (a - b).norm());
            (apart.fold(0.0, f64::max), found.forces["ligaments"].norm())
        });
        println!("{}: {moved:.3?} (mm, mN) upright, supine", ligament.name());
        let most = moved.iter().fold(0.0, |most: f64, (way, _)| most.max(*way));
        let pull = moved.iter().fold(0.0, |most: f64, (_, force)| most.max(*force));
        assert!(most > 0.05 && pull > 1.0, "{}: {moved:?}", ligament.name());
    }
}

#[test]
fn ends_of_skin_and_fascia_are_fixed_across_the_cuts_alone() {
    let (body, plan) = volunteer();
    let mesh = &body.mesh;
    let model = body.body(&plan).model(&mesh.points, MODULI, PoseName::Upright.gravity(), None);
    let model = model.unwrap();
    let mut wanted = vec![[false; 3]; mesh.points.len()];
    let mut count = [0, 0];
    for cut in [Patch::Superior, Patch::Inferior] {
        for (layer, axis) in [(Patch::Skin, 1), (Patch::ChestWall, 2)] {
            let ends = shared_nodes(mesh, layer, cut);
            count[axis - 1] += ends.len();
            for node in ends {
                wanted[node as usize][axis] = true;
            }
        }
    }
    assert!(count.iter().all(|count| *count > 4), "{count:?}");
    assert_eq!(model.fixed(), wanted);
    assert!(model.held().is_empty());
}

#[test]
fn a_bonded_wall_is_held_where_it_is() {
    let (body, mut plan) = volunteer();
    plan.interface = InterfacePlan::uniform(InterfaceKind::Bonded, None);
    let mesh = &body.mesh;
    let model = body.body(&plan).model(&mesh.points, MODULI, PoseName::Prone.gravity(), None);
    let model = model.unwrap();
    let wall = mesh.patch_nodes(Patch::ChestWall);
    let held: Vec<u32> = model.held().keys().copied().collect();
    assert_eq!(held, wall);
    for (&node, place) in model.held() {
        assert!(model.fixed()[node as usize] == [true; 3] && *place == mesh.points[node as usize]);
    }
}
