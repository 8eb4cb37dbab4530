//! Markers of a digital volunteer: what a perfect model would miss them by.

use super::{MarkerError, TRUE_SKIN, true_points};
use mammotwin_data::{Failure, Vec3, io::hdf5};
use mammotwin_stages::{
    fiducials::{Anchors, Fiducials, Miss, Summary},
    volunteer::Truth,
};

/// Misses of the markers of a pose, beside those of the true skin; `None` without markers.
pub(super) fn measure(
    reference: &str,
    truth: &Truth,
    bodies: &hdf5::Reader,
    found: &Fiducials,
) -> Result<Option<MarkerError>, Failure> {
    let (Some(moved_mm), Some(before), Some(after)) =
        (found.moved_mm(), found.before(), found.after())
    else {
        return Ok(None);
    };
    let faces: Vec<[u32; 3]> = bodies.get(TRUE_SKIN)?;
    let at = |pose: &str| true_points(truth, bodies, reference, pose);
    let stuck: Vec<Vec3> = found.markers.iter().map(|marker| marker.reference).collect();
    let measured: Vec<Vec3> = found.markers.iter().map(|marker| marker.measured).collect();
    let anchors = Anchors::new(&faces, &at(reference)?, &stuck)
        .map_err(|cause| Failure::BadInput(format!("truth of {}: markers: {cause}", found.pose)))?;
    let misses: Vec<Miss> =
        anchors.misses(&at(&found.pose)?, &measured).into_iter().flatten().collect();
    Ok(Summary::of(&misses).map(|floor| MarkerError { moved_mm, before, after, floor }))
}
