//! The fold under a large, soft breast of a person who stands: skin on skin.

use mammotwin_data::{
    progress::Silent,
    solution::Solution,
    study::{Elements, MeshPlan},
};
use mammotwin_solver::{Options, solve, solve_near};
use mammotwin_stages::model::{Moduli, skin_through_skin};
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

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
