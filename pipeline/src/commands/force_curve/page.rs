//! Sentences, tables and the page of the study of force curves.

use super::{
    bench::{DATA, SIGMAS},
    tally::{Tier, Trial, count},
};
use crate::{cli::ForceCurveArguments, page::median};
use mammotwin_stages::force_curve::{
    library::CurveEffect,
    record::{Channel, Record},
    search::CurveScreening,
    verdict::CurveVerdict,
};
use std::{fmt::Write, path::Path};

/// Person, data, screening, names of the ladders.
pub type Screened = (u64, &'static str, CurveScreening, Vec<&'static str>);
/// Person, effect, severity, amplitude, sizes, thickness (mm) at which the truth ended, if it was tried.
pub type Hidden = (u64, &'static str, f64, f64, [Option<f64>; 3], Option<f64>);

/// What a benchmark shows beside its trials.
#[derive(Default)]
pub struct Shown {
    /// Person, data, screening of a record without errors, names of the ladders.
    pub screens: Vec<Screened>,
    /// Person, effect, severity asked for, amplitude, its size with each kind of data (standard deviations),
    /// and the thickness (mm) at which the truth ended: too early when `None`.
    pub truths: Vec<Hidden>,
}

/// What a record tells, and what it does not, in sentences.
pub fn said(found: &CurveVerdict, record: &Record, added: Option<&Path>) -> Vec<String> {
    let kind = serde_json::to_value(found.verdict).ok();
    let kind = kind.as_ref().and_then(|kind| kind.as_str()).unwrap_or_default().replace('_', " ");
    let name = found.effect.map(|name| format!(": {name}")).unwrap_or_default();
    let set = match found.set.len() {
        0 | 1 => String::new(),
        _ => format!(" {{{}}}", found.set.join(", ")),
    };
    let mut all = vec![format!("{kind}{name}{set}. {}", found.reason)];
    all.push(format!(
        "Without an effect: thickness off by {:.1} mm, tissue {:.2} times as stiff as calibrated; score of smooth \
         residuals {:.1}.",
        found.offset_mm, found.stiffness, found.left
    ));
    for score in &found.scores {
        let note = if score.testable {
            let alike = match score.alike.is_empty() {
                true => String::new(),
                false => format!("; not told from {}", score.alike.join(", ")),
            };
            format!("amplitude about {:.3}{alike}", score.amplitude)
        } else {
            let most = score.detectable_z;
            format!("not testable with these data: {most:.1} at its largest plausible amplitude")
        };
        all.push(format!(
            "{}: score {:.1} (by chance up to {:.1}), {:.0} % of its change is left by offset and stiffness; {note}.",
            score.effect,
            score.z,
            found.limit,
            100.0 * score.surviving
        ));
    }
    for c in &found.candidates {
        let ([amplitude, error], [before, after]) = (c.amplitude, c.held_out);
        let unit = CurveEffect::named(c.effect).map_or("", |e| e.unit);
        all.push(format!(
            "Fitted {}: {amplitude:.3} ± {error:.3} {unit}, offset {:.1} mm, stiffness {:.2}; held-out misfit \
             {before:.2} -> {after:.2} (errors leave 1), {:.1} standard errors.",
            c.effect, c.offset_mm, c.stiffness, c.held_out_z
        ));
    }
    let measured = |channel: Channel| record.0.iter().any(|r| r.channel == channel);
    let mut further = Vec::new();
    if !measured(Channel::Tilt) {
        further.push("the tilt of the paddle (tilt_deg)");
    }
    if !measured(Channel::Extent) {
        further.push("how far the image of the breast reaches (extent_mm)");
    }
    if !further.is_empty() && !found.scores.iter().all(|s| s.testable && s.alike.is_empty()) {
        all.push(format!("What would tell more: {}.", further.join(", ")));
    }
    for name in &found.set {
        if let Some(effect) = CurveEffect::named(name).filter(|_| found.set.len() > 1) {
            all.push(format!("{name} is told from others by: {}.", effect.separated_by));
        }
    }
    if let Some(path) = added {
        all.push(format!("Switched on in {}.", path.display()));
    }
    all
}

/// All trials as CSV.
pub fn csv(trials: &[Trial]) -> String {
    let mut text = String::from(
        "tier,seed,hidden,amplitude,sigma,data,detected,best,second,set,verdict,named,ratio,held_out_before,\
         held_out_after\n",
    );
    for t in trials {
        let word = |name: Option<&'static str>| name.unwrap_or("");
        let verdict = serde_json::to_value(t.verdict).ok();
        let verdict = verdict.as_ref().and_then(|v| v.as_str()).unwrap_or_default().to_owned();
        let ratio = t.ratio.map_or(String::new(), |r| format!("{r:.3}"));
        let held = t.held_out.map_or(",".into(), |[b, a]| format!("{b:.3},{a:.3}"));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{},{},{},{:.5},{},{},{},{},{},{},{verdict},{},{ratio},{held}",
            t.tier.name(),
            t.seed,
            t.hidden,
            t.amplitude,
            t.sigma,
            t.data.replace(", ", "+"),
            t.detected,
            word(t.best[0]),
            word(t.best[1]),
            t.set.join(" "),
            word(t.named)
        );
    }
    text
}

/// The page.
pub fn markdown(trials: &[Trial], shown: &Shown, arguments: &ForceCurveArguments) -> String {
    let ForceCurveArguments { preset, seeds, draws, size_mm, stiffer, .. } = arguments;
    let mut text = format!(
        "# Effects of the compression, hidden in digital volunteers\n\n`mammotwin study force-curve`: volunteers \
         `{preset}` of seeds {seeds:?}, tissue {stiffer} times as stiff, edges of {size_mm} mm (truth {:.1} mm, another \
         lattice), {draws} draws of errors for each case. A second record of the same compression, with errors of its own, decides.\n\n## What these data could show\n\nSize (standard deviations) of the largest change that the model \
         reaches once offset and stiffness took their part, the part that is left, and what is not told apart (cosine \
         over 0.95). The limit is passed by chance once in a hundred records.\n\n\
         | data | seed | limit | effect | size | left | told apart |\n|---|---|---|---|---|---|---|\n",
        0.7 * size_mm
    );
    for (seed, data, screening, names) in &shown.screens {
        for name in names {
            let Some(score) = screening.scores.iter().find(|s| s.effect == *name) else { continue };
            let apart = match (score.testable, score.alike.is_empty()) {
                (false, _) => "not testable".to_owned(),
                (true, true) => "yes".into(),
                (true, false) => format!("not from {}", score.alike.join(", ")),
            };
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "| {data} | {seed} | {:.2} | {name} | {:.1} | {:.0} % | {apart} |",
                screening.limit,
                score.detectable_z,
                100.0 * score.surviving
            );
        }
    }
    text += "\nCosines between what is left of the largest changes:\n";
    for (seed, data, screening, names) in &shown.screens {
        let _ = write!(text, "\n| {data}, seed {seed} | {} |\n|---|", names.join(" | "));
        text += &"---|".repeat(names.len());
        for (name, row) in names.iter().zip(&screening.cosines) {
            let cells: Vec<String> = row.iter().map(|c| format!("{c:.2}")).collect();
            let _ = write!(text, "\n| {name} | {} |", cells.join(" | "));
        }
        text.push('\n');
    }
    text += "\n## What was hidden\n\n| effect | seed | asked for (σ) | amplitude | force (σ) | with picture (σ) | with \
             tilt (σ) | truth ended at (mm) |\n|---|---|---|---|---|---|---|---|\n";
    for (seed, name, sigma, amplitude, sizes, ended_mm) in &shown.truths {
        let size = |s: &Option<f64>| s.map_or("-".into(), |s| format!("{s:.1}"));
        let ended = ended_mm.map_or("too early: not tried".into(), |mm| format!("{mm:.1}"));
        let [a, b, c] = sizes.each_ref().map(size);
        let _ = writeln!(
            text,
            "| {name} | {seed} | {sigma} | {amplitude:.3} | {a} | {b} | {c} | {ended} |"
        );
    }
    text += "\n## Found\n\nOf the detected: is the hidden effect the best one, among the best two, in the set that the \
             answer leaves (mean size)? Of all: named, named wrongly. Amplitude over truth: median of the fits of the \
             hidden effect.\n\n| hidden | σ | data | detected | best | best two | set holds truth | named | wrong | \
             amplitude / truth |\n|---|---|---|---|---|---|---|---|---|---|\n";
    let mut hidden: Vec<&str> = Vec::new();
    for trial in trials.iter().filter(|t| t.tier == Tier::Single) {
        if !hidden.contains(&trial.hidden.as_str()) {
            hidden.push(&trial.hidden);
        }
    }
    for (data, _) in &DATA {
        for name in hidden.iter().map(Some).chain([None]) {
            for sigma in SIGMAS {
                let of = |t: &&Trial| {
                    t.tier == Tier::Single
                        && t.data == *data
                        && t.sigma == sigma
                        && name.is_none_or(|name| t.hidden == **name)
                };
                let own: Vec<&Trial> = trials.iter().filter(of).collect();
                if own.is_empty() {
                    continue;
                }
                let c = count(own.iter().copied());
                let ratio = median(own.iter().filter_map(|t| t.ratio).collect());
                let ratio = match name {
                    Some(_) => ratio.map_or("-".into(), |r| format!("{r:.2}")),
                    None => String::new(),
                };
                let size = c.members as f64 / (c.sets.max(1)) as f64;
                let name = name.map_or("**all**", |name| name);
                let _ = writeln!(
                    text,
                    "| {name} | {sigma} | {data} | {} of {} | {} | {} | {} of {} ({size:.1}) | {} | {} | {ratio} |",
                    c.detected, c.all, c.first, c.second, c.held, c.sets, c.named, c.wrong
                );
            }
        }
    }
    text += "\n## Nothing hidden, measurements that are off, effects outside of the library\n\n| case | data | over the \
             limit | named an effect | ambiguous | unknown | artefact |\n|---|---|---|---|---|---|---|\n";
    for tier in [Tier::Null, Tier::Decoy, Tier::Outside] {
        let mut words: Vec<&str> = Vec::new();
        for trial in trials.iter().filter(|t| t.tier == tier) {
            if !words.contains(&trial.hidden.as_str()) {
                words.push(&trial.hidden);
            }
        }
        for word in words {
            for (data, _) in &DATA {
                let of = |t: &&Trial| t.tier == tier && t.data == *data && t.hidden == word;
                let c = count(trials.iter().filter(of));
                let before = if tier == Tier::Outside { "without " } else { "" };
                let _ = writeln!(
                    text,
                    "| {before}{word} | {data} | {} of {} | {} | {} | {} | {} |",
                    c.detected, c.all, c.wrong, c.ambiguous, c.unknown, c.artifact
                );
            }
        }
    }
    text
}
