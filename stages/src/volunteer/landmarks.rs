//! Where the markers stick on the stress-free skin.

use super::{
    PoseName,
    preset::{Stream, stream},
    torso::{BreastFrame, Torso},
};
use mammotwin_data::{Vec3, landmarks::Landmarks};
use rand_distr::{Distribution, Normal};

/// Four markers on the chest wall (sternum and inframammary lines), three on each breast, and
/// the nipples, in the body frame (mm).
pub fn stress_free(torso: &Torso) -> Landmarks {
    let breast = &torso.person.breast;
    let mut marks = Landmarks::default();
    let mut put = |name: String, place: Vec3| {
        marks.0.insert(name, place);
    };
    let sternum = |z: f64| on_skin(torso, &Vec3::new(0.0, 0.0, z), &Vec3::y());
    put("chest_sternum_superior".into(), sternum(0.95 * breast.base_z_mm));
    put("chest_sternum_inferior".into(), sternum(-0.7 * breast.base_z_mm));
    for frame in &torso.breasts {
        let side = frame.side.name();
        let at = |lateral: f64, up: f64| on_breast(torso, frame, lateral, up);
        let fold = 1.0 + 5.0 / breast.base_z_mm;
        put(format!("chest_inframammary_{side}"), at(-0.1, -fold));
        put(format!("breast_{side}_upper"), at(0.0, 0.6));
        put(format!("breast_{side}_outer"), at(0.6, -0.1));
        put(format!("breast_{side}_lower"), at(-0.25, -0.6));
        put(format!("nipple_{side}"), frame.apex);
    }
    marks
}

/// The skin over a place of the base, given in half axes of the breast.
fn on_breast(torso: &Torso, frame: &BreastFrame, lateral: f64, up: f64) -> Vec3 {
    let breast = &torso.person.breast;
    let base =
        frame.base + lateral * breast.base_x_mm * frame.lateral + up * breast.base_z_mm * Vec3::z();
    on_skin(torso, &base, &frame.outward)
}

/// Where a ray from inside leaves the smooth skin.
fn on_skin(torso: &Torso, inside: &Vec3, outward: &Vec3) -> Vec3 {
    let chest = &torso.person.chest;
    let (mut low, mut high) = (-30.0, 2.0 * chest.half_axis_y_mm);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if torso.smooth_skin(&(inside + middle * outward)) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    inside + low * outward
}

/// Landmarks as a person points at them: with a normal error along each axis.
pub fn pointed_at(exact: &Landmarks, pose: PoseName, seed: u64, error_mm: f64) -> Landmarks {
    let mut random = stream(seed ^ (pose as u64) << 32, Stream::Pointing);
    let error = Normal::new(0.0, error_mm).expect("a constant, finite standard deviation");
    let mut point = |p: &Vec3| p.map(|c| (100.0 * (c + error.sample(&mut random))).round() / 100.0);
    Landmarks(exact.0.iter().map(|(name, p)| (name.clone(), point(p))).collect())
}
