//! Images from outside: one program, so that its tests share the cores.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod automatic_exposure;
mod fat_suppression;
mod inclusions;
mod mammogram;
mod measures;
mod phantom;
mod projection;
mod register;
mod register_real;
mod scribbles;
mod segment;
mod segment_real;
mod transport;
mod unit;
