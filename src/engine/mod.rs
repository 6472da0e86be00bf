//! Prepares a scene for tracing: checks it, builds its tree, opens the units (the CPU, a GPU) and makes a tracer for
//! each. The integrators in [`crate::render`] do not depend on trees, units or tracers;
//! [`PreparedScene::submit`] brings both together.

mod alpha_filter;
#[cfg_attr(not(feature = "gpu"), path = "no_gpu.rs")]
mod gpu;
#[cfg(feature = "gpu")]
mod opening;
mod prepared_scene;
mod tree;
mod units;

#[cfg(feature = "gpu")]
pub use gpu::calibration_host;
pub use prepared_scene::PreparedScene;
pub use tree::{MIN_SAVED_TRIANGLES, build as build_tree};
pub use units::{UnitChoice, Units, UnitsError};
