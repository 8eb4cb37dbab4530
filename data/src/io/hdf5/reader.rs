//! Reads an HDF5 file that may be damaged.

use super::{Element, Hdf5Error, Row};
use ::hdf5::{Dataset, File, H5Type, types::VarLenUnicode};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Deflate packs at most 1032 : 1, so a dataset that claims more is a damaged header.
const LARGEST_RATIO: u64 = 1100;

/// A file open for reading.
#[derive(Debug)]
pub struct Reader {
    file: File,
    path: PathBuf,
}

impl Reader {
    /// Opens a file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Hdf5Error> {
        let path = path.as_ref().to_owned();
        let file = File::open(&path)
            .map_err(|cause| Hdf5Error::io(&path, "cannot open it as HDF5", cause))?;
        Ok(Self { file, path })
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether there is a dataset or group of this path.
    pub fn has(&self, name: &str) -> bool {
        // The library looks up one link at a time.
        let mut above = String::new();
        name.split('/').filter(|part| !part.is_empty()).all(|part| {
            above.push('/');
            above.push_str(part);
            self.file.link_exists(&above)
        })
    }

    /// Names of what a group holds, sorted.
    pub fn names(&self, group: &str) -> Result<Vec<String>, Hdf5Error> {
        let names = self.file.group(group).and_then(|group| group.member_names());
        let mut names = names.map_err(|cause| self.failed(group, cause))?;
        names.sort_unstable();
        Ok(names)
    }

    /// Rows of a dataset of shape `(n, ..)`.
    pub fn get<R: Row>(&self, name: &str) -> Result<Vec<R>, Hdf5Error> {
        let (shape, flat) = self.array::<R::Element>(name)?;
        if shape.is_empty() || shape[1..] != *R::SHAPE {
            let needed = [
                &["n".to_string()],
                &R::SHAPE.iter().map(ToString::to_string).collect::<Vec<_>>()[..],
            ]
            .concat();
            return Err(self.mismatch(
                name,
                format!("{shape:?}"),
                format!("[{}]", needed.join(", ")),
            ));
        }
        let length = R::SHAPE.iter().product();
        Ok(flat.chunks_exact(length).map(R::from_flat).collect())
    }

    /// Shape and values of a dataset, last index fastest.
    pub fn array<T: Element>(&self, name: &str) -> Result<(Vec<usize>, Vec<T>), Hdf5Error> {
        let dataset = self.dataset::<T>(name)?;
        let values = dataset.read_raw().map_err(|cause| self.failed(name, cause))?;
        Ok((dataset.shape(), values))
    }

    /// One number.
    pub fn scalar<T: Element>(&self, name: &str) -> Result<T, Hdf5Error> {
        let dataset = self.dataset::<T>(name)?;
        dataset.read_scalar().map_err(|cause| self.failed(name, cause))
    }

    /// One text.
    pub fn text(&self, name: &str) -> Result<String, Hdf5Error> {
        let dataset = self.dataset::<VarLenUnicode>(name)?;
        let text = dataset.read_scalar().map_err(|cause| self.failed(name, cause))?;
        self.decoded(name, &text)
    }

    /// Texts of a dataset of shape `(n,)`.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, Hdf5Error> {
        let dataset = self.dataset::<VarLenUnicode>(name)?;
        let texts = dataset.read_raw().map_err(|cause| self.failed(name, cause))?;
        texts.iter().map(|text| self.decoded(name, text)).collect()
    }

    /// A value that was written as JSON text.
    pub fn json<T: DeserializeOwned>(&self, name: &str) -> Result<T, Hdf5Error> {
        let text = self.text(name)?;
        serde_json::from_str(&text).map_err(|cause| Hdf5Error::invalid(&self.path, name, cause))
    }

    pub(super) fn invalid(&self, name: &str, why: impl std::fmt::Display) -> Hdf5Error {
        Hdf5Error::invalid(&self.path, name, why)
    }

    /// A dataset of exactly this type that the file can really hold.
    fn dataset<T: H5Type>(&self, name: &str) -> Result<Dataset, Hdf5Error> {
        if !self.has(name) {
            return Err(Hdf5Error::Missing { path: self.path.clone(), name: name.into() });
        }
        let dataset = self.file.dataset(name).map_err(|cause| self.failed(name, cause))?;
        let kind = dataset.dtype().and_then(|kind| kind.to_descriptor());
        let kind = kind.map_err(|cause| self.failed(name, cause))?;
        if kind != T::type_descriptor() {
            return Err(self.mismatch(name, kind.to_string(), T::type_descriptor().to_string()));
        }
        let shape = dataset.get_shape().map_err(|cause| self.failed(name, cause))?;
        let bytes =
            shape.iter().try_fold(kind.size() as u64, |bytes, &n| bytes.checked_mul(n as u64));
        let limit = self.file.size().saturating_mul(LARGEST_RATIO);
        match bytes {
            Some(bytes) if bytes <= limit => Ok(dataset),
            _ => Err(self.invalid(name, format!("shape {shape:?} is more than the file can hold"))),
        }
    }

    fn failed(&self, name: &str, cause: ::hdf5::Error) -> Hdf5Error {
        Hdf5Error::io(&self.path, &format!("cannot read {name}"), cause)
    }

    fn mismatch(&self, name: &str, found: String, expected: String) -> Hdf5Error {
        Hdf5Error::Mismatch { path: self.path.clone(), name: name.into(), found, expected }
    }

    fn decoded(&self, name: &str, text: &VarLenUnicode) -> Result<String, Hdf5Error> {
        String::from_utf8(text.as_bytes().to_vec()).map_err(|cause| self.invalid(name, cause))
    }
}
