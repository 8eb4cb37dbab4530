//! Compressions that differ by one standard deviation of what they rest on, and what comfort owes to it.

use super::{Outcome, Squeezed, gravity, measured::Fitted, press};
use mammotwin_data::{
    Failure,
    store::{Run, Stored},
    study::{CompressPlan, Study},
};
use mammotwin_stages::{
    calibrate::{Calibration, Parameter},
    comfort::Comfort,
    compress::Compression,
    mesh::BreastMesh,
    stiffer::{Deviations, Stiffer, Varied, variations},
};

/// Whether the modulus of the breast that is compressed is fitted.
fn is_fitted(study: &Study, plan: &CompressPlan) -> bool {
    study.calibrate.parameters.iter().any(|key| key == Parameter::of_side(plan.side).key())
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

/// The fit of stiffer breasts, or why there is none.
pub(super) type Raised = Result<Stored<Calibration>, String>;

/// That fit, once for all ways; `None` where nobody asks for it.
pub(super) fn raised<'a>(
    study: &Study,
    mut plans: impl Iterator<Item = &'a CompressPlan>,
    outcome: &Outcome,
    run: &Run<'_>,
) -> Result<Option<Raised>, Failure> {
    if !study.comfort.uncertainty || !plans.any(|plan| is_fitted(study, plan)) {
        return Ok(None);
    }
    match stiffer(study, outcome, run) {
        Ok(calibration) => Ok(Some(Ok(calibration))),
        Err(Failure::Numerics(why) | Failure::BadInput(why)) => Ok(Some(Err(why))),
        Err(other) => Err(other),
    }
}

/// Label of what differs from `label` by what is varied; no way is called so, since names of ways have no full stop.
fn with(label: &str, varied: Varied) -> String {
    let name = varied.name();
    if label.is_empty() { name.into() } else { format!("{label}.{name}") }
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
    (outcome, raised): (&Outcome, Option<&Raised>),
    squeezed: &mut Squeezed,
) -> Result<(), Failure> {
    let mut stage = Deviations { comfort: study.comfort, varied: Vec::new(), failed: None };
    let (mut others, mut comforts) = (Vec::new(), Vec::new());
    let raised = raised.filter(|_| is_fitted(study, plan));
    for (what, other) in variations(plan, &study.comfort, raised.is_some()) {
        let calibration = match raised.filter(|_| what == Varied::Moduli) {
            None => &outcome.calibration,
            Some(Ok(calibration)) => calibration,
            Some(Err(why)) => {
                stage.failed.get_or_insert(format!("{}: {why}", what.name()));
                continue;
            }
        };
        match varied(study, (what, &other), label, run, (&outcome.mesh, calibration)) {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Designs may be called `thin` and `thin_place`.
    #[test]
    fn no_other_way_is_called_as_one_that_is_varied() {
        assert_eq!(with("thin", Varied::Place), "thin.place");
        assert_eq!(with("", Varied::Jm), "jm");
    }
}
