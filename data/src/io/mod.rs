//! Readers and writers of files.

pub mod dicom;
pub mod hdf5;
pub mod landmarks;
pub mod metaimage;
pub mod nifti;
pub mod picture;
pub mod ply;
pub mod stl;
pub mod torque;
