//! From a compressed breast to a mammogram, its quality and its dose.
//!
//! [`phantom`] puts microcalcifications into the compressed shape, [`project`] gives the path
//! length in tissue behind each pixel, [`exposure`] the quanta of a [`spectrum`] that the
//! [`detector`] counts, [`quality`] reads the picture, [`dose`] what it costs.
//!
//! Frame of all of them: x from the person's left (-) to right (+), y away from the chest wall,
//! 0 at the edge of the detector, z up from the detector's surface.

pub mod attenuation;
pub mod calcification;
pub mod calibration;
pub mod detector;
pub mod dose;
pub mod exposure;
pub mod focal_spot;
pub mod geometry;
pub mod inside;
pub mod known;
pub mod mtf;
pub mod phantom;
pub mod placement;
pub mod project;
pub mod quality;
pub mod raster;
pub mod shapes;
pub mod spectrum;
pub mod statistics;
pub mod transport;
