//! A picture as data: the spec, the registry of integrators, and what renders any frame of it.
//!
//! ```text
//! RenderSpec -check→ CheckedSpec -read, change, prepare→ Rendering -integrator→ frames, units, sums → pictures
//! ```
//!
//! The command line, an options file, a job over HTTP and a unit on its way to a worker are doors to this room: each of
//! them fills in a [`RenderSpec`], and [`open()`] does the rest. What belongs to a machine alone (threads, outputs,
//! progress) is no part of a spec.

mod any_integrator;
mod at_time;
mod checked;
mod checkpoint;
mod facts;
mod frames;
mod identity;
mod material_change;
mod matrix;
mod moving;
mod open;
mod picture_file;
mod plugin_options;
mod registry;
mod rendering;
#[doc(hidden)]
pub mod scene_file;
#[doc(hidden)]
pub mod shaders;
mod spec;
mod unit;
mod views;
mod watched;

pub use any_integrator::AnyIntegrator;
pub use at_time::TimedScene;
pub use checked::{CheckedSpec, afford};
pub use checkpoint::Checkpoint;
pub use frames::Frames;
pub use material_change::MaterialChange;
pub use moving::Moving;
pub use open::{open, open_scene, open_with};
pub use picture_file::PictureFile;
pub use plugin_options::{OptionError, PluginOptions, Setting};
pub use registry::{IntegratorParams, PluginError, Registry};
pub use rendering::{Rendering, mean_samples};
pub use shaders::{ShaderSurface, Shaders};
pub use spec::*;
pub use unit::{FrameSum, Watch};
pub use watched::RenderedFrame;

/// Tells an error with its causes, without causes that its text already contains.
pub fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| {
        if told.is_empty() {
            cause
        } else if told.contains(&cause) {
            told
        } else {
            format!("{told}: {cause}")
        }
    })
}
