//! Rays and hits in the layout that the CPU and GPUs share (RA section 4: 32 and 16 bytes).

use bytemuck::{Pod, Zeroable};

/// A ray, 32 bytes: origin and direction in world units. Hits count if `t_min <= t <= t_max`, where `t` is in
/// lengths of `direction`, which need not be normalised. [`crate::geom::CanonicalRay::new`] says which rays
/// hit nothing by definition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// The start.
    pub origin: [f32; 3],
    /// Least `t` that counts; a negative value counts as 0.
    pub t_min: f32,
    /// The direction. Its largest component must be 1e-9 to 1e9 in size, else the ray hits nothing.
    pub direction: [f32; 3],
    /// Greatest `t` that counts; may be +∞.
    pub t_max: f32,
}

impl Ray {
    /// A ray from `t` = 0 to infinity. Takes any three numbers: arrays, or vectors of any version of glam.
    #[inline]
    pub fn new(origin: impl Into<[f32; 3]>, direction: impl Into<[f32; 3]>) -> Self {
        Self { origin: origin.into(), t_min: 0.0, direction: direction.into(), t_max: f32::INFINITY }
    }

    /// A ray from one point to another: `t` is 0 at the first and 1 at the second, both included.
    pub fn between(from: impl Into<[f32; 3]>, to: impl Into<[f32; 3]>) -> Self {
        let (from, to): ([f32; 3], [f32; 3]) = (from.into(), to.into());
        let direction = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        Self { t_max: 1.0, ..Self::new(from, direction) }
    }

    /// The point at `t` lengths of the direction from the origin.
    ///
    /// ```
    /// use raystream_rays::stream::Ray;
    ///
    /// let ray = Ray::new([0.0, 1.0, 0.0], [0.0, 0.0, 2.0]);
    /// assert_eq!(ray.at(1.5).to_array(), [0.0, 1.0, 3.0]);
    /// ```
    pub fn at(&self, t: f32) -> glam::Vec3 {
        glam::Vec3::from(self.origin) + glam::Vec3::from(self.direction) * t
    }
}

/// The value of [`Hit::primitive`] for a miss.
pub const MISS: u32 = u32::MAX;

/// The nearest hit of a ray, or a miss; 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Hit {
    /// Ray parameter of the hit; +∞ for a miss.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex, 0 to 1; 0 for a miss.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, 0 to 1; 0 for a miss.
    pub v: f32,
    /// Primitive id of the triangle, or [`MISS`].
    pub primitive: u32,
}

impl Hit {
    /// A miss.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: MISS };

    /// True if the ray hit nothing.
    #[inline]
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
