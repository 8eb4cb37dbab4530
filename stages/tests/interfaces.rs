//! The contacts of the chest wall (Mîra 2018, table 2.1 and appendix C) under a digital volunteer.

use mammotwin_data::{
    mesh::Patch,
    progress::Silent,
    solution::Solution,
    study::{Elements, InterfaceKind, InterfacePlan, InterfaceRegion, MeshPlan, RegionPlan},
};
use mammotwin_solver::{Options, SolveError, solve};
use mammotwin_stages::model::{Moduli, region};
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

/// How far (mm) nodes of the chest wall went, with their regions.
type Ways = Vec<(Option<InterfaceRegion>, f64)>;

/// Elements of the bodies.
const LINEAR: MeshPlan = MeshPlan { size_mm: 13.0, elements: Elements::Linear };

struct Volunteer {
    torso: Torso,
    body: TruthBody,
}

fn volunteer() -> Volunteer {
    let torso = Torso::new(Preset::named("tiny").unwrap(), 1);
    let body = TruthBody::new(&torso, LINEAR, &Silent).unwrap();
    Volunteer { torso, body }
}

impl Volunteer {
    /// The pose from the stress-free shape, and how far (mm) chest-wall nodes slid, with regions.
    fn pose(
        &self,
        interface: InterfacePlan,
        pose: PoseName,
    ) -> Result<(Solution, Ways), SolveError> {
        let mut plan = model_plan(&self.torso.person);
        plan.interface = interface;
        let body = self.body.body(&plan);
        let rest = &self.body.mesh.points;
        let moduli = Moduli::new(0.4, 0.4);
        let model = body.model(rest, moduli, pose.gravity(), None).unwrap();
        let clock = std::time::Instant::now();
        let found = solve(&model, rest, &Options::default(), &Silent);
        let time = clock.elapsed();
        let kind = plan.interface.kind.name();
        match &found {
            Ok(found) => println!("{kind} {}: {time:.2?}, {:?}", pose.name(), found.checks),
            Err(error) => println!("{kind} {}: {error}, {time:.2?}", pose.name()),
        }
        let found = found?;
        let nodes = body.mesh.patch_nodes(Patch::ChestWall);
        let slid = nodes.iter().map(|&n| {
            let way = found.points[n as usize] - rest[n as usize];
            (region(body.anatomy, &body.mesh.points[n as usize]), way.norm())
        });
        let slid = slid.collect();
        Ok((found, slid))
    }
}

fn mean(slid: &Ways, of: impl Fn(Option<InterfaceRegion>) -> bool) -> f64 {
    let ways: Vec<f64> = slid.iter().filter(|(r, _)| of(*r)).map(|(_, way)| *way).collect();
    assert!(!ways.is_empty());
    ways.iter().sum::<f64>() / ways.len() as f64
}

#[test]
fn every_contact_of_the_table_carries_a_supine_breast() {
    let volunteer = volunteer();
    let mut ways = Vec::new();
    for (kind, friction) in [
        (InterfaceKind::NoSeparation, 0.0),
        (InterfaceKind::NoSeparation, 0.1),
        (InterfaceKind::NoSeparation, 0.5),
        (InterfaceKind::Frictionless, 0.0),
        (InterfaceKind::Frictional, 0.1),
        (InterfaceKind::Rough, 0.0),
    ] {
        let plan = InterfacePlan::uniform(kind, Some(friction));
        let (found, slid) = volunteer.pose(plan, PoseName::Supine).unwrap();
        let checks = found.checks;
        assert!(checks.max_penetration_mm < 0.05 && checks.max_gap_mm < 0.05, "{checks:?}");
        assert!(checks.force_imbalance < 1e-3 && checks.moment_imbalance < 1e-3, "{checks:?}");
        ways.push(mean(&slid, |_| true));
    }
    println!("mean way on the wall: {ways:.3?} mm");
    assert!(ways[0] > ways[1] && ways[1] > ways[2] && ways[2] > ways[5]);
}

#[test]
fn regions_of_the_rim_hold_what_slides_between_them() {
    let volunteer = volunteer();
    let bonded = RegionPlan { kind: InterfaceKind::Bonded, friction: None };
    let mut mixed = InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(0.1));
    for region in
        [InterfaceRegion::Inframammary, InterfaceRegion::DeepMedial, InterfaceRegion::Lateral]
    {
        mixed.regions.insert(region, bonded);
    }
    for pose in [PoseName::Supine, PoseName::Prone, PoseName::Upright] {
        let sliding = InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(0.1));
        let (_, free) = volunteer.pose(sliding, pose).unwrap();
        let (found, held) = volunteer.pose(mixed.clone(), pose).unwrap();
        assert!(found.forces.contains_key("chest_wall") && found.forces.contains_key("fixed"));
        let base = |r: Option<InterfaceRegion>| r == Some(InterfaceRegion::Base);
        let (free, held) = (mean(&free, base), mean(&held, base));
        println!("{}: base {free:.3} mm free, {held:.3} mm within a bonded rim", pose.name());
        assert!(held < free && held > 0.0);
    }
}

#[test]
fn a_hanging_breast_knows_friction_only_where_it_is_pressed_on() {
    let volunteer = volunteer();
    let change = |pose: PoseName| {
        let [free, rubbed] = [0.0, 0.3].map(|friction| {
            let plan = InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(friction));
            volunteer.pose(plan, pose).unwrap().0.points
        });
        let squares = free.iter().zip(&rubbed).map(|(a, b)| (a - b).norm_squared());
        (squares.sum::<f64>() / free.len() as f64).sqrt()
    };
    let [prone, supine] = [PoseName::Prone, PoseName::Supine].map(change);
    println!("friction moves the nodes by {prone:.3} mm prone, {supine:.3} mm supine");
    assert!(prone < 0.3 * supine);
}
