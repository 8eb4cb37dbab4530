//! Effects of the compression hidden in a digital volunteer's record of force and thickness: found, and not
//! invented.

use mammotwin_stages::{
    discover::VerdictName,
    force_curve::{
        course::Pressed,
        evidence::Evidence,
        library::CurveEffect,
        record::{Channel, RecordError},
        trial::{
            Measuring, Meshed, Person, Way, drawn_stiffness, gathered, measured, press_all, ways,
        },
        verdict::{CurveVerdict, judge},
    },
};
use std::sync::LazyLock;

const THINNEST_MM: f64 = 48.0;
const PLACES: (usize, f64, f64) = (16, 115.0, THINNEST_MM);
/// What is hidden, and how much of it: strong.
const HIDDEN: [(&str, f64); 2] = [("paddle_offset", 9.0), ("limit_chain", 0.2)];

struct Unit {
    evidence: Evidence,
    truths: Vec<Pressed>,
}

static UNIT: LazyLock<Unit> = LazyLock::new(|| {
    let person = Person { preset: "large".into(), seed: 7, stiffer: 3.0 };
    let plan = person.plan(25.0, THINNEST_MM).unwrap();
    let effects =
        ["paddle_offset", "prestress_gravity", "paddle_elastic", "rate_stiffening", "limit_chain"]
            .map(|name| CurveEffect::named(name).unwrap());
    let (mesh, others, truth) = Meshed::set(22.0);
    let mut all = ways(&plan, &effects, mesh, &others);
    let own = all.len();
    all.push(Way { label: "truth".into(), mesh: truth, plan: plan.clone() });
    for (name, amplitude) in HIDDEN {
        let with = CurveEffect::named(name).unwrap().switched(&plan, amplitude);
        all.push(Way { label: name.into(), mesh: truth, plan: with });
    }
    let mut pressed = press_all(&person, &all, &|| true, &|_, _| Ok(())).unwrap();
    let truths = pressed.split_off(own).into_iter().flatten().collect();
    let error = RecordError::default();
    let evidence = gathered(&plan, &effects, pressed, THINNEST_MM, error).unwrap();
    Unit { evidence, truths }
});

const ALL: [Channel; 3] = [Channel::Force, Channel::Area, Channel::Extent];

fn judged(truth: usize, how: Measuring, seed: u64) -> CurveVerdict {
    let error = RecordError::default();
    let stiffness = drawn_stiffness(&error, 1000 + seed);
    let [record, another] = [2 * seed, 2 * seed + 1]
        .map(|n| measured(&UNIT.truths[truth], PLACES, &error, how, (stiffness, n)).0.only(&ALL));
    let found = judge(&UNIT.evidence, &record, Some(&another)).unwrap();
    println!(
        "{truth} seed {seed}: {:?} {:?} {:?} limit {:.2} offset {:.1} stiffness {:.2} left {:.1} {:?} {:?}",
        found.verdict,
        found.effect,
        found.set,
        found.limit,
        found.offset_mm,
        found.stiffness,
        found.left,
        found
            .scores
            .iter()
            .map(|s| (s.effect, (10.0 * s.z).round() / 10.0, s.testable))
            .collect::<Vec<_>>(),
        found.candidates.first().map(|c| (c.effect, c.amplitude, c.held_out_z, c.left))
    );
    found
}

fn detected(found: &CurveVerdict) -> bool {
    found.scores.iter().any(|s| s.testable && s.z > found.limit)
}

/// A limit of 1 % is passed in at most 2 of 20 draws, and no effect is named.
#[test]
fn nothing_hidden_raises_no_alarm() {
    let found: Vec<_> = (0..20).map(|seed| judged(0, Measuring::USUAL, seed)).collect();
    let alarms = found.iter().filter(|v| detected(v)).count();
    println!("{alarms} alarms of 20");
    assert!(alarms <= 2, "{alarms}");
    assert!(found.iter().all(|v| v.verdict != VerdictName::Named));
}

/// Strong effects, five draws each: detected in all, and in the answer's set or its name in at least four.
#[test]
fn strong_effects_are_detected_and_in_the_set() {
    for (n, (name, _)) in HIDDEN.iter().enumerate() {
        let found: Vec<_> = (0..5).map(|seed| judged(n + 1, Measuring::USUAL, seed)).collect();
        assert!(found.iter().all(detected), "{name}");
        let held = found.iter().filter(|v| v.set.contains(name)).count();
        println!("{name}: in the set in {held} of 5");
        assert!(held >= 4, "{name}: {held}");
    }
}

/// A thickness that is shown 4 mm wrongly, or a force that is shown 10 % wrongly, is not given the name of an
/// effect in more than 1 of 20.
#[test]
fn a_wrong_scale_is_not_named_physics() {
    for how in [
        Measuring { offset_mm: 4.0, ..Measuring::USUAL },
        Measuring { gain: 1.1, ..Measuring::USUAL },
    ] {
        let named = (0..20)
            .map(|seed| judged(0, how, 100 + seed))
            .filter(|v| v.verdict == VerdictName::Named)
            .count();
        println!("{how:?}: named {named} of 20");
        assert!(named <= 1, "{named}");
    }
}

#[test]
fn a_compression_that_may_not_begin_is_neither_made_nor_told() {
    let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
    let plan = person.plan(15.0, 60.0).unwrap();
    let way =
        |label: &str| Way { label: label.into(), mesh: Meshed::new(20.0, 0), plan: plan.clone() };
    let told = std::sync::atomic::AtomicUsize::new(0);
    let count = |_: &Way, _: &Option<Pressed>| {
        told.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Ok(())
    };
    let begins = || told.load(std::sync::atomic::Ordering::Relaxed) == 0;
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let ways = [way("first"), way("second"), way("third")];
    let made = one.install(|| press_all(&person, &ways, &begins, &count)).unwrap();
    assert_eq!(made.iter().filter(|course| course.is_some()).count(), 1);
    assert_eq!(told.into_inner(), 1);
}
