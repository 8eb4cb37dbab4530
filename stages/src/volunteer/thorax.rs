//! What is behind the muscle: ribs, sternum, lungs, heart, liver and spine. Rigid, so that a
//! registration finds features along x, y and z.

use super::torso::{Torso, ellipse};
use mammotwin_data::{Vec3, labels::Tissue};
use mammotwin_imaging::mri::synthesize::{Substance, noise};

/// Thickness of the bony cage (mm).
const CAGE_MM: f64 = 14.0;
/// Distance of ribs along z (mm).
const RIB_PITCH_MM: f64 = 27.0;

/// From the outside of the cage to the front of the ribs and the fat around them (mm): the muscle in
/// front of them cannot be told from the pectoral muscle that lies on it, and counts as such.
const RIBS_BEHIND_MM: f64 = 7.0 - 1.12 * 4.6;

/// What is at a place behind the chest wall (`rib_cage`: distance from the rib cage, mm).
pub fn thorax(torso: &Torso, p: &Vec3, rib_cage: f64) -> (Substance, Tissue) {
    if rib_cage > 0.0 {
        let tissue = if p.y > 0.0 { Tissue::PectoralMuscle } else { Tissue::Thorax };
        return (Substance::Muscle, tissue);
    }
    let spine = spine(torso, p);
    let substance = match spine {
        Some(found) => found,
        None if rib_cage > -CAGE_MM => cage(torso, p, rib_cage),
        None => inside(torso, p, rib_cage),
    };
    let before_ribs = rib_cage > -RIBS_BEHIND_MM && p.y > 0.0 && substance == Substance::Muscle;
    (substance, if before_ribs { Tissue::PectoralMuscle } else { Tissue::Thorax })
}

/// Sternum, ribs, costal cartilage, intercostal muscle.
fn cage(torso: &Torso, p: &Vec3, rib_cage: f64) -> Substance {
    let chest = &torso.person.chest;
    if p.y > 0.0 && p.z > -58.0 {
        let half_width = 15.0 + 9.0 * ((p.z - 55.0) / 18.0).tanh().max(0.0);
        let to_face = (rib_cage + 7.0).abs() - 6.0;
        let to_edge = (p.x.abs() - half_width).max(-58.0 - p.z).max(to_face);
        if to_edge < 0.0 {
            // A thin plate between manubrium and body.
            let joint = (p.z - 58.0).abs() < 1.5;
            let bone = to_edge > -1.3 || joint;
            return if bone { Substance::CorticalBone } else { Substance::Marrow };
        }
    }
    let [u, v] = [p.x / chest.half_axis_x_mm, p.y / chest.half_axis_y_mm];
    let norm = u.hypot(v).max(1e-9);
    let (sin, cos) = (u.abs() / norm, v / norm);
    // Height of a rib around the chest: down from the spine to the front, up to the sternum.
    let fall = -45.0 * sin + 35.0 * (1.0 - cos);
    let along = (p.z - fall - 9.0) / RIB_PITCH_MM;
    let rib = along.round();
    let side = u64::from(p.x < 0.0);
    let jitter = noise::mix(torso.seed() ^ (rib as i64 as u64) << 1 ^ side) % 1000;
    let off = (along - rib) * RIB_PITCH_MM - (jitter as f64 / 250.0 - 2.0);
    let level = (off / 6.8).hypot((rib_cage + 7.0) / 4.6);
    if level > 1.0 {
        let pleural_fat = rib_cage < -12.0 || level < 1.12;
        return if pleural_fat { Substance::Fat } else { Substance::Muscle };
    }
    match (cos > 0.84, level > 0.76) {
        (true, _) => Substance::Cartilage,
        (false, true) => Substance::CorticalBone,
        (false, false) => Substance::Marrow,
    }
}

/// Lungs, heart, mediastinum, and what is below the diaphragm.
fn inside(torso: &Torso, p: &Vec3, rib_cage: f64) -> Substance {
    let chest = &torso.person.chest;
    let (a, b) = (chest.half_axis_x_mm, chest.half_axis_y_mm);
    let dome = -62.0 - 45.0 * ((p.x / (0.8 * a)).powi(2) + (p.y / (0.8 * b)).powi(2))
        + if p.x > 0.0 { 12.0 } else { 0.0 } * (p.x / 30.0).min(1.0);
    let heart = ((p.x + 28.0) / 46.0).hypot((p.y - 0.36 * b) / 36.0).hypot((p.z + 20.0) / 52.0);
    if heart < 1.0 {
        let wall = heart > 0.74 || (p.x + 0.3 * p.z + 30.0).abs() < 5.0;
        return if wall { Substance::Myocardium } else { Substance::Blood };
    }
    if heart < 1.08 {
        return Substance::Fat;
    }
    if p.z < dome {
        let stomach = p.x < -25.0 && p.y > -10.0;
        return if stomach { Substance::Muscle } else { Substance::Liver };
    }
    if ellipse(p.x + 16.0, p.y + 0.42 * b, 11.0, 11.0) < 0.0 {
        return Substance::Blood;
    }
    if p.z > 10.0 && ellipse(p.x, p.y + 0.18 * b, 8.5, 8.0) < 0.0 {
        return Substance::Air;
    }
    let wavy = 4.0 * noise::smooth(torso.seed() ^ 0x31, p, 25.0);
    if p.x.abs() < 17.0 + wavy && p.y > -0.5 * b {
        let vessel = noise::smooth(torso.seed() ^ 0x32, p, 14.0) > 0.12 && p.y < 0.6 * b;
        return if vessel { Substance::Blood } else { Substance::Fat };
    }
    let vessels = noise::smooth(torso.seed() ^ 0x33, p, 9.0);
    let central = (1.0 + rib_cage / 90.0).max(0.0);
    if vessels > 0.62 + 0.3 * central { Substance::Muscle } else { Substance::Lung }
}

/// Vertebrae, discs, canal and the muscles beside them; `None` elsewhere.
fn spine(torso: &Torso, p: &Vec3) -> Option<Substance> {
    let b = torso.person.chest.half_axis_y_mm;
    if p.y > -0.35 * b || p.x.abs() > 60.0 {
        return None;
    }
    let body = ellipse(p.x, p.y + b - 42.0, 18.0, 15.0);
    if body < 0.0 {
        let along = (p.z / 25.0 - (p.z / 25.0).floor()) * 25.0;
        let disc = along < 5.5;
        return Some(match (disc, body > -1.5 || !(7.0..=23.5).contains(&along)) {
            (true, _) => Substance::Disc,
            (false, true) => Substance::CorticalBone,
            (false, false) => Substance::VertebralMarrow,
        });
    }
    let canal = ellipse(p.x, p.y + b - 20.0, 9.0, 8.0);
    if canal < 0.0 {
        let cord = ellipse(p.x, p.y + b - 20.0, 5.0, 4.0) < 0.0;
        return Some(if cord { Substance::Disc } else { Substance::Fluid });
    }
    if canal < 3.0 {
        return Some(Substance::CorticalBone);
    }
    let paraspinal = ellipse(p.x.abs() - 28.0, p.y + b - 16.0, 22.0, 13.0) < 0.0;
    paraspinal.then_some(Substance::Muscle)
}
