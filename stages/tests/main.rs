//! Stages from outside: one program, so that its tests share the cores.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod calibration;
mod common;
mod curve_search;
mod effects;
mod elements;
mod force_curve;
mod gravity_share;
mod image_chain;
mod images_to_mesh;
mod interfaces;
mod ligaments;
mod meshes;
mod muscle;
mod oblique;
mod plates;
mod prestress;
mod registration;
mod skin_contact;
mod stiffness_scale;
mod surfaces;
mod unloading;
mod victre;
mod volunteer_measures;
