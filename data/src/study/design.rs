//! Designs of paddles in a file of their own: what each changes in a compression.

use super::{
    BiopsyPlan, CompressPlan, CurvePlan, CushionPlan, GimbalPlan, HingePlan, OutlinePlan,
    PaddleName, PlatePlan, SpotPlan, StudyError,
    validate::{Refusal, plain_name},
    validate_paddles, wording,
};
use serde::Deserialize;
use std::collections::BTreeMap;

/// One design: a paddle with its own table, as in `[compress]`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DesignPlan {
    /// Paddle.
    pub paddle: PaddleName,
    /// Hinge of a flex paddle.
    pub hinge: Option<HingePlan>,
    /// Plate of an elastic paddle.
    pub plate: Option<PlatePlan>,
    /// Shape of a curved paddle.
    pub curve: Option<CurvePlan>,
    /// Gimbal of a tilting paddle.
    pub gimbal: Option<GimbalPlan>,
    /// Where the plate ends; that of the study when absent.
    pub outline: Option<OutlinePlan>,
    /// A spot paddle.
    pub spot: Option<SpotPlan>,
    /// Window of a biopsy paddle.
    pub biopsy: Option<BiopsyPlan>,
    /// Foam of a cushion.
    pub cushion: Option<CushionPlan>,
    /// Radius (mm) of the rounded edges of both plates; that of the study when absent.
    pub edge_radius_mm: Option<f64>,
    /// Friction between skin and plates; that of the study when absent.
    pub friction: Option<f64>,
}

impl DesignPlan {
    /// A compression under this design.
    pub fn of(&self, plan: &CompressPlan) -> CompressPlan {
        let under = plan.under(self.paddle);
        CompressPlan {
            hinge: self.hinge.clone(),
            plate: self.plate,
            curve: self.curve,
            gimbal: self.gimbal,
            outline: self.outline.or(under.outline),
            spot: self.spot,
            biopsy: self.biopsy,
            cushion: self.cushion,
            edge_radius_mm: self.edge_radius_mm.unwrap_or(under.edge_radius_mm),
            friction: self.friction.unwrap_or(under.friction),
            ..under
        }
    }
}

/// Reads a file of designs, a table `[NAME]` each.
///
/// # Errors
/// Keys that are not known, names that are none, paddles that cannot be meant under `plan`.
pub fn designs(
    text: &str,
    plan: &CompressPlan,
) -> Result<BTreeMap<String, CompressPlan>, StudyError> {
    let read: BTreeMap<String, DesignPlan> =
        toml::from_str(text).map_err(|error| wording::refused(&error, text))?;
    let mut made = BTreeMap::new();
    for (name, design) in read {
        let under = design.of(plan);
        let checked = plain_name(&name, &name).and_then(|()| {
            if design.paddle == PaddleName::Cad {
                let why = "a paddle from CAD is named in the study; write paddle = \"cad\" there";
                return super::validate::refuse("compress.paddle", why);
            }
            if under.hinge.as_ref().is_some_and(|hinge| hinge.file.is_some()) {
                let why = "a measured hinge is named in the study; give its two numbers here";
                return super::validate::refuse("compress.hinge.file", why);
            }
            super::validate::within("compress.friction", under.friction, 0.0, 2.0)?;
            validate_paddles::paddle(&under)
        });
        if let Err(Refusal { path, why }) = checked {
            let path = match path.strip_prefix("compress") {
                Some(key) => format!("{name}{key}"),
                None => path,
            };
            return Err(StudyError::at_key(text, &path, &why));
        }
        made.insert(name, under);
    }
    Ok(made)
}
