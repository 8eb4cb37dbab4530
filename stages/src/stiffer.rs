//! The model with the fitted moduli one standard deviation higher: what places of tissue and comfort owe to them.

use crate::{
    calibrate::{Calibration, Experiment, Measured},
    comfort::Comfort,
    compress::{Compress, Compression},
    mesh::BreastMesh,
    model::{Body, Moduli},
    place::Shapes,
    quality::Metrics,
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::Side,
    metric::Metric,
    progress::{Part, Progress},
    store::{Artifact, Stage},
    study::{CalibratePlan, ComfortPlan, CompressPlan, ModelPlan},
    surface::TriMesh,
};
use serde::Serialize;
use std::path::Path;

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
    /// How its comfort is measured.
    pub comfort: ComfortPlan,
}

/// All shapes of the stiffer model, and the comfort of its compression.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stiffened {
    /// Shapes.
    pub shapes: Shapes,
    /// Comfort; empty without a compression, when it ended early, or when the modulus of its breast was not fitted
    /// together with a standard deviation.
    pub comfort: Vec<Metric>,
    /// The key of `compress.stop` that ended the compression.
    pub met: Option<String>,
}

impl Artifact for Stiffened {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        self.shapes.put(&mut file)?;
        file.put_json("comfort", &self.comfort, "metrics of the compression")?;
        file.put_json("met", &self.met, "limit that ended it; null: none")?;
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let (comfort, met) = (file.json("comfort")?, file.json("met")?);
        Ok(Self { shapes: Shapes::get(&file)?, comfort, met })
    }
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
    const VERSION: u32 = 3;
    const METHODS: &'static str = "What a place and comfort owe to the moduli was found from the same model with the fitted moduli one \
         standard deviation higher.";
    type Input = (
        (BreastMesh, Calibration),
        (PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>),
        Option<TriMesh>,
    );
    type Output = Stiffened;

    fn run(
        &self,
        ((mesh, calibration), (reference, registered, surfaces), cad): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Stiffened, Failure> {
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
        let none = |shapes| Stiffened { shapes, ..Stiffened::default() };
        let Some(plan) = &self.compress else { return Ok(none(Shapes::of(&fit, None))) };
        let compress = Compress { model: self.model.clone(), plan: plan.clone() };
        let body = Body { mesh: &mesh.corners(), ..Body::new(mesh, &self.model) };
        let pressed =
            compress.press(&body, &compress.start(&fit)?, moduli, cad.as_ref(), &plates)?;
        let shapes = Shapes::of(&fit, Some(&pressed));
        let deviation = match plan.side {
            Side::Right => calibration.precision.right,
            Side::Left => calibration.precision.left,
        };
        if deviation.is_none() || pressed.stopped_early.is_some() {
            return Ok(none(shapes));
        }
        let mut comfort = Comfort { plan: self.comfort }.run(&pressed, &plates)?.metrics;
        comfort.retain(|metric| metric.value.is_finite());
        Ok(Stiffened { shapes, comfort, met: pressed.met })
    }
}

/// Name of the metric that is only yes or no.
const YES_OR_NO: &str = "peak_pressure_juxtathoracic";

/// Gives the metrics of comfort one standard deviation: by how much those of the stiffer breasts differ.
#[derive(Debug, Clone, Serialize)]
pub struct Deviations;

impl Stage for Deviations {
    const NAME: &'static str = "deviations";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "One standard deviation of a metric of comfort is by how much it differs when the fitted \
         moduli of the breasts are one standard deviation higher; skin, fascia, the law in compression and the mesh add to it.";
    type Input = (Metrics, Compression, Stiffened);
    type Output = Metrics;

    fn run(
        &self,
        (metrics, compression, stiffened): &Self::Input,
        _: &dyn Progress,
    ) -> Result<Metrics, Failure> {
        Ok(with_deviations(metrics, compression, stiffened))
    }
}

/// The metrics with what stiffer breasts change; as they are where the two compressions did not end alike.
fn with_deviations(metrics: &Metrics, compression: &Compression, stiffened: &Stiffened) -> Metrics {
    let mut metrics = metrics.clone();
    if compression.stopped_early.is_some() || compression.met != stiffened.met {
        return metrics;
    }
    for metric in metrics.metrics.iter_mut().filter(|metric| metric.name != YES_OR_NO) {
        let other = stiffened.comfort.iter().find(|other| other.name == metric.name);
        metric.sd = other.map(|other| (other.value - metric.value).abs());
    }
    metrics
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compress::Course;

    fn metric(name: &str, value: f64) -> Metric {
        Metric::new(name, name, "N", value, "test")
    }

    #[test]
    fn a_metric_deviates_by_what_stiffer_breasts_change() {
        let metrics = Metrics {
            metrics: vec![metric("force_n", 20.0), metric("area", 3.0), metric(YES_OR_NO, 1.0)],
            ..Metrics::default()
        };
        let pressed = |met: Option<&str>| Compression {
            met: met.map(String::from),
            ..Compression::of_course(Course::default())
        };
        let stiffened = Stiffened {
            comfort: vec![metric("force_n", 17.5), metric(YES_OR_NO, 0.0)],
            met: Some("thickness_mm".into()),
            ..Stiffened::default()
        };
        let found = with_deviations(&metrics, &pressed(Some("thickness_mm")), &stiffened);
        let sd = |n: usize| found.metrics[n].sd;
        assert_eq!((sd(0), sd(1), sd(2)), (Some(2.5), None, None));
        assert_eq!(found.metrics[0].value, 20.0);
        // Compressions that ended by other limits are not compared.
        assert_eq!(with_deviations(&metrics, &pressed(Some("force_n")), &stiffened), metrics);
        let early =
            Compression { stopped_early: Some("stalled".into()), ..pressed(Some("thickness_mm")) };
        assert_eq!(with_deviations(&metrics, &early, &stiffened), metrics);
    }

    #[test]
    fn shapes_and_comfort_come_back() {
        let stiffened = Stiffened {
            shapes: Shapes { rest: vec![Vec3::new(1.0, 2.0, 3.0)], ..Shapes::default() },
            comfort: vec![metric("force_n", 17.5)],
            met: Some("force_n".into()),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stiffened.h5");
        stiffened.save(&path).unwrap();
        assert_eq!(Stiffened::load(&path).unwrap(), stiffened);
    }
}
