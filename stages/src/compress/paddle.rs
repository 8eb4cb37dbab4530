//! The paddle of a study, as the solver knows it.

use mammotwin_data::{
    Failure,
    study::{
        CompressPlan, CurvePlan, CushionPlan, GimbalPlan, HingePlan, OutlinePlan, PaddleName,
        PlatePlan, PlateSupport, SpotName,
    },
    surface::TriMesh,
    units::NEWTON,
};
use mammotwin_solver::paddles::{
    Biopsy, CadPaddle, CurvedPlate, Cushion, ElasticPlate, Gimbal, Hinge, Outline, Paddle,
    RoundedRectangle, Sheet, Spot, SpotShape, Support,
};
use std::sync::Arc;

/// kPa of a MPa.
const MEGAPASCAL: f64 = 1000.0;

/// The paddle that a plan names, as it describes it or with assumed numbers, and where it ends;
/// `cad` is the surface in its file.
///
/// # Errors
/// An elastic plate or a surface without meaning.
pub(super) fn paddle(
    plan: &CompressPlan,
    cad: Option<&TriMesh>,
) -> Result<(Paddle, Outline), Failure> {
    let plate = plan.outline.as_ref().map(rectangle);
    let mut outline = Outline { plate, window: None };
    let paddle = match plan.paddle {
        PaddleName::Rigid => Paddle::Rigid,
        PaddleName::Flex => {
            let HingePlan { axis_mm, linear_n_mm_per_rad, quadratic_n_mm_per_rad2, .. } =
                plan.hinge.clone().unwrap_or_default();
            let linear_mn_mm = linear_n_mm_per_rad * NEWTON;
            let quadratic_mn_mm = quadratic_n_mm_per_rad2 * NEWTON;
            Paddle::Flex(Hinge { axis_mm, linear_mn_mm, quadratic_mn_mm })
        }
        PaddleName::Elastic => {
            let plate = plan.plate.unwrap_or_default();
            let elastic = ElasticPlate::new(sheet(&plate))
                .map_err(|cause| Failure::BadInput(format!("compress.plate: {cause}")))?;
            Paddle::Lifted(Arc::new(elastic))
        }
        PaddleName::Curved => {
            let CurvePlan { rise_mm, reach_mm, arch_radius_mm } = plan.curve.unwrap_or_default();
            let arch_radius_mm = arch_radius_mm.unwrap_or(f64::INFINITY);
            Paddle::Lifted(Arc::new(CurvedPlate { rise_mm, reach_mm, arch_radius_mm }))
        }
        PaddleName::Tilting => {
            let GimbalPlan { axis_mm, tilt_n_mm_per_rad, roll_n_mm_per_rad } =
                plan.gimbal.unwrap_or_default();
            let tilt_mn_mm = tilt_n_mm_per_rad * NEWTON;
            let roll_mn_mm = roll_n_mm_per_rad * NEWTON;
            Paddle::Lifted(Arc::new(Gimbal { axis_mm, tilt_mn_mm, roll_mn_mm }))
        }
        PaddleName::Spot => {
            let spot = plan.spot.unwrap_or_default();
            let shape = match spot.shape {
                SpotName::Round => SpotShape::Round,
                SpotName::Square => SpotShape::Square(spot.corner_mm),
            };
            let (size_mm, along_mm, away_mm) = (spot.size_mm, spot.along_mm, spot.away_mm);
            outline = Spot { shape, size_mm, along_mm, away_mm }.outline();
            Paddle::Rigid
        }
        PaddleName::Biopsy => {
            let plan = plan.biopsy.unwrap_or_default();
            let size = [plan.window_width_mm, plan.window_depth_mm];
            let window = RoundedRectangle::new(size, plan.corner_mm, plan.along_mm, plan.away_mm);
            let plate = plate.unwrap_or_else(|| rectangle(&OutlinePlan::SMALL));
            outline = Biopsy { plate, window }.outline();
            Paddle::Rigid
        }
        PaddleName::Cushion => {
            let CushionPlan { thickness_mm, young_kpa } = plan.cushion.unwrap_or_default();
            Paddle::Cushioned(Cushion { thickness_mm, young_kpa })
        }
        PaddleName::Cad => {
            let Some(surface) = cad else {
                let why = "compress.paddle: cad needs a file; add cad = { file = \"paddle.stl\" }";
                return Err(Failure::BadInput(why.into()));
            };
            let found = from_cad(surface, plan.edge_radius_mm)?;
            outline = found.outline;
            Paddle::Lifted(Arc::new(found.field))
        }
    };
    Ok((paddle, outline))
}

/// The paddle in a file from CAD, with edges of a radius (mm).
///
/// # Errors
/// A surface that is none.
pub fn from_cad(surface: &TriMesh, edge_radius_mm: f64) -> Result<CadPaddle, Failure> {
    CadPaddle::new(surface, edge_radius_mm)
        .map_err(|cause| Failure::BadInput(format!("compress.cad.file: {cause}")))
}

fn rectangle(plan: &OutlinePlan) -> RoundedRectangle {
    RoundedRectangle::new([plan.width_mm, plan.depth_mm], plan.corner_mm, 0.0, 0.0)
}

fn sheet(plate: &PlatePlan) -> Sheet {
    Sheet {
        width_mm: plate.width_mm,
        depth_mm: plate.depth_mm,
        thickness_mm: plate.thickness_mm,
        young_kpa: plate.young_mpa * MEGAPASCAL,
        poisson: plate.poisson,
        support: match plate.support {
            PlateSupport::Frame => Support::Frame,
            PlateSupport::AllSides => Support::AllSides,
            PlateSupport::Rear => Support::Rear,
        },
        lip_mm: plate.lip_mm,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_solver::paddles::Lift;

    #[test]
    fn the_default_plate_bends_by_millimetres_under_a_hundred_newtons() {
        // Over 120 x 60 mm at its chest-wall edge, as a breast would press. The thesis names 3.5 mm,
        // without force.
        let plate = ElasticPlate::new(sheet(&PlatePlan::default())).unwrap();
        let mut forces = mammotwin_solver::paddles::AT_REST;
        for i in 0..12 {
            for j in 0..6 {
                let place = [10.0 * f64::from(i) - 55.0, 10.0 * f64::from(j) + 5.0];
                for (force, weight) in forces.iter_mut().zip(plate.weights(place)) {
                    *force += 100.0 * NEWTON / 72.0 * weight;
                }
            }
        }
        let bend = plate.bend([0.0, 0.0], &plate.pose_under(&forces)).value;
        println!("{bend:.2} mm");
        assert!(bend > 1.0 && bend < 7.0, "{bend} mm");
    }
}
