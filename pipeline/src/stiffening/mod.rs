//! Jₘ and the place of the paddle from a measured course of force and thickness.

mod foretold;
mod gravity;
mod page;
mod posterior;

pub use foretold::{Foretold, foretell, foretold_chart, foretold_said, foretold_table};
pub use gravity::{Both, Hanging, gravity_table};
pub use page::{course_table, page, posterior_table, said};
pub use posterior::{Course, Grid, Marginal, Posterior, RecordError};

use crate::force_curve;
use mammotwin_data::{
    Failure,
    study::{CompressLaw, CompressPlan, LawName, StopPlan},
};
use mammotwin_stages::force_curve::record::{Channel, Reading};
use std::path::Path;

/// One point of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// Force (N).
    pub force_n: f64,
}

/// How much farther (mm) than a record the model is pressed: forces change with the thickness there too.
const FARTHER_MM: f64 = 0.5;

/// Reads the forces of a record ([`force_curve::read_record`]).
///
/// # Errors
/// [`Failure::BadInput`] with the line that cannot be meant.
pub fn read_record(path: &Path) -> Result<Vec<Measured>, Failure> {
    let forces = force_curve::read_record(path)?.0.into_iter();
    let forces = forces.filter(|reading| reading.channel == Channel::Force);
    let point = |r: Reading| Measured { thickness_mm: r.thickness_mm, force_n: r.value };
    Ok(forces.map(point).collect())
}

/// The compression of a study with another Jₘ and another place of the paddle, to the smallest
/// thickness of a record.
pub fn way(
    plan: &CompressPlan,
    jm: f64,
    distance_mm: f64,
    record: &[Measured],
) -> (String, CompressPlan) {
    let least = record.iter().map(|m| m.thickness_mm).fold(f64::INFINITY, f64::min);
    let law = CompressLaw { name: LawName::Gent, jm: Some(jm), ..plan.law };
    let stop = StopPlan { thickness_mm: Some(least - FARTHER_MM), ..StopPlan::default() };
    let label = format!("jm_{jm}_at_{distance_mm}mm").replace('.', "-");
    (label, CompressPlan { law, stop, chest_wall_distance_mm: distance_mm, ..plan.clone() })
}
