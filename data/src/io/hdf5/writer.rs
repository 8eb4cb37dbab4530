//! Makes a new HDF5 file.

use super::{Element, Hdf5Error, Row};
use crate::rigid::RigidTransform;
use ::hdf5::{
    File,
    types::{FixedAscii, VarLenUnicode},
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Datasets from this size on are compressed (bytes).
const COMPRESS_FROM: usize = 4096;
/// Size of a chunk (bytes).
const CHUNK: usize = 1 << 18;
/// Deflate level. Floating-point noise gains little from higher ones and pays for them in time.
const DEFLATE: u8 = 2;

/// Frame of the points in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// Right-anterior-superior: of the reference pose, or of a pose's own image.
    Ras,
    /// Of the detector: x along the chest-wall edge of the plates from the nipple, y away from the
    /// chest wall, z from the receptor to the paddle.
    Detector,
}

impl Frame {
    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ras => "RAS mm",
            Self::Detector => "detector mm",
        }
    }
}

/// A new file. Nothing is safe on the disk before [`Writer::finish`] returned `Ok`.
#[derive(Debug)]
pub struct Writer {
    pub(super) file: File,
    path: PathBuf,
}

impl Writer {
    /// Makes a file; one of this name is replaced.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, Hdf5Error> {
        let path = path.as_ref().to_owned();
        let file = File::with_options()
            .with_fcpl(|plist| plist.obj_track_times(false))
            .create(&path)
            .map_err(|cause| Hdf5Error::io(&path, "cannot make the file", cause))?;
        Ok(Self { file, path })
    }

    /// Writes what is still in memory and closes the file. Without this call a full disk goes
    /// unnoticed.
    pub fn finish(self) -> Result<(), Hdf5Error> {
        let closing = |cause| Hdf5Error::io(&self.path, "cannot write the file to its end", cause);
        let flushed = self.file.flush();
        let closed = self.file.close();
        flushed.map_err(closing)?;
        closed.map_err(closing)
    }

    /// Says in which frame the points of this file are (attribute `coordinate_system`).
    pub fn frame(&mut self, frame: Frame) -> Result<(), Hdf5Error> {
        self.attribute("/", "coordinate_system", frame.name())
    }

    /// Writes a rigid motion: `rotation` row by row, and `translation_mm`.
    pub fn put_motion(
        &mut self,
        group: &str,
        motion: &RigidTransform,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let rotation = motion.rotation.transpose();
        let name = format!("{group}/rotation");
        self.put_array(&name, &[3, 3], rotation.as_slice(), "1", "Rotation, row by row")?;
        let name = format!("{group}/translation_mm");
        let after = "Translation, after the rotation";
        self.put(&name, motion.translation.as_slice(), "mm", after)?;
        self.attribute(group, "long_name", long_name)
    }

    /// Writes rows as a dataset of shape `(n, ..)`. `name` is a path; its groups are made.
    /// `units` is `"1"` for a pure number.
    pub fn put<R: Row>(
        &mut self,
        name: &str,
        rows: &[R],
        units: &str,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let mut flat = Vec::with_capacity(rows.len() * R::SHAPE.iter().product::<usize>());
        rows.iter().for_each(|row| row.flatten(&mut flat));
        let shape = [&[rows.len()], R::SHAPE].concat();
        self.put_array(name, &shape, &flat, units, long_name)
    }

    /// Writes an array with the last index fastest.
    ///
    /// # Panics
    /// When `shape` does not have as many elements as `values`.
    pub fn put_array<T: Element>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: &[T],
        units: &str,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let array = ndarray::ArrayView::from_shape(ndarray::IxDyn(shape), values)
            .expect("as many values as the shape says");
        let mut builder = self.file.new_dataset_builder();
        let bytes = size_of_val(values);
        if bytes >= COMPRESS_FROM {
            let row = bytes / shape[0];
            let mut chunk = shape.to_vec();
            chunk[0] = (CHUNK / row.max(1)).clamp(1, shape[0]);
            builder = builder.shuffle().deflate(DEFLATE).chunk(chunk);
        }
        builder.with_data(array).create(name).map_err(|cause| self.failed(name, cause))?;
        self.describe(name, units, long_name)
    }

    /// Writes one number.
    pub fn put_scalar<T: Element>(
        &mut self,
        name: &str,
        value: T,
        units: &str,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let made = self.file.new_dataset::<T>().create(name);
        made.and_then(|dataset| dataset.write_scalar(&value))
            .map_err(|cause| self.failed(name, cause))?;
        self.describe(name, units, long_name)
    }

    /// Writes one text. Its `units` are `"text"`.
    pub fn put_text(&mut self, name: &str, text: &str, long_name: &str) -> Result<(), Hdf5Error> {
        let value = self.encoded(name, text)?;
        let made = self.file.new_dataset::<VarLenUnicode>().create(name);
        made.and_then(|dataset| dataset.write_scalar(&value))
            .map_err(|cause| self.failed(name, cause))?;
        self.describe(name, "text", long_name)
    }

    /// Writes texts as a dataset of shape `(n,)`. Their `units` are `"text"`.
    pub fn put_texts(
        &mut self,
        name: &str,
        texts: &[impl AsRef<str>],
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let values: Result<Vec<_>, _> =
            texts.iter().map(|text| self.encoded(name, text.as_ref())).collect();
        let values = ndarray::Array1::from(values?);
        let builder = self.file.new_dataset_builder().with_data(&values);
        builder.create(name).map_err(|cause| self.failed(name, cause))?;
        self.describe(name, "text", long_name)
    }

    /// Writes a value as JSON text.
    ///
    /// JSON knows no NaN or infinity: they become `null` and do not come back.
    pub fn put_json(
        &mut self,
        name: &str,
        value: &impl Serialize,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let text = serde_json::to_string_pretty(value)
            .map_err(|cause| Hdf5Error::invalid(&self.path, name, cause))?;
        self.put_text(name, &text, long_name)
    }

    /// Makes a group and those above it.
    pub fn group(&mut self, name: &str) -> Result<(), Hdf5Error> {
        self.file.create_group(name).map(|_| ()).map_err(|cause| self.failed(name, cause))
    }

    /// Writes a text attribute of a dataset or group that exists; `"/"` is the file itself.
    pub fn attribute(&mut self, of: &str, name: &str, text: &str) -> Result<(), Hdf5Error> {
        let value = self.encoded(of, text)?;
        let make = |object: &::hdf5::Location| {
            object.new_attr::<VarLenUnicode>().create(name)?.write_scalar(&value)
        };
        self.located(of).and_then(|object| make(&object)).map_err(|cause| self.failed(of, cause))
    }

    /// Writes a text attribute in fixed-length ASCII, as VTK and the dimension scales want it.
    pub(super) fn ascii_attribute<const N: usize>(
        &mut self,
        of: &str,
        name: &str,
        text: &[u8; N],
    ) -> Result<(), Hdf5Error> {
        let value = FixedAscii::<N>::from_ascii(text)
            .map_err(|cause| Hdf5Error::invalid(&self.path, of, cause))?;
        let make = |object: ::hdf5::Location| {
            object.new_attr::<FixedAscii<N>>().create(name)?.write_scalar(&value)
        };
        self.located(of).and_then(make).map_err(|cause| self.failed(of, cause))
    }

    /// Writes an attribute of integers; one integer becomes a scalar. `"/"` is the file itself.
    pub fn integer_attribute(
        &mut self,
        of: &str,
        name: &str,
        values: &[i64],
    ) -> Result<(), Hdf5Error> {
        let make = |object: ::hdf5::Location| match values {
            [value] => object.new_attr::<i64>().create(name)?.write_scalar(value),
            _ => object.new_attr_builder().with_data(values).create(name).map(|_| ()),
        };
        self.located(of).and_then(make).map_err(|cause| self.failed(of, cause))
    }

    /// A dataset or group as something that can carry attributes.
    pub(super) fn located(&self, name: &str) -> ::hdf5::Result<::hdf5::Location> {
        let object = self.file.group(name).map(|group| (*group).clone());
        object.or_else(|_| self.file.dataset(name).map(|dataset| (**dataset).clone()))
    }

    pub(super) fn failed(&self, name: &str, cause: ::hdf5::Error) -> Hdf5Error {
        Hdf5Error::io(&self.path, &format!("cannot write {name}"), cause)
    }

    fn describe(&mut self, name: &str, units: &str, long_name: &str) -> Result<(), Hdf5Error> {
        self.attribute(name, "units", units)?;
        self.attribute(name, "long_name", long_name)
    }

    fn encoded(&self, name: &str, text: &str) -> Result<VarLenUnicode, Hdf5Error> {
        text.parse().map_err(|cause| Hdf5Error::invalid(&self.path, name, cause))
    }
}
