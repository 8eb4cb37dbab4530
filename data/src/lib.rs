//! What flows through mammotwin, and where it is kept.
//!
//! No physics and no algorithms live here: only the values that stages hand to each other
//! ([`volume`], [`labels`], [`surface`], [`mesh`], [`solution`], [`radiograph`], [`metric`]),
//! the study that a person writes ([`study`]), readers and writers ([`io`]), and the [`store`]
//! that remembers what each stage made.
//!
//! Everything after [`io`] is in millimetres, right-anterior-superior, and in the units of
//! [`units`].

pub mod failure;
pub mod io;
pub mod labels;
pub mod landmarks;
pub mod mesh;
pub mod metric;
pub mod progress;
pub mod radiograph;
pub mod rigid;
pub mod solution;
pub mod store;
pub mod study;
pub mod surface;
pub mod tables;
pub mod units;
pub mod volume;

pub use failure::Failure;

/// 3×3 matrix: deformation gradients, stresses, rotations.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// A point or displacement in mm.
pub type Vec3 = nalgebra::Vector3<f64>;
