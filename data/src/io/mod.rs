//! Readers and writers of files.

pub mod hdf5;
pub mod nifti;
