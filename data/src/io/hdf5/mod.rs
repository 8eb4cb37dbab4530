//! HDF5 files: every stage result, and the results of a study.
//!
//! A [`Writer`] makes a new file and a [`Reader`] reads one. Both know rows of plain numbers
//! ([`Row`]), shaped arrays, texts and JSON; every dataset carries the attributes `units` and
//! `long_name`. Whole values (meshes, volumes, solutions, radiographs) go into a group:
//!
//! ```
//! use mammotwin_data::{Failure, io::hdf5, mesh::TetMesh};
//!
//! fn save(mesh: &TetMesh, stiffness_kpa: f64, path: &std::path::Path) -> Result<(), Failure> {
//!     let mut file = hdf5::Writer::create(path)?;
//!     file.put_mesh("mesh", mesh)?;
//!     file.put_scalar("stiffness_kpa", stiffness_kpa, "kPa", "Young's modulus")?;
//!     Ok(file.finish()?)
//! }
//!
//! fn load(path: &std::path::Path) -> Result<(TetMesh, f64), Failure> {
//!     let file = hdf5::Reader::open(path)?;
//!     Ok((file.mesh("mesh")?, file.scalar("stiffness_kpa")?))
//! }
//! ```
//!
//! Equal calls give equal bytes: no times are kept, objects lie in the order of the calls.
//! `f64` and `f32` values are kept bit by bit.

mod curves;
mod error;
mod images;
mod meshes;
mod reader;
mod row;
mod vtkhdf;
mod writer;

pub use curves::{Column, Curve};
pub use error::Hdf5Error;
pub use reader::Reader;
pub use row::{Element, Row};
pub use vtkhdf::{Field, Step};
pub use writer::{Frame, Writer};

#[cfg(test)]
mod tests;
