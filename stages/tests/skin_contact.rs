//! What skin keeps off: other skin, in the fold under a large, soft breast of a person who stands, and an arm.

use crate::common::{field_of_view, labels, torso};
use mammotwin_data::{
    Vec3,
    mesh::Patch,
    progress::Silent,
    rigid::RigidTransform,
    solution::Solution,
    store::Stage,
    study::{ArmPlan, Elements, MeshPlan},
};
use mammotwin_solver::{Options, solve, solve_near};
use mammotwin_stages::{
    mesh::Mesh,
    model::{Body, Moduli, skin_through_skin},
    pose::PoseTarget,
    register::Registered,
    surface::Surface,
    volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan},
};
use std::collections::BTreeMap;

/// Volunteer `large` with the abdomen under her breasts: her own limits end above it.
struct Standing {
    torso: Torso,
    body: TruthBody,
}

impl Standing {
    fn new(size_mm: f64) -> Self {
        let mut torso = Torso::new(Preset::named("large").unwrap().person(7), 7);
        torso.limits.least_z_mm -= 70.0;
        let plan = MeshPlan { size_mm, elements: Elements::Linear };
        let body = TruthBody::new(&torso, plan, &Silent).unwrap();
        Self { torso, body }
    }

    /// She stands, with or without contact of her skin; from her stress-free shape, or from a state near the end.
    fn posed(&self, kpa: f64, contact: bool, near: Option<&Solution>) -> Solution {
        let mut plan = model_plan(&self.torso.person);
        plan.skin_contact = contact;
        let body = self.body.body(&plan);
        let rest = &body.mesh.points;
        let gravity = PoseName::Upright.gravity();
        let model = body.model(rest, Moduli::new(kpa, kpa), gravity, None).unwrap();
        let clock = std::time::Instant::now();
        let found = match near {
            Some(near) => solve_near(&model, &near.points, &Options::default(), &Silent),
            None => solve(&model, rest, &Options::default(), &Silent),
        };
        let found = found.unwrap();
        println!("{kpa} kPa, contact {contact}: {:.1?}, {:?}", clock.elapsed(), found.checks);
        assert!(found.checks.residual < 1e-6 && found.checks.internal_imbalance < 1e-9);
        assert!(found.checks.force_imbalance < 1e-6 && found.checks.moment_imbalance < 1e-6);
        found
    }

    fn through_mm(&self, found: &Solution) -> f64 {
        let deepest = skin_through_skin(&self.body.mesh, &found.points);
        println!("  through skin: {deepest:?}");
        deepest.map_or(0.0, |(_, mm)| mm)
    }
}

/// Largest distance (mm) between the nodes of two states.
fn apart_mm(one: &Solution, other: &Solution) -> f64 {
    let pairs = one.points.iter().zip(&other.points);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Verifies: a large breast of 0.3 kPa on the abdomen, upright, volunteer `large` | skin passes through skin without contact, not with it | more than 1 mm and none
#[test]
fn a_breast_lies_on_the_abdomen() {
    let standing = Standing::new(13.0);
    let free = standing.posed(0.3, false, None);
    assert!(standing.through_mm(&free) > 1.0);
    let kept = standing.posed(0.3, true, None);
    assert_eq!(standing.through_mm(&kept), 0.0);
    assert!(kept.checks.max_penetration_mm < 0.05);
    let moved = apart_mm(&free, &kept);
    println!("contact moves her by up to {moved:.1} mm");
    assert!(moved > 1.0);
}

/// Verifies: the same at 0.5, 0.3, 0.2 kPa, from rest and from where skin has passed through skin | what does not touch is as without contact; both ways end alike | 1e-3 mm, 0.1 mm at 0.3 kPa, 0.5 mm at 0.2 kPa
#[test]
#[ignore = "minutes: soft breasts in many load steps"]
fn contact_changes_only_what_touches_and_does_not_depend_on_the_way() {
    let standing = Standing::new(13.0);
    // A fold of flat facets may lie in more than one way: 0.02 and 0.31 mm were seen.
    for (kpa, touches, alike_mm) in [(0.5, false, 0.0), (0.3, true, 0.1), (0.2, true, 0.5)] {
        let (free, kept) = (standing.posed(kpa, false, None), standing.posed(kpa, true, None));
        assert_eq!(standing.through_mm(&free) > 1.0, touches);
        assert_eq!(standing.through_mm(&kept), 0.0);
        if !touches {
            assert!(apart_mm(&free, &kept) < 1e-3);
            continue;
        }
        let pushed = standing.posed(kpa, true, Some(&free));
        let apart = apart_mm(&pushed, &kept);
        println!("from rest and from the crossed state: {apart:.4} mm apart");
        assert_eq!(standing.through_mm(&pushed), 0.0);
        assert!(apart < alike_mm, "{apart}");
    }
}

/// Verifies: a prone breast, volunteer `tiny`, beside an arm that would be 8 mm deep in it | skin out of the arm, its force borne, the same in another frame of the pose's image | 0.05 mm, 1e-6, 1e-4 mm
#[test]
fn skin_keeps_off_an_arm() {
    let torso = torso("tiny", 1);
    let labels = labels(&torso, &field_of_view(&torso, [2.5; 3]));
    let size = MeshPlan { size_mm: 15.0, elements: Elements::Linear };
    let mesh = Mesh(size).run(&labels, &Silent).unwrap();
    let surfaces = Surface::default().run(&labels, &Silent).unwrap();
    let plan = model_plan(&torso.person);
    let moduli = Moduli::new(0.4, 0.4);
    let rest = &mesh.mesh.points;
    // Her chest lies otherwise in the image of the pose than in the reference pose.
    let about = Vec3::new(20.0, -10.0, 5.0);
    let motion =
        RigidTransform::about(&about, &Vec3::new(0.2, -0.3, 0.4), &Vec3::new(7.0, -3.0, 11.0));
    let target = |transform: RigidTransform| {
        let gravity = PoseName::Prone.gravity();
        let registered = Registered { transform, ..Registered::reference(gravity) };
        let mut moved = surfaces.clone();
        let back = transform.inverse();
        moved.skin.points.iter_mut().for_each(|p| *p = back.point(p));
        PoseTarget::new("prone", &mesh, &registered, &moved).unwrap()
    };
    let still = target(RigidTransform::identity());
    let free = still.load(&Body::new(&mesh, &plan), rest, moduli, rest, false).unwrap();
    // Across the front of the right breast, from its side.
    let skin = mesh.mesh.patch_nodes(Patch::Skin);
    let aside = (Vec3::y() + Vec3::x() * mesh.anatomy.breasts[0].center.x.signum()).normalize();
    let along = |n: &u32| aside.dot(&free.points[*n as usize]);
    let first = skin.iter().max_by(|a, b| along(a).total_cmp(&along(b))).unwrap();
    let (radius_mm, deep_mm) = (40.0, 8.0);
    let axis = free.points[*first as usize] + (radius_mm - deep_mm) * aside;
    let ends = [-60.0, 60.0].map(|z| axis + Vec3::z() * z);
    let with_arm = |transform: RigidTransform| {
        let [from_mm, to_mm] = ends.map(|end| transform.inverse().point(&end).into());
        let mut plan = plan.clone();
        let arm = ArmPlan { from_mm, to_mm, radius_mm };
        plan.arms = BTreeMap::from([("prone".into(), vec![arm]), ("other".into(), vec![arm])]);
        target(transform).load(&Body::new(&mesh, &plan), rest, moduli, rest, false).unwrap()
    };
    let kept = with_arm(RigidTransform::identity());
    let deep = |found: &Solution| {
        let off = |n: &u32| {
            let p = found.points[*n as usize] - axis;
            radius_mm - (p - Vec3::z() * p.z.clamp(-60.0, 60.0)).norm()
        };
        skin.iter().map(off).fold(f64::MIN, f64::max)
    };
    let (before, after) = (deep(&free), deep(&kept));
    let moved = apart_mm(&free, &kept);
    println!(
        "{before:.2} mm deep, {after:.4} mm with contact, moved by {moved:.1} mm: {:?}",
        kept.checks
    );
    assert!(before > 7.9 && after < 0.05, "{before} {after}");
    assert!(kept.checks.residual < 1e-6 && kept.checks.force_imbalance < 1e-6);
    assert!(kept.forces["arm_1"].dot(&aside) < -10.0, "{:?}", kept.forces);
    assert!(apart_mm(&kept, &with_arm(motion)) < 1e-4);
}
