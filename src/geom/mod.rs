//! Maths without policy: boxes, the canonical triangle test, frames, sampling warps and the
//! counter-based sampler. Imports nothing of raystream.

mod aabb;
mod basis;
mod canonical;
pub mod octahedral;
mod placement;
mod sampler;
pub mod warp;

pub use aabb::Aabb;
pub use basis::Basis;
pub use canonical::{CanonicalHit, CanonicalRay, MAX_COORDINATE};
pub(crate) use canonical::{DIRECTION_RANGE, MIN_COMPONENT, SLACK};
pub use placement::Placement;
pub use sampler::Sampler;
#[cfg(any(test, feature = "render"))]
pub(crate) use sampler::mix;
#[cfg(feature = "render")]
pub(crate) use sampler::{mix_lanes, unit};
