//! A record, the model before and after, and what errors leave.

use mammotwin_stages::force_curve::{
    evidence::{Evidence, Parameters},
    record::{Channel, Reading, Record},
    verdict::CurveVerdict,
};
use std::fmt::Write;

/// A force curve: record, model without and with an effect, two standard deviations around the latter.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Heading.
    pub title: String,
    /// Thickness (mm) and force (N) of the record, and whether the search saw it.
    pub record: Vec<(f64, f64, bool)>,
    /// Thickness (mm), force without and with the effect (N), and a standard deviation (N).
    pub model: Vec<[f64; 4]>,
    /// What the curve with an effect is called; none when there is no candidate.
    pub with: Option<String>,
    /// Whether what the search did not see is another record, whose thicknesses are off by a number of its own.
    pub another: bool,
}

/// Points of a drawn curve.
const POINTS: usize = 60;

impl Band {
    /// Of a verdict on a record.
    pub fn of(
        title: String,
        evidence: &Evidence,
        (record, another): (&Record, Option<&Record>),
        found: &CurveVerdict,
    ) -> Self {
        let seen = match another {
            Some(_) => record.clone(),
            None => record.rows(&record.split()[0]),
        };
        let is_seen = |r: &Reading| seen.0.contains(r);
        let more = another.iter().flat_map(|another| &another.0);
        let forces: Vec<&Reading> =
            record.0.iter().filter(|r| r.channel == Channel::Force).collect();
        let ends = [forces.first(), forces.last()].map(|r| r.map_or(0.0, |r| r.thickness_mm));
        let place = |n: usize| ends[0] + (ends[1] - ends[0]) * n as f64 / (POINTS - 1) as f64;
        let readings: Vec<Reading> = (0..POINTS)
            .map(|n| Reading { thickness_mm: place(n), channel: Channel::Force, value: 0.0 })
            .collect();
        let plain = Parameters {
            offset_mm: found.offset_mm,
            stiffness: found.stiffness.ln(),
            amplitude: 0.0,
        };
        let before = evidence.predicted(&readings, None, &plain);
        let best = found.candidates.first();
        let ladder =
            best.and_then(|b| evidence.ladders.iter().position(|l| l.effect.name == b.effect));
        let after = match best.zip(ladder) {
            Some((best, ladder)) => evidence.predicted(&readings, Some(ladder), &best.parameters()),
            None => before.clone(),
        };
        let row = |n: usize| {
            let size = evidence.error.of(Channel::Force, after[n]);
            [place(n), before[n], after[n], size]
        };
        Self {
            title,
            record: forces
                .iter()
                .map(|r| (r.thickness_mm, r.value, is_seen(r)))
                .chain(
                    more.filter(|r| r.channel == Channel::Force)
                        .map(|r| (r.thickness_mm, r.value, false)),
                )
                .collect(),
            model: (0..POINTS).map(row).collect(),
            with: best.map(|best| format!("with {} {:.3}", best.effect, best.amplitude[0])),
            another: another.is_some(),
        }
    }
}

/// The curves as CSV.
pub fn csv(figure: &Band) -> String {
    let mut text = String::from(
        "# Model with fitted offset and stiffness\nthickness_mm,without_n,with_n,error_n\n",
    );
    for [h, before, after, size] in &figure.model {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{h:.3},{before:.4},{after:.4},{size:.4}");
    }
    text
}

/// Size of the picture and its margins: left, top, right, bottom.
const SIZE: [f64; 2] = [780.0, 480.0];
const MARGIN: [f64; 4] = [70.0, 40.0, 20.0, 56.0];
const BEFORE: &str = "#c85000";
const AFTER: &str = "#005e9e";
const INK: &str = "#464646";

/// Round numbers from one to another, some six of them.
fn ticks(from: f64, to: f64) -> Vec<f64> {
    let rough = ((to - from) / 6.0).max(1e-9);
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|part| part * power).into_iter().find(|s| *s >= rough);
    let step = step.unwrap_or(rough);
    let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
    // So many decimals are none of the binary fraction's.
    (first..=last).map(|n| (n as f64 * step * 1e6).round() / 1e6).collect()
}

/// Draws it as SVG; thicknesses fall from left to right.
pub fn band(figure: &Band) -> String {
    let [width, height] = SIZE;
    let [left, top, right, bottom] = MARGIN;
    let thick: Vec<f64> = figure.model.iter().map(|row| row[0]).collect();
    let (from, to) = (thick.first().copied().unwrap_or(1.0), thick.last().copied().unwrap_or(0.0));
    let largest = figure.model.iter().map(|row| row[1].max(row[2] + 2.0 * row[3]));
    let most = largest.chain(figure.record.iter().map(|r| r.1)).fold(1e-9, f64::max) * 1.05;
    let x = |h: f64| left + (from - h) / (from - to).max(1e-9) * (width - left - right);
    let y = |f: f64| height - bottom - f / most * (height - top - bottom);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"14\" fill=\"{INK}\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"{left}\" y=\"24\" font-size=\"16\">{}</text>\n",
        mammotwin_stages::report::escaped(&figure.title)
    );
    // Writing to a string does not fail.
    for f in ticks(0.0, most) {
        let _ = writeln!(
            svg,
            "<line x1=\"{left}\" x2=\"{:.1}\" y1=\"{:.1}\" y2=\"{:.1}\" stroke=\"#e2e2de\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{f}</text>",
            width - right,
            y(f),
            y(f),
            left - 8.0,
            y(f) + 5.0
        );
    }
    for h in ticks(to, from) {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{h}</text>",
            x(h),
            height - bottom + 20.0
        );
    }
    let path = |points: &mut dyn Iterator<Item = (f64, f64)>| {
        points.fold(String::new(), |text, (h, f)| text + &format!("{:.1},{:.1} ", x(h), y(f)))
    };
    let mut upper = figure.model.iter().map(|r| (r[0], r[2] + 2.0 * r[3]));
    let mut lower = figure.model.iter().rev().map(|r| (r[0], (r[2] - 2.0 * r[3]).max(0.0)));
    let around = path(&mut upper) + &path(&mut lower);
    let line = |column: usize, color: &str, dash: &str| {
        let points = path(&mut figure.model.iter().map(|r| (r[0], r[column])));
        format!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2.5\"{dash}/>\n"
        )
    };
    let _ = writeln!(svg, "<polygon points=\"{around}\" fill=\"{AFTER}\" fill-opacity=\"0.16\"/>");
    svg += &line(1, BEFORE, " stroke-dasharray=\"7 4\"");
    svg += &line(2, AFTER, "");
    for (h, f, seen) in &figure.record {
        let fill = if *seen { INK } else { "white" };
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4.5\" fill=\"{fill}\" stroke=\"{INK}\" stroke-width=\"1.6\"/>",
            x(*h),
            y(*f)
        );
    }
    let with = figure.with.clone().unwrap_or_else(|| "model".into());
    let open = if figure.another { "another, its thickness off by itself" } else { "held out" };
    let legend = [
        (format!("record (filled: seen, open: {open})"), INK),
        ("model without an effect, offset and stiffness fitted".into(), BEFORE),
        (format!("{with}; ± 2 standard deviations of a force"), AFTER),
    ];
    for (n, (text, color)) in legend.iter().enumerate() {
        let down = top + 22.0 + 20.0 * n as f64;
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"16\" height=\"5\" fill=\"{color}\"/>\
             <text x=\"{:.1}\" y=\"{down:.1}\">{}</text>",
            left + 16.0,
            down - 7.0,
            left + 40.0,
            mammotwin_stages::report::escaped(text)
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">thickness (mm)</text>\
         <text transform=\"translate(20 {:.1}) rotate(-90)\" text-anchor=\"middle\">force (N)</text>",
        0.5 * (left + width - right),
        height - 12.0,
        0.5 * height
    );
    svg + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_lie_within() {
        assert_eq!(ticks(0.0, 174.0), [0.0, 50.0, 100.0, 150.0]);
        assert_eq!(ticks(46.0, 115.0), [60.0, 80.0, 100.0]);
        assert_eq!(ticks(0.0, 0.35), [0.0, 0.1, 0.2, 0.3]);
    }
}
