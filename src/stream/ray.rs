//! Rays and hits as they lie in memory, on CPU and GPU alike (RA section 4: 32 and 16 bytes).

use bytemuck::{Pod, Zeroable};

/// A ray: origin and direction in world units, hits count for `t_min <= t <= t_max`, `t` in lengths
/// of `direction` (which need not be normalised). [`crate::geom::CanonicalRay::new`] says which rays
/// hit nothing by definition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: [f32; 3],
    /// Least `t` that counts; below 0 counts as 0.
    pub t_min: f32,
    /// Where it goes.
    pub direction: [f32; 3],
    /// Greatest `t` that counts; may be +∞.
    pub t_max: f32,
}

impl Ray {
    /// A ray that looks as far as there is anything.
    pub fn new(origin: glam::Vec3, direction: glam::Vec3) -> Self {
        Self { origin: origin.into(), t_min: 0.0, direction: direction.into(), t_max: f32::INFINITY }
    }

    /// A ray from one point to another: `t` is 0 at the first and 1 at the second, both included.
    pub fn between(from: glam::Vec3, to: glam::Vec3) -> Self {
        Self { t_max: 1.0, ..Self::new(from, to - from) }
    }
}

/// The value of [`Hit::primitive`] of a ray that hit nothing.
pub const MISS: u32 = u32::MAX;

/// The nearest hit of a ray, or a miss.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Hit {
    /// Ray parameter of the hit; +∞ for a miss.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex; 0 for a miss.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex; 0 for a miss.
    pub v: f32,
    /// Index of the triangle in the scene's order, or [`MISS`].
    pub primitive: u32,
}

impl Hit {
    /// No hit.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: MISS };

    /// Whether nothing was hit.
    pub fn is_miss(&self) -> bool {
        self.primitive == MISS
    }
}

impl Default for Hit {
    fn default() -> Self {
        Self::NONE
    }
}

const _: () = assert!(size_of::<Ray>() == 32 && size_of::<Hit>() == 16);
