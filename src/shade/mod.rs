//! Shading turns hits into radiance: batch sort, surface interactions, BSDFs, lights and the loop stack.
//!
//! Integrators shade a batch run by run ([`sort()`]). All rays of a run hit the same material. Work that
//! depends only on the material is done once a run. The rest is done in SIMD lanes ([`crate::lanes`]), 8 or
//! 16 rays at a time (RA section 4). [`single`] shades one ray with the same code.

pub mod arena;
mod base_colour;
pub mod bsdf;
mod cone;
pub mod finish_blocks;
mod geometry;
mod interaction;
pub mod light;
pub mod loop_stack;
pub mod medium;
mod mix;
mod normals;
pub mod offset;
pub mod single;
mod sort;
mod surface_bounds;
#[cfg(test)]
mod tests;
mod turn;

pub use crate::scene::lookup;
pub use arena::ArenaUse;
pub use base_colour::base_colour;
pub use bsdf::Bsdf;
pub use cone::Cone;
pub use geometry::Hits;
pub use interaction::{CoatShape, Interaction, prefetch_hits};
pub use light::{LightSample, Lights, LitScene};
pub use loop_stack::LoopStack;
pub use mix::material_of;
pub use sort::{Run, Sorted, sort};
pub use surface_bounds::{SurfaceBounds, sought_materials};
