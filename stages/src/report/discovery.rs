//! `discovery.html`: where simulation and measurement disagree, what explains it, and the gap with and
//! without it.

use super::{
    Fact, SurfaceMap,
    chart::{self, Axis, Chart, Line},
    html::{map_over, significant},
    palette::Palette,
    surface::Camera,
};
use crate::{
    discover::{Candidate, Cluster, Discovery, Drift, PoseGap, PoseModuli, VerdictName},
    effects::Effect,
};
use mammotwin_data::{Failure, surface::TriMesh};
use minijinja::{Environment, context};
use std::collections::BTreeMap;

/// A study with and without the effect, run whole.
#[derive(Debug, Clone, Default)]
pub struct Added {
    /// Modified Hausdorff distance (mm) without and with it, by pose.
    pub modified_hausdorff_mm: BTreeMap<String, [f64; 2]>,
    /// Thickness (mm) and force (N) of the compression without and with it.
    pub force: Option<[Vec<(f64, f64)>; 2]>,
}

/// The page.
///
/// # Errors
/// [`Failure::BadInput`] for a discovery whose parts do not fit each other.
pub fn render(
    subject: &str,
    held_out: &str,
    found: &Discovery,
    added: Option<&Added>,
    methods: &[&str],
) -> Result<String, Failure> {
    let Discovery { verdict, screening, drift, budget, clusters, gaps } = found;
    let best = verdict.chosen();
    let shown = best.filter(|_| verdict.effect.is_some() || !verdict.set.is_empty());
    let effect = shown.and_then(|best| Effect::named(&best.effect));
    let mut facts = Vec::new();
    let mut about = Vec::new();
    if let (Some(best), Some(effect)) = (shown, effect) {
        facts.push(Fact::new(effect.amplitude.meaning, amplitude(best)));
        let [before, after] = [best.held_out.before_mm, best.held_out.after_mm];
        let gap = format!("{before:.2} → {after:.2} mm");
        facts.push(Fact::new(&format!("{held_out}, never seen by the search (rms)"), gap));
        facts.push(Fact::new(
            "Foretold change there",
            format!("{:.1} standard errors", best.held_out.z),
        ));
        facts.push(Fact::new("Weight among what was fitted", format!("{:.2}", verdict.weight)));
        about.push(Fact::new("Where it acts", effect.place));
        about.push(Fact::new("How it shows", effect.signature));
        about.push(Fact::new("Looks like", effect.confused_with.join(", ")));
        about.push(Fact::new("What would tell them apart", effect.separated_by));
    }
    let lead = match effect {
        Some(effect) => format!("{} {}", effect.sentence, sentence(&verdict.reason)),
        None => sentence(&verdict.reason),
    };
    let surfaces = distances(gaps, held_out)?;
    let mut maps = Vec::new();
    for (floor_mm, [without, with]) in &surfaces {
        let map = |surface| map_over(surface, Some(TWICE * floor_mm));
        maps.push([map(without)?, map(with)?]);
    }
    let force = added.and_then(|added| added.force.as_ref()).map(|curves| {
        let line = |(name, points): (&str, &Vec<(f64, f64)>)| Line {
            name: name.into(),
            points: points.clone(),
        };
        let chart = Chart {
            title: "Force on the way".into(),
            caption:
                "The study's compression with the material of its own law; the effect comes on \
                      top of it, and the moduli are those fitted with it."
                    .into(),
            x_label: "thickness (mm)".into(),
            y_label: "force (N)".into(),
            lines: ["without", "with the effect"].into_iter().zip(curves).map(line).collect(),
            marks: Vec::new(),
            x_axis: Axis::Falling,
        };
        context! { title => chart.title, caption => chart.caption, body => chart::lines(&chart) }
    });
    let largest = screening.scores.iter().map(|s| s.z).fold(1.5 * screening.limit, f64::max);
    let percent = |z: f64| (100.0 * z / largest.max(f64::MIN_POSITIVE)).clamp(0.0, 100.0);
    let bars: Vec<_> = screening
        .ranked()
        .into_iter()
        .map(|score| {
            context! {
                name => score.effect,
                title => Effect::named(&score.effect).map(|effect| effect.title),
                z => format!("{:.1}", score.z),
                width => format!("{:.1}", percent(score.z)),
                limit => format!("{:.1}", percent(screening.limit)),
                over => score.z > screening.limit,
                testable => score.testable,
            }
        })
        .collect();
    let names: Vec<&String> = screening.scores.iter().map(|score| &score.effect).collect();
    let matrix: Vec<_> = names
        .iter()
        .zip(&screening.cosines)
        .map(|(name, row)| {
            let cells: Vec<_> = row.iter().map(|&cosine| cell(cosine)).collect();
            context! { name => name, cells => cells }
        })
        .collect();
    let errors = [
        ("Node to node", budget.white_mm, None),
        ("Segmentation", budget.segmentation_mm, Some(budget.segmentation_length_mm)),
        ("Change of the chest wall", budget.chest_mm, Some(budget.chest_length_mm)),
        ("Surfaces as a whole", budget.offset_mm, None),
    ]
    .map(|(name, size, length)| {
        let over = length.map(|mm| format!(" over {mm:.0} mm")).unwrap_or_default();
        Fact::new(name, format!("{size:.2} mm{over}"))
    });
    let page = context! {
        style => include_str!("style.css"),
        subject => subject,
        heading => heading(verdict.verdict, effect, verdict.set.len()),
        lead => lead,
        facts => facts,
        about => about,
        held_out => held_out,
        added => added.is_some(),
        gaps => rows(gaps, added),
        maps => maps,
        clusters => clusters.iter().take(MOST_CLUSTERS).map(cluster).collect::<Vec<_>>(),
        more_clusters => clusters.len().saturating_sub(MOST_CLUSTERS),
        force => force,
        drift => drift.poses.iter().map(moduli).collect::<Vec<_>>(),
        apart => apart(drift),
        systematic => format!("{:.1}", budget.systematic()),
        limit => format!("{:.1}", screening.limit),
        bars => bars,
        candidates => verdict.candidates.iter().map(candidate).collect::<Vec<_>>(),
        names => names,
        matrix => matrix,
        errors => errors,
        methods => methods,
    };
    let mut environment = Environment::new();
    environment
        .add_template("discovery.html", include_str!("discovery.html"))
        .and_then(|()| environment.get_template("discovery.html")?.render(page))
        .map_err(|cause| Failure::BadInput(format!("discovery.html: {cause:#}")))
}

fn moduli(of: &PoseModuli) -> minijinja::Value {
    let side = |n: usize| {
        let [kpa, deviation] = [of.moduli_kpa[n], of.moduli_kpa[n] * of.log_error[n]];
        format!("{kpa:.3} ± {deviation:.3}")
    };
    context! { pose => of.pose, right => side(0), left => side(1) }
}

/// What the moduli pose by pose say; nothing for one pose.
fn apart(drift: &Drift) -> Option<String> {
    let limit = drift.limit?;
    let fall = drift.fall;
    let numbers = format!(
        "the squared misfit falls by {fall:.0}, errors make it fall by {limit:.0} once in a thousand times"
    );
    Some(if drift.differs() {
        format!("No moduli fit all of them: {numbers}.")
    } else {
        format!("They do not contradict each other: {numbers}.")
    })
}

/// Standard deviations of what errors leave that the line under a scale is wide to either side.
const TWICE: f64 = 2.0;
/// Clusters that the page lists.
const MOST_CLUSTERS: usize = 12;

fn cluster(cluster: &Cluster) -> minijinja::Value {
    context! {
        pose => cluster.pose,
        place => cluster.place,
        nodes => cluster.nodes.len(),
        mean => format!("{:+.1}", cluster.mean_mm).replace('-', "−"),
        z => format!("{:.1}", cluster.largest_z),
    }
}

fn heading(verdict: VerdictName, effect: Option<&Effect>, alike: usize) -> String {
    let title = effect.map(|effect| effect.title).unwrap_or_default();
    match verdict {
        VerdictName::NoDiscrepancy => "No significant discrepancy".into(),
        VerdictName::MeasurementArtifact => "A measurement error, not physics".into(),
        VerdictName::Named => format!("Missing: {title}"),
        VerdictName::Ambiguous => format!("Missing: {title}, or {} more alike", alike.max(2) - 1),
        VerdictName::Unknown => "A discrepancy that the library does not explain".into(),
        VerdictName::InsufficientData if effect.is_none() => "The data cannot tell".into(),
        VerdictName::InsufficientData => format!("Perhaps missing: {title}; the data cannot tell"),
    }
}

/// A capital at the beginning and a full stop at the end.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first: String = letters.next().map(|c| c.to_uppercase().collect()).unwrap_or_default();
    let stop = if text.ends_with('.') { "" } else { "." };
    format!("{first}{}{stop}", letters.as_str())
}

fn amplitude(candidate: &Candidate) -> String {
    let [value, deviation] = candidate.amplitude;
    let unit = Effect::named(&candidate.effect).map_or("", |effect| effect.amplitude.unit);
    let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
    format!("{} ± {}{unit}", significant(value), significant(deviation))
}

fn candidate(c: &Candidate) -> minijinja::Value {
    let [right, left] = c.moduli_kpa;
    context! {
        name => c.effect,
        amplitude => amplitude(c),
        meaning => Effect::named(&c.effect).map(|effect| effect.amplitude.meaning),
        gain => format!("{:.0}", c.gain),
        moduli => format!("{right:.3} / {left:.3}"),
        held_out => format!("{:.2} → {:.2}", c.held_out.before_mm, c.held_out.after_mm),
        z => format!("{:.1}", c.held_out.z),
        left => format!("{:.0} ({:.0})", c.left[0], c.left[1]),
    }
}

/// One row a pose; the reference pose has only what the studies say.
fn rows(gaps: &[PoseGap], added: Option<&Added>) -> Vec<minijinja::Value> {
    let studies = added.map(|added| &added.modified_hausdorff_mm);
    let known = |pose: &String| gaps.iter().any(|gap| gap.pose == *pose);
    let more = studies.into_iter().flat_map(|s| s.keys()).filter(|pose| !known(pose));
    let of_gaps = gaps.iter().map(|gap| (&gap.pose, Some(gap.rms_mm)));
    of_gaps
        .chain(more.map(|pose| (pose, None)))
        .map(|(pose, rms)| {
            let number = |at: usize| rms.map_or("–".into(), |rms| format!("{:.2}", rms[at]));
            // Only what lies above the floor can be closed.
            let closed = match rms {
                Some([before, after, floor]) if before > floor => {
                    let part = (before - after) / (before - floor);
                    if part < 1.0 { format!("{:.0} %", 100.0 * part) } else { "whole".into() }
                }
                _ => "–".into(),
            };
            let study = studies.and_then(|s| s.get(pose));
            let whole = |at: usize| study.map_or("–".into(), |pair| format!("{:.2}", pair[at]));
            context! {
                pose => pose,
                before => number(0),
                after => number(1),
                floor => number(2),
                closed => closed,
                hausdorff_before => whole(0),
                hausdorff_after => whole(1),
            }
        })
        .collect()
}

/// Distances without and with the effect, all on one scale, and what errors alone leave (mm); the held-out pose first.
fn distances(gaps: &[PoseGap], held_out: &str) -> Result<Vec<(f64, [SurfaceMap; 2])>, Failure> {
    let mut order: Vec<&PoseGap> = gaps.iter().collect();
    order.sort_by_key(|gap| gap.pose != held_out);
    let all: Vec<f64> =
        gaps.iter().flat_map(|gap| gap.before_mm.iter().chain(&gap.after_mm).copied()).collect();
    let range = Palette::Diverging.range(&all);
    let map = |gap: &PoseGap, when: &str, skin: &TriMesh, distances: &[f64]| {
        let mut values = vec![f64::NAN; skin.points.len()];
        for (&node, &mm) in gap.active.iter().zip(distances) {
            let place = values.get_mut(node as usize).ok_or_else(|| {
                Failure::BadInput(format!("discovery: {}: no node {node}", gap.pose))
            })?;
            *place = mm;
        }
        let note = if gap.pose == held_out { ", held out" } else { "" };
        Ok::<_, Failure>(SurfaceMap {
            title: format!("{}{note}: {when} the effect", gap.pose),
            caption: String::new(),
            surface: skin.clone(),
            values,
            label: "simulated outside (+) or inside (−) of measured (mm)".into(),
            palette: Palette::Diverging,
            range: Some(range),
            cameras: vec![Camera::Front],
        })
    };
    let pair = |gap: &PoseGap| {
        let [_, _, floor_mm] = gap.rms_mm;
        let without = map(gap, "without", &gap.skin[0], &gap.before_mm)?;
        Ok((floor_mm, [without, map(gap, "with", &gap.skin[1], &gap.after_mm)?]))
    };
    order.into_iter().map(pair).collect()
}

fn cell(cosine: f64) -> minijinja::Value {
    let [r, g, b] = Palette::Diverging.color(cosine, [-1.0, 1.0]);
    let ink = if cosine.abs() > 0.6 { "#fff" } else { "#22262a" };
    context! {
        text => format!("{cosine:.2}").replace('-', "−"),
        color => format!("rgb({r},{g},{b})"),
        ink => ink,
    }
}
