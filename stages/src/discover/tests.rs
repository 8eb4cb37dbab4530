//! Verdicts on drawn skins, where everything is known.

use super::{
    Budget, Course, Evidence, Judge, Signature, VerdictName,
    course::Change,
    refit::{Fitted, linear},
    trial::Errors,
};
use crate::{discover::RigidError, effects::Effect, model::Moduli, shape::Shape};
use mammotwin_data::Vec3;
use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const POSES: [&str; 3] = ["prone", "tilted", "upright"];
const HELD_OUT: &str = "tilted";

/// A half ellipsoid of 60 x 60 x 50 mm, evenly covered.
fn dome() -> Shape {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let count = 90;
    let unit = (0..count).map(|n| {
        let up = (f64::from(n) + 0.5) / f64::from(count);
        let (sin, cos) = (golden * f64::from(n)).sin_cos();
        let around = (1.0 - up * up).sqrt();
        Vec3::new(around * cos, up, around * sin)
    });
    let half = Vec3::new(60.0, 50.0, 60.0);
    let (points, normals) =
        unit.map(|u| (u.component_mul(&half), u.component_div(&half).normalize())).unzip();
    Shape { points, normals }
}

/// What waves of some length (mm) along an axis change (mm) about the distances, one size a pose.
fn waves(shape: &Shape, axis: usize, length_mm: f64, sizes: [f64; 3]) -> DVector<f64> {
    let one = |size: f64| {
        shape.points.iter().map(move |p| size * (std::f64::consts::TAU * p[axis] / length_mm).sin())
    };
    DVector::from_vec(sizes.into_iter().flat_map(one).collect())
}

/// Scales with the height over the chest wall, as a modulus does.
fn sag(shape: &Shape, right: bool) -> DVector<f64> {
    let own = |p: &Vec3| if (p.x < 0.0) == right { 0.1 * p.y } else { 0.0 };
    let one = |size: f64| shape.points.iter().map(move |p| size * own(p));
    DVector::from_vec([1.0, 0.6, -0.8].into_iter().flat_map(one).collect())
}

/// A library of two effects that differ and one that is like the first; evidence of the residuals (mm).
pub(super) fn evidence(residual: DVector<f64>) -> Evidence {
    let shape = dome();
    let nodes = shape.points.len();
    let exact = |mean: DVector<f64>| Change { off: DVector::zeros(mean.len()), mean };
    let linear = |column: DVector<f64>| Course::through((1.0, &exact(column)), None);
    let signature = |name: &str, column: DVector<f64>| {
        let effect = Effect::named(name).unwrap();
        let (small, range) = (effect.amplitude.small, effect.amplitude.range);
        Signature::small(effect, range, small, small * column)
    };
    let stripes = waves(&shape, 0, 50.0, [3.0, 2.5, 2.0]);
    let like = &stripes + waves(&shape, 2, 30.0, [0.1, 0.1, 0.1]);
    Evidence {
        poses: POSES.map(String::from).to_vec(),
        held_out: HELD_OUT.into(),
        weighed: (0..nodes as u32).collect(),
        edges: Vec::new(),
        shapes: vec![shape.clone(); 3],
        moduli: Moduli::new(0.3, 0.2),
        off: DVector::zeros(3 * nodes),
        by_moduli: [linear(sag(&shape, true)), linear(sag(&shape, false))],
        signatures: vec![
            signature("limit_chain", stripes),
            signature("skin_prestress", 10.0 * waves(&shape, 2, 60.0, [2.0, 2.0, -2.0])),
            signature("cooper_anisotropy", like),
        ],
        failed: Vec::new(),
        meshings: (0..3).map(|n| waves(&shape, 2, 40.0 + f64::from(n), [0.02; 3])).collect(),
        growth: DVector::from_element(3 * nodes, 1.0),
        budget: Budget {
            white_mm: 0.25,
            segmentation_mm: 0.25,
            segmentation_length_mm: 12.0,
            chest_mm: 0.3,
            chest_length_mm: 60.0,
            offset_mm: 0.3,
            voxel_mm: 1.0,
        },
        reference: shape,
        residual,
    }
}

pub(super) fn nothing() -> DVector<f64> {
    DVector::zeros(3 * dome().points.len())
}

/// Residuals of a model that lacks an effect of this amplitude: what it lacks, with the sign turned.
fn lacking(name: &str, amplitude: f64) -> DVector<f64> {
    let known = evidence(nothing());
    let signature = known.signatures.iter().find(|s| s.effect.name == name).unwrap();
    -signature.change(amplitude)
}

fn verdict(evidence: &Evidence) -> super::Verdict {
    Judge::new(evidence).unwrap().linear(&evidence.residual).1
}

fn without_the_rival(residual: DVector<f64>) -> Evidence {
    evidence(residual).without_effect("cooper_anisotropy")
}

#[test]
fn nothing_is_found_where_nothing_is_hidden() {
    let found = verdict(&evidence(nothing()));
    assert_eq!(found.verdict, VerdictName::NoDiscrepancy);
    assert_eq!((found.effect, found.set), (None, Vec::new()));
}

#[test]
fn errors_of_the_budget_and_rigid_motions_are_seldom_anything() {
    let known = evidence(nothing());
    // Twice what a registration is off by.
    let rigid = RigidError { shift_mm: 0.7, turn: 0.005 };
    let errors = Errors::new(&known, &known.budget, rigid).unwrap();
    let judge = Judge::new(&known).unwrap();
    let draws = 600;
    let alarms = (0..draws)
        .map(|draw| judge.linear(&errors.draw(&mut ChaCha8Rng::seed_from_u64(draw))).1.verdict)
        .filter(|verdict| *verdict != VerdictName::NoDiscrepancy)
        .count();
    // One in a hundred by the scores, one in a thousand by the smooth rest.
    assert!(alarms <= 12, "{alarms} of {draws}");
}

#[test]
fn a_hidden_effect_is_named_with_its_amplitude() {
    let found = verdict(&without_the_rival(lacking("limit_chain", 0.8)));
    assert_eq!(found.verdict, VerdictName::Named, "{}", found.reason);
    assert_eq!(found.effect.as_deref(), Some("limit_chain"));
    let [amplitude, deviation] = found.candidates[0].amplitude;
    assert!((amplitude - 0.8).abs() < 1e-3 && deviation > 0.0, "{amplitude} ± {deviation}");
    assert!(found.candidates[0].held_out.after_mm < 0.05 * found.candidates[0].held_out.before_mm);
}

#[test]
fn effects_that_look_alike_are_a_set() {
    let found = verdict(&evidence(lacking("limit_chain", 0.8)));
    assert_eq!(found.verdict, VerdictName::Ambiguous, "{}", found.reason);
    let mut set = found.set.clone();
    set.sort_unstable();
    assert_eq!(set, ["cooper_anisotropy", "limit_chain"]);
    let known = evidence(nothing());
    let screening = Judge::new(&known).unwrap().screen(&lacking("limit_chain", 0.8));
    assert_eq!(screening.alike("limit_chain"), ["cooper_anisotropy"]);
    assert!(screening.alike("skin_prestress").is_empty());
}

#[test]
fn a_held_out_pose_without_the_change_bears_nothing_out_and_its_opposite_refutes() {
    let nodes = dome().points.len();
    let changed = |part: f64| {
        let mut residual = lacking("limit_chain", 0.8);
        residual.rows_mut(nodes, nodes).scale_mut(part);
        verdict(&without_the_rival(residual))
    };
    let absent = changed(0.0);
    assert_ne!(absent.verdict, VerdictName::Named, "{}", absent.reason);
    let opposite = changed(-1.0);
    assert_eq!(opposite.verdict, VerdictName::Unknown, "{}", opposite.reason);
    assert!(opposite.reason.contains("worse"), "{}", opposite.reason);
}

#[test]
fn more_than_is_plausible_is_unknown() {
    let found = verdict(&without_the_rival(lacking("limit_chain", 2.4)));
    assert_eq!(found.verdict, VerdictName::Unknown, "{}", found.reason);
    assert_eq!(found.candidates[0].amplitude[0], 1.2);
    assert!(found.candidates[0].beyond > 2.0, "{}", found.candidates[0].beyond);
}

#[test]
fn what_the_library_lacks_is_unknown() {
    let known = evidence(nothing());
    let strange = waves(&known.reference, 2, 110.0, [2.5, 2.0, 2.0]);
    let found = verdict(&evidence(strange));
    assert_eq!(found.verdict, VerdictName::Unknown, "{}", found.reason);
    assert_eq!(found.effect, None);
}

#[test]
fn a_second_effect_is_told_beside_the_first() {
    let both = lacking("limit_chain", 0.8) + lacking("skin_prestress", 0.1);
    let found = verdict(&without_the_rival(both));
    assert_eq!(found.verdict, VerdictName::Named, "{}", found.reason);
    let second = found.second.unwrap();
    let mut names = [found.effect.unwrap(), second.effect.clone()];
    names.sort_unstable();
    assert_eq!(names, ["limit_chain", "skin_prestress"]);
    assert!(second.z > second.limit && second.completes(), "{second:?}");
    assert!(found.reason.contains(&second.effect), "{}", found.reason);

    // A third is missing in the library: neither is named.
    let strange = waves(&dome(), 2, 110.0, [2.5, 2.0, 2.0]);
    let both = lacking("limit_chain", 0.8) + lacking("skin_prestress", 0.1) + strange;
    let found = verdict(&without_the_rival(both));
    assert_eq!(found.verdict, VerdictName::Unknown, "{}", found.reason);
    // One alone leaves nothing.
    assert!(verdict(&without_the_rival(lacking("limit_chain", 0.8))).second.is_none());
}

#[test]
fn a_pose_that_lies_elsewhere_is_an_error_of_the_measurement() {
    let known = evidence(nothing());
    let nodes = known.nodes();
    let mut residual = nothing();
    let [x, ..] = known.reference.rigid_modes();
    residual.rows_mut(0, nodes).copy_from(&(12.0 * x));
    let found = verdict(&evidence(residual));
    assert_eq!(found.verdict, VerdictName::MeasurementArtifact, "{}", found.reason);
    assert_eq!(found.effect.as_deref(), Some("registration"));
}

#[test]
fn failed_solves_and_blind_data_are_no_evidence() {
    let mut failed = without_the_rival(lacking("limit_chain", 0.8));
    failed.failed = vec!["friction".into()];
    let found = verdict(&failed);
    assert_eq!(found.verdict, VerdictName::InsufficientData);
    assert!(found.reason.contains("friction"), "{}", found.reason);

    let mut blind = evidence(nothing());
    for signature in &mut blind.signatures {
        let effect = signature.effect;
        let (small, range) = (effect.amplitude.small, effect.amplitude.range);
        *signature = Signature::small(effect, range, small, 1e-6 * nothing().add_scalar(1.0));
    }
    assert_eq!(verdict(&blind).verdict, VerdictName::InsufficientData);
}

#[test]
fn a_fit_that_came_to_no_end_is_no_evidence() {
    let known = without_the_rival(lacking("limit_chain", 0.8));
    let judge = Judge::new(&known).unwrap();
    let screening = judge.screen(&known.residual);
    let fit = |effect| linear(&known, &judge.whitener, &judge.seen, &known.residual, effect);
    let stuck = |fitted: Fitted| Fitted { unsettled: Some("10 of 10 failed".into()), ..fitted };
    let (without, right, other) = (fit(None), fit(Some(0)), fit(Some(1)));
    let told = |without: &Fitted, with: &[(usize, Fitted)]| judge.judge(&screening, without, with);
    let sound = [(0, right.clone()), (1, other.clone())];
    assert_eq!(told(&without, &sound).verdict, VerdictName::Named);
    // All solutions with the effect failed: it stays where it began, and gains nothing.
    let nowhere = stuck(Fitted { amplitude: 0.0, ..without.clone() });
    let found = told(&without, &[(0, nowhere), sound[1].clone()]);
    assert_eq!(found.verdict, VerdictName::InsufficientData, "{}", found.reason);
    assert!(found.reason.contains("limit_chain") && found.reason.contains("10 of 10"));
    assert!(found.effect.is_none() && found.set.is_empty());
    // Moduli that stay too far off: each effect would gain what they do not.
    let found = told(&stuck(without.clone()), &sound);
    assert_eq!(found.verdict, VerdictName::InsufficientData, "{}", found.reason);
    assert!(found.reason.contains("the moduli alone"), "{}", found.reason);
    // One that shows in nothing may fail.
    let found = told(&without, &[(0, right), (1, stuck(other))]);
    assert_eq!(found.verdict, VerdictName::Named, "{}", found.reason);
}

#[test]
fn the_rival_that_the_held_out_pose_bears_out_is_told() {
    let known = evidence(lacking("limit_chain", 0.8));
    let judge = Judge::new(&known).unwrap();
    let screening = judge.screen(&known.residual);
    let fit = |effect| linear(&known, &judge.whitener, &judge.seen, &known.residual, effect);
    let (without, right) = (fit(None), fit(Some(0)));
    // Explains the seen poses as well, by a hair better; in the held-out one it puts waves beside a part of the truth.
    let like = Fitted { misfit: right.misfit - 0.1, ..fit(Some(2)) };
    let nodes = known.nodes();
    let beside = waves(&known.reference, 2, 37.0, [0.0, 0.3, 0.0]);
    let judged = |part: f64| {
        let mut wrong = like.clone();
        let held_out = (1.0 - part) * &without.residual + &beside;
        wrong.residual.rows_mut(nodes, nodes).copy_from(&held_out.rows(nodes, nodes));
        judge.judge(&screening, &without, &[(2, wrong), (0, right.clone())])
    };
    // The part with which the misfit there rises by 2: its fall is a parabola of that.
    let fall = [0.0, 0.5, 1.0].map(|part| judged(part).candidates[0].held_out.fall);
    let curve = 2.0 * (fall[0] + fall[2] - 2.0 * fall[1]);
    let slope = fall[2] - fall[0] - curve;
    let under = (slope * slope - 4.0 * curve * (fall[0] + 2.0)).sqrt();
    let found = judged((under - slope) / (2.0 * curve));
    assert_eq!(found.candidates[0].effect, "cooper_anisotropy");
    let of_held_out = found.candidates[0].held_out;
    assert!(of_held_out.fall < 0.0 && !of_held_out.refutes(), "{of_held_out:?}");
    assert_eq!(found.verdict, VerdictName::InsufficientData, "{}", found.reason);
    assert_eq!(found.effect.as_deref(), Some("limit_chain"));
    assert_eq!(found.chosen().unwrap().effect, "limit_chain");
    assert_eq!(found.set, ["limit_chain", "cooper_anisotropy"]);
}

#[test]
fn errors_of_the_held_out_pose_are_not_measured_in_it() {
    let mut known = evidence(nothing());
    let nodes = known.nodes();
    let near = |a: usize, b: usize| {
        a < b && (known.reference.points[a] - known.reference.points[b]).norm() < 20.0
    };
    let pairs = (0..nodes).flat_map(|a| (0..nodes).map(move |b| (a, b)));
    known.edges = pairs.filter(|&(a, b)| near(a, b)).map(|(a, b)| [a as u32, b as u32]).collect();
    let rough = |pose: usize| {
        let mut errors = nothing();
        let at = nodes * pose;
        errors.rows_mut(at, nodes).iter_mut().enumerate().for_each(|(n, e)| {
            *e = if n % 2 == 0 { 2.0 } else { -2.0 };
        });
        known.with_errors(&errors).budget.white_mm
    };
    assert_eq!(rough(1), 0.25);
    assert!(rough(0) > 0.25, "{}", rough(0));
}

#[test]
fn moduli_that_differ_from_pose_to_pose_are_told() {
    let known = evidence(nothing());
    let nodes = known.nodes();
    let drift = |residual: DVector<f64>| {
        let evidence = evidence(residual);
        Judge::new(&evidence).unwrap().drift()
    };
    let same = drift(0.3 * sag(&known.reference, true));
    assert!(!same.differs() && same.fall < 1e-6, "{same:?}");
    assert_eq!(
        same.poses.iter().map(|p| p.pose.as_str()).collect::<Vec<_>>(),
        ["prone", "upright"]
    );
    for pose in &same.poses {
        assert!((pose.moduli_kpa[0] - 0.3 * (-0.3_f64).exp()).abs() < 1e-9, "{pose:?}");
        assert!((pose.moduli_kpa[1] - 0.2).abs() < 1e-9 && pose.log_error[0] > 0.0, "{pose:?}");
    }
    // The prone pose alone hangs as tissue of less than half the stiffness.
    let mut residual = nothing();
    residual.rows_mut(0, nodes).copy_from(&sag(&known.reference, true).rows(0, nodes));
    let apart = drift(residual);
    assert!(apart.differs(), "{apart:?}");
}
