//! The integrators, driven without a scheduler.

mod ambient_occlusion;
#[cfg(feature = "wgsl")]
mod bases;
mod dispersion;
mod dropped;
mod filters;
#[cfg(feature = "wgsl")]
mod finish_calls;
pub mod harness;
mod layers;
mod media;
mod panes;
mod parts;
mod path;
mod pictures;
mod pinned;
mod procedural;
mod progressive;
mod ray_shader;
mod recursion;
mod reflected_lamps;
mod scattering;
mod scenes;
#[cfg(feature = "wgsl")]
mod see_through;
#[cfg(feature = "wgsl")]
mod shaders;
mod single_ray;
#[cfg(feature = "wgsl")]
mod wgsl;
mod whitted;
