//! What places of tissue and comfort owe to numbers that are known to one standard deviation only: the fitted moduli,
//! Jₘ in compression, the place of the paddle.

use crate::{
    calibrate::{Calibration, Experiment, Measured},
    compress::Compression,
    mesh::BreastMesh,
    model::Moduli,
    quality::Metrics,
    register::Registered,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3,
    labels::Side,
    progress::Progress,
    store::Stage,
    study::{CalibratePlan, ComfortPlan, CompressPlan, ModelPlan},
};
use serde::Serialize;

/// Computes stress-free shape and poses once more with stiffer breasts.
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
}

/// Moduli of the breasts one standard deviation of their logarithms above the fitted ones; those that were not fitted
/// stay, and so does what both share.
pub fn raised(calibration: &Calibration) -> Moduli {
    let precision = &calibration.precision;
    let [right, left] =
        [Side::Right, Side::Left].map(|side| precision.of_side(side).unwrap_or_default());
    calibration.after.moduli.times(right.exp(), left.exp())
}

impl Stage for Stiffer {
    const NAME: &'static str = "stiffer";
    const VERSION: u32 = 3;
    const METHODS: &'static str = "What a place and comfort owe to the moduli was found from the same model with the fitted moduli one \
         standard deviation higher.";
    type Input = ((BreastMesh, Calibration), (PoseSurfaces, Vec<Registered>, Vec<PoseSurfaces>));
    /// The fit of the stiffer model is `after`, that of the best moduli `before`.
    type Output = Calibration;

    fn run(
        &self,
        ((mesh, calibration), (reference, registered, surfaces)): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<Calibration, Failure> {
        let first = (self.reference.as_str(), self.gravity, reference);
        let measured = Measured::new(first, &self.poses, registered, surfaces);
        let experiment = Experiment::new(mesh, &self.model, &self.calibrate, &measured)?;
        let near = Some(&calibration.after);
        let after = experiment.evaluate(raised(calibration), near, progress, "poses, stiffer")?;
        Ok(Calibration { before: calibration.after.clone(), after, ..calibration.clone() })
    }
}

/// What is one standard deviation higher in a compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Varied {
    /// The fitted moduli of the breasts, in the stress-free shape, too: that of [`Stiffer`].
    Moduli,
    /// Jₘ of the law in compression.
    Jm,
    /// The distance from the chest wall to the plates' edges.
    Place,
}

impl Varied {
    /// As in names of stages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Moduli => "moduli",
            Self::Jm => "jm",
            Self::Place => "place",
        }
    }
}

/// The compressions that differ from a plan by one standard deviation of what it rests on: by the moduli where that of
/// its breast is `fitted`, by Jₘ where its law has one.
pub fn variations(
    plan: &CompressPlan,
    comfort: &ComfortPlan,
    fitted: bool,
) -> Vec<(Varied, CompressPlan)> {
    let mut all = Vec::new();
    if fitted {
        all.push((Varied::Moduli, plan.clone()));
    }
    if let Some(jm) = plan.law.jm.filter(|_| comfort.jm_sd_percent > 0.0) {
        let mut other = plan.clone();
        other.law.jm = Some(jm * (1.0 + comfort.jm_sd_percent / 100.0));
        all.push((Varied::Jm, other));
    }
    if comfort.placement_sd_mm > 0.0 {
        let mut other = plan.clone();
        other.chest_wall_distance_mm += comfort.placement_sd_mm;
        all.push((Varied::Place, other));
    }
    all
}

/// Name of the metric that is only yes or no.
const YES_OR_NO: &str = "peak_pressure_juxtathoracic";

/// Gives the metrics of comfort one standard deviation: the root of the sum of squares of what they differ by.
#[derive(Debug, Clone, Serialize)]
pub struct Deviations {
    /// By how much the compressions differ.
    pub comfort: ComfortPlan,
    /// In what the further compressions differ, in their order.
    pub varied: Vec<Varied>,
    /// Why one of them could not be computed.
    pub failed: Option<String>,
}

impl Stage for Deviations {
    const NAME: &'static str = "deviations";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "One standard deviation of a metric of comfort is the root of the sum of squares of what it differs by \
         when the fitted moduli of the breasts, Jₘ in compression, or the distance of the plates from the chest wall are one \
         standard deviation larger; skin, fascia and the mesh add to it.";
    /// Metrics, compression and fit; then the further compressions and their metrics.
    type Input = ((Metrics, Compression, Calibration), Vec<Compression>, Vec<Metrics>);
    type Output = Metrics;

    fn run(
        &self,
        ((metrics, compression, calibration), others, comforts): &Self::Input,
        _: &dyn Progress,
    ) -> Result<Metrics, Failure> {
        let deviation = calibration.precision.of_side(compression.side);
        Ok(self.with_deviations(metrics, compression, deviation, others, comforts))
    }
}

impl Deviations {
    /// The metrics with what the others differ by and what was varied; as they are, with the reason, where the
    /// compressions did not end alike. `deviation` is that of the logarithm of the modulus.
    fn with_deviations(
        &self,
        metrics: &Metrics,
        compression: &Compression,
        deviation: Option<f64>,
        others: &[Compression],
        comforts: &[Metrics],
    ) -> Metrics {
        let mut metrics = metrics.clone();
        let (mut said, mut counted) = (Vec::new(), Vec::new());
        let mut why_not = self.failed.clone();
        if compression.stopped_early.is_some() {
            why_not = Some("the compression ended before its limit".into());
        }
        for ((varied, other), comfort) in self.varied.iter().zip(others).zip(comforts) {
            let name = varied.name();
            let what = match (varied, deviation) {
                // Higher by nothing: it was not fitted after all.
                (Varied::Moduli, None) => continue,
                (Varied::Moduli, Some(sd)) => {
                    format!("fitted moduli ({:.1} %)", 100.0 * (sd.exp() - 1.0))
                }
                (Varied::Jm, _) => format!("Jₘ ({} %)", self.comfort.jm_sd_percent),
                (Varied::Place, _) => {
                    format!("place of the plates ({} mm)", self.comfort.placement_sd_mm)
                }
            };
            if other.stopped_early.is_some() || other.met != compression.met {
                why_not.get_or_insert(format!("{name}: the compression ended otherwise"));
            }
            said.push(what);
            counted.push(comfort);
        }
        if said.is_empty() {
            why_not.get_or_insert("nothing was varied".into());
        }
        if let Some(why) = why_not {
            metrics.deviations = Some(format!("none; {why}"));
            return metrics;
        }
        for metric in metrics.metrics.iter_mut().filter(|metric| metric.name != YES_OR_NO) {
            let other = |metrics: &&Metrics| {
                let found = metrics.metrics.iter().find(|other| other.name == metric.name);
                found.map_or(f64::NAN, |other| (other.value - metric.value).powi(2))
            };
            let sd = counted.iter().map(other).sum::<f64>().sqrt();
            metric.sd = sd.is_finite().then_some(sd);
        }
        metrics.deviations = Some(said.join(", "));
        metrics
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{compress::Course, force_curve::trial::Person};
    use mammotwin_data::metric::Metric;

    fn metrics(values: &[(&str, f64)]) -> Metrics {
        let metric = |(name, value): &(&str, f64)| Metric::new(name, name, "N", *value, "test");
        Metrics { metrics: values.iter().map(metric).collect(), ..Metrics::default() }
    }

    fn pressed(met: &str) -> Compression {
        Compression { met: Some(met.into()), ..Compression::of_course(Course::default()) }
    }

    #[test]
    fn a_metric_deviates_by_the_root_of_the_sum_of_squares() {
        let stage = Deviations {
            comfort: ComfortPlan::default(),
            varied: vec![Varied::Moduli, Varied::Jm, Varied::Place],
            failed: None,
        };
        let first = metrics(&[("force_n", 20.0), ("area", 3.0), (YES_OR_NO, 1.0)]);
        let comforts = [
            metrics(&[("force_n", 23.0), ("area", 3.5), (YES_OR_NO, 0.0)]),
            metrics(&[("force_n", 16.0), (YES_OR_NO, 1.0)]),
            metrics(&[("force_n", 32.0), ("area", 3.0), (YES_OR_NO, 1.0)]),
        ];
        let others = ["force_n"; 3].map(pressed);
        let of = |stage: &Deviations, deviation, met, others: &[Compression]| {
            stage.with_deviations(&first, &pressed(met), deviation, others, &comforts)
        };
        let found = of(&stage, Some(0.1), "force_n", &others);
        let sd = |found: &Metrics, n: usize| found.metrics[n].sd;
        // 3, 4 and 12; an area that one lacks has none.
        assert_eq!((sd(&found, 0), sd(&found, 1), sd(&found, 2)), (Some(13.0), None, None));
        assert_eq!(found.metrics[0].value, 20.0);
        let said = found.deviations.clone().unwrap();
        assert_eq!(said, "fitted moduli (10.5 %), Jₘ (25 %), place of the plates (2 mm)");
        // A modulus that was not fitted is left out.
        let found = of(&stage, None, "force_n", &others);
        assert!((sd(&found, 0).unwrap() - 160f64.sqrt()).abs() < 1e-12);
        // None, with the reason, where one compression ended otherwise, or failed.
        let mut mixed = others.clone();
        mixed[1] = pressed("thickness_mm");
        let mut early = others.clone();
        early[2].stopped_early = Some("stalled".into());
        let failed = Deviations { failed: Some("jm: no equilibrium".into()), ..stage.clone() };
        for (found, says) in [
            (of(&stage, Some(0.1), "force_n", &mixed), "jm: the compression ended otherwise"),
            (of(&stage, Some(0.1), "force_n", &early), "place: the compression ended otherwise"),
            (of(&failed, Some(0.1), "force_n", &others), "jm: no equilibrium"),
        ] {
            assert!(found.metrics.iter().all(|metric| metric.sd.is_none()));
            assert_eq!(found.deviations, Some(format!("none; {says}")));
        }
    }

    #[test]
    fn what_can_be_varied_is() {
        let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
        let plan = person.plan(15.0, 46.0).unwrap();
        let comfort = ComfortPlan::default();
        let all = variations(&plan, &comfort, true);
        let names: Vec<&str> = all.iter().map(|(varied, _)| varied.name()).collect();
        assert_eq!(names, ["moduli", "jm", "place"]);
        assert_eq!(all[0].1, plan);
        assert_eq!(all[1].1.law.jm, plan.law.jm.map(|jm| 1.25 * jm));
        assert_eq!(all[2].1.chest_wall_distance_mm, 17.0);
        let none = ComfortPlan { jm_sd_percent: 0.0, placement_sd_mm: 0.0, ..comfort };
        assert!(variations(&plan, &none, false).is_empty());
    }
}
