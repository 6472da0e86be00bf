//! Boxes of the builder, one in a register of eight lanes.

use crate::geom::Aabb;
use crate::lanes::{Lanes, load_one, store_one, swap_halves};
use bytemuck::{Pod, Zeroable};

/// A box as its lower corner and its negated upper corner, each in the first three of four lanes, so that the
/// union of two boxes is one minimum. Lanes 3 and 7 are not part of the box.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct PackedBounds(pub [f32; 8]);

impl PackedBounds {
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    /// A box with any value in lane 3.
    #[inline]
    pub fn new(bounds: &Aabb, lane_3: f32) -> Self {
        let ([a, b, c], [x, y, z]) = (bounds.min.to_array(), bounds.max.to_array());
        Self([a, b, c, lane_3, -x, -y, -z, 0.0])
    }

    #[inline(always)]
    pub fn load<L: Lanes>(&self, l: L) -> L::F {
        load_one(l, &self.0)
    }

    #[inline(always)]
    pub fn store<L: Lanes>(l: L, bounds: L::F) -> Self {
        Self(store_one(l, bounds))
    }

    #[inline]
    pub fn union(&self, other: &Self) -> Self {
        let mut union = *self;
        for i in 0..8 {
            union.0[i] = if union.0[i] < other.0[i] { union.0[i] } else { other.0[i] };
        }
        union
    }

    /// Half the surface area. At most about 1e23, so costs stay finite; infinite for an empty box.
    #[inline(always)]
    pub fn half_area(&self) -> f32 {
        // Negated sizes: their products are those of the sizes.
        let [a, b, c, _, x, y, z, _] = self.0;
        let [x, y, z] = [a + x, b + y, c + z];
        x * y + y * z + z * x
    }

    #[inline]
    pub fn to_aabb(self) -> Aabb {
        let [a, b, c, _, x, y, z, _] = self.0;
        // Subtracted from zero, so that a corner at 0 does not become -0.
        Aabb { min: [a, b, c].into(), max: [0.0 - x, 0.0 - y, 0.0 - z].into() }
    }
}

/// The sort key of a box: twice its centre, as a packed box without extent.
#[inline(always)]
pub(super) fn key<L: Lanes>(l: L, bounds: L::F) -> L::F {
    l.sub(bounds, swap_halves(l, bounds))
}
