//! How much depends on the tissues: gravity over each parameter, and the error of the model over all moduli.

mod page;
pub mod profiles;

pub use page::{errors, page, sweeps, thesis_sweeps};

use crate::graph::{Fitted, fitted, gravity, measured, meshed};
use mammotwin_data::{
    Failure,
    store::{Run, Stored},
    study::Study,
};
use mammotwin_stages::sensitivity::{ErrorRow, Errors, Parameter, Sweep, Swept};

/// What [`vary`] makes.
#[derive(Debug)]
pub struct Varied {
    /// Gravity from behind over each parameter.
    pub sweeps: Vec<Stored<Swept>>,
    /// Errors of the model, row after row of the plan.
    pub rows: Vec<Stored<Errors>>,
}

/// Moduli (kPa) over which the error of the model is mapped.
#[derive(Debug, Clone)]
pub struct ErrorMap {
    /// Of both breasts.
    pub breast_kpa: Vec<f64>,
    /// Of the skin and of the fascia, row after row.
    pub rows: Vec<[f64; 2]>,
}

/// Varies the tissues of a study: gravity from behind over each parameter, and, where asked for, the
/// error of the model over all moduli.
pub fn vary(
    study: &Study,
    sweeps: &[(Parameter, Vec<f64>)],
    map: &ErrorMap,
    run: &Run<'_>,
) -> Result<Varied, Failure> {
    let reference = study.reference_pose();
    let measured = measured(study, reference, run)?;
    let first = &measured.images[reference];
    let mesh = meshed(study, study.mesh, "", &first.labels, run)?;
    let sweep = |(parameter, values): &(Parameter, Vec<f64>)| {
        let (parameter, values) = (*parameter, values.clone());
        let sweep = Sweep { model: study.model.clone(), parameter, values };
        run.stage(parameter.name(), &sweep, &mesh)
    };
    let sweeps = sweeps.iter().map(sweep).collect::<Result<_, _>>()?;
    let Fitted { names, motions, surfaces } = fitted(study, &measured);
    let row = |&[skin_kpa, fascia_kpa]: &[f64; 2]| {
        let mut model = study.model.clone();
        (model.skin.young_kpa, model.fascia.young_kpa) = (skin_kpa, fascia_kpa);
        let row = ErrorRow {
            model,
            plan: study.calibrate.clone(),
            gravity: gravity(reference, &study.poses[reference])?,
            reference: reference.into(),
            poses: names.clone(),
            breast_kpa: map.breast_kpa.clone(),
        };
        let label = format!("skin_{skin_kpa}_fascia_{fascia_kpa}").replace('.', "-");
        run.stage(&label, &row, (&mesh, &first.surfaces, &motions[..], &surfaces[..]))
    };
    let rows = map.rows.iter().map(row).collect::<Result<_, _>>()?;
    Ok(Varied { sweeps, rows })
}
