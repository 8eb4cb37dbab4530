//! What a finished run says of a volunteer, gathered from its results.

use crate::{graph::Outcome, score::Estimates};
use mammotwin_data::Failure;
use mammotwin_data::labels::Tissue;
use mammotwin_stages::{
    calibrate::Parameter,
    fiducials::{Fiducials, Miss, Summary},
    pose::PoseFit,
    surface,
};
use serde_json::{Map, Value, json};

/// Loads what can be compared with a truth; fails when a result is not computed yet.
pub fn estimates(outcome: &Outcome) -> Result<Estimates, Failure> {
    let mut found = Estimates { reference: outcome.reference.clone(), ..Estimates::default() };
    for (name, pose) in &outcome.measured.images {
        let (labels, surfaces) = (pose.labels.load()?, pose.surfaces.load()?);
        let parts = [
            ("skin", labels.map(|tissue| tissue != Tissue::Background), &surfaces.skin),
            ("chest_wall", labels.map(Tissue::is_chest_wall), &surfaces.chest_wall),
        ];
        let mut borders = Map::new();
        for (part, mask, surface) in parts {
            let distances = surface::from_border(&mask, surface).map_err(|cause| {
                Failure::BadInput(format!("surface of {part}, {name}: {cause}"))
            })?;
            let at = |share: f64| distances.get((share * distances.len() as f64) as usize);
            let border = json!({
                "median_mm": at(0.5),
                "p95_mm": at(0.95),
                "p99_mm": at(0.99),
                "max_mm": distances.last(),
            });
            borders.insert(part.into(), border);
        }
        found.surface.insert(name.clone(), borders.into());
        found.labels.insert(name.clone(), labels);
        if let Some(registered) = &pose.registered {
            found.to_reference.insert(name.clone(), registered.load()?.transform);
        }
    }
    let calibration = outcome.calibration.load()?;
    for parameter in Parameter::ALL {
        let value = parameter.given(&calibration.after.moduli);
        found.moduli.extend(value.map(|value| (parameter.key().into(), value)));
    }
    for (before, after) in calibration.before.poses.iter().zip(&calibration.after.poses) {
        found.distance.insert(after.pose.clone(), distances(before, after));
    }
    for (name, validation) in &outcome.validations {
        let validation = validation.load()?;
        found.distance.insert(name.clone(), distances(&validation.before, &validation.after));
    }
    for (name, fiducials) in &outcome.fiducials {
        found.fiducials.extend(markers(&fiducials.load()?).map(|value| (name.clone(), value)));
    }
    found.fit = json!({
        "misfit_mm": calibration.misfit_mm(),
        "lack_of_fit": calibration.lack_of_fit(),
        "converged": calibration.converged,
        "correlation": calibration.precision.correlation(Parameter::Right, Parameter::Left),
    });
    Ok(found)
}

/// Misses of the carried markers; `None` without markers.
fn markers(found: &Fiducials) -> Option<Value> {
    let (before, after) = (found.before()?, found.after()?);
    let numbers = |summary: &Summary| {
        json!({
            "mean_mm": summary.mean_mm,
            "max_mm": summary.max_mm,
            "tangential_mean_mm": summary.tangential_mean_mm,
            "tangential_max_mm": summary.tangential_max_mm,
            "normal_mean_mm": summary.normal_mean_mm,
        })
    };
    let miss =
        |miss: &Miss| json!({ "normal_mm": miss.normal_mm, "tangential_mm": miss.tangential_mm });
    let mut each = Map::new();
    for marker in &found.markers {
        let mut told = miss(&marker.after);
        told["before"] = miss(&marker.before);
        each.insert(marker.name.clone(), told);
    }
    let mut told = numbers(&after);
    told["moved_mm"] = json!(found.moved_mm());
    told["before"] = numbers(&before);
    told["markers"] = each.into();
    Some(told)
}

/// Distances of the simulated to the measured skin, with the moduli of the study and the fitted.
fn distances(before: &PoseFit, after: &PoseFit) -> Value {
    let numbers = |fit: &PoseFit| {
        let d = &fit.distances;
        json!({
            "modified_hausdorff_mm": d.modified_hausdorff,
            "hausdorff_mm": d.hausdorff,
            "mean_mm": d.mean,
            "p95_mm": d.p95,
            "max_mm": d.max,
        })
    };
    let mut fitted = numbers(after);
    fitted["before"] = numbers(before);
    fitted
}
