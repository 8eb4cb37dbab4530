//! Tetrahedra and their fields in the group `/VTKHDF`, which VTK, ParaView and pyvista open.
//!
//! A single state is written as version 1.0, which every VTK since 9.1 reads; a series of states
//! needs version 2.0 (VTK 9.3). Format: VTK documentation, "VTKHDF file format",
//! <https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html>.

use super::{Hdf5Error, Writer};
use crate::{Vec3, mesh::TetMesh};

/// `VTK_TETRA`.
const TETRAHEDRON: u8 = 10;

/// A quantity at the nodes or in the tetrahedra.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name with its unit: `pressure_kpa`.
    pub name: String,
    /// Unit; `"1"` for a pure number.
    pub units: String,
    /// What it says, in words.
    pub long_name: String,
    /// Numbers at one node or tetrahedron: 1, 3 or 9.
    pub components: usize,
    /// The numbers, node by node.
    pub values: Vec<f64>,
}

impl Field {
    /// One number at each node or tetrahedron.
    pub fn scalar(name: &str, units: &str, long_name: &str, values: Vec<f64>) -> Self {
        let [name, units, long_name] = [name, units, long_name].map(String::from);
        Self { name, units, long_name, components: 1, values }
    }

    /// One vector at each node or tetrahedron.
    pub fn vector(name: &str, units: &str, long_name: &str, vectors: &[Vec3]) -> Self {
        let values = vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        Self { components: 3, ..Self::scalar(name, units, long_name, values) }
    }

    fn shape(&self, states: usize) -> Vec<usize> {
        let rows = self.values.len() / self.components * states;
        if self.components == 1 { vec![rows] } else { vec![rows, self.components] }
    }
}

/// One state of a series.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Time, load or thickness that a viewer shows.
    pub value: f64,
    /// Node positions (mm).
    pub points: Vec<Vec3>,
    /// Fields at the nodes; the same names in every step.
    pub point_fields: Vec<Field>,
    /// Fields in the tetrahedra; the same names in every step.
    pub cell_fields: Vec<Field>,
}

impl Writer {
    /// Writes one state of a mesh as `/VTKHDF`, version 1.0. `points` are where the nodes are
    /// shown (mm). The cell field `tissue` is added.
    pub fn put_vtkhdf(
        &mut self,
        mesh: &TetMesh,
        points: &[Vec3],
        point_fields: &[Field],
        cell_fields: &[Field],
    ) -> Result<(), Hdf5Error> {
        self.put_cells(mesh, [1, 0])?;
        self.put("VTKHDF/Points", points, "mm", "Node positions, RAS")?;
        for (place, fields) in [("PointData", point_fields), ("CellData", cell_fields)] {
            for field in fields {
                let name = format!("VTKHDF/{place}/{}", field.name);
                let Field { units, long_name, values, .. } = field;
                self.put_array(&name, &field.shape(1), values, units, long_name)?;
            }
        }
        Ok(())
    }

    /// Writes several states of a mesh as `/VTKHDF`, version 2.0. The cell field `tissue` is
    /// added. `value_units` and `value_name` say what [`Step::value`] is.
    ///
    /// # Panics
    /// When the steps do not all have the same fields.
    pub fn put_vtkhdf_steps(
        &mut self,
        mesh: &TetMesh,
        steps: &[Step],
        value_units: &str,
        value_name: &str,
    ) -> Result<(), Hdf5Error> {
        self.put_cells(mesh, [2, 0])?;
        let points: Vec<Vec3> = steps.iter().flat_map(|step| step.points.clone()).collect();
        self.put("VTKHDF/Points", &points, "mm", "Node positions of all steps, RAS")?;
        let at = |name: &str| format!("VTKHDF/Steps/{name}");
        let values: Vec<f64> = steps.iter().map(|step| step.value).collect();
        self.put(&at("Values"), &values, value_units, value_name)?;
        self.integer_attribute("VTKHDF/Steps", "NSteps", &[steps.len() as i64])?;
        let (zeros, ones) = (vec![0i64; steps.len()], vec![1i64; steps.len()]);
        let offsets = |rows: usize| -> Vec<i64> {
            (0..steps.len()).map(|step| (step * rows) as i64).collect()
        };
        self.put(&at("PartOffsets"), &zeros, "1", "First part of each step")?;
        self.put(&at("NumberOfParts"), &ones, "1", "Parts of each step")?;
        let rows = offsets(mesh.points.len());
        self.put(&at("PointOffsets"), &rows, "1", "First node of each step")?;
        let column = [steps.len(), 1];
        let name = at("CellOffsets");
        self.put_array(&name, &column, &zeros, "1", "First tetrahedron of each step")?;
        let name = at("ConnectivityIdOffsets");
        self.put_array(&name, &column, &zeros, "1", "First node index of each step")?;
        self.put(&at("CellDataOffsets/tissue"), &zeros, "1", "First row of each step")?;

        let Some(first) = steps.first() else { return Ok(()) };
        type FieldsOf = fn(&Step) -> &[Field];
        let places: [(&str, FieldsOf); 2] =
            [("PointData", |step| &step.point_fields), ("CellData", |step| &step.cell_fields)];
        for (place, fields_of) in places {
            for (n, field) in fields_of(first).iter().enumerate() {
                let mut values = Vec::with_capacity(field.values.len() * steps.len());
                for step in steps {
                    let here = &fields_of(step)[n];
                    assert_eq!(here.name, field.name, "fields of step {}", step.value);
                    values.extend_from_slice(&here.values);
                }
                let name = format!("VTKHDF/{place}/{}", field.name);
                let shape = field.shape(steps.len());
                self.put_array(&name, &shape, &values, &field.units, &field.long_name)?;
                let rows = offsets(field.shape(1)[0]);
                let name = at(&format!("{place}Offsets/{}", field.name));
                self.put(&name, &rows, "1", "First row of each step")?;
            }
        }
        Ok(())
    }

    /// What all states share.
    fn put_cells(&mut self, mesh: &TetMesh, version: [i64; 2]) -> Result<(), Hdf5Error> {
        let at = |name: &str| format!("VTKHDF/{name}");
        let n = mesh.tets.len();
        let nodes = [mesh.points.len() as i64];
        self.put(&at("NumberOfPoints"), &nodes, "1", "Number of nodes")?;
        self.put(&at("NumberOfCells"), &[n as i64], "1", "Number of tetrahedra")?;
        let name = at("NumberOfConnectivityIds");
        self.put(&name, &[4 * n as i64], "1", "Number of node indices")?;
        let connectivity: Vec<i64> = mesh.tets.as_flattened().iter().map(|&n| n.into()).collect();
        self.put(&at("Connectivity"), &connectivity, "1", "Node indices of the tetrahedra")?;
        let offsets: Vec<i64> = (0..=n as i64).map(|cell| 4 * cell).collect();
        self.put(&at("Offsets"), &offsets, "1", "First node index of each tetrahedron")?;
        self.put(&at("Types"), &vec![TETRAHEDRON; n], "1", "VTK cell types")?;
        let tissues: Vec<u8> = mesh.tissues.iter().map(|tissue| tissue.label()).collect();
        self.put(&at("CellData/tissue"), &tissues, "1", "Tissue label")?;
        self.group(&at("PointData"))?;
        self.integer_attribute("VTKHDF", "Version", &version)?;
        self.ascii_attribute("VTKHDF", "Type", b"UnstructuredGrid")
    }
}
