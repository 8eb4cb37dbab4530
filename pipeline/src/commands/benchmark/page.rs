//! The tables and the chart of the benchmark.

use super::{
    SIGMAS,
    tally::{Results, Tier, Trial, share},
};
use crate::{cli::BenchmarkArguments, page::median};
use mammotwin_stages::{
    discover::VerdictName,
    effects::{EFFECTS, Effect},
    report::scatter::{Dot, Fill, Group, Scatter, scatter},
};
use std::{collections::BTreeMap, fmt::Write};

/// All verdicts, one a line.
pub fn csv(results: &Results) -> String {
    let mut text = String::from(
        "tier,seed,hidden,sigma,verdict,ranked,set,weight,amplitude_over_truth,covered,shrink,held_out_change_mm\n",
    );
    for trial in &results.trials {
        let number = |value: Option<f64>| value.map(|v| format!("{v:.4}")).unwrap_or_default();
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{:.4},{},{},{},{}",
            tier(trial.tier),
            trial.seed,
            trial.truth.unwrap_or_default(),
            trial.sigma,
            word(trial.verdict),
            trial.ranked.join(" "),
            trial.set.join(" "),
            trial.weight,
            number(trial.amplitude),
            trial.covered.map(|covered| covered.to_string()).unwrap_or_default(),
            number(trial.shrink),
            number(trial.held_out_mm)
        );
    }
    text
}

/// Change (mm) of the held-out pose's distance that counts as none.
const STILL_MM: f64 = 0.1;

/// The page.
pub fn markdown(results: &Results, arguments: &BenchmarkArguments) -> String {
    let mut text = String::new();
    let seeds: Vec<String> = arguments.seeds.iter().map(u64::to_string).collect();
    let sigmas: Vec<String> = arguments.sigmas.iter().map(f64::to_string).collect();
    let voxel_mm: Vec<String> = arguments.voxel_mm.iter().map(f64::to_string).collect();
    let voxel = match voxel_mm.is_empty() {
        true => String::new(),
        false => format!(" --voxel-mm {}", voxel_mm.join(",")),
    };
    let truth = arguments.truth_mm.map_or(String::new(), |mm| format!(" --truth-mm {mm}"));
    let named = |option: &str, effects: &[String]| match effects.is_empty() {
        true => String::new(),
        false => format!(" --{option} {}", effects.join(",")),
    };
    let effects = named("effects", &arguments.effects) + &named("asked", &arguments.asked);
    let _ = writeln!(
        text,
        "# What `discover` finds of what was hidden\n\n\
         Made by `mammotwin study discovery --preset {}{voxel}{truth} --seeds {} --draws {} --sigmas {}{effects} --images {}`. Each \
         volunteer is deformed on another mesh of quadratic elements with the effect, and analysed without it; tilted \
         is held out. Severity counts standard deviations of the seen poses after the moduli took what they can. In \
         *single*, *null*, *decoy* and *outside* her labels are the true ones and errors of \
         segmentation, registration and chest wall are drawn from the error budget; fits are linear. \
         *Refit* has no drawn errors; the model itself is fitted. \
         *Images* go through noisy voxels, segmentation and registration with a chest wall that \
         changes; fits are nonlinear.\n",
        arguments.preset,
        seeds.join(","),
        arguments.draws,
        sigmas.join(","),
        arguments.images
    );
    if !results.skipped.is_empty() {
        let count = results.skipped.len();
        let _ = writeln!(
            text,
            "**Unfinished**: the time did not last for {count} parts of cases, listed at the end; the same command goes on there.\n"
        );
    }
    targets(&mut text, results);
    singles(&mut text, results);
    confusion(&mut text, results);
    images(&mut text, results);
    let _ = writeln!(text, "## Not tested\n");
    let mut sigmas: Vec<f64> = results.untestable.iter().map(|(_, sigma)| *sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    sigmas.dedup();
    for sigma in sigmas {
        let names = results.untestable.iter().filter(|(_, s)| *s == sigma);
        let mut names: Vec<&str> = names.map(|(name, _)| name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        if !names.is_empty() {
            let _ = writeln!(text, "- no plausible amplitude has {sigma} σ: {}", names.join(", "));
        }
    }
    for (effect, sigma, why) in &results.failed {
        let _ = writeln!(text, "- {effect} at {sigma} σ: {why}");
    }
    for (effect, sigma, what) in &results.skipped {
        let _ = writeln!(text, "- {effect} at {sigma} σ: no time for {what}");
    }
    text
}

fn targets(text: &mut String, results: &Results) {
    let _ = writeln!(text, "| measure | value | aim | trials |\n|---|---|---|---|");
    let mut line = |measure: &str, value: Option<String>, aim: &str, count: usize| {
        let value = value.unwrap_or_else(|| "–".into());
        let _ = writeln!(text, "| {measure} | {value} | {aim} | {count} |");
    };
    let null: Vec<&Trial> = results.of(Tier::Null).collect();
    line(
        "false alarms, nothing hidden",
        share(&null, Trial::detected).map(percent),
        "≤ 2.5 %",
        null.len(),
    );
    let decoy: Vec<&Trial> = results.of(Tier::Decoy).collect();
    let physics = share(&decoy, Trial::names_physics).map(percent);
    line("physics named, decoys", physics, "≤ 5 %", decoy.len());
    let at = |sigma: f64| -> Vec<&Trial> {
        results.of(Tier::Single).filter(|t| t.sigma == sigma).collect()
    };
    let (weak, medium, strong) = (at(SIGMAS[0]), at(SIGMAS[1]), at(SIGMAS[2]));
    line("detected, 5 σ", share(&medium, Trial::detected).map(percent), "≥ 90 %", medium.len());
    line("detected, 10 σ", share(&strong, Trial::detected).map(percent), "≥ 99 %", strong.len());
    let found: Vec<&Trial> =
        medium.iter().chain(&strong).copied().filter(|t| t.detected()).collect();
    line("best is the truth", share(&found, |t| t.within(1)).map(percent), "≥ 90 %", found.len());
    line(
        "truth among the best two",
        share(&found, |t| t.within(2)).map(percent),
        "≥ 97 %",
        found.len(),
    );
    let sets: Vec<&Trial> = found.iter().copied().filter(|t| !t.set.is_empty()).collect();
    line("set holds the truth", share(&sets, Trial::set_holds).map(percent), "≥ 97 %", sets.len());
    let size = sets.iter().map(|t| t.set.len()).sum::<usize>() as f64 / sets.len().max(1) as f64;
    line("mean size of the set", Some(format!("{size:.2}")), "≤ 1.6", sets.len());
    line("confidently wrong, 2 σ", share(&weak, Trial::wrong).map(percent), "≤ 10 %", weak.len());
    let outside: Vec<&Trial> = results.of(Tier::Outside).collect();
    let unknown = |t: &Trial| t.verdict == VerdictName::Unknown;
    line(
        "outside the library: unknown",
        share(&outside, unknown).map(percent),
        "≥ 90 %",
        outside.len(),
    );
    let strong: Vec<&Trial> = outside.iter().copied().filter(|t| t.sigma == SIGMAS[2]).collect();
    let said = share(&strong, unknown).map(percent);
    line("the same, 10 σ", said, "≥ 90 %", strong.len());
    line(
        "outside the library: named",
        share(&outside, Trial::names_physics).map(percent),
        "≤ 5 %",
        outside.len(),
    );
    for (sigma, trials, aim) in [(5, &medium, "≤ 20 %"), (10, &strong, "≤ 10 %")] {
        let errors: Vec<f64> =
            trials.iter().filter_map(|t| t.amplitude).map(|a| (a - 1.0).abs()).collect();
        let count = errors.len();
        let measure = format!("error of the linear amplitude, {sigma} σ, median");
        line(&measure, median(errors).map(percent), "–", count);
        let refit = results.of(Tier::Refit).filter(|t| t.sigma == f64::from(sigma));
        let errors: Vec<f64> = refit.filter_map(|t| t.amplitude).map(|a| (a - 1.0).abs()).collect();
        let count = errors.len();
        let measure = format!("error of the amplitude after the refit, {sigma} σ, median");
        line(&measure, median(errors).map(percent), aim, count);
        // Where the effect was found and is among what was fitted.
        let fitted: Vec<&Trial> =
            trials.iter().copied().filter(|t| t.detected() && t.covered.is_some()).collect();
        let holds = share(&fitted, |t| t.covered == Some(true)).map(percent);
        let measure = format!("90 % interval of the amplitude holds the truth, {sigma} σ");
        line(&measure, holds, "85 – 95 %", fitted.len());
    }
    let named: Vec<&Trial> = found.iter().copied().filter(|t| t.names_physics()).collect();
    let shrinks: Vec<f64> = named.iter().filter_map(|t| t.shrink).collect();
    let count = shrinks.len();
    let measure = format!(
        "held-out gap closed, median where there is one over the floor ({count} of {} named)",
        named.len()
    );
    line(&measure, median(shrinks).map(percent), "≥ 70 %", count);
    let worse = |t: &Trial| t.held_out_mm.is_some_and(|mm| mm > 0.0);
    line(
        "named, held-out pose farther off",
        share(&named, worse).map(percent),
        "never",
        named.len(),
    );
    let nothing: Vec<&Trial> = null.iter().copied().filter(|t| t.held_out_mm.is_some()).collect();
    let still = |t: &Trial| t.held_out_mm.is_some_and(|mm| mm.abs() <= STILL_MM);
    let measure = "nothing hidden: best effect moves the held-out pose by 0.1 mm at most";
    line(measure, share(&nothing, still).map(percent), "all", nothing.len());
    let (error, count) = results.calibration_error();
    let error = error.map(|e| format!("{e:.2}"));
    line("expected calibration error of the weight, all kinds of trials", error, "≤ 0.05", count);
    text.push('\n');
}

fn singles(text: &mut String, results: &Results) {
    let _ = writeln!(
        text,
        "## One hidden effect\n\n![What is found over the size of an effect](detection.svg)\n\n\
         *σ found*: size of the hidden amplitude for the model that was calibrated to the data.\n\n\
         | effect | σ | σ found | detected | best | best two | named | wrong | amplitude / truth | refit / truth | trials |\n\
         |---|---|---|---|---|---|---|---|---|---|---|"
    );
    for effect in EFFECTS {
        for sigma in results.sigmas() {
            let cell = results.cell(Tier::Single, effect.name, sigma);
            if cell.is_empty() {
                continue;
            }
            let of = |holds: fn(&Trial) -> bool| share(&cell, holds).map_or("–".into(), percent);
            let amplitude = median(cell.iter().filter_map(|t| t.amplitude).collect());
            let refit = results.cell(Tier::Refit, effect.name, sigma);
            let refit = median(refit.iter().filter_map(|t| t.amplitude).collect());
            let number = |value: Option<f64>| value.map_or("–".into(), |v| format!("{v:.2}"));
            let _ = writeln!(
                text,
                "| {} | {sigma} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
                effect.name,
                results.size(effect.name, sigma).map_or("–".into(), |size| format!("{size:.1}")),
                of(Trial::detected),
                of(|t| t.within(1)),
                of(|t| t.within(2)),
                of(Trial::names_physics),
                of(Trial::wrong),
                number(amplitude),
                number(refit),
                cell.len()
            );
        }
    }
    text.push('\n');
}

/// Of each hidden effect at 5 and 10 σ: what was said.
fn confusion(text: &mut String, results: &Results) {
    let mut said: BTreeMap<&str, BTreeMap<String, usize>> = BTreeMap::new();
    let shown = |t: &&Trial| t.sigma >= SIGMAS[1] || t.tier != Tier::Single;
    for trial in results.trials.iter().filter(|t| t.tier != Tier::Outside).filter(shown) {
        let answer = match (trial.verdict, trial.ranked.first()) {
            (VerdictName::Named, Some(best)) => best.clone(),
            (VerdictName::Ambiguous, _) => {
                let mut set = trial.set.clone();
                set.sort_unstable();
                format!("{{{}}}", set.join(", "))
            }
            (verdict, _) => format!("*{}*", word(verdict).replace('_', " ")),
        };
        let row = trial.truth.unwrap_or(match trial.tier {
            Tier::Decoy => "nothing, decoy",
            _ => "nothing",
        });
        *said.entry(row).or_default().entry(answer).or_default() += 1;
    }
    let _ = writeln!(text, "## What was said\n\n| hidden (5 σ and more) | answers |\n|---|---|");
    for (hidden, answers) in said {
        let mut answers: Vec<(String, usize)> = answers.into_iter().collect();
        answers.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        let answers: Vec<String> =
            answers.into_iter().map(|(answer, count)| format!("{answer} {count}")).collect();
        let _ = writeln!(text, "| {hidden} | {} |", answers.join(" · "));
    }
    text.push('\n');
}

fn images(text: &mut String, results: &Results) {
    let all: Vec<&Trial> = results.of(Tier::Images).collect();
    if all.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "## Through the images\n\n\
         | seed | hidden | σ | verdict | best | set | amplitude / truth | held-out gap closed |\n\
         |---|---|---|---|---|---|---|---|"
    );
    for trial in all {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} |",
            trial.seed,
            trial.truth.unwrap_or("nothing"),
            trial.sigma,
            word(trial.verdict).replace('_', " "),
            trial.ranked.first().map_or("–", String::as_str),
            trial.set.join(", "),
            trial.amplitude.map_or("–".into(), |a| format!("{a:.2}")),
            trial.shrink.map_or("–".into(), percent)
        );
    }
    let whites: Vec<f64> = results.budgets.iter().map(|(_, budget)| budget.white_mm).collect();
    if let Some(white) = median(whites) {
        let _ = writeln!(
            text,
            "\nNoise of the segmentation from node to node: {white:.2} mm (median)."
        );
    }
    text.push('\n');
}

/// What is found of each effect over the size that it has in the data.
pub fn chart(results: &Results) -> String {
    let group = |effect: &'static Effect| {
        let dots: Vec<Dot> =
            results.sigmas().into_iter().flat_map(|sigma| dots(results, effect, sigma)).collect();
        (!dots.is_empty()).then(|| Group { name: effect.name.into(), dots })
    };
    scatter(&Scatter {
        title: "What is found of each effect".into(),
        x_label: "size found (standard deviations)".into(),
        y_label: "part of the trials (%)".into(),
        groups: EFFECTS.into_iter().filter_map(group).collect(),
        shapes: vec!["detected".into(), "best is the truth".into()],
        full: String::new(),
    })
}

/// Detected, and the truth as the best explanation, of one effect and severity.
fn dots(results: &Results, effect: &Effect, sigma: f64) -> Vec<Dot> {
    let cell = results.cell(Tier::Single, effect.name, sigma);
    let Some(size) = results.size(effect.name, sigma) else { return Vec::new() };
    let holds: [fn(&Trial) -> bool; 2] = [Trial::detected, |trial| trial.within(1)];
    let dot = |(shape, holds): (usize, fn(&Trial) -> bool)| {
        let part = share(&cell, holds)?;
        let name = format!("{}, {sigma} σ", effect.name);
        Some(Dot { at: (size, 100.0 * part), shape, fill: Fill::Full, name })
    };
    holds.into_iter().enumerate().filter_map(dot).collect()
}

fn percent(part: f64) -> String {
    format!("{:.1} %", 100.0 * part)
}

fn tier(tier: Tier) -> &'static str {
    match tier {
        Tier::Null => "null",
        Tier::Decoy => "decoy",
        Tier::Single => "single",
        Tier::Refit => "refit",
        Tier::Outside => "outside",
        Tier::Images => "images",
    }
}

fn word(verdict: VerdictName) -> String {
    let value = serde_json::to_value(verdict).ok();
    value.as_ref().and_then(|v| v.as_str()).unwrap_or_default().into()
}
