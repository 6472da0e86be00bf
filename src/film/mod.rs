//! Accumulation, tone mapping and image files.

mod accumulation;

pub use accumulation::{Film, MAX_RADIANCE, TooManySplats};
