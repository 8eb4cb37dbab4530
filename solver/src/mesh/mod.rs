//! Tetrahedral meshes: made from signed distances, improved, measured, cut and searched.
//!
//! [`tetrahedralize`](tetrahedralize::tetrahedralize) clips a regular lattice by one surface of a
//! [`Domain`](domain::Domain) after the other, so that the creases between them stay sharp, and
//! then lets [`improve`] move nodes and flip elements until the worst of them is good.

#[cfg(test)]
mod bodies;
pub mod clip;
pub mod crop;
pub mod domain;
mod flip;
pub mod improve;
pub mod lattice;
pub mod locate;
pub mod quadratic;
pub mod quality;
mod smooth;
pub mod tetrahedralize;
pub mod topology;

#[cfg(test)]
mod tests;
