//! The stages of the pipeline, one file each, and the breast model that they share.
//!
//! A stage is thin: it says what it needs and what it makes, and calls `imaging` and `solver`.

pub mod report;
pub mod results;
pub mod volunteer;
