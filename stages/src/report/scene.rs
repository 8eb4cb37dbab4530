//! Surfaces with numbers on them, to be turned about in the page; see `viewer.js`.

use super::palette::Palette;
use base64::{Engine, engine::general_purpose::STANDARD};
use mammotwin_data::{Failure, Vec3, surface::TriMesh};
use serde::Serialize;
use serde_json::{Value, json};

/// One body in one or more states.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// "Compression".
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// Triangles of all states; vertices without triangles cost space only.
    pub triangles: Vec<[u32; 3]>,
    /// What can be shown on it.
    pub quantities: Vec<Quantity>,
    /// The states, in the order of the slider.
    pub states: Vec<SceneState>,
    /// What the slider moves through: "load step", "moduli".
    pub along: String,
    /// Words at the ends of the axes x, y, z.
    pub axes: [&'static str; 3],
    /// Buttons.
    pub views: Vec<View>,
}

/// What can be shown on a surface.
#[derive(Debug, Clone)]
pub struct Quantity {
    /// "von Mises stress".
    pub name: String,
    /// "kPa".
    pub unit: &'static str,
    /// Colours.
    pub palette: Palette,
    /// Ends of the scale; chosen from the values of all states when absent.
    pub range: Option<[f64; 2]>,
    /// What grey means: "not touched".
    pub none: &'static str,
}

/// One state of a body.
#[derive(Debug, Clone, Default)]
pub struct SceneState {
    /// "52.3 mm, 41.2 N".
    pub label: String,
    /// Vertices (mm).
    pub points: Vec<Vec3>,
    /// For each quantity one number a vertex, NaN where there is none.
    pub values: Vec<Vec<f64>>,
    /// Borders of the plates (mm), if there are any: receptor, paddle, window of the paddle.
    pub plates: Vec<Vec<Vec3>>,
}

/// From where one looks.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct View {
    /// "front".
    pub name: &'static str,
    /// Angle (degrees) of the eye from x towards y.
    pub azimuth: f64,
    /// Angle (degrees) of the eye above the plane of x and y.
    pub elevation: f64,
}

/// Views of a person in RAS.
pub const OF_A_PERSON: [View; 5] = [
    View { name: "oblique", azimuth: 60.0, elevation: 15.0 },
    View { name: "front", azimuth: 90.0, elevation: 0.0 },
    View { name: "her right", azimuth: 0.0, elevation: 0.0 },
    View { name: "her left", azimuth: 180.0, elevation: 0.0 },
    View { name: "below", azimuth: 90.0, elevation: -89.0 },
];

/// Views of a breast between plates, in the frame of the detector.
pub const BETWEEN_PLATES: [View; 4] = [
    View { name: "oblique", azimuth: 35.0, elevation: 18.0 },
    View { name: "side", azimuth: 0.0, elevation: 0.0 },
    View { name: "nipple", azimuth: 90.0, elevation: 0.0 },
    View { name: "paddle", azimuth: 90.0, elevation: 89.0 },
];

/// Largest number of a coordinate or value in the page; the next one stands for no value.
const TOP: f64 = 65534.0;
const NONE: u16 = 65535;

impl Scene {
    /// The scene as JSON: numbers are 16 bits within their range, little-endian, in base64.
    ///
    /// # Errors
    /// [`Failure::BadInput`] when a state has other numbers of vertices or of quantities.
    pub fn packed(&self) -> Result<Value, Failure> {
        let (surface, kept) = self.compacted()?;
        let all = || self.states.iter().flat_map(|s| kept.iter().map(|&n| s.points[n as usize]));
        let inf = Vec3::repeat(f64::INFINITY);
        let (low, high) = all().fold((inf, -inf), |(l, h), p| (l.inf(&p), h.sup(&p)));
        let size = (high - low).max().max(1e-6);
        let mut positions: Vec<u16> = Vec::new();
        for p in all() {
            positions.extend([0, 1, 2].map(|i| (TOP * (p[i] - low[i]) / size).round() as u16));
        }
        let mut quantities = Vec::new();
        for (q, quantity) in self.quantities.iter().enumerate() {
            let of_states = || {
                self.states.iter().flat_map(|s| kept.iter().map(move |&n| &s.values[q][n as usize]))
            };
            let values: Vec<f64> = of_states().copied().collect();
            let finite = || values.iter().copied().filter(|v| v.is_finite());
            let least = finite().fold(f64::INFINITY, f64::min);
            let span = (finite().fold(f64::NEG_INFINITY, f64::max) - least).max(1e-9);
            let range = quantity.range.unwrap_or_else(|| quantity.palette.range(&values));
            let code = |v: &f64| match v.is_finite() {
                true => (TOP * (v - least) / span).round() as u16,
                false => NONE,
            };
            quantities.push(json!({
                "name": quantity.name, "unit": quantity.unit, "none": quantity.none, "range": range,
                "stops": quantity.palette.stops(), "least": if least.is_finite() { least } else { 0.0 },
                "span": span, "values": encoded(values.iter().map(code)),
            }));
        }
        let indices = surface.triangles.as_flattened();
        let bytes: Vec<u8> = indices.iter().flat_map(|n| n.to_le_bytes()).collect();
        let plate =
            |border: &Vec<Vec3>| border.iter().map(|&p| <[f64; 3]>::from(p)).collect::<Vec<_>>();
        let plates = |s: &SceneState| s.plates.iter().map(plate).collect::<Vec<_>>();
        Ok(json!({
            "title": self.title, "caption": self.caption, "along": self.along,
            "labels": self.states.iter().map(|s| &s.label).collect::<Vec<_>>(),
            "plates": self.states.iter().map(plates).collect::<Vec<_>>(),
            "axes": self.axes, "views": self.views, "low": <[f64; 3]>::from(low), "size": size,
            "vertices": kept.len(), "triangles": STANDARD.encode(bytes),
            "positions": encoded(positions.into_iter()), "quantities": quantities,
        }))
    }

    /// The surface without vertices that no triangle uses, and which vertices are kept.
    fn compacted(&self) -> Result<(TriMesh, Vec<u32>), Failure> {
        let vertices = self.states.first().map_or(0, |state| state.points.len());
        for state in &self.states {
            let fit = |values: &Vec<f64>| values.len() == vertices;
            let whole = state.values.len() == self.quantities.len();
            if state.points.len() != vertices || !whole || !state.values.iter().all(fit) {
                let title = &self.title;
                let why = format!("report: {title}: state {} does not fit the others", state.label);
                return Err(Failure::BadInput(why));
            }
        }
        let points = self.states.first().map_or(Vec::new(), |state| state.points.clone());
        Ok(TriMesh { points, triangles: self.triangles.clone() }.compacted())
    }
}

fn encoded(values: impl Iterator<Item = u16>) -> String {
    STANDARD.encode(values.flat_map(u16::to_le_bytes).collect::<Vec<u8>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let quantity = Quantity {
            name: "pressure".into(),
            unit: "kPa",
            palette: Palette::Sequential,
            range: None,
            none: "not touched",
        };
        let state = SceneState {
            label: "a".into(),
            points: vec![Vec3::zeros(), Vec3::repeat(99.0), Vec3::x() * 10.0, Vec3::y() * 20.0],
            values: vec![vec![1.0, 7.0, f64::NAN, 3.0]],
            plates: vec![],
        };
        Scene {
            triangles: vec![[0, 2, 3]],
            quantities: vec![quantity],
            states: vec![state],
            ..Scene::default()
        }
    }

    #[test]
    fn numbers_are_packed_within_their_range_and_nan_is_marked() {
        let packed = scene().packed().unwrap();
        assert_eq!(packed["vertices"], 3);
        assert_eq!(packed["size"], 20.0);
        let words = |text: &Value| -> Vec<u16> {
            let bytes = STANDARD.decode(text.as_str().unwrap()).unwrap();
            bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
        };
        let half = 32767;
        assert_eq!(words(&packed["positions"]), [0, 0, 0, half, 0, 0, 0, 65534, 0]);
        // The vertex that no triangle has does not count: values run from 1 to 3.
        let quantity = &packed["quantities"][0];
        assert_eq!(words(&quantity["values"]), [0, 65535, 65534]);
        assert_eq!((quantity["least"].as_f64(), quantity["span"].as_f64()), (Some(1.0), Some(2.0)));
        assert_eq!(quantity["range"], json!([0.0, 3.0]));
    }

    #[test]
    fn a_state_of_another_body_is_refused() {
        let mut two = scene();
        let mut other = two.states[0].clone();
        other.points.pop();
        two.states.push(other);
        assert!(two.packed().unwrap_err().to_string().contains("does not fit"));
    }
}
