//! Looking for an effect that the model of a study lacks.

use super::{Fitted, Outcome, calibrated, gravity};
use mammotwin_data::{
    Failure,
    store::{Run, Stored},
    study::{Elements, MeshPlan, Study},
};
use mammotwin_stages::{
    calibrate::Parameter,
    discover::{Discover, Discovery, Evidence, Gather},
    effects::Effect,
};

/// What [`discover`] makes.
#[derive(Debug)]
pub struct Found {
    /// Residuals, their derivatives and errors.
    pub evidence: Stored<Evidence>,
    /// The answer.
    pub discovery: Stored<Discovery>,
}

/// Edges of the quadratic elements with which effects are looked for, over those of a study's linear
/// ones: what linear elements are off is larger than most effects.
const QUADRATIC_EDGE: f64 = 1.25;

/// Whether an effect can be looked for with what a study calibrates.
fn searchable(study: &Study) -> Result<(), Failure> {
    if !study.model.muscle.rigid {
        let why = "model.muscle.rigid: effects are looked for with quadratic elements, which a deformable muscle does \
            not have; set it to true";
        return Err(Failure::BadInput(why.into()));
    }
    let fitted = Parameter::named(&study.calibrate.parameters);
    if let Some(shared) = fitted.into_iter().find(|parameter| parameter.side().is_none()) {
        let why = format!(
            "calibrate.parameters: effects are looked for beside the moduli of the breasts alone; leave {} out",
            shared.key()
        );
        return Err(Failure::BadInput(why));
    }
    if study.calibrate.stress_free.takes_another_pose() {
        let why = "calibrate.stress_free: effects are not seen where the shape is corrected until a pose fits; take \
            \"inverse\" or \"fixed_point\"";
        return Err(Failure::BadInput(why.into()));
    }
    Ok(())
}

/// Calls the stages of a study, and looks for an effect that its model lacks.
pub fn discover(
    study: &Study,
    held_out: &str,
    effects: &[&'static Effect],
    run: &Run<'_>,
) -> Result<Found, Failure> {
    searchable(study)?;
    let Outcome { reference, measured, mesh, calibration, .. } = super::run(study, run)?;
    let (meshing, mesh, calibration) = match study.mesh.elements {
        Elements::Quadratic => (study.mesh, mesh, calibration),
        Elements::Linear => {
            let size_mm = QUADRATIC_EDGE * study.mesh.size_mm;
            let meshing = MeshPlan { size_mm, elements: Elements::Quadratic };
            let (mesh, calibration) = calibrated(study, meshing, &measured, "quadratic", run)?;
            (meshing, mesh, calibration)
        }
    };
    let Fitted { names, motions, surfaces } = Fitted::of(measured.targets(study).into_iter());
    let gather = Gather {
        model: study.model.clone(),
        calibrate: study.calibrate.clone(),
        mesh: meshing,
        gravity: gravity(&reference, &study.poses[&reference])?,
        poses: names,
        reference: reference.clone(),
        held_out: held_out.into(),
        effects: effects.iter().map(|effect| effect.name).collect(),
    };
    let first = &measured.images[&reference];
    let inputs = (&first.labels, &first.surfaces, &mesh, &calibration, &motions[..], &surfaces[..]);
    let evidence = run.stage("", &gather, inputs)?;
    let discover = Discover { gather };
    let discovery = run.stage("", &discover, (&evidence, inputs))?;
    run.export("discovery.h5", &discovery)?;
    Ok(Found { evidence, discovery })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;
    use mammotwin_data::study::parse;

    #[test]
    fn a_calibration_that_hides_effects_is_refused() {
        let of = |calibrate: &str| {
            let pose = |name: &str| {
                format!(
                    "[poses.{name}]\nimage = \"{name}.nii\"\nposture = \"{name}\"\nuse = \"fit\"\n"
                )
            };
            let poses = pose("supine") + &pose("prone");
            let text = format!(
                "schema = 1\n[subject]\nid = \"v\"\n{poses}[model]\nreference_pose = \"supine\"\n[calibrate]\n{calibrate}\n"
            );
            searchable(&parse(&text).unwrap()).map_err(|why| why.to_string())
        };
        assert_eq!(of("parameters = [\"breast.young_right_kpa\"]"), Ok(()));
        let why = of("parameters = [\"skin.young_kpa\"]").unwrap_err();
        assert!(why.contains("leave skin.young_kpa out"), "{why}");
        let why = of("stress_free = \"damped_prediction_correction\"").unwrap_err();
        assert!(why.contains("until a pose fits"), "{why}");
    }
}
