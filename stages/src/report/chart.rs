//! Charts as SVG.

use super::html::{escaped, significant};
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
};

/// Quantities over one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Heading.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// Axis with its unit: "thickness (mm)".
    pub x_label: String,
    /// Axis with its unit.
    pub y_label: String,
    /// Lines, the first one strongest.
    pub lines: Vec<Line>,
    /// Single points with a name: a record, an optimum.
    pub marks: Vec<Mark>,
    /// Whether the x axis runs from high to low.
    pub x_axis: Axis,
}

/// Direction of the horizontal axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Axis {
    /// Small on the left.
    #[default]
    Rising,
    /// Large on the left: a thickness that shrinks as time goes on.
    Falling,
}

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Name in the legend.
    pub name: String,
    /// Points.
    pub points: Vec<(f64, f64)>,
}

/// One named point.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Name in the legend.
    pub name: String,
    /// Where it is.
    pub point: (f64, f64),
}

/// How often values occur.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Heading.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// Axis with its unit.
    pub x_label: String,
    /// The values.
    pub values: Vec<f64>,
    /// Ends of the axis; those of the values when absent.
    pub range: Option<[f64; 2]>,
    /// A value that should not be passed, drawn as a line.
    pub limit: Option<f64>,
}

/// Lines and marks of the same colour-blind safe set (Okabe and Ito 2008).
pub(super) const COLORS: [RGBColor; 8] = [
    RGBColor(0, 94, 158),
    RGBColor(200, 80, 0),
    RGBColor(0, 138, 100),
    RGBColor(178, 90, 140),
    RGBColor(90, 90, 90),
    RGBColor(86, 180, 233),
    RGBColor(150, 130, 0),
    RGBColor(110, 50, 20),
];
pub(super) const INK: RGBColor = RGBColor(70, 70, 70);
pub(super) const GRID: RGBColor = RGBColor(226, 226, 222);
/// Twice the size in which they are shown: plotters rounds to whole pixels.
const SIZE: (u32, u32) = (1040, 640);
const SMALL: (u32, u32) = (720, 500);

/// Draws a chart; points that are not finite are left out.
pub fn lines(chart: &Chart) -> String {
    let finite = |&(x, y): &(f64, f64)| x.is_finite() && y.is_finite();
    let all = chart.lines.iter().flat_map(|line| line.points.iter().copied());
    let all = all.chain(chart.marks.iter().map(|mark| mark.point)).filter(finite);
    let all: Vec<(f64, f64)> = all.collect();
    let Extents { x, y } = extents(all.into_iter());
    let x = match chart.x_axis {
        Axis::Rising => x,
        Axis::Falling => [x[1], x[0]],
    };
    let mut svg = String::new();
    let hits = draw_lines(&mut svg, chart, x, y).expect("drawing into memory does not fail");
    with_hits(svg, [&chart.x_label, &chart.y_label], &hits)
}

/// Ends of both axes.
pub(super) struct Extents {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

/// Ends of the axes around finite points.
pub(super) fn extents(points: impl Iterator<Item = (f64, f64)> + Clone) -> Extents {
    let (x, y) = (extent(points.clone().map(|p| p.0)), extent(points.map(|p| p.1)));
    // An axis that begins near zero begins at zero.
    let y = if y[0] >= 0.0 && y[0] < 0.5 * y[1] { [0.0, y[1] * 1.06] } else { padded(y, 0.06) };
    Extents { x: padded(x, 0.03), y }
}

/// A drawn point: its pixel, and what it says.
pub(super) struct Hit {
    pub at: (i32, i32),
    pub name: String,
    pub point: (f64, f64),
}

/// Adds invisible circles that say their values, for `page.js` and for readers of titles.
pub(super) fn with_hits(svg: String, [x_label, y_label]: [&str; 2], hits: &[Hit]) -> String {
    let value = |label: &str, value: f64| {
        let (name, unit) = label.split_once(" (").unwrap_or((label, ""));
        escaped(&format!("{name} {} {}", significant(value), unit.trim_end_matches(')')))
    };
    let circle = |hit: &Hit| {
        let Hit { at: (x, y), name, point } = hit;
        let (across, up) = (value(x_label, point.0), value(y_label, point.1));
        let text = format!("{}: {}; {}", escaped(name), up.trim_end(), across.trim_end());
        format!(
            "<circle class=\"hit\" fill=\"transparent\" cx=\"{x}\" cy=\"{y}\" r=\"10\"><title>{text}</title></circle>"
        )
    };
    let circles: String = hits.iter().map(circle).collect();
    svg.replacen("</svg>", &format!("{circles}</svg>"), 1)
}

pub(super) type Drawn<'a, T = ()> =
    Result<T, DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

/// Axes with their labels and lines, about so many numbers along x.
pub(super) fn axes<'a>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    Extents { x, y }: Extents,
    [x_label, y_label]: [&str; 2],
    numbers: usize,
) -> Drawn<'a, ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>> {
    let mut axes = ChartBuilder::on(area)
        .margin(24)
        .x_label_area_size(84)
        .y_label_area_size(120)
        .build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
    axes.configure_mesh()
        .bold_line_style(GRID.stroke_width(2))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.stroke_width(2))
        .label_style(("sans-serif", 27, &INK))
        .axis_desc_style(("sans-serif", 29, &INK))
        .x_labels(numbers)
        .y_labels(6)
        .x_desc(x_label)
        .y_desc(y_label)
        .x_label_formatter(&|v| number(*v))
        .y_label_formatter(&|v| number(*v))
        .draw()?;
    Ok(axes)
}

fn draw_lines<'a>(
    svg: &'a mut String,
    chart: &Chart,
    x: [f64; 2],
    y: [f64; 2],
) -> Drawn<'a, Vec<Hit>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let mut axes = axes(&area, Extents { x, y }, [&chart.x_label, &chart.y_label], 7)?;
    for (line, color) in chart.lines.iter().zip(COLORS.iter().cycle()) {
        let style = color.stroke_width(4);
        let points = line.points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite());
        axes.draw_series(LineSeries::new(points.clone(), style))?
            .label(&line.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 30, y)], style));
        axes.draw_series(points.map(|point| Circle::new(point, 6, color.filled())))?;
    }
    let colors = COLORS.iter().cycle().skip(chart.lines.len());
    for (mark, color) in chart.marks.iter().zip(colors) {
        let style = color.stroke_width(6);
        axes.draw_series([Cross::new(mark.point, 12, style)])?
            .label(&mark.name)
            .legend(move |(x, y)| Cross::new((x + 15, y), 9, style));
    }
    if chart.lines.len() + chart.marks.len() > 1 {
        axes.configure_series_labels()
            .position(emptiest_corner(chart, x, y))
            .background_style(WHITE.mix(0.85))
            .border_style(GRID)
            .label_font(("sans-serif", 27, &INK))
            .margin(16)
            .legend_area_size(40)
            .draw()?;
    }
    let lines = chart.lines.iter().flat_map(|line| line.points.iter().map(|&p| (&line.name, p)));
    let marks = chart.marks.iter().map(|mark| (&mark.name, mark.point));
    let finite = lines.chain(marks).filter(|(_, p)| p.0.is_finite() && p.1.is_finite());
    let hit = |(name, point): (&String, (f64, f64))| Hit {
        at: axes.backend_coord(&point),
        name: name.clone(),
        point,
    };
    let hits = finite.map(hit).collect();
    area.present()?;
    Ok(hits)
}

/// Part of the axes that a legend takes.
const LEGEND: (f64, f64) = (0.35, 0.4);

/// The corner where a legend hides the fewest points and pieces of lines.
fn emptiest_corner(chart: &Chart, x: [f64; 2], y: [f64; 2]) -> SeriesLabelPosition {
    let place = |p: &(f64, f64)| ((p.0 - x[0]) / (x[1] - x[0]), (p.1 - y[0]) / (y[1] - y[0]));
    let mut places: Vec<(f64, f64)> = chart.marks.iter().map(|m| place(&m.point)).collect();
    for line in &chart.lines {
        places.extend(line.points.iter().map(place));
        for pair in line.points.windows(2) {
            let (a, b) = (place(&pair[0]), place(&pair[1]));
            let between = |part: f64| (a.0 + part * (b.0 - a.0), a.1 + part * (b.1 - a.1));
            places.extend([0.25, 0.5, 0.75].map(between));
        }
    }
    let corners = [
        (SeriesLabelPosition::UpperLeft, 0.0, 1.0),
        (SeriesLabelPosition::UpperRight, 1.0, 1.0),
        (SeriesLabelPosition::LowerLeft, 0.0, 0.0),
        (SeriesLabelPosition::LowerRight, 1.0, 0.0),
    ];
    let hidden = |across: f64, up: f64| {
        let inside =
            |p: &&(f64, f64)| (p.0 - across).abs() < LEGEND.0 && (p.1 - up).abs() < LEGEND.1;
        places.iter().filter(inside).count()
    };
    let best = corners.into_iter().min_by_key(|&(_, across, up)| hidden(across, up));
    best.map_or(SeriesLabelPosition::UpperLeft, |(corner, ..)| corner)
}

/// Draws a histogram of 30 bars.
pub fn histogram(histogram: &Histogram) -> String {
    let bars = 30;
    let finite = || histogram.values.iter().copied().filter(|v| v.is_finite());
    let [low, high] = histogram.range.unwrap_or_else(|| padded(extent(finite()), 0.02));
    let width = (high - low) / bars as f64;
    let mut counts = vec![0u32; bars];
    for value in finite() {
        counts[(((value - low) / width).max(0.0) as usize).min(bars - 1)] += 1;
    }
    let mut svg = String::new();
    draw_bars(&mut svg, histogram, [low, width], &counts)
        .expect("drawing into memory does not fail");
    svg
}

fn draw_bars<'a>(
    svg: &'a mut String,
    histogram: &Histogram,
    [low, width]: [f64; 2],
    counts: &[u32],
) -> Drawn<'a> {
    let high = low + width * counts.len() as f64;
    let most = f64::from(counts.iter().copied().max().unwrap_or(1).max(1)) * 1.06;
    let area = SVGBackend::with_string(svg, SMALL).into_drawing_area();
    let mut axes = ChartBuilder::on(&area)
        .margin(20)
        .x_label_area_size(84)
        .y_label_area_size(120)
        .build_cartesian_2d(low..high, 0.0..most)?;
    axes.configure_mesh()
        .disable_x_mesh()
        .bold_line_style(GRID.stroke_width(2))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.stroke_width(2))
        .label_style(("sans-serif", 27, &INK))
        .axis_desc_style(("sans-serif", 29, &INK))
        .x_labels(6)
        .y_labels(5)
        .x_desc(&histogram.x_label)
        .y_desc("count")
        .x_label_formatter(&|v| number(*v))
        .y_label_formatter(&|v| number(*v))
        .draw()?;
    axes.draw_series(counts.iter().enumerate().filter(|(_, count)| **count > 0).map(
        |(n, &count)| {
            let left = low + width * n as f64;
            Rectangle::new(
                [(left + 0.06 * width, 0.0), (left + 0.94 * width, f64::from(count))],
                COLORS[0].filled(),
            )
        },
    ))?;
    if let Some(limit) = histogram.limit.filter(|limit| (low..=high).contains(limit)) {
        let style = COLORS[1].stroke_width(4);
        axes.draw_series([PathElement::new([(limit, 0.0), (limit, most)], style)])?;
    }
    area.present()
}

/// A number as short as it can be.
pub(super) fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    // No minus before a zero.
    format!("{}", rounded + 0.0)
}

fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.min(value), high.max(value)]
    });
    if low <= high { [low, high] } else { [0.0, 1.0] }
}

fn padded([low, high]: [f64; 2], part: f64) -> [f64; 2] {
    let more = if high > low { (high - low) * part } else { low.abs().max(1.0) * 0.5 };
    [low - more, high + more]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_say_their_values() {
        let chart = Chart {
            title: String::new(),
            caption: String::new(),
            x_label: "thickness (mm)".into(),
            y_label: "force (N)".into(),
            lines: vec![Line {
                name: "a<b".into(),
                points: vec![(50.0, 22.4312), (f64::NAN, 1.0)],
            }],
            marks: vec![],
            x_axis: Axis::Falling,
        };
        let svg = lines(&chart);
        assert_eq!(svg.matches("class=\"hit\"").count(), 1);
        assert!(svg.contains("<title>a&lt;b: force 22.4 N; thickness 50 mm</title>"), "{svg}");
    }

    #[test]
    fn charts_of_nothing_and_of_nan_are_drawn() {
        let chart = Chart {
            title: String::new(),
            caption: String::new(),
            x_label: "x".into(),
            y_label: "y".into(),
            lines: vec![Line { name: "a".into(), points: vec![(f64::NAN, 1.0)] }],
            marks: vec![],
            x_axis: Axis::Falling,
        };
        assert!(lines(&chart).ends_with("</svg>\n"));
        let bars = Histogram {
            title: String::new(),
            caption: String::new(),
            x_label: "x".into(),
            values: vec![3.0; 7],
            range: None,
            limit: Some(4.0),
        };
        // One bar of seven.
        assert!(histogram(&bars).matches("fill=\"#005E9E\"").count() == 1);
    }
}
