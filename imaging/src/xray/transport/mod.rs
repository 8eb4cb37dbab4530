//! Photon transport by Monte Carlo: dose in the true shape, and scatter.
//!
//! Photons of 5 to 50 keV are absorbed (photoelectric effect), lose energy (Klein-Nishina times the
//! incoherent scattering function) or turn (Rayleigh with form factors), in air, in boxes of one
//! material and in a body of several. Electrons give their energy where they are set free;
//! fluorescence, Doppler broadening, polarisation and interference between molecules are not
//! followed.
//!
//! Frame of the detector, see [`crate::xray`]. Sums are the same bits for any number of threads.

pub mod angles;
pub mod bodies;
pub mod distance;
pub mod exam;
pub mod grid;
pub mod media;
pub mod photon;
pub mod scene;
pub mod source;
pub mod study;
pub mod tally;
