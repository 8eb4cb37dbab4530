//! The stages of the pipeline, one file each, and the breast model that they share.
//!
//! A stage is thin: it says what it needs and what it makes, and calls `imaging` and `solver`.
//! What a breast is (skin, fascia, ligaments, chest wall) is said in [`model`].

pub mod align;
pub mod artifact;
pub mod calibrate;
pub mod clamp;
pub mod comfort;
pub mod compress;
pub mod correspondence;
pub mod deliver;
pub mod discover;
pub mod effects;
pub mod fiducials;
pub mod force_curve;
pub mod gland;
pub mod image_chain;
pub mod in_view;
pub mod load_steps;
pub mod mammogram;
pub mod measure;
pub mod mesh;
pub mod mesh_study;
pub mod model;
pub mod monte_carlo;
pub mod muscle;
pub mod phantom;
pub mod pictures;
pub mod place;
pub mod pose;
pub mod posture;
pub mod quality;
pub mod register;
pub mod relabel;
pub mod report;
pub mod results;
pub mod scan;
pub mod search_box;
pub mod segment;
pub mod sensitivity;
pub mod shape;
mod span;
pub mod stiffer;
pub mod surface;
pub mod validate;
pub mod volunteer;
pub mod wall_distance;
