//! `mammotwin study discovery`: how often `discover` names what was hidden.
//!
//! Volunteers with and without hidden effects are made once and kept; a run that was cut short goes
//! on where it ended. What is hidden lies in each volunteer's `truth` folder and in the plan here; the
//! search reads neither.

mod case;
mod page;
mod tally;

use super::{
    effects::library,
    synth::{truth_edge, voxels},
    write,
};
use crate::{cli::BenchmarkArguments, display::Task};
use case::{Case, Kind};
use mammotwin_data::{Failure, progress::Progress};
use mammotwin_stages::{
    discover::{Evidence, Judge, RigidError, Verdict, trial::Errors},
    effects::Effect,
    volunteer::{PoseName, Preset},
};
use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::{
    fs,
    time::{Duration, Instant},
};
use tally::{Tier, Trial};

/// The pose that no search sees.
const HELD_OUT: PoseName = PoseName::Tilted;
/// Severities of the tables (standard deviations, after the moduli took what they can).
const SIGMAS: [f64; 3] = [2.0, 5.0, 10.0];
/// What registration leaves: measured on volunteers.
const RIGID: RigidError = RigidError { shift_mm: 0.35, turn: 0.0025 };
/// Times the noise of the budget, draw after draw, where nothing is hidden.
const NULL_NOISE: [f64; 3] = [0.7, 1.0, 1.5];

/// Makes what is missing, tries all verdicts, and writes `trials.csv`, `discovery-benchmark.md` and
/// `detection.svg`.
pub fn benchmark(arguments: &BenchmarkArguments) -> Result<(), Failure> {
    if arguments.seeds.is_empty() || arguments.draws == 0 {
        return Err(Failure::Usage(
            "give at least one of --seeds, and --draws of 1 or more".into(),
        ));
    }
    let (hidden, asked) = (library(&arguments.effects)?, library(&arguments.asked)?);
    let wanted = |effect: &Effect| hidden.iter().any(|hidden| hidden.name == effect.name);
    Preset::named(&arguments.preset)?;
    let (voxel_mm, truth_mm) = (voxels(&arguments.voxel_mm)?, truth_edge(arguments.truth_mm)?);
    let out = &arguments.out;
    fs::create_dir_all(out).map_err(|cause| Failure::io(out, cause))?;
    let end = arguments.minutes.map(|minutes| Instant::now() + Duration::from_secs(60 * minutes));
    let late = || end.is_some_and(|end| Instant::now() >= end);
    let task = Task::new("benchmark");
    let mut results = tally::Results::default();
    for &seed in &arguments.seeds {
        let case = |hidden: Option<(&'static Effect, f64)>, sigma: f64, kind: Kind| Case {
            out: out.clone(),
            preset: arguments.preset.clone(),
            seed,
            hidden,
            sigma,
            kind,
            asked: asked.clone(),
            voxel_mm,
            truth_mm,
        };
        task.report(0.0, &format!("seed {seed}: nothing hidden"));
        let null = case(None, 0.0, Kind::Exact).evidence()?;
        results.extend(nulls(&null, seed, arguments.draws)?);
        results.extend(decoys(&null, seed, arguments.draws)?);
        let mut cases = Vec::new();
        for &sigma in &arguments.sigmas {
            let all = severities(&null, seed, sigma)?.into_iter();
            for (effect, amplitude) in all.filter(|(effect, _)| wanted(effect)) {
                match amplitude {
                    Some(amplitude) => cases.push((effect, amplitude, sigma)),
                    None => results.untestable(effect.name, sigma),
                }
            }
        }
        for (n, &(effect, amplitude, sigma)) in cases.iter().enumerate() {
            let case = case(Some((effect, amplitude)), sigma, Kind::Exact);
            if late() && !case.has("evidence") {
                results.skipped(effect.name, sigma, "the case");
                continue;
            }
            task.report(
                n as f64 / cases.len() as f64,
                &format!("seed {seed}: {} at {sigma} sigma", effect.name),
            );
            match case.evidence() {
                Ok(evidence) => {
                    let hidden = (effect, amplitude, sigma);
                    results.extend(singles(&evidence, &null, seed, hidden, arguments.draws)?);
                    // Once more with fits of the model itself, without drawn errors.
                    if late() && !case.has("discover") {
                        results.skipped(effect.name, sigma, "fits of the model itself");
                    } else {
                        refit(&case, &mut results)?;
                    }
                    if let Some(size) = size(&evidence, &null, seed, effect, amplitude)? {
                        results.sized(effect.name, sigma, size);
                    }
                }
                Err(Failure::Numerics(why)) => results.failed(effect.name, sigma, &why),
                Err(other) => return Err(other),
            }
        }
        // Through the whole image path: nothing, then the strongest case of each effect.
        cases.sort_by(|a, b| b.2.total_cmp(&a.2));
        let strongest = cases.iter().fold(Vec::new(), |mut kept, case| {
            if kept.iter().all(|(effect, ..): &(&Effect, f64, f64)| effect.name != case.0.name) {
                kept.push(*case);
            }
            kept
        });
        let scanned = [None].into_iter().chain(strongest.into_iter().map(Some));
        for hidden in scanned.take(arguments.images) {
            let (name, sigma) = hidden.map_or(("nothing", 0.0), |(e, _, sigma)| (e.name, sigma));
            task.report(0.5, &format!("seed {seed}: {name} at {sigma} sigma through the images"));
            let imaged = case(hidden.map(|(effect, a, _)| (effect, a)), sigma, Kind::Imaged);
            if late() && !imaged.has("discover") {
                results.skipped(name, sigma, "images");
                continue;
            }
            match imaged.discovery() {
                Ok(found) => {
                    let truth = hidden.map(|(effect, amplitude, _)| (effect.name, amplitude));
                    results.extend([Trial::new(Tier::Images, seed, truth, sigma, &found.verdict)]);
                    results.measured(seed, &imaged.evidence()?);
                }
                Err(Failure::Numerics(why)) => results.failed(name, sigma, &why),
                Err(other) => return Err(other),
            }
        }
    }
    drop(task);
    let page = page::markdown(&results, arguments);
    write(&out.join("trials.csv"), page::csv(&results))?;
    write(&out.join("detection.svg"), page::chart(&results))?;
    write(&out.join("discovery-benchmark.md"), &page)?;
    tell!("{page}");
    Ok(())
}

/// The verdict of fits of the model itself. One that cannot be computed is told, and is no end of the others.
fn refit(case: &Case, results: &mut tally::Results) -> Result<(), Failure> {
    let Some((effect, amplitude)) = case.hidden else { return Ok(()) };
    match case.discovery() {
        Ok(found) => {
            let truth = Some((effect.name, amplitude));
            results.extend([Trial::new(Tier::Refit, case.seed, truth, case.sigma, &found.verdict)]);
        }
        Err(Failure::Numerics(why)) => {
            let why = format!("fits of the model itself: {why}");
            results.failed(effect.name, case.sigma, &why);
        }
        Err(other) => return Err(other),
    }
    Ok(())
}

/// The amplitude of each effect whose change has a severity, in standard deviations of what a trial's
/// score varies by; `None` when no plausible one has.
fn severities(
    null: &Evidence,
    seed: u64,
    sigma: f64,
) -> Result<Vec<(&'static Effect, Option<f64>)>, Failure> {
    let noisy = drawn(null, null, seed)?;
    Ok(Judge::new(&noisy)?.amplitudes_of(sigma))
}

/// The size of what is hidden, in standard deviations of a trial, as the case's own model has it.
fn size(
    evidence: &Evidence,
    null: &Evidence,
    seed: u64,
    effect: &Effect,
    amplitude: f64,
) -> Result<Option<f64>, Failure> {
    let noisy = drawn(evidence, null, seed)?;
    Ok(Judge::new(&noisy)?.size_of(effect.name, amplitude))
}

/// Evidence with one draw of errors of the budget of the volunteer without an effect.
fn drawn(evidence: &Evidence, null: &Evidence, seed: u64) -> Result<Evidence, Failure> {
    let errors = Errors::new(evidence, &null.budget, RIGID)?;
    Ok(evidence.with_errors(&errors.draw(&mut ChaCha8Rng::seed_from_u64(seed))))
}

/// The seed of the draws of a person, a tier and what is hidden: no two cases have the same errors.
fn seed_of(seed: u64, tier: Tier, hidden: Option<(&Effect, f64)>) -> u64 {
    let words = hidden.map_or(String::new(), |(effect, sigma)| format!("{} {sigma}", effect.name));
    let bytes = format!("{seed} {tier:?} {words}");
    // Fowler, Noll and Vo's hash.
    bytes.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Verdicts on evidence with drawn errors. Each draw has its own seed.
fn tried(
    evidence: &Evidence,
    draws: usize,
    seed: u64,
    errors: impl Fn(usize, &mut ChaCha8Rng) -> DVector<f64> + Sync,
) -> Result<Vec<Verdict>, Failure> {
    let judge = Judge::new(evidence)?;
    (0..draws)
        .into_par_iter()
        .map(|draw| {
            let mut random = ChaCha8Rng::seed_from_u64(seed.wrapping_add(draw as u64));
            let noisy = evidence.with_errors(&errors(draw, &mut random));
            Ok(judge.again(&noisy)?.linear(&noisy.residual).1)
        })
        .collect()
}

fn nulls(null: &Evidence, seed: u64, draws: usize) -> Result<Vec<Trial>, Failure> {
    let errors = Errors::new(null, &null.budget, RIGID)?;
    let verdicts = tried(null, 2 * draws, seed_of(seed, Tier::Null, None), |draw, random| {
        NULL_NOISE[draw % NULL_NOISE.len()] * errors.draw(random)
    })?;
    Ok(verdicts.iter().map(|v| Trial::new(Tier::Null, seed, None, 0.0, v)).collect())
}

/// What must not be called physics: rigid errors three times as large, surfaces half a voxel off, noise
/// half as large again.
fn decoys(null: &Evidence, seed: u64, draws: usize) -> Result<Vec<Trial>, Failure> {
    let rigid = RigidError { shift_mm: 3.0 * RIGID.shift_mm, turn: 3.0 * RIGID.turn };
    let plain = Errors::new(null, &null.budget, RIGID)?;
    let moved = Errors::new(null, &null.budget, rigid)?;
    let own = seed_of(seed, Tier::Decoy, None);
    let verdicts = tried(null, draws, own, |draw, random| match draw % 3 {
        0 => moved.draw(random),
        1 => plain.draw(random) + plain.biased(0.5 * null.budget.voxel_mm, random),
        _ => 1.5 * plain.draw(random),
    })?;
    Ok(verdicts.iter().map(|v| Trial::new(Tier::Decoy, seed, None, 0.0, v)).collect())
}

/// One hidden effect: with the whole library, and with a library that lacks it.
fn singles(
    evidence: &Evidence,
    null: &Evidence,
    seed: u64,
    (effect, amplitude, sigma): (&'static Effect, f64, f64),
    draws: usize,
) -> Result<Vec<Trial>, Failure> {
    let errors = Errors::new(evidence, &null.budget, RIGID)?;
    let truth = Some((effect.name, amplitude));
    let hidden = Some((effect, sigma));
    let own = seed_of(seed, Tier::Single, hidden);
    let found = tried(evidence, draws, own, |_, random| errors.draw(random))?;
    let mut trials: Vec<Trial> =
        found.iter().map(|v| Trial::new(Tier::Single, seed, truth, sigma, v)).collect();
    if sigma > SIGMAS[0] {
        let less = evidence.without_effect(effect.name);
        let own = seed_of(seed, Tier::Outside, hidden);
        let found = tried(&less, draws.div_ceil(2), own, |_, random| errors.draw(random))?;
        trials.extend(found.iter().map(|v| Trial::new(Tier::Outside, seed, truth, sigma, v)));
    }
    Ok(trials)
}
