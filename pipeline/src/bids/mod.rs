//! A folder of the Brain Imaging Data Structure as input, derivatives of the same as output.
//!
//! One image for each pose: `sub-01/anat/sub-01_acq-prone_T1w.nii.gz`. What BIDS has no word for is
//! told in `docs/bids.md`.

pub mod dataset;
pub mod derivatives;
pub mod group;

/// Study of a participant when no template is given.
pub const DEFAULT_TEMPLATE: &str = include_str!("template.toml");
