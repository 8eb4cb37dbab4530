//! The weight of a compressed breast: kept or neglected, as the thesis neglects it.

use mammotwin_data::{progress::Silent, store::Stage, study::ComfortPlan};
use mammotwin_stages::{
    comfort::Comfort,
    compress::Compression,
    force_curve::trial::{Meshed, Person},
};

/// mN of a mm³ of tissue of 0.981 g/cm³.
const WEIGHT_MN_PER_MM3: f64 = 0.981e-3 * 9.80665;

fn metric(made: &Compression, name: &str) -> f64 {
    let found = Comfort { plan: ComfortPlan::default() }.run(made, &Silent).unwrap().metrics;
    found.iter().find(|metric| metric.name == name).unwrap().value
}

/// Verifies: weight kept in the compression: receptor less paddle | between nothing and the breast's weight | sign, bound
#[test]
fn the_receptor_bears_a_part_of_the_weight_that_is_kept() {
    let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
    let ready = person.meshed(Meshed::new(13.0, 0)).unwrap();
    let neglected = person.plan(15.0, 46.0).unwrap();
    let mut kept = neglected.clone();
    kept.gravity_share = 1.0;
    let made = [&neglected, &kept].map(|plan| ready.compressed(plan).unwrap());
    let last = |values: &[f64]| *values.last().unwrap();
    let more = made.each_ref().map(|made| {
        assert_eq!(made.met.as_deref(), Some("thickness_mm"), "{:?}", made.stopped_early);
        let curve = &made.curve;
        let [paddle, receptor] = [last(&curve.force_n), last(&curve.receptor_force_n)];
        println!(
            "paddle {paddle:.3} N, receptor {receptor:.3} N, mean {:.3} kPa, largest {:.3} kPa, 95 % {:.3} kPa, nominal {:.2} mm",
            metric(made, "mean_pressure_kpa"),
            metric(made, "peak_pressure_kpa"),
            metric(made, "pressure_p95_kpa"),
            made.nominal_thickness_mm
        );
        receptor - paddle
    });
    let weight_n = 1e-3 * WEIGHT_MN_PER_MM3 * made[0].mesh.volume_mm3();
    println!("the receptor bears {:.3} N more, of {weight_n:.3} N of weight", more[1] - more[0]);
    assert!((0.05..1.0).contains(&((more[1] - more[0]) / weight_n)), "{more:?} N");

    // To the force that the weightless breast needed.
    let force = last(&made[0].curve.force_n);
    let thickness = [neglected, kept].map(|mut plan| {
        plan.stop.thickness_mm = None;
        plan.stop.force_n = Some(force);
        let made = ready.compressed(&plan).unwrap();
        assert_eq!(made.met.as_deref(), Some("force_n"), "{:?}", made.stopped_early);
        println!("{force:.3} N: {:.2} mm", made.thickness_mm);
        made.thickness_mm
    });
    // The one without weight is the one that gave the force, to its 1 %.
    assert!((thickness[0] - 46.0).abs() < 0.5, "{thickness:?}");
    assert!((thickness[1] - thickness[0]).abs() < 10.0, "{thickness:?}");
}
