//! The search on curves that are formulas instead of solutions.

use mammotwin_data::study::{CompressPlan, LawName, PaddleName};
use mammotwin_stages::{
    discover::VerdictName,
    force_curve::{
        course::Pressed,
        evidence::{Evidence, Ladder, Parameters, rungs},
        library::{CURVE_EFFECTS, CurveEffect},
        record::{Channel, Reading, Record, RecordError},
        search::{amplitude_of, refit, screen, size_of},
        trial::{Measuring, Person, drawn_stiffness, measured},
        verdict::judge,
    },
};

/// Stands for a compression: stiffer by a factor, sooner by `sooner` mm, bent upwards by `bend`.
fn formula(stiffer: f64, sooner: f64, bend: f64, tilt: f64) -> Pressed {
    let thickness_mm: Vec<f64> = (0..=18).map(|n| 130.0 - 5.0 * f64::from(n)).collect();
    let force = |h: &f64| {
        let pressed = ((130.0 + sooner - h) / 85.0).max(0.0);
        stiffer * 20.0 * pressed.powi(2) * (bend * pressed.powi(4)).exp()
    };
    let force_n: Vec<f64> = thickness_mm.iter().map(force).collect();
    let values = [
        force_n.clone(),
        thickness_mm.iter().map(|h| 50.0 * (130.0 - h)).collect(),
        thickness_mm.iter().map(|h| 55.0 + 0.2 * (130.0 - h)).collect(),
        force_n.iter().map(|f| tilt * f / 30.0).collect(),
    ];
    Pressed { thickness_mm, values }
}

fn ladder(name: &str, rungs: &[(f64, Pressed)]) -> Ladder {
    let plain = formula(1.0, 0.0, 1.4, 0.0);
    Ladder::new(CurveEffect::named(name).unwrap(), &plain, rungs.iter().cloned(), 45.0)
}

fn evidence() -> Evidence {
    let bend = |a: f64| (a, formula(1.0, 0.0, 1.4 + 2.0 * a, 0.0));
    let hinge = |a: f64| (a, formula(1.0, 0.0, 1.4 - 0.3 * a, a));
    let rate = |a: f64| (a, formula(1.0 + a, 0.0, 1.4, 0.0));
    Evidence {
        plain: formula(1.0, 0.0, 1.4, 0.0),
        ladders: vec![
            ladder("limit_chain", &[-0.4, -0.2, 0.1, 0.2, 0.3].map(bend)),
            ladder("paddle_hinge", &[0.3, 1.0, 2.0, 3.0].map(hinge)),
            ladder("rate_stiffening", &[-0.3, 0.2, 0.6, 1.5].map(rate)),
        ],
        others: vec![
            formula(1.03, 1.0, 1.41, 0.0),
            formula(0.98, -1.0, 1.39, 0.0),
            formula(1.01, 0.5, 1.405, 0.0),
        ],
        error: RecordError::default(),
    }
}

const PLACES: (usize, f64, f64) = (16, 110.0, 46.0);

fn drawn(truth: &Pressed, how: Measuring, seed: u64) -> Record {
    let error = RecordError::default();
    let stiffness = drawn_stiffness(&error, 1_000_000 + seed);
    measured(truth, PLACES, &error, how, (stiffness, seed)).0
}

#[test]
fn curves_pass_through_their_states_and_go_on_behind_them() {
    let course = formula(1.0, 0.0, 1.4, 0.0);
    for (n, &h) in course.thickness_mm.iter().enumerate() {
        for channel in Channel::ALL {
            let known = course.values[channel.place()][n];
            assert!((course.at(channel, h) - known).abs() < 1e-9 * (1.0 + known), "{h}");
        }
    }
    // Between them within 1 %.
    let exact = |h: f64| 20.0 * ((130.0 - h) / 85.0f64).powi(2);
    let between = formula(1.0, 0.0, 0.0, 0.0);
    for h in [97.0, 62.5, 48.1] {
        assert!((between.at(Channel::Force, h) / exact(h) - 1.0).abs() < 0.01, "{h}");
    }
    assert!(course.at(Channel::Force, 38.0) > course.at(Channel::Force, 40.0));
    assert_eq!(course.at(Channel::Force, 140.0), 0.0);
}

#[test]
fn a_ladder_knows_amplitudes_between_its_rungs_and_drops_rungs_that_end_early() {
    let evidence = evidence();
    let bent = &evidence.ladders[0];
    let found = bent.at(Channel::Force, 50.0, 0.15);
    let exact = formula(1.0, 0.0, 1.7, 0.0).at(Channel::Force, 50.0);
    assert!((found / exact - 1.0).abs() < 0.01, "{found} {exact}");
    let mut short = formula(1.0, 0.0, 2.4, 0.0);
    short.thickness_mm.truncate(12);
    short.values.iter_mut().for_each(|v| v.truncate(12));
    let early = ladder("limit_chain", &[(0.1, formula(1.0, 0.0, 1.6, 0.0)), (0.5, short)]);
    assert_eq!(early.range(), [0.0, 0.1]);
}

#[test]
fn offset_and_stiffness_are_fitted_and_leave_nothing() {
    let evidence = evidence();
    let places = drawn(&evidence.plain, Measuring::USUAL, 1);
    let truth = Parameters { offset_mm: -2.5, stiffness: 0.08, amplitude: 0.0 };
    let record = evidence.as_measured(&places, None, &truth).unwrap();
    let weighed = evidence.weigh(&record).unwrap();
    let found = weighed.fit(None, Parameters::default());
    // The priors pull, by less than what the errors leave open.
    let jacobian = weighed.nuisance(None, &found);
    let open = (jacobian.transpose() * &jacobian).try_inverse().unwrap();
    let [offset, stiffness] = [0, 1].map(|n| open[(n, n)].sqrt());
    println!("{found:?}, standard deviations {offset} mm and {stiffness}");
    assert!((found.offset_mm + 2.5).abs() < offset, "{found:?}");
    assert!((found.stiffness - 0.08).abs() < stiffness, "{found:?}");
    assert!(offset < 1.0 && stiffness < 0.1);
    assert!(weighed.residual(None, &found).norm() < 1.0);
}

#[test]
fn a_hidden_bend_is_found_with_its_amplitude() {
    let evidence = evidence();
    let places = drawn(&evidence.plain, Measuring::USUAL, 1);
    let truth = Parameters { offset_mm: 1.0, stiffness: -0.05, amplitude: 0.2 };
    let record = evidence.as_measured(&places, Some(0), &truth).unwrap();
    let weighed = evidence.weigh(&record).unwrap();
    let screening = screen(&weighed);
    assert_eq!(screening.scores[0].effect, "limit_chain");
    assert!(screening.scores[0].z > screening.limit);
    let fit = refit(&weighed, 0, &screening.plain);
    assert!((fit.at.amplitude - 0.2).abs() < 0.03, "{fit:?}");
    let size = size_of(&evidence, &places, 0, 0.2).unwrap();
    let amplitude = amplitude_of(&evidence, &places, 0, size).unwrap();
    assert!((amplitude - 0.2).abs() < 0.01, "{amplitude}");
}

#[test]
fn what_is_all_forces_alike_is_told_from_stiffness_by_its_prior_alone() {
    let evidence = evidence();
    let places = drawn(&evidence.plain, Measuring::USUAL, 1);
    let rate = 2;
    let size = |error: RecordError| {
        size_of(&Evidence { error, ..evidence.clone() }, &places, rate, 0.6).unwrap()
    };
    let usual = size(RecordError::default());
    let unsure = size(RecordError { stiffness: 1.0, ..RecordError::default() });
    // ln 1.6 over the prior of stiffness, gain and meshes (0.108); less for what the errors leave open.
    assert!(usual > 3.0 && usual < 4.6, "{usual}");
    assert!(unsure < 0.6, "{unsure}");
}

#[test]
fn errors_alone_pass_the_limit_as_rarely_as_it_says() {
    let evidence = evidence();
    let verdicts: Vec<_> = (0..300)
        .map(|seed| {
            judge(&evidence, &drawn(&evidence.plain, Measuring::USUAL, seed), None).unwrap()
        })
        .collect();
    let alarms =
        verdicts.iter().filter(|v| v.scores.iter().any(|s| s.testable && s.z > v.limit)).count();
    println!("{alarms} of 300 over the limit");
    // 1 % of 300 is 3; more than 10 have a probability below 0.1 %.
    assert!(alarms <= 10, "{alarms}");
    let named = verdicts.iter().filter(|v| v.verdict == VerdictName::Named).count();
    assert!(named <= 3, "{named}");
}

#[test]
fn a_thickness_that_is_shown_wrongly_is_no_physics() {
    let evidence = evidence();
    let how = Measuring { offset_mm: 6.0, ..Measuring::USUAL };
    for seed in 0..20 {
        let verdict = judge(&evidence, &drawn(&evidence.plain, how, seed), None).unwrap();
        assert_ne!(verdict.verdict, VerdictName::Named, "{}", verdict.reason);
    }
}

#[test]
fn too_few_forces_are_insufficient() {
    let evidence = evidence();
    let places = (6, 110.0, 46.0);
    let (record, _) =
        measured(&evidence.plain, places, &evidence.error, Measuring::USUAL, (1.0, 3));
    assert_eq!(judge(&evidence, &record, None).unwrap().verdict, VerdictName::InsufficientData);
}

#[test]
fn the_last_forces_are_held_out_and_nothing_else() {
    let reading =
        |thickness_mm: f64, channel: Channel| Reading { thickness_mm, channel, value: 1.0 };
    let forces = (0..12).map(|n| reading(100.0 - f64::from(n), Channel::Force));
    let record = Record::new(forces.chain([reading(89.0, Channel::Extent)]).collect());
    let [seen, held_out] = record.split().map(|rows| record.rows(&rows));
    assert_eq!((seen.forces(), seen.0.len(), held_out.0.len()), (9, 10, 3));
    assert!(held_out.0.iter().all(|r| r.thickness_mm < 91.5));
}

fn plan(paddle: PaddleName, law: LawName) -> CompressPlan {
    let person = Person { preset: "tiny".into(), seed: 1, stiffer: 1.0 };
    let mut plan = person.plan(15.0, 46.0).unwrap();
    plan.paddle = paddle;
    plan.law.name = law;
    plan.law.jm = (law == LawName::Gent).then_some(2.0);
    plan
}

#[test]
fn effects_have_a_range_around_zero_and_name_rivals_that_exist() {
    let plan = plan(PaddleName::Rigid, LawName::Gent);
    for effect in CURVE_EFFECTS {
        let [least, greatest] = (effect.range)(&plan).unwrap();
        assert!(least <= 0.0 && greatest > 0.0, "{}", effect.name);
        assert_eq!(effect.switched(&plan, 0.0), plan);
        for amplitude in rungs([least, greatest]) {
            let with = effect.switched(&plan, amplitude);
            assert_ne!(with, plan, "{} {amplitude}", effect.name);
        }
        for rival in effect.confused_with {
            assert!(CurveEffect::named(rival).is_some_and(|r| r.name != effect.name), "{rival}");
        }
    }
}

#[test]
fn effects_go_on_from_what_the_study_has() {
    let named = |name: &str| CurveEffect::named(name).unwrap();
    let mut flex = plan(PaddleName::Flex, LawName::Gent);
    let own = flex.hinge.clone().unwrap_or_default().linear_n_mm_per_rad;
    let softer = named("paddle_hinge").switched(&flex, 1.0);
    assert!((softer.hinge.unwrap().linear_n_mm_per_rad / own - 0.5).abs() < 1e-12);
    assert!((named("paddle_elastic").range)(&flex).is_none());
    flex.paddle = PaddleName::Spot;
    assert!((named("paddle_hinge").range)(&flex).is_none());
    let gent = named("limit_chain").switched(&flex, 0.25);
    assert!((gent.law.jm.unwrap() - 1.0 / 0.75).abs() < 1e-12);
    let neo = plan(PaddleName::Rigid, LawName::NeoHookean);
    let gent = named("limit_chain").switched(&neo, 0.5);
    assert_eq!((gent.law.name, gent.law.jm), (LawName::Gent, Some(2.0)));
    assert!((named("limit_chain").range)(&plan(PaddleName::Rigid, LawName::Ogden)).is_none());
    let most = (named("prestress_gravity").range)(&neo).unwrap();
    assert_eq!(most, [0.0, 1.0]);
}

#[test]
fn with_another_record_a_bend_is_the_best_and_nothing_is_never_named() {
    let evidence = evidence();
    let stiffness = 1.05;
    let places = drawn(&evidence.plain, Measuring::USUAL, 1);
    let amplitude = Parameters { amplitude: 0.3, ..Parameters::default() };
    let mut first = 0;
    let truth = |n: u64, at: &Parameters| {
        let own = evidence.as_measured(&places, Some(0), at).unwrap();
        // Errors of a plain record on top of what the bend changes.
        let drawn =
            measured(&evidence.plain, PLACES, &evidence.error, Measuring::USUAL, (stiffness, n)).0;
        let plain = evidence.predicted(&drawn.0, None, &Parameters::default());
        let all = own.0.iter().zip(&drawn.0).zip(plain.iter());
        let sum = all.map(|((own, drawn), plain)| Reading {
            value: own.value + drawn.value - plain,
            ..*own
        });
        Record(sum.collect())
    };
    for seed in 0..5 {
        let [seen, another] = [2 * seed, 2 * seed + 1].map(|n| truth(n, &amplitude));
        let found = judge(&evidence, &seen, Some(&another)).unwrap();
        let best = found.candidates.first();
        println!("{seed}: {:?} {best:?}", found.verdict);
        first += usize::from(best.is_some_and(|best| best.effect == "limit_chain"));
        let [seen, another] =
            [2 * seed, 2 * seed + 1].map(|n| truth(100 + n, &Parameters::default()));
        let found = judge(&evidence, &seen, Some(&another)).unwrap();
        assert_ne!(found.verdict, VerdictName::Named, "{}", found.reason);
    }
    assert!(first >= 4, "{first} of 5");
}
