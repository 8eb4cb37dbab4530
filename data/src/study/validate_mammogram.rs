//! Refuses mammograms that cannot be meant.

use super::{
    mammogram::{AbsorberPlan, MammogramPlan, MassPlan, UnitPlan},
    validate::{Checked, refuse, within},
};
use crate::tables;

/// Energies (keV) of the tables of attenuation.
const TABULATED_KEV: [f64; 2] = [5.0, 50.0];
/// Thicknesses (mm) of Dance's tables.
const DANCE_MM: [f64; 2] = [20.0, 110.0];
/// Different materials that masses may have: photon transport has room for so many.
const MASS_MATERIALS: usize = 3;

pub(super) fn mammogram(plan: &MammogramPlan) -> Checked {
    let [low, high] = TABULATED_KEV;
    within("mammogram.energy_kev", plan.energy_kev, low, high)?;
    beam(plan)?;
    within("mammogram.pixel_mm", plan.pixel_mm, 0.01, 5.0)?;
    within("mammogram.glandularity", plan.glandularity, 0.0, 1.0)?;
    if let Some(monte_carlo) = plan.monte_carlo {
        let photons = monte_carlo.photons as f64;
        within("mammogram.monte_carlo.photons", photons, 1000.0, 1e10)?;
    }
    let matrix = &plan.calcifications;
    for (key, count) in [("rows", matrix.rows), ("columns", matrix.columns)] {
        within(&format!("mammogram.calcifications.{key}"), count as f64, 0.0, 100.0)?;
    }
    within("mammogram.calcifications.pitch_mm", matrix.pitch_mm, 0.1, 100.0)?;
    for (n, diameter) in matrix.diameter_mm.iter().enumerate() {
        within(&format!("mammogram.calcifications.diameter_mm[{n}]"), *diameter, 0.01, 5.0)?;
    }
    let [x, y] = matrix.center_mm.unwrap_or_default();
    within("mammogram.calcifications.center_mm[0]", x, -500.0, 500.0)?;
    within("mammogram.calcifications.center_mm[1]", y, -500.0, 500.0)?;
    masses(&plan.masses)?;
    unit(&plan.unit)
}

/// A mammogram's dose needs a thickness that the tables have, where the study states one.
pub(super) fn thickness(stop_mm: Option<f64>) -> Checked {
    let [low, high] = DANCE_MM;
    match stop_mm {
        Some(stated) if !(low..=high).contains(&stated) => {
            let why = format!(
                "{stated} mm is outside of Dance's tables ({low} - {high} mm), which the dose of a \
                 mammogram needs; change it, or leave out [mammogram]"
            );
            refuse("compress.stop.thickness_mm", why)
        }
        _ => Ok(()),
    }
}

fn beam(plan: &MammogramPlan) -> Checked {
    let Some(beam) = &plan.beam else { return Ok(()) };
    let kv = beam.kv.to_string();
    let mut known: Vec<[&str; 2]> =
        tables::rows(tables::SPECTRA).map(|row| [row[0], row[1]]).collect();
    known.dedup();
    if known.contains(&[&beam.target_filter, &kv]) {
        return Ok(());
    }
    let list = known.iter().map(|[name, kv]| format!("{name} at {kv} kV")).collect::<Vec<_>>();
    let why = format!("no spectrum of {} at {kv} kV; there are: ", beam.target_filter);
    refuse("mammogram.beam", why + &list.join(", "))
}

fn masses(all: &[MassPlan]) -> Checked {
    let mut materials: Vec<&str> = all.iter().map(|mass| mass.material.as_str()).collect();
    materials.sort_unstable();
    materials.dedup();
    if materials.len() > MASS_MATERIALS {
        let why = format!("{} materials; masses may have {MASS_MATERIALS}", materials.len());
        return refuse("mammogram.masses", why);
    }
    for (n, mass) in all.iter().enumerate() {
        let path = format!("mammogram.masses[{n}]");
        material(&format!("{path}.material"), &mass.material)?;
        for (k, radius) in mass.radii_mm.iter().enumerate() {
            within(&format!("{path}.radii_mm[{k}]"), *radius, 0.05, 50.0)?;
        }
        match (mass.center_mm, mass.center_share) {
            (Some(place), None) => {
                for (k, at) in place.iter().enumerate() {
                    within(&format!("{path}.center_mm[{k}]"), *at, -500.0, 500.0)?;
                }
            }
            (None, Some(place)) => {
                for (k, at) in place.iter().enumerate() {
                    within(&format!("{path}.center_share[{k}]"), *at, 0.0, 1.0)?;
                }
            }
            _ => return refuse(path, "give its middle as center_mm or as center_share, not both"),
        }
    }
    Ok(())
}

fn unit(plan: &UnitPlan) -> Checked {
    within("mammogram.unit.source_height_mm", plan.source_height_mm, 300.0, 2000.0)?;
    for (n, extent) in plan.field_mm.iter().enumerate() {
        within(&format!("mammogram.unit.field_mm[{n}]"), *extent, 10.0, 500.0)?;
    }
    for (key, plate) in [("paddle", &plan.paddle), ("receptor", &plan.receptor)] {
        if let Some(AbsorberPlan { material: name, thickness_mm }) = plate {
            material(&format!("mammogram.unit.{key}.material"), name)?;
            within(&format!("mammogram.unit.{key}.thickness_mm"), *thickness_mm, 0.01, 20.0)?;
        }
    }
    if let Some(spot) = plan.focal_spot {
        within("mammogram.unit.focal_spot.width_mm", spot.width_mm, 0.01, 2.0)?;
    }
    within("mammogram.unit.heel_per_100mm", plan.heel_per_100mm, 0.0, 0.3)?;
    let noise = plan.electronic_noise_quanta;
    within("mammogram.unit.electronic_noise_quanta", noise, 0.0, 1e4)?;
    within("mammogram.unit.lag", plan.lag, 0.0, 0.5)
}

fn material(path: &str, name: &str) -> Checked {
    let mut known = tables::rows(tables::MATERIALS).map(|row| row[0]);
    if known.any(|row| row == name) {
        return Ok(());
    }
    let list: Vec<&str> = tables::rows(tables::MATERIALS).map(|row| row[0]).collect();
    refuse(path, format!("{name:?} is not known; there are: {}", list.join(", ")))
}
