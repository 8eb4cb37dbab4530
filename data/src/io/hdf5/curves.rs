//! Curves that xarray and netCDF readers know as variables over a dimension.

use super::{Hdf5Error, Writer};
use ::hdf5::{ObjectReference, ObjectReference1, types::VarLenArray};

/// Values of one quantity along a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name of the dataset, with its unit: `force_n`.
    pub name: String,
    /// Unit; `"1"` for a pure number.
    pub units: String,
    /// What it says, in words.
    pub long_name: String,
    /// The values.
    pub values: Vec<f64>,
}

impl Column {
    /// A column from its parts.
    pub fn new(name: &str, units: &str, long_name: &str, values: Vec<f64>) -> Self {
        let [name, units, long_name] = [name, units, long_name].map(String::from);
        Self { name, units, long_name, values }
    }
}

/// Quantities over one dimension.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name of the group.
    pub name: String,
    /// What it shows, in words.
    pub long_name: String,
    /// The dimension.
    pub along: Column,
    /// The quantities; each as long as `along`.
    pub columns: Vec<Column>,
}

impl Writer {
    /// Writes a curve into `group/NAME`: `along` as an HDF5 dimension scale, the columns attached
    /// to it.
    ///
    /// # Panics
    /// When a column is not as long as the dimension.
    pub fn put_curve(&mut self, group: &str, curve: &Curve) -> Result<(), Hdf5Error> {
        let group = format!("{group}/{}", curve.name);
        let along = &curve.along;
        let scale = format!("{group}/{}", along.name);
        self.put(&scale, &along.values, &along.units, &along.long_name)?;
        self.attribute(&group, "long_name", &curve.long_name)?;
        self.ascii_attribute(&scale, "CLASS", b"DIMENSION_SCALE\0")?;
        self.attribute(&scale, "NAME", &along.name)?;
        for column in &curve.columns {
            assert_eq!(column.values.len(), along.values.len(), "{}", column.name);
            let name = format!("{group}/{}", column.name);
            self.put(&name, &column.values, &column.units, &column.long_name)?;
            self.attach(&name, &scale).map_err(|cause| self.failed(&name, cause))?;
        }
        Ok(())
    }

    /// Says that the only dimension of `name` is `scale` (attribute `DIMENSION_LIST`).
    fn attach(&self, name: &str, scale: &str) -> ::hdf5::Result<()> {
        let reference = ObjectReference1::create(&self.file, scale)?;
        let list = [VarLenArray::from_slice(&[reference])];
        let dataset = self.file.dataset(name)?;
        dataset.new_attr_builder().with_data(&list).create("DIMENSION_LIST").map(|_| ())
    }
}
