//! Mathematics that every part of the renderer shares. Of raystream it imports `lanes` only: most of it is
//! written once for any number of SIMD lanes.
//!
//! - [`CanonicalRay`], the one ray/triangle test that defines every hit to the bit, and [`Placement`], which
//!   moves instances by operations that are as exactly defined. Tracers build on these two.
//! - [`Sampler`] gives random numbers for a pixel and sample, [`warp`] maps them to directions and points,
//!   and [`Basis`] turns directions into world space. Cameras, lights and shading build on these three.
//! - [`Aabb`] is the box type, [`octahedral`] packs unit vectors, and [`Skin`] bends meshes.
//!
//! Words are defined in `docs/glossary.md`.

mod aabb;
mod basis;
mod canonical;
#[cfg(test)]
pub(crate) mod dyadic;
mod expansion;
mod half_open;
mod half_open_eight;
pub mod octahedral;
mod placement;
mod sampler;
mod skin;
pub mod warp;

pub use aabb::Aabb;
pub use basis::Basis;
#[doc(hidden)]
pub use canonical::SLACK;
pub use canonical::{CanonicalHit, CanonicalRay, MAX_COORDINATE};
#[doc(hidden)]
pub use canonical::{DIRECTION_RANGE, MIN_COMPONENT};
pub(crate) use expansion::Expansion;
pub(crate) use half_open::is_on_triangle;
#[doc(hidden)]
pub use half_open::{Crossing, HalfOpenRay};
pub(crate) use half_open_eight::{EightCrossings, EightPairs, Verdict};
pub use placement::{Placement, PlacementError};
pub use sampler::Sampler;
#[doc(hidden)]
pub use sampler::mix;
#[doc(hidden)]
pub use sampler::{mix_lanes, unit};
pub use skin::{Bend, Skin, SkinError};
