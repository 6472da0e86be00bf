//! Voxels of the tree, and the part of a triangle that lies in one.

use glam::Vec3;

/// A part of space between two corners.
#[derive(Clone, Copy, Debug)]
pub struct Voxel {
    pub min: Vec3,
    pub max: Vec3,
}

/// A triangle that six planes have clipped has at most this many corners.
const MOST_CORNERS: usize = 9;

impl Voxel {
    /// Contains nothing.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest around points.
    pub fn around(points: &[Vec3]) -> Self {
        points
            .iter()
            .fold(Self::EMPTY, |voxel, &point| Self { min: voxel.min.min(point), max: voxel.max.max(point) })
    }

    /// The part that lies in both.
    pub fn common(self, other: Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    pub fn is_empty(self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Half of its surface.
    pub fn half_area(self) -> f32 {
        let Vec3 { x, y, z } = self.max - self.min;
        x * y + y * z + z * x
    }

    /// Its parts before and behind a plane across an axis.
    pub fn halves(self, axis: usize, plane: f32) -> [Self; 2] {
        let (mut before, mut behind) = (self, self);
        before.max[axis] = plane;
        behind.min[axis] = plane;
        [before, behind]
    }

    /// The smallest around the part of a triangle that lies in it. `None` if no part does.
    pub fn around_part(self, corners: &[Vec3; 3]) -> Option<Self> {
        let mut polygon = Polygon::of(corners);
        for axis in 0..3 {
            polygon = polygon.clipped(axis, self.min[axis], 1.0).clipped(axis, self.max[axis], -1.0);
        }
        let part = Self::around(polygon.corners()).common(self);
        (!part.is_empty()).then_some(part)
    }
}

/// A convex polygon.
struct Polygon {
    corners: [Vec3; MOST_CORNERS],
    count: usize,
}

impl Polygon {
    fn of(triangle: &[Vec3; 3]) -> Self {
        let mut polygon = Self { corners: [Vec3::ZERO; MOST_CORNERS], count: 0 };
        triangle.iter().for_each(|&corner| polygon.push(corner));
        polygon
    }

    fn corners(&self) -> &[Vec3] {
        &self.corners[..self.count]
    }

    /// Rounding may give a thin polygon a corner more than it can have; that corner is next to another.
    fn push(&mut self, corner: Vec3) {
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    /// The part at one side of a plane across an axis: where `sign` times the distance is not negative (Sutherland and
    /// Hodgman).
    fn clipped(&self, axis: usize, plane: f32, sign: f32) -> Self {
        let mut part = Self { corners: [Vec3::ZERO; MOST_CORNERS], count: 0 };
        let corners = self.corners();
        for (number, &corner) in corners.iter().enumerate() {
            let next = corners[(number + 1) % corners.len()];
            let [from, to] = [corner, next].map(|corner| (corner[axis] - plane) * sign);
            if from >= 0.0 {
                part.push(corner);
            }
            if (from < 0.0) != (to < 0.0) {
                let mut crossing = corner + (next - corner) * (from / (from - to));
                crossing[axis] = plane;
                part.push(crossing);
            }
        }
        part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_clipped_to_a_voxel() {
        let corners = [Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 2.0)];
        let voxel = Voxel { min: Vec3::new(1.0, 1.0, -1.0), max: Vec3::splat(9.0) };
        let part = voxel.around_part(&corners).expect("a part");
        assert_eq!((part.min, part.max), (Vec3::new(1.0, 1.0, 0.5), Vec3::new(3.0, 3.0, 1.5)));
        let beside = Voxel { min: Vec3::splat(3.0), max: Vec3::splat(9.0) };
        assert!(beside.around_part(&corners).is_none());
    }
}
