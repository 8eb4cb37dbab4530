//! `/poses` and `/calibration`: how each pose lies to the reference pose, where its simulation is,
//! and how far that is from what was measured.

use crate::{
    calibrate::{Calibration, Fit, Parameter},
    fiducials::{Fiducials, Miss, Summary},
    measure::{PoseMeasures, SideMeasures},
    model::Moduli,
    pose::PoseFit,
    register::Registered,
    segment::{REAR_SEEN, WALL_SEEN},
};
use mammotwin_data::{
    Failure, Vec3, io::hdf5::Writer, labels::Side, mesh::TetMesh, store::Notes, study::Use,
    units::DEGREE,
};

/// One pose of the study.
#[derive(Debug, Clone, Copy)]
pub struct PoseResult<'a> {
    /// Its motion to the reference pose; `None` for the reference pose itself.
    pub registered: Option<&'a Registered>,
    /// What the study uses it for.
    pub usage: Use,
    /// With the moduli of the study.
    pub before: &'a PoseFit,
    /// With the fitted moduli.
    pub after: &'a PoseFit,
    /// Markers on the breasts, where the pose and the reference pose have landmarks.
    pub fiducials: Option<&'a Fiducials>,
}

/// Writes `/poses/NAME`.
pub fn put_pose(file: &mut Writer, pose: &PoseResult) -> Result<(), Failure> {
    let fit = pose.after;
    let group = format!("poses/{}", fit.pose);
    let at = |name: &str| format!("{group}/{name}");
    let role = match (pose.registered, pose.usage) {
        (None, _) => "reference",
        (Some(_), Use::Fit) => "fit",
        (Some(_), Use::Validate) => "validate",
    };
    file.put_text(&at("role"), role, "What the study uses the pose for")?;
    let long_name = "Direction of gravity, unit vector";
    file.put(&at("gravity"), fit.gravity.as_slice(), "1", long_name)?;
    file.put_state(&at("solution"), &fit.solution)?;
    let long_name = match role {
        "validate" => format!("{}, simulated, held out", fit.pose),
        _ => format!("{}, simulated", fit.pose),
    };
    file.attribute(&group, "long_name", &long_name)?;
    let Some(registered) = pose.registered else { return Ok(()) };
    put_registration(file, &group, registered)?;
    put_fit(file, &at("before"), pose.before, "With the moduli of the study")?;
    let long_name = "Nodes of the pose with the moduli of the study";
    file.put(&at("before/points"), &pose.before.solution.points, "mm", long_name)?;
    put_fit(file, &at("after"), fit, "With the fitted moduli")?;
    match pose.fiducials.filter(|found| !found.markers.is_empty()) {
        Some(found) => put_fiducials(file, &at("fiducials"), found),
        None => Ok(()),
    }
}

fn put_fiducials(file: &mut Writer, group: &str, found: &Fiducials) -> Result<(), Failure> {
    let at = |name: &str| format!("{group}/{name}");
    let markers = &found.markers;
    let names: Vec<&str> = markers.iter().map(|marker| marker.name.as_str()).collect();
    file.put_texts(&at("names"), &names, "Markers on the breasts that both poses have")?;
    let measured: Vec<Vec3> = markers.iter().map(|marker| marker.measured).collect();
    file.put(&at("measured_mm"), &measured, "mm", "Where each was measured")?;
    let moved: Vec<f64> = markers.iter().map(|marker| marker.moved_mm()).collect();
    let long_name = "Distance of that from its place in the reference pose";
    file.put(&at("moved_mm"), &moved, "mm", long_name)?;
    let before: Vec<Miss> = markers.iter().map(|marker| marker.before).collect();
    put_misses(file, &at("before"), &before, "With the moduli of the study")?;
    let after: Vec<Miss> = markers.iter().map(|marker| marker.after).collect();
    put_misses(file, &at("after"), &after, "With the fitted moduli")?;
    Ok(file.attribute(group, "long_name", "Markers, carried by the simulated skin")?)
}

fn put_misses(file: &mut Writer, group: &str, misses: &[Miss], words: &str) -> Result<(), Failure> {
    let at = |name: &str| format!("{group}/{name}");
    let carried: Vec<Vec3> = misses.iter().map(|miss| miss.carried).collect();
    file.put(&at("carried_mm"), &carried, "mm", "Where the simulated skin carries each")?;
    let normal: Vec<f64> = misses.iter().map(|miss| miss.normal_mm).collect();
    let long_name = "Carried less measured place along the outward normal of the skin";
    file.put(&at("normal_mm"), &normal, "mm", long_name)?;
    let tangential: Vec<f64> = misses.iter().map(|miss| miss.tangential_mm).collect();
    file.put(&at("tangential_mm"), &tangential, "mm", "The rest of it, along the skin")?;
    if let Some(summary) = Summary::of(misses) {
        for (name, value, long_name) in [
            ("mean_mm", summary.mean_mm, "Mean distance"),
            ("max_mm", summary.max_mm, "Largest distance"),
            ("tangential_mean_mm", summary.tangential_mean_mm, "Mean distance along the skin"),
            ("tangential_max_mm", summary.tangential_max_mm, "Largest distance along the skin"),
            ("normal_mean_mm", summary.normal_mean_mm, "Mean distance along the normal"),
        ] {
            file.put_scalar(&at(name), value, "mm", long_name)?;
        }
    }
    Ok(file.attribute(group, "long_name", words)?)
}

/// Writes `/poses/NAME/breasts`: what the breasts of a pose measure.
pub fn put_measures(file: &mut Writer, pose: &str, measures: &PoseMeasures) -> Result<(), Failure> {
    for one in &measures.sides {
        put_breast(file, &format!("poses/{pose}/breasts/{}", one.side.name()), one)?;
    }
    if measures.skin_mm.is_empty() {
        return Ok(());
    }
    let group = format!("poses/{pose}/breasts/skin");
    file.put_surface(&group, &measures.skin)?;
    let long_name = "Thickness of the skin";
    file.put(&format!("{group}/thickness_mm"), &measures.skin_mm, "mm", long_name)?;
    file.attribute(&group, "long_name", "Skin on which a thickness was told")?;
    Ok(())
}

/// Writes `/poses/NAME/segmentation`: what the segmentation says of its labels.
pub fn put_segmentation(file: &mut Writer, pose: &str, notes: &Notes) -> Result<(), Failure> {
    let at = |name: &str| format!("poses/{pose}/segmentation/{name}");
    for (name, long_name) in [
        (
            WALL_SEEN,
            "Part of the chest wall behind the breasts on which fat and muscle were told apart",
        ),
        (REAR_SEEN, "Part of the chest wall on which the rear of the muscle was seen"),
    ] {
        if let Some(&value) = notes.values.get(name) {
            file.put_scalar(&at(name), value, "1", long_name)?;
        }
    }
    Ok(file.put_texts(&at("warnings"), &notes.warnings, "What somebody should look at")?)
}

fn put_breast(file: &mut Writer, group: &str, one: &SideMeasures) -> Result<(), Failure> {
    for (name, value, units, long_name) in [
        ("volume_cm3", one.volume_cm3, "cm3", "Breast in front of the chest wall, skin included"),
        ("gland_volume_cm3", one.gland_cm3, "cm3", "Fibroglandular tissue"),
        ("gland_share", one.gland_share, "1", "Share of gland in gland and fat, by volume"),
        ("protrusion_mm", one.protrusion_mm, "mm", "Farthest skin from the chest wall"),
    ] {
        file.put_scalar(&format!("{group}/{name}"), value, units, long_name)?;
    }
    let nipple = "Nipple in the frame of the reference pose";
    file.put(&format!("{group}/nipple_mm"), one.nipple_mm.as_slice(), "mm", nipple)?;
    let from = one.nipple_from.name();
    file.put_text(&format!("{group}/nipple_from"), from, "What tells where the nipple is")?;
    let Some(skin) = one.skin else { return Ok(()) };
    for (name, value, units, long_name) in [
        ("skin_median_mm", skin.median_mm, "mm", "Thickness of the skin, median"),
        ("skin_p05_mm", skin.p05_mm, "mm", "5 % of the skin are thinner"),
        ("skin_p95_mm", skin.p95_mm, "mm", "95 % of the skin are thinner"),
        ("skin_seen", skin.seen, "1", "Share of the skin on which a thickness was told"),
    ] {
        file.put_scalar(&format!("{group}/{name}"), value, units, long_name)?;
    }
    Ok(())
}

fn put_registration(
    file: &mut Writer,
    group: &str,
    registered: &Registered,
) -> Result<(), Failure> {
    let long_name = "From the pose's own image to the reference pose";
    file.put_motion(&format!("{group}/to_reference"), &registered.transform, long_name)?;
    let at = |name: &str| format!("{group}/registration/{name}");
    let start = &registered.start;
    let long_name = "What the landmarks alone gave, or a search where there were none";
    file.put_motion(&at("from_landmarks"), &start.transform, long_name)?;
    let count = start.landmarks as u64;
    file.put_scalar(&at("landmarks"), count, "1", "Landmarks that both poses have")?;
    if let Some(rms) = start.landmark_rms_mm {
        let long_name = "Landmarks after their own fit, root mean square";
        file.put_scalar(&at("landmark_rms_mm"), rms, "mm", long_name)?;
    }
    if let Some(wall) = &registered.wall {
        for (name, value, units, long_name) in [
            ("wall_mean_mm", wall.mean_mm, "mm", "Front of the muscle from the reference's: mean"),
            ("wall_p95_mm", wall.p95_mm, "mm", "95 % of its distances are smaller"),
            ("wall_max_mm", wall.max_mm, "mm", "Its largest distance"),
            ("wall_within_5mm", wall.within_5mm, "1", "Part of it that is within 5 mm"),
        ] {
            file.put_scalar(&at(name), value, units, long_name)?;
        }
    }
    let Some(image) = &registered.image else { return Ok(()) };
    let (before, after) = (image.similarity_before, image.similarity_after);
    file.put_scalar(&at("similarity_before"), before, "1", "Correlation at the start")?;
    file.put_scalar(&at("similarity_after"), after, "1", "Correlation at the end")?;
    if let Some(rms) = image.change_rms_mm {
        let long_name = "Change of the chest wall's shape, root mean square";
        file.put_scalar(&at("change_rms_mm"), rms, "mm", long_name)?;
    }
    let turns = image.uncertainty.rotation_rad.map(|rad| rad / DEGREE);
    let long_name = "Standard deviation of the rotation about x, y, z";
    file.put(&at("sd_rotation_deg"), &turns, "deg", long_name)?;
    let long_name = "Standard deviation of the translation along x, y, z";
    file.put(&at("sd_translation_mm"), &image.uncertainty.translation_mm, "mm", long_name)?;
    Ok(())
}

fn put_fit(file: &mut Writer, group: &str, fit: &PoseFit, long_name: &str) -> Result<(), Failure> {
    let at = |name: &str| format!("{group}/{name}");
    file.put(&at("nodes"), &fit.active, "1", "Nodes of the skin that are compared")?;
    let signed = "Signed distance of each of them to the measured skin, positive outside of it";
    file.put(&at("signed_distance_mm"), &fit.signed_mm, "mm", signed)?;
    let d = &fit.distances;
    for (name, value, long_name) in [
        ("min_mm", d.min, "Distance of the nearest node"),
        ("max_mm", d.max, "Distance of the farthest node"),
        ("mean_mm", d.mean, "Mean distance of the nodes"),
        ("p95_mm", d.p95, "95 % of the nodes are nearer"),
        ("hausdorff_mm", d.hausdorff, "Hausdorff distance"),
        ("modified_hausdorff_mm", d.modified_hausdorff, "Modified Hausdorff distance"),
    ] {
        file.put_scalar(&at(name), value, "mm", long_name)?;
    }
    file.attribute(group, "long_name", long_name)?;
    Ok(())
}

/// How much the fit leaves, and how well it knows the moduli.
fn put_certainty(file: &mut Writer, found: &Calibration) -> Result<(), Failure> {
    if let (Some(misfit_mm), Some(lack)) = (found.misfit_mm(), found.lack_of_fit()) {
        let long_name = "Root mean square distance that is left after the best rigid motions";
        file.put_scalar("calibration/misfit_mm", misfit_mm, "mm", long_name)?;
        let long_name = "That over what chest walls and labels explain";
        file.put_scalar("calibration/lack_of_fit", lack, "1", long_name)?;
    }
    let precision = &found.precision;
    let (right, left) = (Parameter::Right, Parameter::Left);
    for (name, value, long_name) in [
        ("sd_ln_young_right", precision.of(right), "Standard deviation of ln(modulus), right"),
        ("sd_ln_young_left", precision.of(left), "Standard deviation of ln(modulus), left"),
        ("correlation", precision.correlation(right, left), "Correlation of the two"),
    ] {
        if let Some(value) = value {
            file.put_scalar(&format!("calibration/{name}"), value, "1", long_name)?;
        }
    }
    let Some(second) = &found.second else { return Ok(()) };
    let put = |file: &mut Writer, name: &str, moduli: Moduli, long_name: &str| {
        let both = [moduli.right_kpa, moduli.left_kpa];
        file.put(&format!("calibration/second_start/{name}"), &both, "kPa", long_name)
    };
    put(file, "from_kpa", second.from, "Right and left modulus that a second search began with")?;
    if let Some(end) = second.end {
        put(file, "end_kpa", end, "Right and left modulus that it ended with")?;
    }
    Ok(())
}

/// Writes `/calibration/shared`: what was fitted beside the moduli of the breasts.
fn put_shared(file: &mut Writer, found: &Calibration, draws: &[Moduli]) -> Result<(), Failure> {
    for parameter in Parameter::shared() {
        let Some(value) = parameter.given(&found.after.moduli) else { continue };
        let group = format!("calibration/shared/{}", parameter.key().replace('.', "_"));
        let (units, words) = (parameter.units(), parameter.words());
        file.put_scalar(&format!("{group}/value"), value, units, words)?;
        let Some(sd) = found.precision.of(parameter) else { continue };
        let long_name = "Standard deviation of its logarithm";
        file.put_scalar(&format!("{group}/sd_ln"), sd, "1", long_name)?;
        for side in [Side::Right, Side::Left] {
            let with = found.precision.correlation(parameter, Parameter::of_side(side));
            if let Some(with) = with {
                let long_name = "Correlation with the logarithm of the modulus of that breast";
                let name = format!("{group}/correlation_{}", side.name());
                file.put_scalar(&name, with, "1", long_name)?;
            }
        }
        let drawn: Vec<f64> = draws.iter().filter_map(|draw| parameter.given(draw)).collect();
        file.put(&format!("{group}/draws"), &drawn, units, "Drawn with calibration/draws_kpa")?;
    }
    Ok(())
}

/// Moduli that are drawn.
pub const DRAWS: usize = 1000;

/// Writes `/calibration`; `rest` is the stress-free shape that belongs to the fitted moduli.
pub fn put_calibration(
    file: &mut Writer,
    found: &Calibration,
    fitted: &[String],
    rest: &TetMesh,
) -> Result<(), Failure> {
    file.put_texts("calibration/fitted", fitted, "Keys of the study that were fitted")?;
    let mut put = |when: &str, fit: &Fit, words: &str| -> Result<(), Failure> {
        let (moduli, trip) = (fit.moduli, fit.round_trip);
        for (name, value, units, long_name) in [
            ("young_right_kpa", moduli.right_kpa, "kPa", "Young's modulus of the right breast"),
            ("young_left_kpa", moduli.left_kpa, "kPa", "Young's modulus of the left breast"),
            ("round_trip_rms_mm", trip.rms_mm, "mm", "Reference pose, loaded again: rms of nodes"),
            ("round_trip_max_mm", trip.max_mm, "mm", "Reference pose, loaded again: farthest node"),
            ("off_wall_max_mm", trip.off_wall_mm, "mm", "Way of sliding nodes onto the chest wall"),
        ] {
            file.put_scalar(&format!("calibration/{when}/{name}"), value, units, long_name)?;
        }
        Ok(file.attribute(&format!("calibration/{when}"), "long_name", words)?)
    };
    put("before", &found.before, "With the moduli of the study")?;
    put("after", &found.after, "With the fitted moduli")?;
    put_certainty(file, found)?;
    let draws = found.precision.draws(found.after.moduli, DRAWS);
    if !draws.is_empty() {
        let values: Vec<f64> = draws.iter().flat_map(|d| [d.right_kpa, d.left_kpa]).collect();
        let long_name = "Young's moduli of the right and the left breast, drawn from what the distances leave open";
        file.put_array("calibration/draws_kpa", &[draws.len(), 2], &values, "kPa", long_name)?;
    }
    put_shared(file, found, &draws)?;
    file.put_mesh("calibration/rest", rest)?;
    file.attribute("calibration/rest", "long_name", "Stress-free shape of all poses")?;
    Ok(())
}
