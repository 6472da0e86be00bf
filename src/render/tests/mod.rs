//! The integrators, driven without a scheduler.

pub mod harness;
mod path;
mod scenes;
mod single_ray;
mod whitted;
