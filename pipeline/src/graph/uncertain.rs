//! Compressions that differ by one standard deviation of what they rest on, and what comfort owes to it.

use super::{Outcome, Squeezed, gravity, measured::Fitted, press};
use mammotwin_data::{
    Failure,
    store::{Run, Stored},
    study::{CompressPlan, Study},
};
use mammotwin_stages::{
    calibrate::Calibration,
    comfort::Comfort,
    compress::Compression,
    mesh::BreastMesh,
    stiffer::{Deviations, Stiffer, Varied, variations},
};

/// Whether the modulus of the breast that is compressed is fitted.
pub(super) fn is_fitted(study: &Study) -> bool {
    let side = study.compress.as_ref().map(|plan| plan.side);
    let key = side.map(|side| format!("breast.young_{}_kpa", side.name()));
    key.is_some_and(|key| study.calibrate.parameters.contains(&key))
}

/// The same model with the fitted moduli one standard deviation higher.
pub(crate) fn stiffer(
    study: &Study,
    outcome: &Outcome,
    run: &Run<'_>,
) -> Result<Stored<Calibration>, Failure> {
    let Outcome { reference, measured, mesh, calibration, .. } = outcome;
    let targets = measured.targets(study).into_iter();
    let Fitted { names, motions, surfaces } = Fitted::of(targets);
    let stage = Stiffer {
        model: study.model.clone(),
        calibrate: study.calibrate.clone(),
        gravity: gravity(reference, &study.poses[reference])?,
        reference: reference.clone(),
        poses: names,
    };
    let first = &measured.images[reference].surfaces;
    run.stage("", &stage, ((mesh, calibration), (first, &motions[..], &surfaces[..])))
}

/// Label of what differs from `label` by what is varied.
fn with(label: &str, varied: Varied) -> String {
    let name = varied.name();
    if label.is_empty() { name.into() } else { format!("{label}_{name}") }
}

/// A compression that differs from one of `label` by what is varied.
pub(crate) fn varied(
    study: &Study,
    (varied, plan): (Varied, &CompressPlan),
    label: &str,
    run: &Run<'_>,
    body: (&Stored<BreastMesh>, &Stored<Calibration>),
) -> Result<Stored<Compression>, Failure> {
    press(study, plan, &with(label, varied), run, body)
}

/// Gives comfort its standard deviations: from one compression more for each number that is known to one only. What
/// cannot be computed is said in the metrics.
pub(super) fn deviate(
    study: &Study,
    plan: &CompressPlan,
    label: &str,
    run: &Run<'_>,
    (outcome, stiffer): (&Outcome, Option<&Stored<Calibration>>),
    squeezed: &mut Squeezed,
) -> Result<(), Failure> {
    let mut stage = Deviations { comfort: study.comfort, varied: Vec::new(), failed: None };
    let (mut others, mut comforts) = (Vec::new(), Vec::new());
    for (what, other) in variations(plan, &study.comfort, stiffer.is_some()) {
        let calibration = stiffer.filter(|_| what == Varied::Moduli);
        let body = (&outcome.mesh, calibration.unwrap_or(&outcome.calibration));
        match varied(study, (what, &other), label, run, body) {
            Ok(compression) => {
                let comfort = Comfort { plan: study.comfort.without_uncertainty() };
                comforts.push(run.stage(&with(label, what), &comfort, &compression)?);
                others.push(compression);
                stage.varied.push(what);
            }
            Err(Failure::Numerics(why) | Failure::BadInput(why)) => {
                stage.failed.get_or_insert(format!("{}: {why}", what.name()));
            }
            Err(other) => return Err(other),
        }
    }
    let first = (&squeezed.metrics[0], &squeezed.compression, &outcome.calibration);
    squeezed.metrics[0] = run.stage(label, &stage, (first, &others[..], &comforts[..]))?;
    Ok(())
}
