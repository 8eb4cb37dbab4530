//! Numbers over two axes as panels of coloured cells, as SVG.

use super::{chart::number, palette::Palette};
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

/// Panels that share their axes and their colours.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Axis with its unit.
    pub x_label: String,
    /// Axis with its unit.
    pub y_label: String,
    /// Columns of every panel.
    pub x: Vec<f64>,
    /// Rows of every panel, the lowest first.
    pub y: Vec<f64>,
    /// Panels, left to right, top to bottom.
    pub panels: Vec<HeatPanel>,
    /// Panels beside each other.
    pub across: usize,
}

/// One panel.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatPanel {
    /// Heading.
    pub title: String,
    /// Row after row; NaN where there is no number.
    pub values: Vec<f64>,
    /// Place of the value that is framed.
    pub framed: Option<usize>,
}

impl HeatPanel {
    /// A panel whose smallest value is framed.
    pub fn least(title: String, values: Vec<f64>) -> Self {
        Self::framed(title, values, |value| value)
    }

    /// A panel whose largest value is framed.
    pub fn most(title: String, values: Vec<f64>) -> Self {
        Self::framed(title, values, |value| -value)
    }

    fn framed(title: String, values: Vec<f64>, cost: fn(f64) -> f64) -> Self {
        let finite = values.iter().enumerate().filter(|(_, value)| value.is_finite());
        let framed = finite.min_by(|a, b| cost(*a.1).total_cmp(&cost(*b.1)));
        Self { framed: framed.map(|(place, _)| place), title, values }
    }
}

const INK: RGBColor = RGBColor(60, 60, 60);
/// Size of a cell, and what is around a panel's cells: left, top, right, bottom.
const CELL: (i32, i32) = (62, 42);
const AROUND: [i32; 4] = [92, 48, 24, 84];

type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

/// Draws all panels with one scale of colours.
pub fn heat(map: &HeatMap) -> String {
    let mut svg = String::new();
    draw(&mut svg, map).expect("drawing into memory does not fail");
    svg
}

fn draw<'a>(svg: &'a mut String, map: &HeatMap) -> Drawn<'a> {
    let across = map.across.clamp(1, map.panels.len().max(1));
    let down = map.panels.len().div_ceil(across).max(1);
    let [left, top, right, bottom] = AROUND;
    let width = left + right + CELL.0 * map.x.len() as i32;
    let height = top + bottom + CELL.1 * map.y.len() as i32;
    let size = ((width * across as i32) as u32, (height * down as i32) as u32);
    let area = SVGBackend::with_string(svg, size).into_drawing_area();
    let all: Vec<f64> = map.panels.iter().flat_map(|panel| panel.values.clone()).collect();
    let range = Palette::Sequential.range(&all);
    for (panel, part) in map.panels.iter().zip(area.split_evenly((down, across))) {
        draw_panel(&part, map, panel, range)?;
    }
    area.present()
}

fn draw_panel<'a>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    map: &HeatMap,
    panel: &HeatPanel,
    range: [f64; 2],
) -> Drawn<'a> {
    let [left, top, ..] = AROUND;
    let (columns, rows) = (map.x.len(), map.y.len());
    let font = |size: i32| ("sans-serif", size).into_font().color(&INK);
    let at = |anchor: (HPos, VPos), size: i32| font(size).pos(Pos::new(anchor.0, anchor.1));
    let corner = |column: usize, row: usize| {
        (left + CELL.0 * column as i32, top + CELL.1 * (rows - 1 - row) as i32)
    };
    let middle = |(x, y): (i32, i32)| (x + CELL.0 / 2, y + CELL.1 / 2);
    let center = (HPos::Center, VPos::Center);
    area.draw_text(&panel.title, &at((HPos::Left, VPos::Center), 20), (left, top / 2))?;
    for row in 0..rows {
        for column in 0..columns {
            let Some(&value) = panel.values.get(row * columns + column) else { continue };
            let from = corner(column, row);
            let to = (from.0 + CELL.0, from.1 + CELL.1);
            let [r, g, b] = Palette::Sequential.color(value, range);
            let color = RGBColor(r, g, b);
            area.draw(&Rectangle::new([from, to], color.filled()))?;
            let bright = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
            let ink = if bright > 130.0 { BLACK } else { WHITE };
            let text = if value.is_finite() { format!("{value:.2}") } else { "–".into() };
            let style =
                ("sans-serif", 18).into_font().color(&ink).pos(Pos::new(center.0, center.1));
            area.draw_text(&text, &style, middle(from))?;
        }
    }
    if let Some(place) = panel.framed.filter(|_| columns > 0) {
        let (x, y) = corner(place % columns, place / columns);
        let frame = [(x + 2, y + 2), (x + CELL.0 - 2, y + CELL.1 - 2)];
        area.draw(&Rectangle::new(frame, RED.stroke_width(4)))?;
    }
    for (column, x) in map.x.iter().enumerate() {
        let (x_at, _) = middle(corner(column, 0));
        let y_at = top + CELL.1 * rows as i32 + 16;
        area.draw_text(&number(*x), &at(center, 18), (x_at, y_at))?;
    }
    for (row, y) in map.y.iter().enumerate() {
        let (_, y_at) = middle(corner(0, row));
        area.draw_text(&number(*y), &at((HPos::Right, VPos::Center), 18), (left - 10, y_at))?;
    }
    let below = top + CELL.1 * rows as i32 + 46;
    area.draw_text(&map.x_label, &at(center, 19), (left + CELL.0 * columns as i32 / 2, below))?;
    let upwards = at(center, 19).transform(FontTransform::Rotate270);
    area.draw_text(&map.y_label, &upwards, (20, top + CELL.1 * rows as i32 / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_says_its_number_and_the_smallest_is_framed() {
        let map = HeatMap {
            x_label: "breast (kPa)".into(),
            y_label: "skin (kPa)".into(),
            x: vec![0.2, 0.3, 0.5],
            y: vec![2.0, 4.0],
            panels: vec![HeatPanel::least(
                "fascia 120 kPa".into(),
                vec![3.0, 1.25, 2.0, 4.0, f64::NAN, 5.0],
            )],
            across: 3,
        };
        let svg = heat(&map);
        for text in ["1.25", "5.00", "–", "fascia 120 kPa", "breast (kPa)", "skin (kPa)"] {
            assert!(svg.contains(text), "{text}");
        }
        assert_eq!(svg.matches("#FF0000").count(), 1);
        assert_eq!(map.panels[0].framed, Some(1));
        assert_eq!(HeatPanel::most(String::new(), map.panels[0].values.clone()).framed, Some(5));
    }
}
