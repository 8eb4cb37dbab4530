//! A pose that the calibration never saw.

use crate::{
    calibrate::{Calibration, Fit},
    mesh::BreastMesh,
    model::Body,
    pose::{PoseFit, PoseTarget},
    posture,
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    progress::Progress,
    store::{Artifact, Stage},
    study::ModelPlan,
};
use serde::Serialize;
use std::path::Path;

/// Loads the calibrated breasts into a held-out pose.
#[derive(Debug, Clone, Serialize)]
pub struct Validate {
    /// Tissues and supports.
    pub model: ModelPlan,
    /// Name of the pose.
    pub pose: String,
}

/// The held-out pose, simulated before and after the fit.
#[derive(Debug, Clone)]
pub struct Validation {
    /// With the moduli of the study and the stress-free shape that belongs to them.
    pub before: PoseFit,
    /// With the fitted moduli.
    pub after: PoseFit,
}

impl Artifact for Validation {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Ras)?;
        file.put_text("pose", &self.after.pose, "name of the pose")?;
        self.before.put(&mut file, "before")?;
        self.after.put(&mut file, "after")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let pose = file.text("pose")?;
        Ok(Self {
            before: PoseFit::get(&file, "before", &pose)?,
            after: PoseFit::get(&file, "after", &pose)?,
        })
    }
}

impl Stage for Validate {
    const NAME: &'static str = "validate";
    const VERSION: u32 = 3;
    const METHODS: &'static str = "A pose that the calibration never read was simulated from the stress-free shape; \
         distances are those of Mîra (2018, Appendix A) on the skin of the breasts.";
    type Input = (BreastMesh, Calibration, Registered, PoseSurfaces);
    type Output = Validation;

    fn run(
        &self,
        (mesh, calibration, registered, surfaces): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Validation, Failure> {
        let target = PoseTarget::new(&self.pose, mesh, registered, surfaces)?;
        // The first pose is the reference.
        if let Some(reference) = calibration.after.poses.first() {
            let shape = target.reference_shape(mesh);
            posture::refuse_wrong(&target, &reference.pose, &shape, &reference.gravity)?;
        }
        let body = Body::new(mesh, &self.model);
        let measure = |fit: &Fit, which: &str| {
            let from = |start: &[Vec3]| target.load(&body, &fit.rest, fit.moduli, start, false);
            // A tissue with a limit of stretch may not stand what the reference pose is stretched to.
            let solution = from(&mesh.mesh.points)
                .or_else(|cause| from(&fit.rest).map_err(|_| cause))
                .map_err(|cause| match cause {
                    Failure::Numerics(why) => Failure::Numerics(format!("{why} (with {which})")),
                    other => other,
                })?;
            target.measure(solution)
        };
        progress.report(0.0, "moduli of the study");
        let before = measure(&calibration.before, "the moduli of the study")?;
        progress.report(0.5, "fitted moduli");
        let after = measure(&calibration.after, "the fitted moduli")?;
        Ok(Validation { before, after })
    }
}
