//! What the breasts of a pose measure, as facts and as a map of their skin.

use crate::{
    measure::{PoseMeasures, SideMeasures},
    report::{Fact, SurfaceMap, palette::Palette, surface::Camera},
};

/// Ends of the colour scale of all maps of the skin (mm): one scale, so that maps compare.
const SKIN_RANGE_MM: [f64; 2] = [0.0, 4.0];

/// Facts of both breasts, and the thickness of the skin where it is known.
pub fn section(measures: &PoseMeasures) -> (Vec<Fact>, Option<SurfaceMap>) {
    let mut facts: Vec<Fact> = measures.sides.iter().flat_map(facts).collect();
    if !measures.no_skin.is_empty() {
        facts.push(Fact::new("Skin", measures.no_skin.clone()));
        return (facts, None);
    }
    let map = SurfaceMap {
        title: "Thickness of the skin".into(),
        caption:
            "From profiles of the image along the normals of the skin; nothing where gland lies \
                  under it, and no part of the model."
                .into(),
        surface: measures.skin.clone(),
        values: measures.skin_mm.clone(),
        label: "thickness (mm)".into(),
        palette: Palette::Sequential,
        range: Some(SKIN_RANGE_MM),
        cameras: vec![Camera::Front],
    };
    (facts, (!measures.skin_mm.is_empty()).then_some(map))
}

fn facts(one: &SideMeasures) -> Vec<Fact> {
    let name = match one.side.name() {
        "right" => "Right",
        _ => "Left",
    };
    let n = one.nipple_mm;
    let (volume, protrusion) = (one.volume_cm3, one.protrusion_mm);
    let (gland, share) = (one.gland_cm3, 100.0 * one.gland_share);
    let nipple = format!("({:.0}, {:.0}, {:.0}) mm", n.x, n.y, n.z).replace('-', "−");
    let nipple = format!("{nipple}, {}", one.nipple_from.name());
    let mut facts = vec![
        Fact::new(&format!("{name} breast"), format!("{volume:.0} cm³")),
        Fact::new(&format!("{name} gland"), format!("{gland:.0} cm³, {share:.0} % by volume")),
        Fact::new(&format!("{name} protrusion"), format!("{protrusion:.0} mm")),
        Fact::new(&format!("{name} nipple"), nipple),
    ];
    if let Some(skin) = one.skin {
        let [median, low, high] = [skin.median_mm, skin.p05_mm, skin.p95_mm];
        let text = format!("{median:.1} mm (90 %: {low:.1} – {high:.1})");
        facts.push(Fact::new(&format!("{name} skin"), text));
    }
    facts
}
