//! Readers and writers of files.

pub mod hdf5;
