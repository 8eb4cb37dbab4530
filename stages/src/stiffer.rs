//! The model with the fitted moduli one standard deviation higher: what places of tissue owe to them.

use crate::{
    calibrate::{Calibration, Experiment, Measured},
    compress::Compress,
    mesh::BreastMesh,
    model::{Body, Moduli},
    place::Shapes,
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    progress::{Part, Progress},
    store::Stage,
    study::{CalibratePlan, CompressPlan, ModelPlan},
    surface::TriMesh,
};
use serde::Serialize;

/// Computes all shapes once more with stiffer breasts.
#[derive(Debug, Clone, Serialize)]
pub struct Stiffer {
    /// Tissues and supports.
    pub model: ModelPlan,
    /// How the stress-free shape is found.
    pub calibrate: CalibratePlan,
    /// Unit vector of gravity in the reference pose.
    pub gravity: Vec3,
    /// Name of the reference pose.
    pub reference: String,
    /// Names of all other poses, in the order of the inputs.
    pub poses: Vec<String>,
    /// The compression, if there is one.
    pub compress: Option<CompressPlan>,
}

/// Moduli one standard deviation of their logarithms above the fitted ones; those that were not fitted stay.
pub fn raised(calibration: &Calibration) -> Moduli {
    let (best, precision) = (calibration.after.moduli, calibration.precision);
    let up = |kpa: f64, deviation: Option<f64>| kpa * deviation.unwrap_or_default().exp();
    Moduli {
        right_kpa: up(best.right_kpa, precision.right),
        left_kpa: up(best.left_kpa, precision.left),
    }
}

impl Stage for Stiffer {
    const NAME: &'static str = "stiffer";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "What a place owes to the moduli was found from the same model with the fitted moduli one \
         standard deviation higher.";
    type Input = (
        (BreastMesh, Calibration),
        (PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>),
        Option<TriMesh>,
    );
    type Output = Shapes;

    fn run(
        &self,
        ((mesh, calibration), (reference, registered, surfaces), cad): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Shapes, Failure> {
        let first = (self.reference.as_str(), self.gravity, reference);
        let measured = Measured::new(first, &self.poses, registered, surfaces);
        let experiment = Experiment::new(mesh, &self.model, &self.calibrate, &measured)?;
        let moduli = raised(calibration);
        let (poses, plates) = (
            Part { whole: progress, from: 0.0, to: 0.5 },
            Part { whole: progress, from: 0.5, to: 1.0 },
        );
        let near = Some(&calibration.after);
        let fit = experiment.evaluate(moduli, near, &poses, "poses, stiffer")?;
        let Some(plan) = &self.compress else { return Ok(Shapes::of(&fit, None)) };
        let compress = Compress { model: self.model.clone(), plan: plan.clone() };
        let body = Body { mesh: &mesh.corners(), ..Body::new(mesh, &self.model) };
        let pressed =
            compress.press(&body, compress.start(&fit)?, moduli, cad.as_ref(), &plates)?;
        Ok(Shapes::of(&fit, Some(&pressed)))
    }
}
