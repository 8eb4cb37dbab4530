//! `results.h5` as a stage.

use super::{clamping, fits, sections};
use crate::{
    artifact::{bytes_artifact, bytes_of},
    calibrate::{Calibration, Parameter},
    compress::Compression,
    fiducials::Fiducials,
    mammogram::Mammograms,
    measure::PoseMeasures,
    mesh::BreastMesh,
    pose::PoseFit,
    quality::{Metrics, PictureRegions},
    register::Registered,
    results::{self, Picture, PoseResult, Provenance, Results, State},
    segment::Segmented,
    validate::Validation,
};
use mammotwin_data::{
    Failure,
    io::hdf5::{Column, Curve, Field},
    mesh::TetMesh,
    metric::Metric,
    progress::Progress,
    store::Stage,
    study::{ModelPlan, Study},
};
use serde::Serialize;

/// Writes what was found into one file for other programs.
#[derive(Debug, Clone, Serialize)]
pub struct Deliver {
    /// The study, without the paths of its files.
    pub study: Study,
    /// Names of the poses that were registered, in the order of the inputs.
    pub moving: Vec<String>,
    /// Names of all poses, in the order of their measures.
    pub measured: Vec<String>,
    /// What the segmentation says of its labels.
    pub segmented: Segmented,
    /// Version and stages that made the results.
    pub provenance: Provenance,
}

bytes_artifact!("The bytes of `results.h5`.", ResultsFile, "h5");

impl Stage for Deliver {
    const NAME: &'static str = "results";
    const VERSION: u32 = 10;
    const METHODS: &'static str = "";
    type Input = (
        BreastMesh,
        Calibration,
        (Vec<Validation>, Vec<Fiducials>),
        Vec<Registered>,
        Option<Compression>,
        Option<Mammograms>,
        Vec<Metrics>,
        Vec<PoseMeasures>,
    );
    type Output = ResultsFile;

    fn run(
        &self,
        (
            mesh,
            calibration,
            (validations, fiducials),
            motions,
            compression,
            mammograms,
            metrics,
            measures,
        ): &Self::Input,
        _: &dyn Progress,
    ) -> Result<ResultsFile, Failure> {
        let rest = TetMesh { points: calibration.after.rest.clone(), ..mesh.mesh.clone() };
        let poses = self.poses(calibration, validations, fiducials, motions);
        let pressure: Vec<Field> = compression.iter().flat_map(contact).collect();
        let squeezed = compression.as_ref().map(Compression::in_reference_pose);
        let muscle = mesh.muscle.as_ref().map_or(&[][..], |muscle| &muscle.tets);
        let shown = match (&squeezed, poses.last()) {
            (Some((rest, solution)), _) => Some(State {
                name: "compressed",
                long_name: "Compressed between paddle and receptor",
                rest,
                solution,
                muscle: compression.as_ref().map_or(&[], |found| &found.muscle),
                point_fields: &pressure,
            }),
            (None, Some(last)) => Some(State {
                name: &last.after.pose,
                long_name: &last.after.pose,
                rest: &rest,
                solution: &last.after.solution,
                muscle,
                point_fields: &[],
            }),
            (None, None) => None,
        };
        let mut curves: Vec<Curve> = compression.iter().map(force_thickness).collect();
        curves.extend(clamping::of(metrics).map(clamping::curve));
        curves.push(search(calibration, &self.study.model));
        let regions: Vec<&PictureRegions> = metrics.iter().flat_map(|m| &m.regions).collect();
        let mut pictures = Vec::new();
        if let Some(made) = mammograms {
            for (technique, radiograph) in made.techniques.iter().zip(&made.pictures) {
                let um = (1000.0 * technique.diameter_mm).round();
                let name = format!("calcifications_{um}um");
                let own = |r: &&&PictureRegions| r.diameter_mm == technique.diameter_mm;
                let regions = regions.iter().find(own).copied();
                pictures.push(Picture { name, radiograph, technique, regions });
            }
        }
        let measured: Vec<(&str, &PoseMeasures)> =
            self.measured.iter().map(String::as_str).zip(measures).collect();
        let metrics: Vec<Metric> = sections::round_trip(calibration)
            .into_iter()
            .chain(fits::metrics(calibration, fiducials))
            .chain(sections::walls(&self.moving, motions))
            .chain(metrics.iter().flat_map(|m| m.metrics.clone()))
            .chain(measured.iter().flat_map(|(pose, found)| found.metrics(pose)))
            .collect();
        let results = Results {
            study: &self.study,
            shown: shown.as_ref(),
            calibration: Some((calibration, &rest)),
            muscle,
            nipple_nodes: &mesh.nipple_nodes(),
            poses: &poses,
            measures: &measured,
            segmented: &self.segmented,
            compression: compression.as_ref(),
            curves: &curves,
            pictures: &pictures,
            metrics: &metrics,
            provenance: &self.provenance,
        };
        let bytes = bytes_of("results.h5", |path| results::write(path, &results))?;
        Ok(ResultsFile(bytes))
    }
}

impl Deliver {
    /// All simulated poses: the reference, those that were fitted, those that were held out.
    fn poses<'a>(
        &self,
        calibration: &'a Calibration,
        validations: &'a [Validation],
        fiducials: &'a [Fiducials],
        motions: &'a [Registered],
    ) -> Vec<PoseResult<'a>> {
        let fitted = calibration.before.poses.iter().zip(&calibration.after.poses);
        let held_out = validations.iter().map(|v| (&v.before, &v.after));
        let result = |(before, after): (&'a PoseFit, &'a PoseFit)| {
            let number = self.moving.iter().position(|name| *name == after.pose);
            let registered = number.and_then(|n| motions.get(n));
            let usage = self.study.usage(&after.pose).unwrap_or_default();
            let fiducials = fiducials.iter().find(|found| found.pose == after.pose);
            PoseResult { registered, usage, before, after, fiducials }
        };
        fitted.chain(held_out).map(result).collect()
    }
}

/// Pressure and area of the plates' contact with the skin.
fn contact(compression: &Compression) -> [Field; 2] {
    let long_name = "Contact pressure of paddle and receptor";
    let pressure = compression.contact_pressure_kpa.clone();
    let area_name = "Area of the plates' faces that the skin around the node covers";
    let area = compression.face_areas_mm2();
    [
        Field::scalar("contact_pressure_kpa", "kPa", long_name, pressure),
        Field::scalar("contact_area_mm2", "mm2", area_name, area),
    ]
}

fn force_thickness(compression: &Compression) -> Curve {
    let curve = &compression.curve;
    let column = |name: &str, units: &str, long: &str, values: &[f64]| {
        Column::new(name, units, long, values.to_vec())
    };
    Curve {
        name: "force_thickness".into(),
        long_name: "Course of the compression".into(),
        along: column("thickness_mm", "mm", "Distance of the plates", &curve.thickness_mm),
        columns: vec![
            column("force_n", "N", "Force of the paddle", &curve.force_n),
            column("receptor_force_n", "N", "Force of the receptor", &curve.receptor_force_n),
            column("tilt_deg", "deg", "Tilt of the paddle", &curve.tilt_deg),
            column("roll_deg", "deg", "Roll of the paddle", &curve.roll_deg),
            column("deflection_mm", "mm", "Deflection of the paddle", &curve.deflection_mm),
            column(
                "bulge_mm",
                "mm",
                "Skin above the paddle, beside it or in its window",
                &curve.bulge_mm,
            ),
            column(
                "moved_mm",
                "mm",
                "Largest motion of a node since the state before",
                &curve.moved_mm,
            ),
            column("contact_area_mm2", "mm2", "Contact area", &curve.contact_area_mm2),
            column("front_area_mm2", "mm2", "Contact area of the front", &curve.front_area_mm2),
            column("edge_area_mm2", "mm2", "Contact area of the other edges", &curve.edge_area_mm2),
            column("mean_pressure_kpa", "kPa", "Mean contact pressure", &curve.mean_pressure_kpa),
            column(
                "peak_pressure_kpa",
                "kPa",
                "Largest contact pressure",
                &curve.peak_pressure_kpa,
            ),
            column(
                "paddle_peak_pressure_kpa",
                "kPa",
                "Largest contact pressure on the paddle's face",
                &curve.paddle_peak_pressure_kpa,
            ),
        ],
    }
}

fn search(calibration: &Calibration, model: &ModelPlan) -> Curve {
    let trials = &calibration.trials;
    let column = |name: &str, units: &str, long: &str, of: fn(&crate::calibrate::Trial) -> f64| {
        Column::new(name, units, long, trials.iter().map(of).collect())
    };
    let number = (0..trials.len()).map(|n| n as f64).collect();
    let shared = Parameter::shared().filter_map(|parameter| {
        // The first evaluation is that of the study's numbers, which are fitted from then on.
        let first = parameter.value(&trials.first()?.moduli, model);
        parameter.given(&calibration.after.moduli)?;
        let values = trials
            .iter()
            .map(|t| parameter.given(&t.moduli).or(first).unwrap_or(f64::NAN))
            .collect();
        let name = parameter.key().replace('.', "_");
        Some(Column::new(&name, parameter.units(), &parameter.title(), values))
    });
    let shared: Vec<Column> = shared.collect();
    Curve {
        name: "calibration".into(),
        long_name: "Evaluations of the search for the moduli".into(),
        along: Column::new("trial", "1", "Number of the evaluation", number),
        columns: vec![
            column("young_right_kpa", "kPa", "Right breast", |t| t.moduli.right_kpa),
            column("young_left_kpa", "kPa", "Left breast", |t| t.moduli.left_kpa),
            column("residual_right_mm", "mm", "Right residual", |t| t.residual_right_mm),
            column("residual_left_mm", "mm", "Left residual", |t| t.residual_left_mm),
            column("misfit_mm", "mm", "Distance without rigid motion", |t| t.misfit_mm),
            column("modified_hausdorff_mm", "mm", "Modified Hausdorff distance", |t| {
                t.modified_hausdorff_mm
            }),
        ]
        .into_iter()
        .chain(shared)
        .collect(),
    }
}
