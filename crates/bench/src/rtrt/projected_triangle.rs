//! A triangle as edges in a plane of two axes: 48 bytes (RTRT, section 3.1).

use super::packet::Packet;
use glam::{BVec4A, Vec3, Vec4};

/// The scaled equations of a triangle's plane and of two of its edges, projected along the axis to which its normal is
/// closest. The other axes, u and v, follow that one in turn.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct ProjectedTriangle {
    /// The plane: t = (offset − origin · normal) / (direction · normal), where the normal's own axis is 1.
    normal: [f32; 2],
    offset: f32,
    /// The weight of the second corner is `u · second[0] + v · second[1] + second[2]`.
    second: [f32; 3],
    /// That of the third corner.
    third: [f32; 3],
    axis: u32,
}

const _: () = assert!(size_of::<ProjectedTriangle>() == 48);

impl ProjectedTriangle {
    /// `None` if the triangle has no area.
    pub fn new(&[a, b, c]: &[Vec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a);
        let axis = normal.abs().max_position();
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (to_b, to_c) = (b - a, c - a);
        // Twice the projected area.
        let area = to_b[u] * to_c[v] - to_b[v] * to_c[u];
        if area == 0.0 || !area.is_finite() {
            return None;
        }
        let weight = |[along_u, along_v]: [f32; 2]| [along_u, along_v, -(a[u] * along_u + a[v] * along_v)];
        Some(Self {
            normal: [normal[u], normal[v]].map(|component| component / normal[axis]),
            offset: a.dot(normal) / normal[axis],
            second: weight([to_c[v] / area, -to_c[u] / area]),
            third: weight([-to_b[v] / area, to_b[u] / area]),
            axis: axis as u32,
        })
    }

    /// Distances of four rays, and which of them hit the triangle between `near` and `far`.
    #[inline(always)]
    pub fn test(&self, packet: &Packet, near: Vec4, far: Vec4) -> (Vec4, BVec4A) {
        match self.axis {
            0 => self.test_along::<0, 1, 2>(packet, near, far),
            1 => self.test_along::<1, 2, 0>(packet, near, far),
            _ => self.test_along::<2, 0, 1>(packet, near, far),
        }
    }

    #[inline(always)]
    fn test_along<const K: usize, const U: usize, const V: usize>(
        &self,
        packet: &Packet,
        near: Vec4,
        far: Vec4,
    ) -> (Vec4, BVec4A) {
        let (origin, direction) = (&packet.origin, &packet.direction);
        let [n_u, n_v] = self.normal.map(Vec4::splat);
        let slope = direction[K] + n_u * direction[U] + n_v * direction[V];
        let height = Vec4::splat(self.offset) - origin[K] - n_u * origin[U] - n_v * origin[V];
        let t = height / slope;
        let in_time = t.cmpge(near) & t.cmplt(far);
        if !in_time.any() {
            return (t, in_time);
        }
        let (u, v) = (origin[U] + t * direction[U], origin[V] + t * direction[V]);
        let weight = |[along_u, along_v, constant]: [f32; 3]| {
            u * Vec4::splat(along_u) + v * Vec4::splat(along_v) + Vec4::splat(constant)
        };
        let (second, third) = (weight(self.second), weight(self.third));
        let inside = second.cmpge(Vec4::ZERO) & third.cmpge(Vec4::ZERO) & (second + third).cmple(Vec4::ONE);
        (t, in_time & inside)
    }
}
