//! Puts the parts of the report into the page.

use super::{
    Fact, FitReport, MammogramReport, ReportInput, SurfaceMap,
    chart::{self, Chart, Histogram},
    palette::Palette,
    raster::Raster,
    scene::Scene,
    slice::{OUTLINES, OverlayPicture, Plane, SlicePicture},
    surface,
};
use mammotwin_data::{Failure, metric::Metric};
use minijinja::{Environment, context};
use serde::Serialize;

/// Width (pixels) that all views of a surface fill together.
const VIEWS_WIDTH: f64 = 920.0;
/// Length of the bar in pictures of surfaces (mm).
const BAR_MM: f64 = 50.0;

/// The report as one HTML page without any outside resource.
///
/// # Errors
/// [`Failure::BadInput`] when a surface map does not have one value for each vertex.
pub fn render(input: &ReportInput) -> Result<String, Failure> {
    let mut poses = Vec::new();
    for pose in &input.poses {
        let registration = match &pose.registration {
            None => None,
            Some(registration) => Some(context! {
                facts => registration.facts,
                overlays => registration.overlays.iter().map(fade).collect::<Vec<_>>(),
                maps => maps(registration.chest_wall.as_slice())?,
            }),
        };
        poses.push(context! {
            name => pose.name,
            facts => pose.facts,
            outlines => pose.outlines.iter().map(cut).collect::<Vec<_>>(),
            skin => maps(pose.skin.as_slice())?,
            registration => registration,
        });
    }
    let mesh = input.mesh.as_ref().map(|mesh| {
        let histograms: Vec<_> = mesh.histograms.iter().map(histogram).collect();
        context! { facts => mesh.facts, histograms => histograms }
    });
    let compression = match &input.compression {
        None => None,
        Some(part) => Some(fit(&part.facts, &part.curves, &part.maps, &[])?),
    };
    let fitted = |part: &FitReport| fit(&part.facts, &part.charts, &part.maps, &part.notes);
    let mut validations = Vec::new();
    for (pose, part) in &input.validations {
        validations.push(context! { pose => pose, part => fitted(part)? });
    }
    let page = context! {
        subject => input.subject,
        summary => input.summary,
        facts => input.facts,
        warnings => input.warnings,
        legend => legend(),
        poses => poses,
        mesh => mesh,
        calibration => input.calibration.as_ref().map(fitted).transpose()?,
        validations => validations,
        compression => compression,
        mammograms => input.mammograms.iter().map(mammogram).collect::<Vec<_>>(),
        metrics => input.metrics.iter().map(Row::new).collect::<Vec<_>>(),
        methods => input.methods,
        provenance => input.provenance,
        scenes => scenes(&input.scenes)?,
        viewer_js => include_str!("viewer.js"),
        page_js => include_str!("page.js"),
        style => include_str!("style.css"),
    };
    let mut environment = Environment::new();
    environment
        .add_template("report.html", include_str!("template.html"))
        .and_then(|()| environment.get_template("report.html")?.render(page))
        .map_err(|cause| Failure::BadInput(format!("report: {cause:#}")))
}

/// Scenes as JSON that may stand in a script element; `None` when there are none.
fn scenes(scenes: &[Scene]) -> Result<Option<String>, Failure> {
    if scenes.is_empty() {
        return Ok(None);
    }
    let packed: Vec<_> = scenes.iter().map(Scene::packed).collect::<Result<_, _>>()?;
    Ok(Some(serde_json::Value::from(packed).to_string().replace('<', "\\u003c")))
}

/// Something to look at; `body` is HTML.
#[derive(Serialize)]
pub(super) struct Figure<'a> {
    title: &'a str,
    caption: &'a str,
    body: String,
}

fn fit(
    facts: &[Fact],
    charts: &[Chart],
    surfaces: &[SurfaceMap],
    notes: &[String],
) -> Result<minijinja::Value, Failure> {
    let charts: Vec<_> = charts
        .iter()
        .map(|chart| Figure {
            title: &chart.title,
            caption: &chart.caption,
            body: chart::lines(chart),
        })
        .collect();
    Ok(context! { facts => facts, charts => charts, maps => maps(surfaces)?, notes => notes })
}

fn histogram(histogram: &Histogram) -> Figure<'_> {
    let Histogram { title, caption, .. } = histogram;
    Figure { title, caption, body: chart::histogram(histogram) }
}

fn maps(surfaces: &[SurfaceMap]) -> Result<Vec<Figure<'_>>, Failure> {
    surfaces.iter().map(map).collect()
}

/// Views of a surface and their scale.
fn map(map: &SurfaceMap) -> Result<Figure<'_>, Failure> {
    map_over(map, None)
}

/// The same; a line under the scale is as wide as what errors alone leave, from minus to plus `floor`.
pub(super) fn map_over(map: &SurfaceMap, floor: Option<f64>) -> Result<Figure<'_>, Failure> {
    let SurfaceMap { title, caption, surface, values, palette, .. } = map;
    if values.len() != surface.points.len() {
        let (values, points) = (values.len(), surface.points.len());
        let why = format!("report: {title}: {values} values on a surface of {points} vertices");
        return Err(Failure::BadInput(why));
    }
    let used: Vec<f64> = surface.triangles.iter().flatten().map(|&n| values[n as usize]).collect();
    let range = map.range.unwrap_or_else(|| palette.range(&used));
    let width_mm: f64 = map.cameras.iter().map(|camera| camera.width_mm(surface)).sum();
    let mm_per_pixel = (width_mm / VIEWS_WIDTH).clamp(0.2, 1.0);
    let view = |&camera: &surface::Camera| {
        let picture =
            surface::cut(surface, values, (*palette, range), camera, mm_per_pixel, BAR_MM);
        let Raster { width, height, .. } = picture.picture;
        let image = element(&picture.data_uri(), [width, height], camera.title());
        let ([left, right], title) = (camera.marks(), camera.title());
        format!(
            "<div class=\"view\">{image}<small><b>{left}</b> {title} <b>{right}</b></small></div>"
        )
    };
    let views: String = map.cameras.iter().map(view).collect();
    let scale = scale(*palette, range, &format!("{}; bar: {BAR_MM} mm", map.label), floor);
    let body = format!("<div class=\"views\">{views}</div>{scale}");
    Ok(Figure { title, caption, body })
}

/// A colour scale with five numbers.
fn scale(palette: Palette, [low, high]: [f64; 2], label: &str, floor: Option<f64>) -> String {
    let colors: Vec<String> =
        palette.stops().iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let ticks: String = (0..5)
        .map(|n| low + (high - low) * f64::from(n) / 4.0)
        .map(|value| format!("<span>{}</span>", significant(value)))
        .collect();
    let percent = |value: f64| 100.0 * ((value - low) / (high - low)).clamp(0.0, 1.0);
    let line = floor.filter(|_| high > low).map_or(String::new(), |floor| {
        let (from, to) = (percent(-floor), percent(floor));
        format!(
            "<div class=\"floor\" style=\"margin-left:{from:.1}%;width:{:.1}%\"></div>",
            to - from
        )
    });
    format!(
        "<div class=\"scale\"><div class=\"ramp\" style=\"background:linear-gradient(to right,{})\">\
         </div>{line}<div class=\"ticks\">{ticks}</div><small>{}</small></div>",
        colors.join(","),
        escaped(label)
    )
}

fn cut(cut: &SlicePicture) -> Figure<'_> {
    let body = framed(&image(&cut.picture, &cut.title), cut.plane);
    Figure { title: &cut.title, caption: "", body }
}

/// Three pictures on top of each other; the style sheet shows one, or fades between two.
fn fade(overlay: &OverlayPicture) -> Figure<'_> {
    let layer = |class: &str, picture: &Raster| {
        image(picture, &overlay.title).replacen("<img", &format!("<img class=\"{class}\""), 1)
    };
    let images = [
        layer("board", &overlay.checkerboard),
        layer("fixed", &overlay.fixed),
        layer("moved", &overlay.moved),
    ];
    let body = framed(&images.concat(), overlay.plane).replacen(
        "class=\"cut\"",
        "class=\"cut fade\" tabindex=\"0\"",
        1,
    );
    Figure { title: &overlay.title, caption: "", body }
}

fn framed(images: &str, plane: Plane) -> String {
    let marks: String = ["left", "right", "top", "bottom"]
        .iter()
        .zip(plane.marks())
        .map(|(side, letter)| format!("<b class=\"mark {side}\">{letter}</b>"))
        .collect();
    format!("<div class=\"cut\">{images}{marks}</div>")
}

fn mammogram(report: &MammogramReport) -> minijinja::Value {
    context! {
        title => report.title,
        caption => report.caption,
        mark => report.mark,
        picture => image(&report.picture, &report.title),
        detail => report.detail.as_ref().map(|detail| image(detail, "detail")),
    }
}

fn image(picture: &Raster, text: &str) -> String {
    element(&picture.data_uri(), [picture.width, picture.height], text)
}

fn element(address: &str, [width, height]: [usize; 2], text: &str) -> String {
    let text = escaped(text);
    format!("<img src=\"{address}\" width=\"{width}\" height=\"{height}\" alt=\"{text}\">")
}

fn legend() -> Vec<(String, &'static str)> {
    OUTLINES.iter().map(|(name, [r, g, b])| (format!("rgb({r},{g},{b})"), *name)).collect()
}

/// Text as it is written in HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A metric as text.
#[derive(Serialize)]
struct Row<'a> {
    name: &'a str,
    long_name: &'a str,
    unit: String,
    value: String,
    thesis: String,
    source: &'a str,
}

impl<'a> Row<'a> {
    fn new(metric: &'a Metric) -> Self {
        let Metric { name, long_name, source, .. } = metric;
        let unit = metric.unit.replace("m2", "m²");
        let thesis = metric.thesis.map_or_else(|| "–".into(), significant);
        let value = match metric.sd {
            Some(sd) => format!("{} ± {}", significant(metric.value), significant(sd)),
            None => significant(metric.value),
        };
        Self { name, long_name, unit, value, thesis, source }
    }
}

/// Three significant digits, and no more zeros than needed.
pub(super) fn significant(value: f64) -> String {
    if !value.is_finite() {
        return "not finite".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let exponent = value.abs().log10().floor() as i32;
    if !(-4..7).contains(&exponent) {
        let text = format!("{value:.2e}");
        let (number, power) = text.split_once('e').unwrap_or((&text, "0"));
        return format!(
            "{} · 10{}",
            number.replace('-', "−"),
            power.chars().map(raised).collect::<String>()
        );
    }
    let digits = (2 - exponent).max(0) as usize;
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    };
    text.replace('-', "−")
}

fn raised(digit: char) -> char {
    match digit {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0'..='9' => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{CompressionReport, chart::Axis, surface::Camera};
    use mammotwin_data::{Vec3, surface::TriMesh};

    #[test]
    fn numbers_have_three_significant_digits() {
        let pairs = [
            (22.4312, "22.4"),
            (0.31, "0.31"),
            (-1.0, "−1"),
            (18402.0, "18402"),
            (99.96, "100"),
            (3.2e-9, "3.20 · 10⁻⁹"),
            (0.0, "0"),
            (f64::NAN, "not finite"),
        ];
        for (value, text) in pairs {
            assert_eq!(significant(value), text);
        }
    }

    fn triangle() -> SurfaceMap {
        SurfaceMap {
            title: "Pressure <b>".into(),
            caption: String::new(),
            surface: TriMesh {
                points: vec![Vec3::zeros(), Vec3::x() * 50.0, Vec3::z() * 50.0],
                triangles: vec![[0, 1, 2]],
            },
            values: vec![0.0, 1.0, f64::NAN],
            label: "pressure (kPa)".into(),
            palette: Palette::Sequential,
            range: None,
            cameras: vec![Camera::Front, Camera::Left],
        }
    }

    #[test]
    fn a_page_has_no_outside_resource_and_escapes_text() {
        let curve = Chart {
            title: "Force".into(),
            caption: String::new(),
            x_label: "thickness (mm)".into(),
            y_label: "force (N)".into(),
            lines: vec![],
            marks: vec![],
            x_axis: Axis::Falling,
        };
        let input = ReportInput {
            subject: "<script>alert(1)</script>".into(),
            compression: Some(CompressionReport {
                facts: vec![Fact::new("Force", "22 N")],
                curves: vec![curve],
                maps: vec![triangle()],
            }),
            ..ReportInput::default()
        };
        let page = render(&input).unwrap();
        assert!(page.contains("default-src 'none'"), "the browser itself refuses requests");
        assert!(!page.contains("<script src") && !page.contains("<link"));
        assert!(page.contains("Pressure &lt;b&gt;"));
        // Addresses: data, anchors, and the name of the SVG language.
        let known = ["://www.w3.org", "-equiv=\"Content-Security-Policy\""];
        let outside = page.split("http").skip(1);
        let outside = outside.filter(|rest| !known.iter().any(|word| rest.starts_with(word)));
        assert_eq!(outside.count(), 0);
        assert_eq!(page.matches("data:image/png;base64,").count(), 2);
        assert!(!page.contains("id=\"calibration\""), "parts that are missing leave no heading");
        assert_eq!(page, render(&input).unwrap());
    }

    #[test]
    fn a_map_with_too_few_values_is_refused() {
        let map = SurfaceMap { values: vec![1.0], ..triangle() };
        let compression = CompressionReport { maps: vec![map], ..CompressionReport::default() };
        let input = ReportInput { compression: Some(compression), ..ReportInput::default() };
        let error = render(&input).unwrap_err().to_string();
        assert!(error.contains("1 values on a surface of 3 vertices"), "{error}");
    }
}
