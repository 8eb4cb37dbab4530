//! Paddles that give way or are not flat, and the rules that end a compression.
//!
//! The body is that of `compression.rs`: a breast-like one of 0.5 kPa, 132 mm high. A soft plate makes
//! the coupling strong: a Lexan plate of 4 mm would not be moved by so soft a body.

use crate::common;

use common::squeeze::{EDGE_MM, Squeeze};
use common::{Body, coarse};
use mammotwin_data::{Vec3, study::LawName};
use mammotwin_solver::compress::{Compressed, Step, StopRule, Stops};
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::{
    CurvedPlate, ElasticPlate, Gimbal, Lift, Outline, Paddle, Sheet, Support,
};
use std::sync::Arc;

fn press(body: &Body, paddle: Paddle, stops: Stops, middle_mm: f64) -> Compressed {
    rub(body, paddle, stops, middle_mm, 0.0)
}

fn rub(body: &Body, paddle: Paddle, stops: Stops, middle_mm: f64, friction: f64) -> Compressed {
    let law = Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap();
    let squeeze = Squeeze {
        law,
        radius_mm: 10.0,
        paddle,
        outline: Outline::ENDLESS,
        middle_mm,
        friction,
        step_mm: 8.0,
        stops,
    };
    let done = squeeze.run(body);
    assert!(done.stopped_early.is_none(), "{:?}", done.stopped_early);
    // The last of the small steps to a pose ends where the energy no longer tells: 3e-6 was seen.
    assert!(done.solution.checks.force_imbalance < 1e-5);
    done
}

/// Along each coordinate: what the contact forces of a state push with, from the forces and the
/// places alone, and what the paddle resists with.
fn balance(lift: &dyn Lift, step: &Step, middle_mm: f64) -> [Vec<f64>; 2] {
    let (resistance, _) = lift.resistance(&step.pose);
    let mut push = vec![0.0; lift.coordinates()];
    for pressing in &step.pressing[1] {
        let p = step.points[pressing.node as usize];
        // `away` × `axis` is -x.
        let place = [-p.x - middle_mm, p.z - EDGE_MM];
        for (sum, weight) in push.iter_mut().zip(lift.weights(place)) {
            *sum -= pressing.force_mn.y * weight;
        }
    }
    [push, resistance[..lift.coordinates()].to_vec()]
}

#[track_caller]
fn balances(lift: &dyn Lift, step: &Step, middle_mm: f64) {
    let (_, stiffness) = lift.resistance(&step.pose);
    let [push, resistance] = balance(lift, step, middle_mm);
    for n in 0..push.len() {
        let off_mm = (push[n] - resistance[n]) / stiffness[n];
        let size = step.pose.iter().fold(0.0, |most: f64, q| most.max(q.abs()));
        assert!(off_mm.abs() < 0.003 + 0.01 * size, "{n}: {} {}", push[n], resistance[n]);
    }
}

fn sheet(young_kpa: f64) -> Sheet {
    Sheet {
        width_mm: 240.0,
        depth_mm: 180.0,
        thickness_mm: 4.0,
        young_kpa,
        poisson: 0.4,
        support: Support::Frame,
        lip_mm: 0.0,
    }
}

/// Verifies: elastic paddle: push and bending | equilibrium; hard plate is rigid | 0.003 mm + 1 %; 1e-4
#[test]
fn an_elastic_paddle_bends_until_it_is_in_balance() {
    let body = coarse();
    let to = Stops::at_thickness(76.0);
    let rigid = press(&body, Paddle::Rigid, to, 0.0);
    let force = |done: &Compressed| done.steps.last().unwrap().paddle_force_mn;
    let elastic = |young_kpa: f64| {
        let plate = Arc::new(ElasticPlate::new(sheet(young_kpa)).unwrap());
        let done = press(&body, Paddle::Lifted(plate.clone()), to, 0.0);
        balances(&*plate, done.steps.last().unwrap(), 0.0);
        done
    };
    let hard = elastic(1e12);
    assert!((force(&hard) / force(&rigid) - 1.0).abs() < 1e-4, "a hard plate is rigid");
    // Lexan under so soft a body, and plates nearly as soft as that body.
    let [lexan, soft, softer] = [2.25e6, 1e5, 2e4].map(elastic);
    let bends = [&lexan, &soft, &softer].map(|done| done.steps.last().unwrap().deflection_mm);
    assert!(bends[0] < 0.2 && bends[1] > 1.0 && bends[2] > 1.5 * bends[1], "{bends:?}");
    assert!(force(&rigid) > force(&soft) && force(&soft) > force(&softer));
}

/// Verifies: elastic paddle with friction | equilibrium | 0.003 mm + 1 %
#[test]
fn an_elastic_paddle_that_rubs_is_in_balance() {
    let body = coarse();
    let plate = Arc::new(ElasticPlate::new(sheet(1e5)).unwrap());
    let to = Stops::at_thickness(100.0);
    let done = rub(&body, Paddle::Lifted(plate.clone()), to, 0.0, 0.1);
    let step = done.steps.last().unwrap();
    balances(&*plate, step, 0.0);
    assert!(step.deflection_mm > 0.1 && done.solution.checks.friction_lag <= 1e-4);
}

#[test]
fn a_paddle_on_a_gimbal_turns_about_both_axes() {
    let body = coarse();
    let gimbal = Gimbal { axis_mm: 70.0, tilt_mn_mm: 2e5, roll_mn_mm: 2e5 };
    let lift = Arc::new(gimbal);
    let to = Stops::at_thickness(92.0);
    // Its middle 30 mm beside the breast's: it rolls towards the free side.
    let aside = press(&body, Paddle::Lifted(lift.clone()), to, 30.0);
    let step = aside.steps.last().unwrap();
    balances(&*lift, step, 30.0);
    let middle = press(&body, Paddle::Lifted(lift), to, 0.0);
    let even = middle.steps.last().unwrap();
    println!("rolls {} and {}", step.roll_rad, even.roll_rad);
    assert!(step.roll_rad < -0.01 && even.roll_rad.abs() < 0.3 * step.roll_rad.abs());
    assert!(even.tilt_rad > 0.001, "the side of the nipple sinks");
}

#[test]
fn a_curved_paddle_presses_less_at_its_edge() {
    let body = coarse();
    let curved = CurvedPlate { rise_mm: 15.0, reach_mm: 60.0, arch_radius_mm: f64::INFINITY };
    let to = Stops { force_mn: Some(900.0), ..Stops::default() };
    let share = |paddle: Paddle| {
        let done = press(&body, paddle, to, 0.0);
        assert_eq!(done.met, Some(StopRule::Force));
        let step = done.steps.last().unwrap();
        let near: f64 = step.pressing[1]
            .iter()
            .filter(|p| step.points[p.node as usize].z < EDGE_MM + 20.0)
            .map(|p| -p.force_mn.y)
            .sum();
        near / step.paddle_force_mn
    };
    let [flat, curved] = [Paddle::Rigid, Paddle::Lifted(Arc::new(curved))].map(share);
    println!("within 20 mm of the edge: {flat:.3} flat, {curved:.3} curved");
    assert!(curved < flat);
}

/// Verifies: stop by thickness, force, mean and peak pressure, least gain | the limit | 1 %
#[test]
fn the_first_limit_ends_a_compression_and_is_named() {
    let body = coarse();
    let all = Stops {
        thickness_mm: Some(76.0),
        force_mn: Some(1e6),
        mean_pressure_kpa: Some(100.0),
        peak_pressure_kpa: Some(100.0),
        least_gain_mm_per_n: Some(1e-6),
    };
    let thin = press(&body, Paddle::Rigid, all, 0.0);
    assert_eq!(thin.met, Some(StopRule::Thickness));
    let last = thin.steps.last().unwrap();
    assert!((last.thickness_mm - 76.0).abs() < 1e-9);
    // Halfway in each of the others.
    let half = |value: f64| Some(0.5 * value);
    let force = Stops { force_mn: half(last.paddle_force_mn), ..all };
    let mean = Stops { mean_pressure_kpa: half(last.mean_pressure_kpa), ..all };
    let peak = Stops { peak_pressure_kpa: half(last.peak_pressure_kpa), ..all };
    for (stops, rule) in
        [(force, StopRule::Force), (mean, StopRule::MeanPressure), (peak, StopRule::PeakPressure)]
    {
        let done = press(&body, Paddle::Rigid, stops, 0.0);
        assert_eq!(done.met, Some(rule));
        let step = done.steps.last().unwrap();
        let (value, limit) = match rule {
            StopRule::Force => (step.paddle_force_mn, stops.force_mn),
            StopRule::MeanPressure => (step.mean_pressure_kpa, stops.mean_pressure_kpa),
            _ => (step.peak_pressure_kpa, stops.peak_pressure_kpa),
        };
        let share = value / limit.unwrap();
        assert!((share - 1.0).abs() <= 0.01, "{rule:?}: {share}");
        assert!(step.thickness_mm > 76.0);
    }
    // Half of the slope at the end: between the slopes of the chords of the first course around it.
    let gain = 1e3 / (0.5 * last.slope_mn_per_mm);
    let gaining = Stops { least_gain_mm_per_n: Some(gain), ..all };
    let done = press(&body, Paddle::Rigid, gaining, 0.0);
    assert_eq!(done.met, Some(StopRule::LeastGain));
    let step = done.steps.last().unwrap();
    let share = gain * step.slope_mn_per_mm / 1e3;
    assert!((share - 1.0).abs() <= 0.01, "{share}");
    let chords: Vec<[f64; 2]> = thin
        .steps
        .windows(2)
        .map(|pair| {
            let closed = pair[0].thickness_mm - pair[1].thickness_mm;
            let rise = pair[1].paddle_force_mn - pair[0].paddle_force_mn;
            [0.5 * (pair[0].thickness_mm + pair[1].thickness_mm), rise / closed]
        })
        .collect();
    let around = chords.windows(2).find(|pair| pair[1][0] <= step.thickness_mm).unwrap();
    println!(
        "{:.2} mm, {gain:.1} mm/N: {:.2} mN/mm, chords {around:.2?}",
        step.thickness_mm, step.slope_mn_per_mm
    );
    assert!(around[0][1] < step.slope_mn_per_mm && step.slope_mn_per_mm < around[1][1]);
    // Two at once: the stricter one.
    let both = Stops { peak_pressure_kpa: half(last.peak_pressure_kpa), ..force };
    let done = press(&body, Paddle::Rigid, both, 0.0);
    let step = done.steps.last().unwrap();
    let shares = [
        step.paddle_force_mn / both.force_mn.unwrap(),
        step.peak_pressure_kpa / both.peak_pressure_kpa.unwrap(),
    ];
    let named = if shares[0] >= shares[1] { StopRule::Force } else { StopRule::PeakPressure };
    assert_eq!(done.met, Some(named));
    assert!(shares.iter().all(|share| *share <= 1.011), "{shares:?}");
}

/// Verifies: mean pressure times projected area | force of the paddle | 1e-9
#[test]
fn mean_pressure_times_area_is_the_force_and_fronts_do_not_count() {
    let body = coarse();
    let done = press(&body, Paddle::Rigid, Stops::at_thickness(76.0), 0.0);
    for step in &done.steps {
        let axis = Vec3::y();
        let on_face: f64 =
            step.pressing[1].iter().map(|p| p.pressure_kpa() * p.face_area(&axis)).sum();
        assert!((on_face - step.paddle_force_mn).abs() <= 1e-9 * (1.0 + step.paddle_force_mn));
        assert!(
            step.pressing[1]
                .iter()
                .all(|p| !p.is_upright(&axis) || p.face_area(&axis) < p.area_mm2)
        );
    }
    assert!(done.steps.last().unwrap().front_area_mm2 > 0.0);
}
