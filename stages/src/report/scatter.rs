//! Points in the plane of two quantities, told apart by colour, shape and filling.

use super::chart::{COLORS, Drawn, Hit, INK, axes, extents, with_hits};
use plotters::{coord::Shift, prelude::*};

/// Points over two quantities.
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    /// Heading.
    pub title: String,
    /// Axis with its unit: "thickness (mm)".
    pub x_label: String,
    /// Axis with its unit.
    pub y_label: String,
    /// Points of one colour each.
    pub groups: Vec<Group>,
    /// What the shapes mean, in the order of [`Dot::shape`]; empty when all points have one.
    pub shapes: Vec<String>,
    /// What full points are; the others are hollow.
    pub full: String,
}

/// Points of one colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Name in the legend.
    pub name: String,
    /// The points.
    pub dots: Vec<Dot>,
}

/// One point.
#[derive(Debug, Clone, PartialEq)]
pub struct Dot {
    /// Where it is.
    pub at: (f64, f64),
    /// Which shape.
    pub shape: usize,
    /// Whether it is drawn full.
    pub fill: Fill,
    /// Its name where it is pointed at.
    pub name: String,
}

/// How a point is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// Full.
    Full,
    /// Only its border.
    Hollow,
}

/// Twice the size in which it is shown.
const SIZE: (u32, u32) = (1160, 640);
/// Part of it that the legend has.
const LEGEND: u32 = 300;
const RADIUS: i32 = 11;

/// Draws the points; those that are not finite are left out.
pub fn scatter(scatter: &Scatter) -> String {
    let mut svg = String::new();
    let hits = draw(&mut svg, scatter).expect("drawing into memory does not fail");
    with_hits(svg, [&scatter.x_label, &scatter.y_label], &hits)
}

fn draw<'a>(svg: &'a mut String, scatter: &Scatter) -> Drawn<'a, Vec<Hit>> {
    let finite = |dot: &&Dot| dot.at.0.is_finite() && dot.at.1.is_finite();
    let dots = || scatter.groups.iter().flat_map(|group| &group.dots).filter(finite);
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let (plot, legend) = area.split_horizontally(SIZE.0 - LEGEND);
    let axes =
        axes(&plot, extents(dots().map(|dot| dot.at)), [&scatter.x_label, &scatter.y_label], 6)?;
    let mut hits = Vec::new();
    for (group, color) in scatter.groups.iter().zip(COLORS.iter().cycle()) {
        for dot in group.dots.iter().filter(finite) {
            let at = axes.backend_coord(&dot.at);
            mark(&area, at, dot.shape, dot.fill, color)?;
            hits.push(Hit { at, name: dot.name.clone(), point: dot.at });
        }
    }
    let mut line = 44;
    let mut entry = |name: &str, shape: usize, fill: Fill, color: &RGBColor| -> Drawn<'a> {
        mark(&legend, (24, line), shape, fill, color)?;
        legend.draw(&Text::new(
            name.to_owned(),
            (48, line - 12),
            ("sans-serif", 27).into_font().color(&INK),
        ))?;
        line += 38;
        Ok(())
    };
    for (group, color) in scatter.groups.iter().zip(COLORS.iter().cycle()) {
        entry(&group.name, 0, Fill::Full, color)?;
    }
    for (shape, name) in scatter.shapes.iter().enumerate() {
        entry(name, shape, Fill::Full, &INK)?;
    }
    if dots().any(|dot| dot.fill == Fill::Hollow) {
        entry(&scatter.full, 0, Fill::Full, &INK)?;
        entry("others", 0, Fill::Hollow, &INK)?;
    }
    area.present()?;
    Ok(hits)
}

/// One point of a shape at a pixel.
fn mark<'a>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    (x, y): (i32, i32),
    shape: usize,
    fill: Fill,
    color: &RGBColor,
) -> Drawn<'a> {
    let r = RADIUS;
    let corners: Vec<(i32, i32)> = match shape % 4 {
        0 => {
            area.draw(&Circle::new((x, y), r, WHITE.filled()))?;
            let style = match fill {
                Fill::Full => color.filled(),
                Fill::Hollow => color.stroke_width(4),
            };
            return area.draw(&Circle::new((x, y), r, style));
        }
        1 => vec![(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r)],
        2 => vec![(x, y - r - 2), (x + r + 2, y + r), (x - r - 2, y + r)],
        _ => vec![(x, y - r - 3), (x + r + 3, y), (x, y + r + 3), (x - r - 3, y)],
    };
    area.draw(&Polygon::new(
        corners.clone(),
        match fill {
            Fill::Full => color.filled(),
            Fill::Hollow => WHITE.filled(),
        },
    ))?;
    let border = corners.iter().chain(corners.first()).copied().collect::<Vec<_>>();
    area.draw(&PathElement::new(border, color.stroke_width(4)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finite_point_says_its_name() {
        let dot = |x: f64, fill| Dot { at: (x, 2.0), shape: 3, fill, name: "flex".into() };
        let dots = vec![dot(1.0, Fill::Full), dot(f64::NAN, Fill::Full), dot(3.0, Fill::Hollow)];
        let svg = scatter(&Scatter {
            title: String::new(),
            x_label: "thickness (mm)".into(),
            y_label: "pressure (kPa)".into(),
            groups: vec![Group { name: "flex".into(), dots }],
            shapes: vec!["20 mm".into(), "10 mm".into()],
            full: "on the front".into(),
        });
        assert_eq!(svg.matches("class=\"hit\"").count(), 2);
        assert!(svg.contains("<title>flex: pressure 2 kPa; thickness 3 mm</title>"), "{svg}");
        for word in ["20 mm", "10 mm", "on the front", "others"] {
            assert!(svg.contains(word), "{word}");
        }
    }
}
