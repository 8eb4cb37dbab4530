//! What the report shows in three dimensions.

use crate::{
    calibrate::Calibration,
    compress::Compression,
    mesh::BreastMesh,
    pose::PoseFit,
    report::{
        palette::Palette,
        scene::{BETWEEN_PLATES, OF_A_PERSON, Quantity, Scene, SceneState},
    },
    validate::Validation,
};
use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
    solution::von_mises_kpa,
    units::DEGREE,
};

/// The compression, then the held-out poses, then the fitted ones.
pub fn scenes(
    mesh: &BreastMesh,
    calibration: &Calibration,
    validations: &[Validation],
    compression: Option<&Compression>,
) -> Vec<Scene> {
    let mut scenes: Vec<Scene> = compression.map(between_plates).into_iter().collect();
    let held_out = validations.iter().map(|v| (&v.before, &v.after, ", held out"));
    let fitted = calibration.before.poses.iter().zip(&calibration.after.poses).skip(1);
    let fitted = fitted.map(|(before, after)| (before, after, ""));
    let searched = calibration.trials.len() > 1;
    for (before, after, word) in held_out.chain(fitted) {
        let states = if searched {
            vec![pose_state(mesh, before, "before the fit"), pose_state(mesh, after, "after it")]
        } else {
            vec![pose_state(mesh, after, "moduli of the study")]
        };
        scenes.push(Scene {
            title: format!("Pose {}{word}", after.pose),
            caption: "Simulated skin in the frame of the reference pose; red lies outside of the \
                      measured skin, blue inside."
                .into(),
            triangles: mesh.mesh.patch(Patch::Skin).to_vec(),
            quantities: vec![
                quantity("distance to the measured skin", "mm", Palette::Diverging, "not compared"),
                quantity("von Mises stress", "kPa", Palette::Sequential, "no value"),
            ],
            states,
            along: "moduli".into(),
            axes: ["R", "A", "S"],
            views: OF_A_PERSON.to_vec(),
        });
    }
    scenes
}

fn quantity(name: &str, unit: &'static str, palette: Palette, none: &'static str) -> Quantity {
    Quantity { name: name.into(), unit, palette, range: None, none }
}

fn pose_state(mesh: &BreastMesh, fit: &PoseFit, words: &str) -> SceneState {
    let mut distance = vec![f64::NAN; fit.solution.points.len()];
    for (&node, &signed) in fit.active.iter().zip(&fit.signed_mm) {
        distance[node as usize] = signed;
    }
    let stress: Vec<f64> = fit.solution.cauchy_kpa.iter().map(von_mises_kpa).collect();
    let mean_mm = fit.distances.modified_hausdorff;
    SceneState {
        label: format!("{words}, modified Hausdorff distance {mean_mm:.2} mm"),
        points: fit.solution.points.clone(),
        values: vec![distance, at_nodes(&mesh.mesh, &stress)],
        plates: Vec::new(),
    }
}

fn between_plates(found: &Compression) -> Scene {
    let curve = &found.curve;
    let mut states = Vec::new();
    for (n, step) in found.steps.iter().enumerate() {
        let points: Vec<Vec3> = step.points.iter().map(|p| Vec3::from(p.map(f64::from))).collect();
        let touched = |&p: &f32| if p > 0.0 { f64::from(p) } else { f64::NAN };
        let pressure = step.contact_pressure_kpa.iter().map(touched).collect();
        let stress: Vec<f64> = step.von_mises_kpa.iter().map(|&s| f64::from(s)).collect();
        let moved = points.iter().zip(&found.mesh.points).map(|(p, rest)| (p - rest).norm());
        // No minus before a zero.
        let force_n = (10.0 * curve.force_n[n]).round() / 10.0 + 0.0;
        let label = format!("{:.1} mm, {force_n:.1} N", curve.thickness_mm[n]);
        let values = vec![at_nodes(&found.mesh, &stress), pressure, moved.collect()];
        let tilt_rad = curve.tilt_deg[n] * DEGREE;
        let plates = plates(&points, &found.outline_mm, step.plates_mm, tilt_rad);
        states.push(SceneState { label, points, values, plates });
    }
    Scene {
        title: format!("Compression, {} breast", found.side.name()),
        caption:
            "The breast between receptor and paddle, whose outlines are drawn; in the frame of \
                  the detector."
                .into(),
        triangles: found.mesh.outer_surface().triangles,
        quantities: vec![
            quantity("von Mises stress", "kPa", Palette::Sequential, "no value"),
            quantity("contact pressure", "kPa", Palette::Sequential, "not touched"),
            quantity("way from the stress-free shape", "mm", Palette::Sequential, "no value"),
        ],
        states,
        along: "load step".into(),
        axes: ["edge", "nipple", "paddle"],
        views: BETWEEN_PLATES.to_vec(),
    }
}

/// Border (mm) of the drawn plates around the breast.
const BORDER_MM: f64 = 15.0;

/// Outlines of receptor and paddle, and of its window; an endless one is drawn over the whole
/// breast. The paddle is tilted about the direction of its edge.
fn plates(
    points: &[Vec3],
    outline_mm: &[Vec<[f64; 2]>],
    heights_mm: [f64; 2],
    tilt_rad: f64,
) -> Vec<Vec<Vec3>> {
    let ends = |of: fn(&Vec3) -> f64| {
        points.iter().map(of).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
    };
    let ((left, right), (_, front)) = (ends(|p| p.x), ends(|p| p.y));
    let (left, right, front) = (left - BORDER_MM, right + BORDER_MM, front + BORDER_MM);
    let whole = vec![[left, 0.0], [right, 0.0], [right, front], [left, front]];
    let raised = |polygon: &Vec<[f64; 2]>, height: f64, slope: f64| {
        polygon.iter().map(|&[x, y]| Vec3::new(x, y, height + slope * y)).collect()
    };
    let paddle = if outline_mm.is_empty() { std::slice::from_ref(&whole) } else { outline_mm };
    let mut all = vec![raised(&whole, heights_mm[0], 0.0)];
    all.extend(paddle.iter().map(|one| raised(one, heights_mm[1], -tilt_rad.tan())));
    all
}

/// Values of the tetrahedra at the nodes: means by volume of the stress-free shape.
fn at_nodes(mesh: &TetMesh, values: &[f64]) -> Vec<f64> {
    let (mut sums, mut weights) = (vec![0.0; mesh.points.len()], vec![0.0; mesh.points.len()]);
    for (tet, value) in mesh.tets.iter().zip(values) {
        let volume = TetMesh::tet_volume(&mesh.points, tet);
        for &n in tet {
            sums[n as usize] += volume * value;
            weights[n as usize] += volume;
        }
    }
    sums.iter().zip(&weights).map(|(sum, weight)| sum / weight).collect()
}
