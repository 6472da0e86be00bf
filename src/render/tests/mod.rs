//! The integrators, driven without a scheduler.

mod ambient_occlusion;
pub mod harness;
mod path;
mod pinned;
mod progressive;
mod recursion;
mod scattering;
mod scenes;
mod single_ray;
mod whitted;
