//! Readers and writers of files.

pub mod hdf5;
pub mod landmarks;
pub mod nifti;
pub mod picture;
