//! `results.h5`: everything that a study found out, in one file for other programs.
//!
//! The layout is documented in `docs/hdf5.md`.

mod compression;
mod poses;

pub use compression::Picture;
pub(crate) use poses::put_calibration;
pub use poses::{DRAWS, PoseResult};

use crate::{
    calibrate::Calibration, compress::Compression, measure::PoseMeasures, segment::Segmented,
};
use mammotwin_data::{
    Failure, Mat3, Vec3,
    io::hdf5::{Curve, Field, Frame, Step, Writer},
    labels::Tissue,
    mesh::TetMesh,
    metric::Metric,
    solution::{Solution, von_mises_kpa},
    study::Study,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the layout, raised when a reader must change.
pub const SCHEMA_VERSION: i64 = 2;

/// What goes into the file.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    /// The study that was run.
    pub study: &'a Study,
    /// The most advanced state of equilibrium, for `/VTKHDF`.
    pub shown: Option<&'a State<'a>>,
    /// The calibration, and the stress-free shape that belongs to the fitted moduli.
    pub calibration: Option<(&'a Calibration, &'a TetMesh)>,
    /// Tetrahedra of a deformable muscle on the nodes of that shape.
    pub muscle: &'a [[u32; 4]],
    /// Nodes of that shape which are the nipples, right first.
    pub nipple_nodes: &'a [u32],
    /// The poses, the reference first.
    pub poses: &'a [PoseResult<'a>],
    /// What the breasts measure in each pose, by its name.
    pub measures: &'a [(&'a str, &'a PoseMeasures)],
    /// What the segmentation says of the labels that it made, by pose.
    pub segmented: &'a Segmented,
    /// The compression.
    pub compression: Option<&'a Compression>,
    /// Curves, `force_thickness` among them when there was a compression.
    pub curves: &'a [Curve],
    /// Pictures of the compressed breast.
    pub pictures: &'a [Picture<'a>],
    /// The numbers of the report.
    pub metrics: &'a [Metric],
    /// What made them.
    pub provenance: &'a Provenance,
}

/// A state of equilibrium and the shape it started from.
#[derive(Debug, Clone, Copy)]
pub struct State<'a> {
    /// Name of the group: `prone`, `compressed`.
    pub name: &'a str,
    /// What it is, in words.
    pub long_name: &'a str,
    /// The mesh in its stress-free shape.
    pub rest: &'a TetMesh,
    /// The state.
    pub solution: &'a Solution,
    /// Tetrahedra of a deformable muscle on the same nodes.
    pub muscle: &'a [[u32; 4]],
    /// Further fields at the nodes, contact pressure for example.
    pub point_fields: &'a [Field],
}

/// Program and stages that made the results. No host, user, path or time: equal studies give
/// equal files.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of the program.
    pub program_version: String,
    /// The stages in the order of their work.
    pub stages: Vec<StageRecord>,
}

/// One stage that contributed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageRecord {
    /// Name of the stage.
    pub stage: String,
    /// Which one of its runs: `prone`, `right`; empty when there is only one.
    pub of: String,
    /// Key of parameters and inputs.
    pub key: String,
    /// Hash of the content.
    pub content: String,
}

/// Writes `results.h5`.
pub fn write(path: &Path, results: &Results) -> Result<(), Failure> {
    let mut file = Writer::create(path)?;
    file.frame(Frame::Ras)?;
    file.integer_attribute("/", "schema_version", &[SCHEMA_VERSION])?;
    if let Some(state) = results.shown {
        if state.muscle.is_empty() {
            let (points, cells) = fields(state);
            file.put_vtkhdf(state.rest, &state.solution.points, &points, &cells)?;
        } else {
            let (rest, solution) = with_muscle(state);
            let both = State { rest: &rest, solution: &solution, ..*state };
            let (points, cells) = fields(&both);
            file.put_vtkhdf(&rest, &solution.points, &points, &cells)?;
        }
        file.attribute("VTKHDF", "long_name", state.long_name)?;
    }
    if let Some((found, rest)) = results.calibration {
        let fitted = &results.study.calibrate.parameters;
        put_calibration(&mut file, found, fitted, rest)?;
        compression::put_muscle(&mut file, "calibration/muscle/tets", results.muscle)?;
        let long_name = "Nodes that are the nipples, right and left";
        file.put("calibration/nipple_nodes", results.nipple_nodes, "1", long_name)?;
    }
    for pose in results.poses {
        poses::put_pose(&mut file, pose)?;
    }
    for (pose, measures) in results.measures {
        poses::put_measures(&mut file, pose, measures)?;
    }
    for (pose, notes) in results.segmented {
        poses::put_segmentation(&mut file, pose, notes)?;
    }
    if let Some(found) = results.compression {
        compression::put_compression(&mut file, found)?;
    }
    for curve in results.curves {
        file.put_curve("curves", curve)?;
    }
    for picture in results.pictures {
        compression::put_picture(&mut file, picture)?;
    }
    put_metrics(&mut file, results.metrics)?;
    let parameters = without_paths(results.study)?;
    file.put_json("parameters", &parameters, "The study as JSON, without the paths of its files")?;
    put_provenance(&mut file, results.provenance)?;
    Ok(file.finish()?)
}

/// Writes the states of one mesh as a series that ParaView plays: `/VTKHDF` of version 2.0.
///
/// # Panics
/// When the states are not all of the same mesh.
pub fn write_series(path: &Path, states: &[State]) -> Result<(), Failure> {
    let Some(first) = states.first() else {
        return Err(Failure::BadInput("no state to write: run a pose or a compression".into()));
    };
    let step = |(n, state): (usize, &State)| {
        assert_eq!(state.rest.tets, first.rest.tets, "{} has another mesh", state.name);
        // Further fields may be missing in other states.
        let (point_fields, cell_fields) = fields(&State { point_fields: &[], ..*state });
        let points = state.solution.points.clone();
        Step { value: n as f64, points, point_fields, cell_fields }
    };
    let steps: Vec<Step> = states.iter().enumerate().map(step).collect();
    let names: Vec<&str> = states.iter().map(|state| state.name).collect();
    let mut file = Writer::create(path)?;
    file.put_vtkhdf_steps(first.rest, &steps, "1", "Number of the state")?;
    file.put_texts("states", &names, "Names of the states")?;
    Ok(file.finish()?)
}

/// Breast and muscle as one mesh in one state. The stress of the muscle is not known: NaN.
fn with_muscle(state: &State) -> (TetMesh, Solution) {
    let (mut rest, mut solution) = (state.rest.clone(), state.solution.clone());
    if !state.muscle.is_empty() {
        let mut of_breast = vec![false; rest.points.len()];
        rest.tets.iter().flatten().for_each(|&n| of_breast[n as usize] = true);
        let nodes = solution.mean_stress_kpa.iter_mut().zip(&of_breast);
        nodes.filter(|(_, of_breast)| !**of_breast).for_each(|(mean, _)| *mean = f64::NAN);
    }
    for tet in state.muscle {
        let edges = |points: &[Vec3]| {
            let [a, b, c, d] = tet.map(|n| points[n as usize]);
            Mat3::from_columns(&[b - a, c - a, d - a])
        };
        let inverse = edges(&state.rest.points).try_inverse();
        let gradient = inverse.map(|inverse| edges(&state.solution.points) * inverse);
        rest.tets.push(*tet);
        rest.tissues.push(Tissue::PectoralMuscle);
        solution.deformation_gradient.push(gradient.unwrap_or(Mat3::repeat(f64::NAN)));
        solution.cauchy_kpa.push(Mat3::repeat(f64::NAN));
    }
    (rest, solution)
}

/// Fields at the nodes and in the tetrahedra; displacement and mean stress come first.
fn fields(state: &State) -> (Vec<Field>, Vec<Field>) {
    let Solution { points, mean_stress_kpa, deformation_gradient, cauchy_kpa, .. } = state.solution;
    let moved: Vec<Vec3> =
        points.iter().zip(&state.rest.points).map(|(x, rest)| x - rest).collect();
    let long_name = "Displacement from the stress-free shape";
    let displacement = Field::vector("displacement_mm", "mm", long_name, &moved);
    let long_name = "Mean stress tr σ / 3, negative in compression";
    let mean = Field::scalar("mean_stress_kpa", "kPa", long_name, mean_stress_kpa.clone());
    let point_fields = [&[displacement, mean], state.point_fields].concat();

    let scalar =
        |name, units, long_name, values: Vec<f64>| Field::scalar(name, units, long_name, values);
    let mises = cauchy_kpa.iter().map(von_mises_kpa).collect();
    let stretches: Vec<Vec3> = deformation_gradient.iter().map(principal_stretches).collect();
    let ratios = deformation_gradient.iter().map(Mat3::determinant).collect();
    let long_name = "Principal stretches, largest first";
    let cell_fields = vec![
        scalar("von_mises_kpa", "kPa", "Von Mises stress", mises),
        scalar("volume_ratio", "1", "Volume over stress-free volume, det F", ratios),
        Field::vector("principal_stretches", "1", long_name, &stretches),
    ];
    (point_fields, cell_fields)
}

/// Principal stretches, largest first: the singular values of F.
pub fn principal_stretches(gradient: &Mat3) -> Vec3 {
    let squares = (gradient.transpose() * gradient).symmetric_eigenvalues();
    let mut stretches = squares.map(|square| square.max(0.0).sqrt());
    stretches.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    stretches
}

fn put_metrics(file: &mut Writer, metrics: &[Metric]) -> Result<(), Failure> {
    let texts = |of: fn(&Metric) -> &str| metrics.iter().map(of).collect::<Vec<&str>>();
    file.put_texts("metrics/name", &texts(|m| &m.name), "Name with its unit")?;
    file.put_texts("metrics/long_name", &texts(|m| &m.long_name), "What it says")?;
    let unit = |m: &Metric| if m.unit.is_empty() { "1".into() } else { m.unit.clone() };
    let units: Vec<String> = metrics.iter().map(unit).collect();
    file.put_texts("metrics/unit", &units, "Unit of value and thesis")?;
    let values: Vec<f64> = metrics.iter().map(|m| m.value).collect();
    file.put("metrics/value", &values, "see unit", "Value")?;
    let sd: Vec<f64> = metrics.iter().map(|m| m.sd.unwrap_or(f64::NAN)).collect();
    let long =
        "One standard deviation of the value from the fitted moduli, NaN where it was not computed";
    file.put("metrics/sd", &sd, "see unit", long)?;
    let thesis: Vec<f64> = metrics.iter().map(|m| m.thesis.unwrap_or(f64::NAN)).collect();
    file.put("metrics/thesis", &thesis, "see unit", "Value of Mîra (2018), NaN for none")?;
    file.put_texts("metrics/source", &texts(|m| &m.source), "Equation or table it comes from")?;
    Ok(())
}

fn put_provenance(file: &mut Writer, provenance: &Provenance) -> Result<(), Failure> {
    let version = &provenance.program_version;
    file.put_text("provenance/program_version", version, "Version of mammotwin")?;
    let texts =
        |of: fn(&StageRecord) -> &str| provenance.stages.iter().map(of).collect::<Vec<&str>>();
    file.put_texts("provenance/stage", &texts(|s| &s.stage), "Stage")?;
    file.put_texts("provenance/of", &texts(|s| &s.of), "Pose or side of the stage")?;
    file.put_texts("provenance/key", &texts(|s| &s.key), "Key of parameters and inputs")?;
    file.put_texts("provenance/content", &texts(|s| &s.content), "Hash of the content")?;
    Ok(())
}

/// The study as JSON without the names of files, which may name people.
fn without_paths(study: &Study) -> Result<serde_json::Value, Failure> {
    let mut value = serde_json::to_value(study)
        .map_err(|cause| Failure::BadInput(format!("study: {cause}")))?;
    let poses = value.get_mut("poses").and_then(|poses| poses.as_object_mut());
    for pose in poses.into_iter().flat_map(|poses| poses.values_mut()) {
        if let Some(keys) = pose.as_object_mut() {
            keys.retain(|key, _| {
                !["image", "landmarks", "labels", "scribbles"].contains(&key.as_str())
            });
        }
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::solution::principal_stresses_kpa;

    #[test]
    fn stretches_of_a_rotated_stretch_are_its_diagonal() {
        let rotation = *nalgebra::Rotation3::new(Vec3::new(0.3, -0.8, 1.1)).matrix();
        let stretch = Mat3::from_diagonal(&Vec3::new(0.7, 1.9, 1.2));
        let got = principal_stretches(&(rotation * stretch));
        assert!((got - Vec3::new(1.9, 1.2, 0.7)).norm() < 1e-12, "{got}");
    }

    #[test]
    fn mises_stress_of_tension_and_of_pressure() {
        let tension = Mat3::from_diagonal(&Vec3::new(3.0, 0.0, 0.0));
        assert!((von_mises_kpa(&tension) - 3.0).abs() < 1e-12);
        assert!(von_mises_kpa(&(Mat3::identity() * -5.0)) < 1e-12);
        // Simple shear τ: √3 τ.
        let shear = Mat3::new(0.0, 2.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        assert!((von_mises_kpa(&shear) - 2.0 * 3f64.sqrt()).abs() < 1e-12);
        let [most, least] = principal_stresses_kpa(&(shear - Mat3::identity()));
        assert!((most - 1.0).abs() < 1e-12 && (least + 3.0).abs() < 1e-12);
    }

    #[test]
    fn no_file_name_of_the_study_gets_into_the_results() {
        let text = "schema = 1\n[subject]\nid = \"dv\"\n[poses.prone]\n\
                    image = \"/home/jane_doe/prone.nii.gz\"\nlandmarks = \"jane.csv\"\n\
                    posture = \"prone\"\n";
        let study = mammotwin_data::study::parse(text).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.h5");
        let results = Results {
            study: &study,
            shown: None,
            calibration: None,
            muscle: &[],
            nipple_nodes: &[],
            poses: &[],
            measures: &[],
            segmented: &Segmented::new(),
            compression: None,
            curves: &[],
            pictures: &[],
            metrics: &[Metric::new("a_mm", "A", "mm", 1.0, "eq. 1").beside(2.0)],
            provenance: &Provenance::default(),
        };
        write(&path, &results).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let holds = |word: &str| bytes.windows(word.len()).any(|part| part == word.as_bytes());
        assert!(!holds("jane") && !holds("prone.nii") && holds("prone"));
    }
}
