//! What holds a breast: which nodes the ligaments tie to where, each alone on a digital volunteer, and the ends of skin and
//! fascia at the cuts.

use mammotwin_data::{
    Vec3,
    labels::Side,
    mesh::{Patch, TetMesh},
    progress::Silent,
    solution::Solution,
    study::{Elements, InterfaceKind, InterfacePlan, InterfaceRegion, MeshPlan, ModelPlan},
};
use mammotwin_solver::assemble::State;
use mammotwin_solver::terms::{Block, Load, Order};
use mammotwin_solver::{Options, solve};
use mammotwin_stages::model::{
    Anatomy, BreastBase, LENGTH_MM, Ligament, Moduli, cables, region, shared_nodes,
};
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

const LINEAR: MeshPlan = MeshPlan { size_mm: 13.0, elements: Elements::Linear };
const MODULI: Moduli = Moduli::new(0.4, 0.4);

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

/// Half axes of a round base (mm), and the elliptic radii of its rim.
const HALF_MM: f64 = 60.0;
const RIM: std::ops::RangeInclusive<f64> = 0.85..=1.2;

/// A right breast's base on the plane y = 0.
fn anatomy() -> Anatomy {
    let base = BreastBase {
        side: Side::Right,
        center: Vec3::zeros(),
        lateral: Vec3::x(),
        cranial: Vec3::z(),
        normal: Vec3::y(),
        half_axes_mm: [HALF_MM, HALF_MM],
        nipple: 50.0 * Vec3::y(),
        projection_mm: 50.0,
    };
    Anatomy { sternum_x_mm: -80.0, breasts: vec![base] }
}

/// The wall around it: a grid of 4 mm.
fn wall() -> TetMesh {
    let count = 51u32;
    let at = |n: u32| 4.0 * (f64::from(n) - 25.0);
    let points = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
    let points = points.map(|(i, j)| Vec3::new(at(i), 0.0, at(j))).collect();
    let mut faces = Vec::new();
    for i in 0..count - 1 {
        for j in 0..count - 1 {
            let [a, b, c, d] =
                [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)].map(|(i, j)| i * count + j);
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut mesh = TetMesh { points, ..TetMesh::default() };
    mesh.patches.insert(Patch::ChestWall, faces);
    mesh
}

/// The region of a ligament's sector of the rim.
fn sector(ligament: Ligament) -> InterfaceRegion {
    match ligament {
        Ligament::Inframammary => InterfaceRegion::Inframammary,
        Ligament::DeepMedial => InterfaceRegion::DeepMedial,
        Ligament::Cranial => InterfaceRegion::Cranial,
        Ligament::Lateral => InterfaceRegion::Lateral,
    }
}

#[test]
fn every_ligament_has_its_word_and_its_sector() {
    for ligament in Ligament::ALL {
        assert_eq!(Ligament::from_name(ligament.name()), Some(ligament));
    }
    assert_eq!(Ligament::from_name("cooper"), None);
    let place = |lateral: f64, cranial: f64| HALF_MM * Vec3::new(lateral, 0.0, cranial);
    for (lateral, cranial, want) in [
        (0.0, -1.0, Ligament::Inframammary),
        (0.0, 1.0, Ligament::Cranial),
        (-1.0, 0.0, Ligament::DeepMedial),
        (1.0, 0.0, Ligament::Lateral),
        // Sectors meet on the diagonals.
        (0.69, -0.70, Ligament::Inframammary),
        (0.70, -0.69, Ligament::Lateral),
        (-0.70, 0.69, Ligament::DeepMedial),
        (-0.69, 0.70, Ligament::Cranial),
    ] {
        let found = region(&anatomy(), &place(lateral, cranial));
        assert_eq!(found, Some(sector(want)), "{lateral} {cranial}");
    }
    assert_eq!(region(&anatomy(), &place(0.5, 0.5)), Some(InterfaceRegion::Base));
    assert_eq!(region(&anatomy(), &place(0.0, 0.84)), Some(InterfaceRegion::Base));
    assert_eq!(region(&anatomy(), &place(0.9, 0.9)), None);
}

#[test]
fn a_ligament_holds_the_nodes_of_its_sector_of_the_rim() {
    let (mesh, anatomy) = (wall(), anatomy());
    let mut held = Vec::new();
    for ligament in Ligament::ALL {
        let found = cables(&mesh, &mesh.points, &anatomy, &[ligament]);
        assert!(!found.is_empty());
        for (own, cable) in &found {
            let p = mesh.points[cable.node as usize];
            assert!(*own == ligament && RIM.contains(&(p.norm() / HALF_MM)), "{p}");
            assert_eq!(region(&anatomy, &p), Some(sector(ligament)));
            held.push(cable.node);
        }
    }
    held.sort_unstable();
    let rim = (0..mesh.points.len()).filter(|&n| RIM.contains(&(mesh.points[n].norm() / HALF_MM)));
    assert_eq!(held, rim.map(|n| n as u32).collect::<Vec<_>>(), "each node has one ligament");
    assert!(cables(&mesh, &mesh.points, &anatomy, &[]).is_empty());
}

#[test]
fn sections_share_a_sheet_of_1_mm_around_the_base() {
    let all = cables(&wall(), &wall().points, &anatomy(), &Ligament::ALL);
    let section: f64 = all.iter().map(|(_, cable)| cable.section_mm2).sum();
    // The circle in the middle of the rim.
    let around = std::f64::consts::TAU * HALF_MM * 0.5 * (RIM.start() + RIM.end());
    println!("{section:.1} for {around:.1} mm²");
    assert!((section / around - 1.0).abs() < 0.03, "{section} for {around} mm²");
}

#[test]
fn anchors_lie_away_from_the_centre_of_the_base() {
    let (mesh, anatomy) = (wall(), anatomy());
    // At rest the body is elsewhere: the anchors go along.
    let rest: Vec<Vec3> = mesh.points.iter().map(|p| p + Vec3::new(3.0, 1.0, -2.0)).collect();
    for (_, cable) in cables(&mesh, &rest, &anatomy, &Ligament::ALL) {
        let node = cable.node as usize;
        let arm = cable.anchor - rest[node];
        assert!((arm.norm() - LENGTH_MM).abs() < 1e-12);
        assert!((arm.normalize() - mesh.points[node].normalize()).norm() < 1e-12, "{arm}");
    }
}

#[test]
fn cables_are_just_taut_at_rest_and_pull_away_from_the_centre_only() {
    let (body, plan) = volunteer();
    let rest = &body.mesh.points;
    let whole = body.body(&plan);
    let model = whole.model(rest, MODULI, Vec3::zeros(), None).unwrap();
    let index = model.terms().iter().position(|term| term.name() == "ligaments").unwrap();
    let term = &model.terms()[index];
    let planned = cables(&body.mesh, rest, whole.anatomy, &Ligament::ALL);
    assert_eq!(term.elements(), planned.len());
    // Way (mm) away from the centre, and the strain of each cable.
    for (way, strain) in [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.05)] {
        let mut points = rest.clone();
        for (_, cable) in &planned {
            let node = cable.node as usize;
            points[node] += way * (cable.anchor - rest[node]).normalize();
        }
        let state = State::new(&model, points, Load::GRAVITY);
        for (element, (_, cable)) in planned.iter().enumerate() {
            assert_eq!(term.nodes(element), [cable.node]);
            let mut block = Block::ZERO;
            term.block(element, &state.at(index), Order::Gradient, &mut block).unwrap();
            let out = (cable.anchor - rest[cable.node as usize]).normalize();
            let pull = -block.gradient[0].dot(&out);
            let want = plan.ligaments.young_kpa * cable.section_mm2 * strain;
            // The kink is smooth over a thousandth of the length.
            assert!((pull - want).abs() <= 0.011 * want + 1e-9, "{way}: {pull} for {want} mN");
        }
    }
}
