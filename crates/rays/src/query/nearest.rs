//! The point of a mesh that is nearest to a given point.

use crate::bvh::{Bvh, Child, WIDTH, WideNode};
use crate::geom::MAX_COORDINATE;
use glam::{DVec3, Vec3};
use std::cell::Cell;

thread_local! {
    /// Taken by a call while it searches.
    static STACK: Cell<Vec<Entry>> = const { Cell::new(Vec::new()) };
}

/// A point on a triangle: the answer of [`super::Mesh::nearest_point`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct NearestPoint {
    /// The point on the triangle.
    pub position: Vec3,
    /// Its distance from the point that was asked for.
    pub distance: f32,
    /// Barycentric weight of the triangle's second vertex, 0 to 1.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, 0 to 1.
    pub v: f32,
    /// Primitive id of the triangle.
    pub primitive: u32,
}

/// A child to visit.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    /// At most the squared distance of its box.
    squared: f32,
}

/// The nearest point so far.
struct Best {
    squared: f64,
    position: DVec3,
    u: f64,
    v: f64,
    primitive: Option<u32>,
}

/// The nearest point of a tree's triangles at most `max_distance` away; of equally near ones the one of the lowest
/// primitive id. Computed in `f64`. The answer does not depend on the shape of the tree.
pub fn nearest_point(bvh: &Bvh, point: Vec3, max_distance: f32) -> Option<NearestPoint> {
    let in_range = point.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
    if !in_range || max_distance.is_nan() || max_distance < 0.0 {
        return None;
    }
    let (blocks, nodes) = (bvh.wide().blocks(), bvh.wide().nodes());
    let squared = f64::from(max_distance) * f64::from(max_distance);
    let mut best = Best { squared, position: DVec3::ZERO, u: 0.0, v: 0.0, primitive: None };
    let mut stack = STACK.take();
    stack.clear();
    stack.push(Entry { child: Child::ROOT, squared: 0.0 });
    while let Some(Entry { child, squared }) = stack.pop() {
        if f64::from(squared) > best.squared {
            continue;
        }
        if child.is_block() {
            let block = blocks.get(child);
            for row in 0..block.len() {
                best.visit(point.as_dvec3(), block.corners(row), block.primitive(row));
            }
            continue;
        }
        let node = &nodes[child.index()];
        let distances = squared_distances(node, point);
        let first = stack.len();
        for (child, squared) in node.children.into_iter().zip(distances) {
            if child != Child::NONE && f64::from(squared) <= best.squared {
                stack.push(Entry { child, squared });
            }
        }
        // The nearest child on top.
        stack[first..].sort_unstable_by(|a, b| b.squared.total_cmp(&a.squared));
    }
    STACK.set(stack);
    best.primitive.map(|primitive| NearestPoint {
        position: best.position.as_vec3(),
        distance: best.squared.sqrt() as f32,
        u: best.u as f32,
        v: best.v as f32,
        primitive,
    })
}

/// At most the squared distances of a point from the boxes of a node, by slot.
fn squared_distances(node: &WideNode, point: Vec3) -> [f32; WIDTH] {
    // More than the rounding errors of the sum, in units of the sum, and more than those of underflow.
    const SHRINK: f32 = 1.0 - 1e-6;
    let mut sums = [0.0; WIDTH];
    for axis in 0..3 {
        let (low, high, at) = (&node.faces[0][axis], &node.faces[1][axis], point[axis]);
        for slot in 0..WIDTH {
            let outside = (low[slot] - at).max(at - high[slot]).max(0.0);
            sums[slot] += outside * outside;
        }
    }
    sums.map(|sum| sum * SHRINK - f32::MIN_POSITIVE)
}

impl Best {
    fn visit(&mut self, point: DVec3, corners: [Vec3; 3], primitive: u32) {
        let corners = corners.map(|corner| corner.as_dvec3());
        let (position, u, v) = nearest_on_triangle(point, corners);
        let squared = position.distance_squared(point);
        let is_first = self.primitive.is_none_or(|best| primitive < best);
        if squared < self.squared || squared == self.squared && is_first {
            *self = Self { squared, position, u, v, primitive: Some(primitive) };
        }
    }
}

/// The point of a triangle nearest to `point`, with its barycentric weights. The triangle may be a segment or a point.
fn nearest_on_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> (DVec3, f64, f64) {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(ac);
    let area = normal.length_squared();
    if area > 0.0 {
        let u = ap.cross(ac).dot(normal) / area;
        let v = ab.cross(ap).dot(normal) / area;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            return (a + u * ab + v * ac, u, v);
        }
    }
    // Of each edge: the point, and how far along the edge it is.
    let on_edge = |from: DVec3, to: DVec3| {
        let (along, length) = (to - from, from.distance_squared(to));
        let share = if length > 0.0 { ((point - from).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
        (from + share * along, share)
    };
    let [(on_ab, along_ab), (on_ac, along_ac), (on_bc, along_bc)] =
        [on_edge(a, b), on_edge(a, c), on_edge(b, c)];
    let mut nearest = (on_ab, along_ab, 0.0);
    for other in [(on_ac, 0.0, along_ac), (on_bc, 1.0 - along_bc, along_bc)] {
        if other.0.distance_squared(point) < nearest.0.distance_squared(point) {
            nearest = other;
        }
    }
    nearest
}
