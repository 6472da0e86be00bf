//! Capacity of a ray stream.

use super::{Hit, Ray};

/// The largest number of rays and shadow rays in a stream; see [`super::RayStream::append`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Largest number of rays.
    pub rays: usize,
    /// Largest number of shadow rays.
    pub shadow_rays: usize,
}

impl Capacity {
    /// Bytes of a stream of this capacity, with its hits, its answers to shadow rays, and payloads of these
    /// types.
    pub fn bytes<P, S>(self) -> usize {
        self.rays * (size_of::<Ray>() + size_of::<Hit>() + size_of::<P>())
            + self.shadow_rays * (size_of::<Ray>() + size_of::<u32>() + size_of::<S>())
    }
}

/// The number of paths that `rays` rays and `shadow_rays` shadow rays may belong to, if every path has at
/// most one ray and `shadow_rays_per_path` ≥ 1 shadow rays. Appending the rays of `n` paths raises it by at
/// most `n`.
pub fn paths(rays: usize, shadow_rays: usize, shadow_rays_per_path: usize) -> usize {
    rays.max(shadow_rays.div_ceil(shadow_rays_per_path))
}
