//! Mechanics from outside: one program, so that its tests share the cores.

#![allow(clippy::unwrap_used)] // a test may fail at once

mod assembly;
mod cables;
mod calculix;
mod closed_forms;
mod common;
mod compression;
mod cook;
mod elements;
mod failures;
mod friction;
mod gliding;
mod gravity;
mod indentation;
mod paddles;
mod plates;
mod pressure;
mod quadratic;
mod refusals;
mod self_contact;
mod sensitivity;
mod smooth_curve;
mod unload;
