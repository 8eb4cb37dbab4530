//! Which effect of the compression a measured course of force and thickness has and the model lacks.
//!
//! Measured are forces at several thicknesses and, where there are any, contact areas, how far the image of the
//! breast reaches, and tilts of the paddle. Each effect of the [library] changes the compression of a study;
//! its [ladder](evidence::Ladder) holds whole solutions at several amplitudes. The stiffness of all tissue and an
//! offset of the thickness are fitted in any case; other meshes say what the model's own mesh is off by. A
//! score test asks for each effect whether what is left of its change is in the record; the best are fitted
//! with both; the smallest thicknesses, which the search never saw, decide.

pub mod course;
pub mod evidence;
pub mod library;
pub mod record;
pub mod search;
mod smooth;
pub mod trial;
pub mod verdict;
