//! Curves that xarray and netCDF readers know as variables over a dimension.

use super::{Hdf5Error, Writer};
use ::hdf5::{
    Datatype, ObjectReference, ObjectReference1,
    types::{FixedAscii, VarLenArray},
};
use hdf5_sys::h5t::H5T_str_t;

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
        self.mark_scale(&scale).map_err(|cause| self.failed(&scale, cause))?;
        self.attribute(&scale, "NAME", &along.name)?;
        for column in &curve.columns {
            assert_eq!(column.values.len(), along.values.len(), "{}", column.name);
            let name = format!("{group}/{}", column.name);
            self.put(&name, &column.values, &column.units, &column.long_name)?;
            self.attach(&name, &scale).map_err(|cause| self.failed(&name, cause))?;
        }
        Ok(())
    }

    /// Makes a dataset a dimension scale (attribute `CLASS`).
    #[allow(unsafe_code)]
    fn mark_scale(&self, name: &str) -> ::hdf5::Result<()> {
        let class = FixedAscii::<16>::from_ascii(b"DIMENSION_SCALE\0").expect("it is ASCII");
        let kind = Datatype::from_type::<FixedAscii<16>>()?;
        {
            // The library takes only a text that ends with NUL for a scale, and the wrapper pads
            // every text of fixed length with NULs instead.
            let _lock = hdf5_sys::LOCK.lock();
            // SAFETY: the identifier is that of a datatype which is ours and not yet in a file.
            unsafe { hdf5_sys::h5t::H5Tset_strpad(kind.id(), H5T_str_t::H5T_STR_NULLTERM) };
        }
        let dataset = self.file.dataset(name)?;
        dataset.new_attr_builder().empty_as(&kind).create("CLASS")?.write_scalar(&class)
    }

    /// Says that the only dimension of `name` is `scale` (attribute `DIMENSION_LIST`).
    fn attach(&self, name: &str, scale: &str) -> ::hdf5::Result<()> {
        let reference = ObjectReference1::create(&self.file, scale)?;
        let list = [VarLenArray::from_slice(&[reference])];
        let dataset = self.file.dataset(name)?;
        dataset.new_attr_builder().with_data(&list).create("DIMENSION_LIST").map(|_| ())
    }
}
