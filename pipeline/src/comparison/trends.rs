//! Published compressions of women beside ours, without absolute forces: what both say of the form of the curve, and
//! of where the force rests.

use super::{Found, Way, same_body};
use crate::page::number;
use mammotwin_data::{
    mesh::Patch,
    study::{PaddleName, View},
    tables,
};
use mammotwin_stages::{
    compress::Compression,
    report::chart::{Axis, Chart, Line, Mark},
};

/// How far (in proportion) one of our numbers may be from a published one that has no interval. Chosen beforehand.
const WITHIN: f64 = 0.2;
/// By how much forces of two paddles may differ (in proportion) for their pressures to compare.
const SAME_FORCE: f64 = 0.1;
/// Largest force, over the one of the first published point, that is drawn.
const DRAWN: f64 = 3.0;
/// Forces (N) of the published points.
const FORCES_N: [f64; 2] = [100.0, 150.0];

/// A published number.
#[derive(Debug, Clone, Copy)]
struct Published {
    value: f64,
    women: &'static str,
    source: &'static str,
}

/// A published number by what it is; `view` and `paddle` are `any` where it is of all.
fn published(quantity: &str, view: &str, paddle: &str) -> Option<Published> {
    let fits = |row: &Vec<&'static str>| row[..3] == [quantity, view, paddle];
    let row = tables::rows(tables::COMPRESSION_PUBLISHED).find(fits)?;
    Some(Published { value: row[3].parse().ok()?, women: row[5], source: row[6] })
}

/// Thickness over uncompressed thickness at both forces.
fn ratios() -> Option<[Published; 2]> {
    let at = |force: &str| published(&format!("thickness_ratio_at_{force}_n"), "any", "any");
    Some([at("100")?, at("150")?])
}

/// Thickness (mm) of the breast before the plates touch it: the extent, along the compression, of the skin beyond the
/// plates' chest-wall edge and as wide as the plates, in the first state. `None` without any.
pub fn uncompressed_mm(compression: &Compression) -> Option<f64> {
    let first = compression.steps.first()?;
    let across = compression.outline_mm.iter().flatten().map(|corner| corner[0]);
    let [left, right] =
        across.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
    let between = |p: &[f32; 3]| {
        let [x, y] = [f64::from(p[0]), f64::from(p[1])];
        y >= 0.0 && (left > right || (left..=right).contains(&x))
    };
    let skin = compression.mesh.patch(Patch::Skin).iter().flatten();
    let here = skin.map(|n| &first.points[*n as usize]).filter(|p| between(p));
    let [low, high] = here.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
        [low.min(f64::from(p[2])), high.max(f64::from(p[2]))]
    });
    (high > low).then_some(high - low)
}

/// Thickness over uncompressed thickness against force (N), from contact on.
fn course(found: &Found) -> Option<Vec<(f64, f64)>> {
    let whole = uncompressed_mm(&found.compression)?;
    let curve = &found.compression.curve;
    let both = curve.force_n.iter().zip(&curve.thickness_mm);
    let states = both.map(|(force, mm)| (*force, mm / whole));
    let pressed = states.filter(|(force, ratio)| *force > 0.0 && *ratio < 1.0);
    Some(std::iter::once((0.0, 1.0)).chain(pressed).collect())
}

/// The force at which the thickness first has fallen to a part of the whole; `None` when it never does.
fn force_at(course: &[(f64, f64)], ratio: f64) -> Option<f64> {
    let ends = course.windows(2).find(|ends| ends[0].1 >= ratio && ends[1].1 < ratio)?;
    let [(f0, r0), (f1, r1)] = [ends[0], ends[1]];
    Some(f0 + (f1 - f0) * (r0 - ratio) / (r0 - r1))
}

/// The part of the whole to which a force first presses; `None` beyond the largest force.
fn ratio_at(course: &[(f64, f64)], force: f64) -> Option<f64> {
    let ends = course.windows(2).find(|ends| ends[0].0 <= force && ends[1].0 >= force)?;
    let [(f0, r0), (f1, r1)] = [ends[0], ends[1]];
    Some(if f1 > f0 { r0 + (r1 - r0) * (force - f0) / (f1 - f0) } else { r1 })
}

/// A published number beside ours.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// What is compared.
    pub what: String,
    /// The published number, in words.
    pub published: String,
    /// Of which way ours is.
    pub way: String,
    /// Ours, or why there is none.
    pub ours: String,
    /// Whether they agree; `None` where they cannot be compared.
    pub agrees: Option<bool>,
    /// Who published it, of how many women.
    pub source: String,
}

impl Agreement {
    fn new(what: &str, of: Published, published: String, way: &str) -> Self {
        Self {
            what: what.into(),
            published,
            way: way.into(),
            ours: String::new(),
            agrees: None,
            source: format!("{}, {} women", of.source, of.women),
        }
    }

    fn is(self, ours: String, agrees: Option<bool>) -> Self {
        Self { ours, agrees, ..self }
    }
}

fn is_near(ours: f64, published: f64) -> bool {
    (ours / published - 1.0).abs() <= WITHIN
}

/// The kind of plate in the published comparison that a paddle is like.
fn kind(paddle: PaddleName) -> Option<&'static str> {
    match paddle {
        PaddleName::Rigid => Some("rigid"),
        PaddleName::Flex => Some("flexible"),
        _ => None,
    }
}

/// What the breast bears beyond the juxtathoracic region at the end: its share of the paddle's force, and the mean
/// pressure there (kPa; NaN where the paddle touches nothing beyond).
fn on_the_breast(compression: &Compression, juxtathoracic_mm: f64) -> Option<[f64; 2]> {
    let axis = mammotwin_data::Vec3::z();
    let [mut all, mut beyond, mut area] = [0.0; 3];
    for one in compression.plates[1].touched() {
        let down = -one.force_mn.z;
        all += down;
        if compression.solution.points[one.node as usize].y >= juxtathoracic_mm {
            beyond += down;
            area += one.face_area(&axis);
        }
    }
    (all > 0.0).then(|| [beyond / all, beyond / area])
}

/// All published numbers that something of ours stands beside.
pub fn agreements(found: &[(&Way, &Found)], juxtathoracic_mm: f64) -> Vec<Agreement> {
    let mut all = Vec::new();
    for (way, one) in found {
        curve_agreements(&mut all, way, one);
    }
    for (way, one) in found {
        load_agreements(&mut all, way, one, juxtathoracic_mm);
    }
    flexible_agreements(&mut all, found, juxtathoracic_mm);
    all
}

fn curve_agreements(all: &mut Vec<Agreement>, way: &Way, found: &Found) {
    let (Some([first, second]), Some(course)) = (ratios(), course(found)) else { return };
    let largest = course.iter().map(|state| state.0).fold(0.0, f64::max);
    let fall = 1.0 - second.value / first.value;
    let more = FORCES_N[1] / FORCES_N[0];
    let what = format!(
        "fall of thickness from a force to {more} times that force, from h/h₀ = {} on",
        first.value
    );
    let row = Agreement::new(&what, first, format!("{:.1} %", 100.0 * fall), &way.label);
    all.push(match force_at(&course, first.value) {
        None => row.is(format!("h/h₀ {} is not reached", first.value), None),
        Some(force) => match ratio_at(&course, more * force) {
            None => row.is(format!("{} N are not reached", number(more * force)), None),
            Some(ratio) => {
                let ours = 1.0 - ratio / first.value;
                let text = format!("{:.1} %, from {} N on", 100.0 * ours, number(force));
                row.is(text, Some(is_near(ours, fall)))
            }
        },
    });
    for (of, force) in [first, second].into_iter().zip(FORCES_N) {
        let what = format!("h/h₀ at {force} N");
        let row = Agreement::new(&what, of, number(of.value), &way.label);
        all.push(match ratio_at(&course, force) {
            Some(ratio) => row.is(number(ratio), Some(is_near(ratio, of.value))),
            None => row.is(format!("not reached: {} N at most", number(largest)), None),
        });
    }
}

fn load_agreements(all: &mut Vec<Agreement>, way: &Way, found: &Found, juxtathoracic_mm: f64) {
    let quintile = |n: u8| published(&format!("pressure_quintile_{n}"), "any", "any");
    let least = published("force_low", "any", "any");
    if let (Some(low), Some(high), Some(least)) = (quintile(1), quintile(4), least) {
        let what = "force over contact area, middle three fifths of examinations";
        let text = format!("{} to {} kPa", low.value, high.value);
        let row = Agreement::new(what, low, text, &way.label);
        let [mean, force] = ["mean_pressure_kpa", "force_n"].map(|name| found.metric(name));
        let text = format!("{} kPa at {} N", number(mean), number(force));
        // Examinations are done with more; there is nothing to compare below.
        let comparable = force >= least.value;
        let agrees = (low.value..=high.value).contains(&mean);
        all.push(row.is(text, comparable.then_some(agrees)));
    }
    let share = kind(way.plan.paddle)
        .and_then(|kind| published("breast_force_share", view(way.plan.view), kind));
    let ours = on_the_breast(&found.compression, juxtathoracic_mm);
    if let (Some(share), Some([ours, _])) = (share, ours) {
        let what = "share of the force on the breast, not on the juxtathoracic region";
        let row = Agreement::new(what, share, number(share.value), &way.label);
        all.push(row.is(number(ours), Some(is_near(ours, share.value))));
    }
}

fn view(view: View) -> &'static str {
    match view {
        View::Cc => "cc",
        View::Mlo => "mlo",
    }
}

/// Flexible against rigid paddles at the same distance from the chest wall.
fn flexible_agreements(all: &mut Vec<Agreement>, found: &[(&Way, &Found)], juxtathoracic_mm: f64) {
    for (way, one) in found.iter().filter(|(way, _)| kind(way.plan.paddle) == Some("flexible")) {
        let mm = way.plan.chest_wall_distance_mm;
        let is_rigid = |other: &&(&Way, &Found)| {
            other.0.plan.paddle == PaddleName::Rigid
                && other.0.plan.chest_wall_distance_mm == mm
                && other.0.plan.view == way.plan.view
                && same_body(&other.1.compression, &one.compression)
        };
        let Some((_, rigid)) = found.iter().find(is_rigid) else { continue };
        let both = [rigid, one].map(|f| on_the_breast(&f.compression, juxtathoracic_mm));
        let [Some([share_r, kpa_r]), Some([share_f, kpa_f])] = both else { continue };
        let view = view(way.plan.view);
        let of = |quantity: &str, kind: &str| published(quantity, view, kind);
        let shares = ["rigid", "flexible"].map(|kind| of("breast_force_share", kind));
        if let [Some(r), Some(f)] = shares {
            let what = "share of the force on the breast: flexible over rigid";
            let row = Agreement::new(what, f, number(f.value / r.value), &way.label);
            let ours = share_f / share_r;
            all.push(if share_r > 0.0 {
                row.is(number(ours), Some(is_near(ours, f.value / r.value)))
            } else {
                row.is(
                    format!("nothing rests beyond {juxtathoracic_mm} mm under the rigid one"),
                    None,
                )
            });
        }
        let pressures = ["rigid", "flexible"].map(|kind| of("breast_mean_pressure", kind));
        let limits = ["difference_low", "difference_high"].map(|name| of(name, "flexible"));
        if let ([Some(r), Some(f)], [Some(low), Some(high)]) = (pressures, limits) {
            let [least, most] = [low, high].map(|limit| 1.0 + limit.value / r.value);
            let text = format!("{:.2} ({least:.2} to {most:.2})", f.value / r.value);
            let what = "mean pressure on the breast: flexible over rigid, at one force";
            let row = Agreement::new(what, f, text, &way.label);
            let forces = [rigid, one].map(|f| f.metric("force_n"));
            let ours = kpa_f / kpa_r;
            all.push(if !ours.is_finite() {
                row.is(format!("not both touch anything beyond {juxtathoracic_mm} mm"), None)
            } else if (forces[1] / forces[0] - 1.0).abs() <= SAME_FORCE {
                row.is(format!("{ours:.2}"), Some((least..=most).contains(&ours)))
            } else {
                let [a, b] = forces.map(number);
                row.is(format!("{ours:.2}, but forces are {b} and {a} N"), None)
            });
        }
    }
}

/// Thickness over the whole against force, both without unit; `None` when no way presses so far.
pub fn chart(found: &[(&Way, &Found)]) -> Option<Chart> {
    let [first, second] = ratios()?;
    let line = |(way, one): &(&Way, &Found)| {
        let course = course(one)?;
        let force = force_at(&course, first.value)?;
        let points = course.iter().map(|(f, ratio)| (f / force, *ratio));
        let points = points.take_while(|(f, _)| *f <= DRAWN).collect();
        Some(Line { name: way.label.clone(), points })
    };
    let lines: Vec<Line> = found.iter().filter_map(line).collect();
    let mark = |of: Published, n: usize| Mark {
        name: format!("published, {} N", FORCES_N[n]),
        point: (FORCES_N[n] / FORCES_N[0], of.value),
    };
    (!lines.is_empty()).then(|| Chart {
        title: "Thickness over uncompressed thickness, and published points".into(),
        caption: String::new(),
        x_label: format!("force over that at h/h₀ = {}", first.value),
        y_label: "h/h₀".into(),
        lines,
        marks: vec![mark(first, 0), mark(second, 1)],
        x_axis: Axis::Rising,
    })
}

/// What to know of these comparisons.
pub fn caption(found: &[(&Way, &Found)], juxtathoracic_mm: f64) -> String {
    let largest = found.iter().map(|(_, one)| one.compression.curve.force_n.iter().copied());
    let largest = largest.flatten().fold(0.0, f64::max);
    let reached = largest >= FORCES_N[0];
    let forces = if reached {
        String::new()
    } else {
        format!(
            " No compression here comes to {} N (at most {} N): absolute forces and pressures are not comparable with the \
             published ones, and are not compared; forms of curves and shares of force are.",
            FORCES_N[0],
            number(largest)
        )
    };
    format!(
        "h is the distance of the plates, h₀ the extent along the compression of the skin beyond the plates' chest-wall edge \
         before they touch it; how the published h₀ was measured, its abstract does not say. The curves are scaled in force \
         so that all pass the first published point; the second one is then a test.{forces} The juxtathoracic region \
         is {juxtathoracic_mm} mm wide here (comfort.juxtathoracic_mm); the width of the published one is not in its \
         abstract. Agreement: within {:.0} % of the published number, or in its 95 % interval where it has one; set \
         beforehand, nothing was fitted to it.",
        100.0 * WITHIN
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A course that falls through both published points in its own units of force, and one that is a line.
    #[test]
    fn forms_of_curves_are_compared_without_their_forces() {
        let course =
            |force: f64| vec![(0.0, 1.0), (force, 0.652), (1.5 * force, 0.578), (9.0 * force, 0.4)];
        for force in [0.01, 1.0, 300.0] {
            let course = course(force);
            let found = force_at(&course, 0.652).unwrap();
            assert!((found / force - 1.0).abs() < 1e-12);
            assert!((ratio_at(&course, 1.5 * found).unwrap() - 0.578).abs() < 1e-12);
            assert_eq!(ratio_at(&course, 10.0 * force), None);
        }
        let line = [(0.0, 1.0), (20.0, 0.0)];
        let force = force_at(&line, 0.652).unwrap();
        let fall = 1.0 - ratio_at(&line, 1.5 * force).unwrap() / 0.652;
        let published = 1.0 - 0.578 / 0.652;
        // 0.174 of 0.652: a straight line is no breast.
        assert!((fall - 0.174 / 0.652).abs() < 1e-12 && !is_near(fall, published));
        assert!(is_near(0.1, published) && !is_near(0.08, published));
        assert_eq!(force_at(&line[..1], 0.4), None);
    }

    /// The numbers of the abstracts, and nothing for what is not published.
    #[test]
    fn the_table_has_the_published_numbers() {
        let value = |quantity: &str, view: &str, paddle: &str| {
            published(quantity, view, paddle).map(|one| one.value)
        };
        assert_eq!(ratios().unwrap().map(|one| one.value), [0.652, 0.578]);
        assert_eq!(value("breast_force_share", "cc", "rigid"), Some(0.22));
        assert_eq!(value("breast_force_share", "mlo", "flexible"), Some(0.3));
        assert_eq!(value("breast_force_share", "cc", "soft"), None);
        for row in tables::rows(tables::COMPRESSION_PUBLISHED) {
            assert_eq!(row.len(), 8, "{row:?}");
            assert!(row[3].parse::<f64>().is_ok() && row[7].starts_with("https://"), "{row:?}");
        }
    }
}
