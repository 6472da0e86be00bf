//! Makes a scene ready to trace: builds its tree, opens the units (the CPU, a GPU) and gives each a tracer.
//! The integrators in [`crate::render`] know none of these.

mod alpha_filter;
mod prepared_scene;
mod tree;
mod units;

pub use prepared_scene::PreparedScene;
pub use tree::{WORTH_SAVING, build as build_tree};
#[cfg(feature = "gpu")]
pub use units::calibration_host;
pub use units::{UnitChoice, Units, UnitsError};
