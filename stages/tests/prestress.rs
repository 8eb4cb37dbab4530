//! A breast that hangs: pressed with the stress and the weight that it hangs by, or without.

use mammotwin_data::{
    Vec3,
    study::{CompressLaw, LawName},
};
use mammotwin_stages::{
    compress::Compression,
    force_curve::trial::{Meshed, Person},
    volunteer::Preset,
};

fn last(values: &[f64]) -> f64 {
    *values.last().unwrap()
}

/// Largest distance (mm) of nodes of two compressions.
fn apart(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Nodes (mm) before the paddle presses.
fn first(made: &Compression) -> Vec<Vec3> {
    made.steps.first().unwrap().points.iter().map(|p| Vec3::from(p.map(f64::from))).collect()
}

/// How far (mm) the nodes are from where they are free of stress, at the first state, before the paddle
/// presses, and at the end.
fn strained(made: &Compression) -> [f64; 2] {
    [&first(made), &made.solution.points].map(|points| apart(points, &made.mesh.points))
}

/// Verifies: stress and weight of a hanging breast kept in the compression: first state | the shape it hangs in, by the same law | 0.05 mm
#[test]
fn a_hanging_breast_begins_where_it_hangs() {
    let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
    let ready = person.meshed(Meshed::new(13.0, 0)).unwrap();
    let mut neglected = person.plan(15.0, 46.0).unwrap();
    let mut kept = neglected.clone();
    kept.prestress = true;
    let prone = Vec3::new(0.0, 1.0, 0.0);
    let made = [&neglected, &kept].map(|plan| ready.hanging(plan, prone).unwrap());
    let free = ready.compressed(&neglected).unwrap();
    // Under the law of the poses it hangs where it hung.
    neglected.law = CompressLaw {
        name: LawName::NeoHookean,
        jm: None,
        poisson: Preset::named("tiny").unwrap().fixed.poisson,
        ..neglected.law
    };
    kept.law = neglected.law.clone();
    let same = [&neglected, &kept].map(|plan| ready.hanging(plan, prone).unwrap());
    for (name, made) in [("free", &free), ("neglected", &made[0]), ("kept", &made[1])] {
        assert_eq!(made.met.as_deref(), Some("thickness_mm"), "{:?}", made.stopped_early);
        let curve = &made.curve;
        println!(
            "{name}: paddle {:.3} N, receptor {:.3} N, largest {:.2} kPa, moved {:?} mm",
            last(&curve.force_n),
            last(&curve.receptor_force_n),
            last(&curve.peak_pressure_kpa),
            strained(made)
        );
    }
    let at_first = |made: &Compression| {
        let back = made.to_detector.inverse();
        first(made).iter().map(|p| back.point(p)).collect::<Vec<_>>()
    };
    let moved = [&made, &same].map(|[free, kept]| apart(&at_first(free), &at_first(kept)));
    println!(
        "first states: law of the compression {:.3} mm, of the poses {:.4} mm apart",
        moved[0], moved[1]
    );
    assert!(moved[1] < 0.05, "{moved:?} mm");
    for [neglected, kept] in [&made, &same] {
        assert!(strained(neglected)[0] < 1e-3, "{:?}", strained(neglected));
        assert!(strained(kept)[0] > 5.0, "{:?}", strained(kept));
    }
}
