//! Refuses calibrations that cannot be meant.

use super::{
    LawName, Study, Use,
    validate::{CALIBRATED, Checked, known, refuse},
};

/// What is to be fitted is known, and the poses can tell of it.
pub(super) fn calibrate(study: &Study) -> Checked {
    let (path, parameters) = ("calibrate.parameters", &study.calibrate.parameters);
    known(path, parameters, &CALIBRATED)?;
    let fitted = study.uses().filter(|(_, usage)| *usage == Use::Fit).count();
    if study.calibrate.stress_free.takes_another_pose() {
        corrected(study, fitted)?;
    }
    if parameters.is_empty() {
        if study.calibrate.second_start {
            let why = "repeats a search, but nothing is fitted; name calibrate.parameters or leave it out";
            return refuse("calibrate.second_start", why);
        }
        return Ok(());
    }
    if fitted < 2 {
        let why = "needs two poses with use = \"fit\"; add a pose or empty the list";
        return refuse(path, why);
    }
    let model = &study.model;
    for (tissue, law, jm) in [
        ("breast", model.breast.law, model.breast.jm),
        ("skin", model.skin.law, model.skin.jm),
        ("fascia", model.fascia.law, model.fascia.jm),
    ] {
        let key = format!("{tissue}.jm");
        if parameters.contains(&key) && (law != LawName::Gent || jm.is_none()) {
            let why = format!(
                "{key} is of the Gent law; set model.{tissue}.law = \"gent\" and a first model.{key}"
            );
            return refuse(path, why);
        }
    }
    let lies = model.interface.is_bonded() && model.muscle.rigid;
    if let Some(key) = parameters.iter().find(|key| lies && key.starts_with("fascia.")) {
        let why = format!(
            "no pose tells of {key}: the breast is bonded to a rigid chest wall, and the fascia lies on it; leave it out"
        );
        return refuse(path, why);
    }
    Ok(())
}

/// A shape that is corrected towards another pose than the reference has one, and nothing is fitted to it.
fn corrected(study: &Study, fitted: usize) -> Checked {
    let path = "calibrate.stress_free";
    if fitted < 2 {
        let why = "corrects the shape towards a second pose with use = \"fit\"; add one, or take \"inverse\"";
        return refuse(path, why);
    }
    if !study.calibrate.parameters.is_empty() {
        let why = "makes a pose fit whatever the moduli are; empty calibrate.parameters, or take \"inverse\"";
        return refuse(path, why);
    }
    if !study.model.muscle.rigid {
        let why = "is for a rigid muscle; set model.muscle.rigid to true, or take \"inverse\"";
        return refuse(path, why);
    }
    Ok(())
}
