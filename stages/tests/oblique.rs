//! Compression along an oblique axis: from above and the middle of either breast, and in balance.

use mammotwin_data::{
    Vec3,
    labels::Side,
    study::{CompressPlan, View},
};
use mammotwin_stages::{
    compress::Compression,
    force_curve::trial::{Meshed, Person, Ready},
};

fn ready() -> (Person, Ready) {
    let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
    let ready = person.meshed(Meshed::new(15.0, 0)).unwrap();
    (person, ready)
}

fn oblique(plan: &CompressPlan, side: Side, degrees: f64) -> CompressPlan {
    CompressPlan { side, view: View::Mlo, view_angle_deg: Some(degrees), ..plan.clone() }
}

/// Direction, in the frame of the body (x to her right, z to her head), from the receptor to the paddle.
fn axis(made: &Compression) -> Vec3 {
    made.to_detector.inverse().direction(&Vec3::z())
}

/// Middle (mm, frame of the body) of the skin, free of stress, that a plate came to touch.
fn touched(made: &Compression, plate: usize) -> Vec3 {
    let back = made.to_detector.inverse();
    let nodes: Vec<_> = made.plates[plate].touched().map(|one| one.node as usize).collect();
    assert!(!nodes.is_empty());
    let places = nodes.iter().map(|n| back.point(&made.mesh.points[*n]));
    places.sum::<Vec3>() / nodes.len() as f64
}

/// Forces and moments of all that acts, reactions included; the plates push against each other, and what they do to
/// the nodes is what the course says.
fn in_balance(made: &Compression) {
    let checks = &made.solution.checks;
    println!(
        "sum of forces {:.1e}, of moments {:.1e} of the largest, residual {:.1e}",
        checks.force_imbalance, checks.moment_imbalance, checks.residual
    );
    assert!(checks.force_imbalance < 1e-6 && checks.moment_imbalance < 1e-6, "{checks:?}");
    let last = |values: &[f64]| *values.last().unwrap();
    let told = [last(&made.curve.receptor_force_n), -last(&made.curve.force_n)];
    for (plate, told) in made.plates.iter().zip(told) {
        let sum: Vec3 = plate.force_mn.iter().sum();
        assert!((sum.z / 1000.0 - told).abs() < 1e-6 * told.abs(), "{sum:?} {told}");
        assert!(told * sum.z > 0.0);
    }
}

/// Verifies: oblique view of 0° | every node of the cranio-caudal view | exactly
#[test]
fn an_oblique_view_of_no_angle_is_the_cranio_caudal_one() {
    let (person, ready) = ready();
    let straight = person.plan(15.0, 50.0).unwrap();
    let [cc, none] = [&straight, &oblique(&straight, Side::Right, 0.0)]
        .map(|plan| ready.compressed(plan).unwrap());
    assert_eq!(cc.met.as_deref(), Some("thickness_mm"), "{:?}", cc.stopped_early);
    assert_eq!(cc.curve, none.curve);
    assert_eq!(cc.solution.points, none.solution.points);
    in_balance(&cc);
}

/// Verifies: oblique view of 45°, both breasts | axis, touched skin, sums of forces and moments | 1e-6
#[test]
fn an_oblique_paddle_comes_from_above_and_the_middle_of_either_breast() {
    let (person, ready) = ready();
    let straight = person.plan(15.0, 48.0).unwrap();
    for (side, outwards) in [(Side::Right, 1.0), (Side::Left, -1.0)] {
        let cc = ready.compressed(&CompressPlan { side, ..straight.clone() }).unwrap();
        let mlo = ready.compressed(&oblique(&straight, side, 45.0)).unwrap();
        assert_eq!(mlo.met.as_deref(), Some("thickness_mm"), "{:?}", mlo.stopped_early);
        assert!((axis(&mlo).dot(&axis(&cc)) - 0.5f64.sqrt()).abs() < 1e-12);
        // Turned about the direction away from the chest wall, towards the middle of the body.
        let away = |made: &Compression| made.to_detector.inverse().direction(&Vec3::y());
        assert!((away(&mlo) - away(&cc)).norm() < 1e-12);
        assert!((axis(&mlo).x - axis(&cc).x) * outwards < -0.5, "{side:?} {:?}", axis(&mlo));
        let between = touched(&mlo, 1) - touched(&mlo, 0);
        println!("{side:?}: paddle from receptor {between:.1?} mm, axis {:.3?}", axis(&mlo));
        assert!(between.z > 10.0 && between.x * outwards < -10.0, "{side:?} {between:?}");
        in_balance(&mlo);
        // Both plates come.
        let rises_mm = -mlo.steps[0].plates_mm[0];
        assert!(rises_mm > 1.0, "{side:?}: the receptor rises {rises_mm} mm");
    }
}
