//! `mammotwin discover`: find the disagreement, name the missing effect, add it, show the gap.

use super::{Opened, beside, effects::library, open, run, write};
use crate::{
    cli::{DiscoverArguments, StudyArguments},
    display::Display,
    graph::{self, Outcome},
    plausible::findings,
};
use mammotwin_data::{
    Failure,
    store::{self, Drive, Options, Stage},
    study::Use,
};
use mammotwin_stages::{
    discover::{Discover, Discovery, Gather, Verdict, VerdictName},
    effects::Effect,
    report::discovery,
};
use serde_json::json;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Looks for a missing effect, and runs the study with it when there is one.
pub fn discover(arguments: &DiscoverArguments) -> Result<(), Failure> {
    let library = library(&arguments.effects)?;
    let opened = open(&arguments.study)?;
    let held_out = held_out(&opened, arguments.held_out.as_deref())?;
    opened.refuse_wrong(&findings(&opened.study, &opened.base))?;
    let display = Display::new();
    let options = Options { until: vec!["discover".into()], ..Options::default() };
    let Opened { study, base, store, .. } = &opened;
    let drive = Drive { store, base, options: &options, listener: &display };
    let pass = store::execute(&drive, |run| graph::discover(study, &held_out, &library, run))?;
    drop(display);
    let found = pass.outcome.discovery.load()?;
    let page = opened.store.out.join("discovery.html");
    let show = |added: Option<&Added>| {
        let methods = [Gather::METHODS, Discover::METHODS];
        let shown = added.map(|added| &added.with_and_without);
        let subject = &opened.study.subject.id;
        write(&page, discovery::render(subject, &held_out, &found, shown, &methods)?)
    };
    // What was found is kept whatever becomes of the study with the effect.
    show(None)?;
    let added = match addition(&found.verdict) {
        Some((effect, amplitude)) => Some(add(arguments, &opened, &effect, amplitude)?),
        None => None,
    };
    if added.is_some() {
        show(added.as_ref())?;
    }
    answer(arguments, &held_out, &found, added.as_ref())?;
    if !arguments.json {
        tell!("\n{}", page.display());
    }
    Ok(())
}

/// The study with the effect, and what it changes.
struct Added {
    study: PathBuf,
    effect: String,
    amplitude: f64,
    with_and_without: discovery::Added,
}

/// The pose that decides.
fn held_out(opened: &Opened, wish: Option<&str>) -> Result<String, Failure> {
    let study = &opened.study;
    let others = || study.uses().filter(|(name, _)| *name != study.reference_pose());
    if others().count() < 2 {
        return Err(Failure::BadInput(
            "discover: needs two poses besides the reference pose, one to search and one to decide"
                .into(),
        ));
    }
    if let Some(name) = wish {
        return match others().find(|(known, _)| *known == name) {
            Some((_, Use::Validate)) => Ok(name.into()),
            // Moduli that are calibrated to it, here and in the study with the effect, would prove nothing in it.
            Some((_, Use::Fit)) => Err(Failure::BadInput(format!(
                "--held-out {name}: the calibration reads this pose; set its use = \"validate\""
            ))),
            None => {
                let known: Vec<&str> = others().map(|(name, _)| name.as_str()).collect();
                let known = known.join(", ");
                Err(Failure::Usage(format!("--held-out {name}: no such pose; there are: {known}")))
            }
        };
    }
    let validating = others().find(|(_, usage)| *usage == Use::Validate);
    validating.map(|(name, _)| name.clone()).ok_or_else(|| {
        Failure::BadInput(
            "discover: no pose has use = \"validate\"; a pose that the search does not see must \
             decide"
                .into(),
        )
    })
}

/// The effect that is added: the named one, or the best of an ambiguous set.
fn addition(verdict: &Verdict) -> Option<(String, f64)> {
    let best = verdict.chosen()?;
    let add = matches!(verdict.verdict, VerdictName::Named | VerdictName::Ambiguous);
    add.then(|| (best.effect.clone(), best.amplitude[0]))
}

/// Writes the study with the effect beside the first, computes its poses, and compares.
fn add(
    arguments: &DiscoverArguments,
    opened: &Opened,
    effect: &str,
    amplitude: f64,
) -> Result<Added, Failure> {
    let path = &arguments.study.study;
    let text = fs::read_to_string(path).map_err(|cause| Failure::io(path, cause))?;
    let text = with_effect(&text, effect, amplitude).map_err(|error| {
        Failure::BadInput(format!(
            "{}: cannot take the effect {effect} = {amplitude}: {error}",
            path.display()
        ))
    })?;
    let study = beside(path, "discovered", &text);
    write(&study, text)?;
    let out = opened.store.out.join(format!("with_{effect}"));
    share_cache(&opened.store.out.join("cache"), &out.join("cache"))?;
    let with = open(&StudyArguments { study: study.clone(), out: Some(out) })?;
    let until = ["validate", "calibrate", "compress"].map(String::from).to_vec();
    let options = Options { until, ..Options::default() };
    let [before, after] = [opened, &with].map(|opened| run::execute(opened, &options));
    let (before, after) = (before?.outcome, after?.outcome);
    let (far, near) = (distances(&before)?, distances(&after)?);
    let pairs = far.iter().filter_map(|(pose, b)| Some((pose.clone(), [*b, *near.get(pose)?])));
    let modified_hausdorff_mm = pairs.collect();
    let force = match (force(&before)?, force(&after)?) {
        (Some(before), Some(after)) => Some([before, after]),
        _ => None,
    };
    let with_and_without = discovery::Added { modified_hausdorff_mm, force };
    Ok(Added { study, effect: effect.into(), amplitude, with_and_without })
}

/// A study with an effect besides those that it has. Comments of a study that has effects already are lost.
fn with_effect(study: &str, effect: &str, amplitude: f64) -> Result<String, String> {
    let said = "# Found by `mammotwin discover`.";
    let mut table: toml::Table = study.parse().map_err(|cause| format!("{cause}"))?;
    let model = table.get_mut("model").and_then(toml::Value::as_table_mut);
    let known = model.and_then(|model| model.get_mut("effects")?.as_table_mut());
    let text = match known {
        None => format!("{study}\n{said}\n[model.effects]\n{effect} = {amplitude:?}\n"),
        Some(effects) => {
            // TOML tells 1 from 1.0.
            let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|n| n as f64));
            let before = effects.get(effect).and_then(number).unwrap_or(0.0);
            let mut sum = before + amplitude;
            if let Some(known) = Effect::named(effect) {
                // The fit keeps the sum in its range, but for rounding, which a run would refuse.
                let [least, greatest] = known.amplitude.range;
                sum = sum.clamp(least, greatest);
            }
            effects.insert(effect.into(), sum.into());
            let text = toml::to_string_pretty(&table).map_err(|cause| format!("{cause}"))?;
            format!("{said}\n{text}")
        }
    };
    mammotwin_data::study::parse(&text).map_err(|cause| cause.to_string())?;
    Ok(text)
}

/// Modified Hausdorff distance (mm) of every pose after the fit.
fn distances(outcome: &Outcome) -> Result<BTreeMap<String, f64>, Failure> {
    let mut all = BTreeMap::new();
    for pose in outcome.calibration.load()?.after.poses {
        all.insert(pose.pose, pose.distances.modified_hausdorff);
    }
    for (name, validation) in &outcome.validations {
        all.insert(name.clone(), validation.load()?.after.distances.modified_hausdorff);
    }
    Ok(all)
}

/// Thickness (mm) and force (N) on the way of the compression, if there is one.
fn force(outcome: &Outcome) -> Result<Option<Vec<(f64, f64)>>, Failure> {
    let Some(squeezed) = &outcome.squeezed else { return Ok(None) };
    let course = squeezed.compression.load()?.curve;
    Ok(Some(course.thickness_mm.into_iter().zip(course.force_n).collect()))
}

/// Results that do not depend on the effect are shared: links to the same files.
fn share_cache(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::create_dir_all(to).map_err(|cause| Failure::io(to, cause))?;
    let entries = fs::read_dir(from).map_err(|cause| Failure::io(from, cause))?;
    for entry in entries {
        let source = entry.map_err(|cause| Failure::io(from, cause))?.path();
        let Some(name) = source.file_name() else { continue };
        let target = to.join(name);
        if source.is_dir() {
            share_cache(&source, &target)?;
        } else if !target.exists() && source.extension().is_none_or(|kind| kind != "lock") {
            fs::hard_link(&source, &target)
                .or_else(|_| fs::copy(&source, &target).map(|_| ()))
                .map_err(|cause| Failure::io(&target, cause))?;
        }
    }
    Ok(())
}

fn answer(
    arguments: &DiscoverArguments,
    held_out: &str,
    found: &Discovery,
    added: Option<&Added>,
) -> Result<(), Failure> {
    let verdict = &found.verdict;
    if arguments.json {
        let best = verdict.chosen();
        tell!(
            "{:#}",
            json!({
                "verdict": verdict.verdict,
                "effect": verdict.effect,
                "set": verdict.set,
                "weight": verdict.weight,
                "reason": verdict.reason,
                "amplitude": best.map(|c| c.amplitude),
                "held_out": best.map(|c| json!({
                    "pose": held_out,
                    "before_mm": c.held_out.before_mm,
                    "after_mm": c.held_out.after_mm,
                    "floor_mm": c.held_out.floor_mm,
                    "z": c.held_out.z,
                })),
                "limit": found.screening.limit,
                "scores": found.screening.scores,
                "candidates": verdict.candidates,
                "not_testable": verdict.not_testable,
                "second": verdict.second,
                "moduli_by_pose": found.drift,
                "budget": found.budget,
                "added": added.map(|a| json!({
                    "study": a.study,
                    "effect": a.effect,
                    "amplitude": a.amplitude,
                    "modified_hausdorff_mm": a.with_and_without.modified_hausdorff_mm,
                })),
            })
        );
        return Ok(());
    }
    let kind = serde_json::to_value(verdict.verdict).ok();
    let kind = kind.as_ref().and_then(|kind| kind.as_str()).unwrap_or_default().replace('_', " ");
    let name = verdict.effect.as_deref().map(|name| format!(": {name}")).unwrap_or_default();
    tell!("{kind}{name}\n{}\n", verdict.reason);
    tell!(
        "score of each effect (by chance and systematic errors up to {:.1})",
        found.screening.limit
    );
    for score in found.screening.ranked() {
        let note = match score.amplitude {
            Some(amplitude) => format!("amplitude {amplitude:9.3}"),
            None => "not testable with these data".into(),
        };
        tell!("  {:20} {:6.2}   {note}", score.effect, score.z);
    }
    tell!("\npose            rms before   after   floor (mm, without rigid motion)");
    for gap in &found.gaps {
        let [before, after, floor] = gap.rms_mm;
        let note = if gap.pose == held_out { "   held out" } else { "" };
        tell!("  {:12} {before:10.2} {after:8.2} {floor:7.2}{note}", gap.pose);
    }
    if let Some(added) = added {
        tell!("\nadded {} = {:.4}: {}", added.effect, added.amplitude, added.study.display());
        tell!(
            "pose            modified Hausdorff distance (mm) without and with it, moduli refitted"
        );
        for (pose, [before, after]) in &added.with_and_without.modified_hausdorff_mm {
            tell!("  {pose:12} {before:10.2} {after:8.2}");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = "schema = 1\n[subject]\nid = \"v\"\n[poses.supine]\nimage = \"s.nii\"\nposture = \
         \"supine\"\n[mesh] # edges\nsize_mm = 9.0\n";

    #[test]
    fn an_effect_comes_on_top_of_those_that_a_study_has() {
        let effects = |text: &str| mammotwin_data::study::parse(text).unwrap().model.effects;
        let once = with_effect(STUDY, "limit_chain", 0.25).unwrap();
        assert!(once.starts_with(STUDY), "{once}");
        assert_eq!(effects(&once)["limit_chain"], 0.25);
        let other = with_effect(&once, "skin_region", 0.5).unwrap();
        assert_eq!(effects(&other).len(), 2);
        let more = with_effect(&other, "limit_chain", 0.125).unwrap();
        assert_eq!(effects(&more)["limit_chain"], 0.375);
        // An integer counts, and rounding leads out of no range.
        let whole = format!("{STUDY}[model.effects]\nlimit_chain = 1\n");
        let most = with_effect(&whole, "limit_chain", 0.2 + 1e-15).unwrap();
        assert_eq!(effects(&most)["limit_chain"], 1.2);
        assert_eq!(mammotwin_data::study::parse(&more).unwrap().mesh.size_mm, 9.0);
        assert!(with_effect(STUDY, "magic", 1.0).is_err());
    }

    #[test]
    fn a_pose_that_the_calibration_reads_does_not_decide() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("study.toml");
        let pose = |name: &str, usage: &str| {
            format!(
                "[poses.{name}]\nimage = \"{name}.nii\"\nposture = \"{name}\"\nuse = \"{usage}\"\n"
            )
        };
        let text = STUDY.to_string() + &pose("prone", "fit") + &pose("upright", "validate");
        fs::write(&file, text).unwrap();
        let opened = open(&StudyArguments { study: file, out: None }).unwrap();
        let of = |wish| held_out(&opened, wish).map_err(|why| why.to_string());
        assert_eq!(of(None).as_deref(), Ok("upright"));
        assert_eq!(of(Some("upright")).as_deref(), Ok("upright"));
        let why = of(Some("prone")).unwrap_err();
        assert!(why.contains("use = \"validate\""), "{why}");
        assert!(of(Some("tilted")).unwrap_err().contains("prone, upright"));
    }
}
