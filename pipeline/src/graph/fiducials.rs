//! Landmarks of the poses, and the markers among them that test what was simulated.

use super::PoseOutcome;
use mammotwin_data::{
    Failure,
    landmarks::Landmarks,
    store::{Run, Stored},
    study::Study,
};
use mammotwin_stages::{
    calibrate::Calibration,
    fiducials::{Carry, Fiducials},
    mesh::BreastMesh,
    validate::Validation,
};
use std::collections::BTreeMap;

/// The landmarks of a pose, if the study gives any.
pub(super) fn landmarks(
    study: &Study,
    name: &str,
    run: &Run<'_>,
) -> Result<Option<Stored<Landmarks>>, Failure> {
    let key = format!("poses.{name}.landmarks");
    study.poses[name].landmarks.as_ref().map(|path| run.external(&key, path)).transpose()
}

/// Markers of every simulated pose that has landmarks, as the reference pose has. Calibration and validation do not read
/// them.
pub(super) fn fiducials(
    study: &Study,
    poses: &BTreeMap<String, PoseOutcome>,
    (mesh, calibration): (&Stored<BreastMesh>, &Stored<Calibration>),
    validations: &BTreeMap<String, Stored<Validation>>,
    run: &Run<'_>,
) -> Result<BTreeMap<String, Stored<Fiducials>>, Failure> {
    let mut found = BTreeMap::new();
    let Some(reference) = landmarks(study, study.reference_pose(), run)? else { return Ok(found) };
    for (name, pose) in poses {
        let (Some(registered), Some(own)) = (&pose.registered, landmarks(study, name, run)?) else {
            continue;
        };
        let marked = (&reference, &own);
        let inputs = (mesh, calibration, validations.get(name), registered, marked);
        found.insert(name.clone(), run.stage(name, &Carry { pose: name.clone() }, inputs)?);
    }
    Ok(found)
}
