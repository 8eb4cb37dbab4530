//! What is written comes back; what is damaged is refused.

use super::*;
use crate::{
    Failure, Mat3, Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    radiograph::Radiograph,
    solution::{Checks, Solution},
    surface::TriMesh,
    volume::{Grid, Volume},
};
use std::path::Path;

fn mesh() -> TetMesh {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(1.0, 1.0, 1.0)];
    TetMesh {
        points,
        tets: vec![[0, 1, 2, 3], [1, 2, 3, 4]],
        tissues: vec![Tissue::AdiposeLeft, Tissue::PectoralMuscle],
        patches: [(Patch::Skin, vec![[0, 2, 1]]), (Patch::ChestWall, vec![])].into(),
    }
}

fn solution() -> Solution {
    let gradient = Mat3::new(1.0, 0.1, 0.2, 0.3, 1.4, 0.5, 0.6, 0.7, 1.8);
    Solution {
        points: mesh().points,
        mean_stress_kpa: vec![0.0, -0.0, f64::MIN_POSITIVE, 1.0 / 3.0, f64::NAN],
        deformation_gradient: vec![gradient, Mat3::identity()],
        cauchy_kpa: vec![gradient * 2.0, Mat3::zeros()],
        forces: [("gravity".into(), Vec3::y()), ("skin/fascia é".into(), Vec3::z())].into(),
        checks: Checks { iterations: 7, residual: 1e-9, ..Checks::default() },
    }
}

fn volume() -> Volume<f32> {
    let axes = Mat3::new(0.5, 0.01, 0.0, 0.0, 0.6, 0.0, 0.02, 0.0, 2.0);
    let grid = Grid { shape: [20, 30, 40], axes, origin: Vec3::new(-1.0, 2.0, 3.0) };
    let values = (0..grid.len()).map(|n| (n as f32).sin()).collect();
    Volume { grid, values }
}

fn radiograph() -> Radiograph {
    Radiograph {
        columns: 3,
        rows: 2,
        pitch_mm: 0.1,
        left_mm: -5.0,
        first_row_mm: 0.05,
        pixels: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        quantity: "path length (mm)".into(),
    }
}

fn write_everything(path: &Path) -> Result<(), Hdf5Error> {
    let mut file = Writer::create(path)?;
    file.put_mesh("/mesh", &mesh())?;
    file.put_solution("state/prone", &solution())?;
    file.put_volume("scan", &volume(), "1", "MR signal")?;
    file.put_labels(
        "labels",
        &volume().map(|v| if v > 0.0 { Tissue::Skin } else { Tissue::Other }),
    )?;
    file.put_radiograph("picture", &radiograph())?;
    let TetMesh { points, .. } = mesh();
    file.put_surface("skin", &TriMesh { points, triangles: vec![[0, 1, 2], [4, 3, 2]] })?;
    file.put_json("checks", &solution().checks, "As JSON")?;
    file.attribute("/", "coordinate_system", "RAS mm")?;
    file.finish()
}

#[test]
fn everything_comes_back_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.h5");
    write_everything(&path).unwrap();
    let file = Reader::open(&path).unwrap();
    assert_eq!(file.mesh("mesh").unwrap(), mesh());
    assert_eq!(file.volume::<f32>("/scan").unwrap(), volume());
    assert_eq!(file.radiograph("picture").unwrap(), radiograph());
    assert_eq!(file.surface("skin").unwrap().triangles[1], [4, 3, 2]);
    assert_eq!(file.labels("labels").unwrap().at([1, 0, 0]), Tissue::Skin);
    assert_eq!(file.json::<Checks>("checks").unwrap(), solution().checks);
    let (got, want) = (file.solution("state/prone").unwrap(), solution());
    let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&got.mean_stress_kpa), bits(&want.mean_stress_kpa));
    assert_eq!(got.deformation_gradient, want.deformation_gradient);
    assert_eq!(got.forces, want.forces);
    assert_eq!(got.checks, want.checks);
    assert_eq!(file.names("/").unwrap().len(), 7);
}

#[test]
fn equal_values_give_equal_bytes_at_another_time() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("first.h5"), folder.path().join("second.h5"));
    write_everything(&first).unwrap();
    // HDF5 keeps times in seconds.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    write_everything(&second).unwrap();
    assert!(std::fs::read(first).unwrap() == std::fs::read(second).unwrap());
}

#[test]
fn errors_name_the_dataset_and_what_is_needed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.h5");
    write_everything(&path).unwrap();
    let file = Reader::open(&path).unwrap();
    let text = |error: Hdf5Error| error.to_string();
    let missing = text(file.get::<f64>("mesh/stiffness").unwrap_err());
    assert!(missing.contains("no dataset mesh/stiffness"), "{missing}");
    let shape = text(file.get::<[f64; 2]>("mesh/points").unwrap_err());
    assert!(shape.contains("[5, 3]") && shape.contains("[n, 2]"), "{shape}");
    let kind = text(file.get::<f32>("mesh/points").unwrap_err());
    assert!(kind.contains("float64") && kind.contains("float32"), "{kind}");
    assert!(matches!(
        Failure::from(file.scalar::<f64>("mesh/points").unwrap_err()),
        Failure::Io { .. }
    ));
    assert!(matches!(Reader::open("/nowhere.h5").unwrap_err(), Hdf5Error::Io { .. }));
    assert!(matches!(Writer::create("/nowhere/at/all.h5").unwrap_err(), Hdf5Error::Io { .. }));
}

#[test]
fn indices_beyond_the_nodes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.h5");
    let mut file = Writer::create(&path).unwrap();
    let mut bad = mesh();
    bad.tets[1][2] = 5;
    file.put_mesh("mesh", &bad).unwrap();
    file.finish().unwrap();
    let error = Reader::open(&path).unwrap().mesh("mesh").unwrap_err().to_string();
    assert!(error.contains("node 5 of 5"), "{error}");
}

#[test]
fn a_damaged_file_is_an_error_or_another_value_but_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.h5");
    write_everything(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let broken = folder.path().join("broken.h5");
    let mut refused = 0;
    for n in 0..300usize {
        let mut bytes = whole.clone();
        if n % 3 == 0 {
            bytes.truncate(whole.len() * n / 300);
        } else {
            for k in 0..1 + n % 5 {
                let at = (n * 7919 + k * 104_729) % whole.len();
                bytes[at] ^= 1 << (n % 8);
            }
        }
        std::fs::write(&broken, &bytes).unwrap();
        let read = || -> Result<(), Hdf5Error> {
            let file = Reader::open(&broken)?;
            file.mesh("mesh")?;
            file.solution("state/prone")?;
            file.volume::<f32>("scan")?;
            file.labels("labels")?;
            file.radiograph("picture").map(|_| ())
        };
        refused += usize::from(read().is_err());
    }
    assert!(refused >= 100, "every truncated file at least: {refused}");
}

#[test]
fn a_curve_has_a_dimension_scale_and_a_grid_its_fixed_type() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.h5");
    write_grid(&path).unwrap();
    let file = ::hdf5::File::open(&path).unwrap();
    let attribute = file.group("VTKHDF").unwrap().attr("Type").unwrap();
    let kind = attribute.dtype().unwrap().to_descriptor().unwrap();
    assert_eq!(kind, ::hdf5::types::TypeDescriptor::FixedAscii(16));
    let version = file.group("VTKHDF").unwrap().attr("Version").unwrap();
    assert_eq!(version.read_raw::<i64>().unwrap(), [1, 0]);
    let force = file.dataset("curves/force_thickness/force_n").unwrap();
    assert_eq!(force.attr("DIMENSION_LIST").unwrap().shape(), [1]);
    let file = Reader::open(&path).unwrap();
    assert_eq!(file.get::<i64>("VTKHDF/Offsets").unwrap(), [0, 4, 8]);
}

fn write_grid(path: &Path) -> Result<(), Hdf5Error> {
    let (mesh, state) = (mesh(), solution());
    let mut file = Writer::create(path)?;
    let moved = Field::vector("displacement_mm", "mm", "Displacement", &state.points);
    let strain = Field::scalar("det_f", "1", "Volume ratio", vec![1.0, 0.9]);
    file.put_vtkhdf(&mesh, &state.points, &[moved], &[strain])?;
    let curve = Curve {
        name: "force_thickness".into(),
        long_name: "Compression".into(),
        along: Column::new("thickness_mm", "mm", "Distance of the plates", vec![60.0, 50.0]),
        columns: vec![Column::new("force_n", "N", "Force of the paddle", vec![1.0, 2.0])],
    };
    file.put_curve("curves", &curve)?;
    file.finish()
}

/// Two states of the same mesh.
fn steps() -> Vec<Step> {
    let step = |value: f64| Step {
        value,
        points: mesh().points.iter().map(|p| p * value).collect(),
        point_fields: vec![Field::scalar("p_kpa", "kPa", "Pressure", vec![value; 5])],
        cell_fields: vec![Field::vector("s", "1", "Stretch", &[Vec3::x() * value, Vec3::y()])],
    };
    vec![step(1.0), step(2.0)]
}

#[test]
fn steps_lie_behind_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("steps.h5");
    let mut file = Writer::create(&path).unwrap();
    file.put_vtkhdf_steps(&mesh(), &steps(), "mm", "Thickness").unwrap();
    file.finish().unwrap();
    let file = Reader::open(&path).unwrap();
    assert_eq!(file.get::<i64>("VTKHDF/Steps/PointOffsets").unwrap(), [0, 5]);
    assert_eq!(file.get::<i64>("VTKHDF/Steps/CellDataOffsets/s").unwrap(), [0, 2]);
    assert_eq!(file.get::<Vec3>("VTKHDF/Points").unwrap()[6], Vec3::x() * 2.0);
    assert_eq!(file.get::<Vec3>("VTKHDF/CellData/s").unwrap()[2], Vec3::x() * 2.0);
}
