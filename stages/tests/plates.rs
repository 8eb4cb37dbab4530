//! What a study says of the plates reaches them: lift of the receptor, radius of the edges, a measured hinge.

use mammotwin_data::{
    Vec3,
    io::torque,
    progress::Silent,
    store::Stage,
    study::{ComfortPlan, CompressPlan, HingePlan, PaddleName, ReceptorName},
};
use mammotwin_stages::{
    comfort::Comfort,
    compress::Compression,
    force_curve::trial::{Meshed, Person, Ready},
};

fn ready() -> (CompressPlan, Ready) {
    let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
    let ready = person.meshed(Meshed::new(15.0, 0)).unwrap();
    (person.plan(15.0, 50.0).unwrap(), ready)
}

fn compressed(ready: &Ready, plan: &CompressPlan) -> Compression {
    let made = ready.compressed(plan).unwrap();
    assert_eq!(made.met.as_deref(), Some("thickness_mm"), "{:?}", made.stopped_early);
    made
}

/// Height (mm) of the receptor at the end, along the compression in the frame of the body.
fn receptor_mm(made: &Compression) -> f64 {
    let back = made.to_detector.inverse();
    back.direction(&Vec3::z()).dot(&back.point(&Vec3::zeros()))
}

/// Verifies: receptor at the fold, lifted by 25 mm: above the lowest skin | 25 mm higher; the paddle waits while it rises | 1e-9 mm
#[test]
fn a_receptor_above_the_fold_lifts_the_breast() {
    let (plan, ready) = ready();
    let fold = CompressPlan { receptor: ReceptorName::Fold, ..plan };
    let [level, lifted] = [0.0, 25.0].map(|receptor_lift_mm| {
        compressed(&ready, &CompressPlan { receptor_lift_mm, ..fold.clone() })
    });
    let rise = receptor_mm(&lifted) - receptor_mm(&level);
    println!("rises by {rise:.3} mm, nipples {:.2?} {:.2?}", level.nipple(), lifted.nipple());
    assert!((rise - 25.0).abs() < 1e-9, "{rise}");
    // All that it rises while the paddle stays, then the paddle alone.
    let heights: Vec<[f64; 2]> = lifted.steps.iter().map(|step| step.plates_mm).collect();
    let paddle = |n: usize| heights[n][0] + lifted.curve.thickness_mm[n];
    let risen = heights.iter().position(|at| at[0].abs() < 1e-9).unwrap();
    println!("plates {heights:.1?}, forces {:.3?} N", lifted.curve.force_n);
    assert!(risen > 0 && heights[risen..].iter().all(|at| at[0].abs() < 1e-9));
    assert!((1..risen).all(|n| (paddle(n) - paddle(0)).abs() < 1e-9));
    // The lift itself presses only on the receptor's side; at the end both plates bear the breast and its base.
    let before = lifted.curve.force_n[risen - 1].abs();
    assert!(before < 0.2 * lifted.curve.force_n.last().unwrap(), "{before} N while it is lifted");
    assert!(lifted.curve.receptor_force_n[risen] > 0.0);
}

/// Verifies: radius of the plates' edges 2, 6, 15 mm, same thickness | largest pressure falls as the radius grows | order
#[test]
fn a_sharper_edge_presses_harder() {
    let (plan, ready) = ready();
    // So far from the chest wall the breast is hardly thicker than the gap, and thickest at the edges: they alone press.
    let plan = CompressPlan { chest_wall_distance_mm: 25.0, ..plan };
    let peaks = [2.0, 6.0, 15.0].map(|edge_radius_mm| {
        let made = compressed(&ready, &CompressPlan { edge_radius_mm, ..plan.clone() });
        let found = Comfort { plan: ComfortPlan::default() }.run(&made, &Silent).unwrap().metrics;
        let of = |name: &str| found.iter().find(|metric| metric.name == name).unwrap().value;
        let peak = of("peak_pressure_kpa");
        println!("{edge_radius_mm} mm: {peak:.4} kPa, {:.4} N", of("force_n"));
        peak
    });
    assert!(peaks[0] > 2.0 * peaks[1] && peaks[1] > peaks[2], "{peaks:?} kPa");
}

/// Torque (N mm) of the paddle's forces on its hinge, `axis_mm` from its edge, from the places and forces of the nodes:
/// what turns the side of the nipple upwards.
fn torque_n_mm(made: &Compression, axis_mm: f64) -> f64 {
    let axis = Vec3::new(0.0, axis_mm, made.thickness_mm);
    let moment = |one: mammotwin_solver::compress::Pressing| {
        let arm = made.solution.points[one.node as usize] - axis;
        // The force on the paddle is the opposite of that on the node.
        arm.cross(&-one.force_mn).x / 1000.0
    };
    made.plates[1].touched().map(moment).sum()
}

/// Verifies: hinge from a table of forces and angles: tilt of a flex paddle | torque of its forces by that table's law | 1 %
#[test]
fn a_measured_hinge_tilts_as_its_table_foretells() {
    let (plan, ready) = ready();
    let folder = tempfile::tempdir().unwrap();
    // N mm/rad and N mm/rad²; the lever is 100 mm.
    let tilts = [[300.0, 2000.0], [900.0, 6000.0]].map(|[linear, quadratic]| {
        let row = |n: i32| {
            let tilt = f64::from(n).to_radians();
            format!("{n},{:.9},100\n", tilt * (linear + quadratic * tilt) / 100.0)
        };
        let file = folder.path().join("hinge.csv");
        let rows: String = (1..=12).map(row).collect();
        std::fs::write(&file, format!("{}\n{rows}", torque::HEADER)).unwrap();
        let law = torque::read(&file).unwrap().law().unwrap();
        let hinge = HingePlan {
            linear_n_mm_per_rad: law.linear_n_mm_per_rad,
            quadratic_n_mm_per_rad2: law.quadratic_n_mm_per_rad2,
            ..HingePlan::default()
        };
        let axis_mm = hinge.axis_mm;
        let flex = CompressPlan { paddle: PaddleName::Flex, hinge: Some(hinge), ..plan.clone() };
        let made = compressed(&ready, &flex);
        let tilt = made.curve.tilt_deg.last().unwrap().to_radians();
        let foretold = tilt * (linear + quadratic * tilt.abs());
        let torque = -torque_n_mm(&made, axis_mm);
        println!("tilt {:.3}°, torque {torque:.3} N mm, foretold {foretold:.3}", tilt.to_degrees());
        assert!((torque / foretold - 1.0).abs() < 0.01, "{torque} for {foretold} N mm");
        tilt.abs()
    });
    assert!(tilts[0] > 1.5 * tilts[1] && tilts[1] > 1e-3, "{tilts:?}");
}
