//! Compressions of one breast beside each other: what differs, as tables, charts and a page.

mod page;
mod table;
mod thesis;
mod trends;

pub use page::page;
pub use table::{comparisons, curves, stated, summary, time_courses, trends_csv};
pub use thesis::Study as ThesisStudy;
pub use trends::{Agreement, agreements};

use crate::graph::Squeezed;
use mammotwin_data::{
    Failure,
    metric::Metric,
    study::{CompressPlan, MammogramPlan},
};
use mammotwin_imaging::xray::{
    calibration::Unit,
    quality::{RoiQuality, quality},
    statistics::{mann_whitney, welch},
};
use mammotwin_stages::{
    clamp::ClampCourse,
    comfort::{Burden, Comparison, Weighted, compare, face_pressures},
    compress::Compression,
};

/// One way to compress, and what came of it.
#[derive(Debug)]
pub struct Way {
    /// Its label: `flex`, `elastic_40mm`.
    pub label: String,
    /// How it was compressed.
    pub plan: CompressPlan,
    /// Edge of its elements (mm).
    pub mesh_mm: f64,
    /// What was found, or why nothing was.
    pub found: Result<Found, String>,
}

/// What was found.
#[derive(Debug)]
pub struct Found {
    /// The compressed breast.
    pub compression: Compression,
    /// Comfort, image quality and dose.
    pub metrics: Vec<Metric>,
    /// Values of single regions of interest by what they are: `snr`, `sdnr_300um`.
    pub regions: Vec<(String, Vec<f64>)>,
    /// Closing, clamping and opening in time, where the study asks for it.
    pub course: Option<ClampCourse>,
    /// What standard deviations of comfort rest on, or why there are none, where the study asks for them.
    pub deviations: Option<String>,
}

impl Found {
    /// Loads what was made.
    pub fn load(made: &Squeezed, picture: Option<&MammogramPlan>) -> Result<Self, Failure> {
        let (mut metrics, mut course, mut deviations) = (Vec::new(), None, None);
        for part in &made.metrics {
            let part = part.load()?;
            metrics.extend(part.metrics);
            course = course.or(part.course);
            deviations = deviations.or(part.deviations);
        }
        let mut regions = Vec::new();
        if let (Some(plan), Some(phantom), Some(taken)) = (picture, &made.phantom, &made.mammograms)
        {
            let (phantom, taken) = (phantom.load()?, taken.load()?);
            let refuse = |cause: &dyn std::fmt::Display| {
                Failure::BadInput(format!("regions of interest: {cause}"))
            };
            let unit = Unit::of(plan).map_err(|cause| refuse(&cause))?;
            for (technique, picture) in taken.techniques.iter().zip(&taken.pictures) {
                let one =
                    phantom.with_diameter(technique.diameter_mm).map_err(|cause| refuse(&cause))?;
                let all = quality(picture, &one, &unit.geometry).map_err(|cause| refuse(&cause))?;
                let um = (1000.0 * technique.diameter_mm).round();
                let values = |of: fn(&RoiQuality) -> f64| all.iter().map(of).collect();
                let named = |name: &str, values| (format!("{name}_{um}um"), values);
                regions.push(named("snr", values(|r| r.printed.snr)));
                regions.push(named("sdnr", values(|r| r.printed.sdnr)));
                regions.push(named("snr_detrended", values(|r| r.detrended.snr)));
                regions.push(named("sdnr_detrended", values(|r| r.detrended.sdnr)));
            }
        }
        Ok(Self { compression: made.compression.load()?, metrics, regions, course, deviations })
    }

    /// One standard deviation of a metric; NaN where there is none.
    pub fn sd(&self, name: &str) -> f64 {
        let found = self.metrics.iter().find(|m| m.name == name);
        found.and_then(|m| m.sd).unwrap_or(f64::NAN)
    }

    /// A metric by its name; NaN when it was not measured.
    pub fn metric(&self, name: &str) -> f64 {
        self.metrics.iter().find(|m| m.name == name).map_or(f64::NAN, |m| m.value)
    }
}

/// What is said with standard deviations of comfort; empty where the study asks for none. `all` has the names of ways
/// with what theirs rest on, all of one person and fit.
pub fn deviations_stated<'a>(all: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let said = deviations_of_each(all);
    if said.is_empty() {
        return said;
    }
    format!(
        "{said} All ways share these errors: what two ways differ by is known better than either."
    )
}

/// The same of ways that share nothing.
pub fn deviations_of_each<'a>(all: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut by_text: Vec<(&str, Vec<&str>)> = Vec::new();
    for (way, said) in all {
        match by_text.iter_mut().find(|(known, _)| *known == said) {
            Some((_, ways)) => ways.push(way),
            None => by_text.push((said, vec![way])),
        }
    }
    if by_text.is_empty() {
        return String::new();
    }
    let one = |(said, ways): &(&str, Vec<&str>)| format!("{}: {said}", ways.join(", "));
    let said: Vec<String> = by_text.iter().map(one).collect();
    format!(
        "± one standard deviation of comfort, from what each of these changes when it is that much larger. {}.",
        said.join("; ")
    )
}

/// How one way differs from the first.
#[derive(Debug)]
pub struct Difference {
    /// What is compared, with its unit.
    pub what: String,
    /// The distributions.
    pub comparison: Comparison,
    /// Chance of such a difference between samples of one population, of means (Welch) and of ranks (Mann
    /// and Whitney); none for distributions over area or volume, whose parts are no independent samples.
    pub p: [Option<f64>; 2],
}

/// How `other` differs from `first`.
pub fn differences(first: &Found, other: &Found) -> Vec<Difference> {
    let mut all = Vec::new();
    let mut add = |what: &str, a: &[Weighted], b: &[Weighted], p: [Option<f64>; 2]| {
        if let Some(comparison) = compare(a, b) {
            all.push(Difference { what: what.into(), comparison, p });
        }
    };
    let pressures = [first, other].map(|found| face_pressures(&found.compression));
    add("contact pressure on the faces (kPa), by area", &pressures[0], &pressures[1], [None; 2]);
    let [a, b] = [first, other].map(|found| Burden::of(&found.compression));
    let by_volume = |burden: &Burden, values: &[f64]| burden.by_volume(values, None);
    let [one, two] = [by_volume(&a, &a.von_mises_kpa), by_volume(&b, &b.von_mises_kpa)];
    add("von Mises stress (kPa), by volume", &one, &two, [None; 2]);
    let [one, two] = [by_volume(&a, &a.stretch), by_volume(&b, &b.stretch)];
    add("largest stretch, by volume", &one, &two, [None; 2]);
    for (name, values) in &first.regions {
        let Some((_, others)) = other.regions.iter().find(|(other, _)| other == name) else {
            continue;
        };
        let even = |values: &[f64]| values.iter().map(|v| (*v, 1.0)).collect::<Vec<Weighted>>();
        let p = [welch(values, others), mann_whitney(values, others)].map(|test| Some(test?.p));
        add(&format!("{name}, by region of interest"), &even(values), &even(others), p);
    }
    all
}

/// Whether two compressions are of one breast in one mesh.
fn same_body(first: &Compression, other: &Compression) -> bool {
    first.side == other.side && first.mesh.tets == other.mesh.tets
}

/// How far (mm) tissue lies nearer to the chest wall than in the first way: the largest and the 95th
/// percentile of the nodes that lie between the plates then. `None` when they are of two bodies.
pub fn shift_to_wall(first: &Compression, other: &Compression) -> Option<[f64; 2]> {
    if !same_body(first, other) {
        return None;
    }
    let (a, b) = (&first.solution.points, &other.solution.points);
    // Both frames begin at the plates' edge, which may lie elsewhere on the chest.
    let edges = |c: &Compression| c.to_detector.inverse().point(&mammotwin_data::Vec3::zeros());
    let away = first.to_detector.inverse().direction(&mammotwin_data::Vec3::y());
    let moved = away.dot(&(edges(other) - edges(first)));
    let between = a.iter().zip(b).filter(|(p, _)| p.y > 0.0);
    let mut shifts: Vec<f64> = between.map(|(p, q)| p.y - q.y - moved).collect();
    shifts.sort_by(f64::total_cmp);
    let at = |share: f64| shifts.get((share * shifts.len() as f64) as usize).copied();
    Some([shifts.last().copied()?, at(0.95)?])
}
