//! The point of a mesh, or of a world, that is nearest to a given point.

use crate::bvh::{Bvh, Child, WIDTH, WideNode};
use crate::geom::{MAX_COORDINATE, Placement};
use crate::stream::Hit;
use glam::{DVec3, Vec3};
use std::cell::Cell;
use std::cmp::Ordering;

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
    /// The point on the triangle, before it is rounded.
    pub position64: DVec3,
    /// Its distance from the point that was asked for.
    pub distance: f32,
    /// Barycentric weight of the triangle's second vertex, 0 to 1.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, 0 to 1.
    pub v: f32,
    /// Primitive id of the triangle.
    pub primitive: u32,
}

/// The tree itself, not that of an instance.
const TOP: u32 = u32::MAX;

/// A child to visit.
#[derive(Clone, Copy)]
struct Entry {
    /// Index of the instance, or [`TOP`].
    instance: u32,
    child: Child,
    /// At most the squared distance of its box.
    squared: f32,
}

/// The nearest point so far.
pub(super) struct Best {
    squared: f64,
    position: DVec3,
    u: f64,
    v: f64,
    /// Primitive id of its triangle.
    primitive: Option<u32>,
}

impl NearestPoint {
    /// A hit with the same triangle and weights.
    pub(super) fn as_hit(&self) -> Hit {
        Hit { t: self.distance, u: self.u, v: self.v, primitive: self.primitive }
    }
}

/// The nearest point of a tree's triangles at most `max_distance` away; of equally near ones the one of the lowest
/// primitive id. Computed in `f64`. The answer does not depend on the shape of the tree.
pub fn nearest(bvh: &Bvh, point: DVec3, max_distance: f32) -> Option<NearestPoint> {
    let in_range = point.abs().cmple(DVec3::splat(MAX_COORDINATE.into())).all();
    if !in_range || max_distance.is_nan() || max_distance < 0.0 || bvh.is_empty() {
        return None;
    }
    let mut best = Best::within(max_distance);
    let mut stack = STACK.take();
    stack.clear();
    stack.push(Entry { instance: TOP, child: Child::ROOT, squared: 0.0 });
    while let Some(Entry { instance, child, squared }) = stack.pop() {
        if f64::from(squared) <= best.squared {
            best.visit_child(bvh, point, instance, child, &mut stack);
        }
    }
    STACK.set(stack);
    best.answer()
}

/// At most the squared distances of a point from the boxes of a node, by slot.
fn squared_distances(faces: &[[[f32; WIDTH]; 3]; 2], point: DVec3) -> [f32; WIDTH] {
    // More than the rounding errors of the sum, in units of the sum, and more than those of underflow.
    const SHRINK: f32 = 1.0 - 1e-6;
    let mut sums = [0.0; WIDTH];
    for axis in 0..3 {
        let (low, high) = (&faces[0][axis], &faces[1][axis]);
        // The point lies between these; both are the point itself if it is an `f32`.
        let (below, above) = around(point[axis]);
        for slot in 0..WIDTH {
            let outside = (low[slot] - above).max(below - high[slot]).max(0.0);
            sums[slot] += outside * outside;
        }
    }
    sums.map(|sum| sum * SHRINK - f32::MIN_POSITIVE)
}

/// The nearest `f32` that are not greater, and not less, than a number.
pub(super) fn around(number: f64) -> (f32, f32) {
    let near = number as f32;
    match f64::from(near).total_cmp(&number) {
        Ordering::Less => (near, near.next_up()),
        Ordering::Equal => (near, near),
        Ordering::Greater => (near.next_down(), near),
    }
}

impl Best {
    /// None yet, and none farther than `max_distance`.
    pub fn within(max_distance: f32) -> Self {
        let squared = f64::from(max_distance) * f64::from(max_distance);
        Self { squared, position: DVec3::ZERO, u: 0.0, v: 0.0, primitive: None }
    }

    pub fn answer(&self) -> Option<NearestPoint> {
        self.primitive.map(|primitive| NearestPoint {
            position: self.position.as_vec3(),
            position64: self.position,
            distance: self.squared.sqrt() as f32,
            u: self.u as f32,
            v: self.v as f32,
            primitive,
        })
    }

    /// Visits a child of the tree of an instance, or of the tree itself: [`TOP`].
    fn visit_child(&mut self, bvh: &Bvh, point: DVec3, instance: u32, child: Child, stack: &mut Vec<Entry>) {
        let instances = bvh.instances();
        if child.is_block() && instance == TOP && !instances.is_empty() {
            let instance = child.index() as u32;
            return self.visit_child(bvh, point, instance, Child::ROOT, stack);
        }
        let (wide, first_primitive, placement) = match instances.get(instance as usize) {
            Some(instance) => (instance.tree.wide(), instance.first_primitive, instance.placement),
            None => (bvh.wide(), 0, None),
        };
        if child.is_block() {
            let block = wide.blocks().get(child);
            for row in 0..block.len() {
                let corners = block.corners(row);
                let corners = placement.map_or(corners, |place| corners.map(|corner| place.point(corner)));
                self.visit(point, corners, first_primitive + block.primitive(row));
            }
            return;
        }
        let node = &wide.nodes()[child.index()];
        let distances = match placement {
            None => squared_distances(&node.faces, point),
            Some(placement) => squared_distances(&moved_faces(node, &placement), point),
        };
        let first = stack.len();
        for (child, squared) in node.children.into_iter().zip(distances) {
            if child != Child::NONE && f64::from(squared) <= self.squared {
                stack.push(Entry { instance, child, squared });
            }
        }
        // The nearest child on top.
        stack[first..].sort_unstable_by(|a, b| b.squared.total_cmp(&a.squared));
    }

    /// Takes the nearest point of a triangle if it is nearer, or as near and of a lower primitive id.
    #[inline(always)]
    pub fn visit(&mut self, point: DVec3, corners: [Vec3; 3], primitive: u32) {
        let [a, b, c] = corners;
        let (position, u, v) = nearest_on_triangle(point, [a.as_dvec3(), b.as_dvec3(), c.as_dvec3()]);
        let squared = position.distance_squared(point);
        let is_first = self.primitive.is_none_or(|best| primitive < best);
        if squared < self.squared || squared == self.squared && is_first {
            *self = Self { squared, position, u, v, primitive: Some(primitive) };
        }
    }
}

/// The faces of a node's boxes in the world.
fn moved_faces(node: &WideNode, placement: &Placement) -> [[[f32; WIDTH]; 3]; 2] {
    let mut faces = WideNode::EMPTY.faces;
    for slot in (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE) {
        let bounds = placement.bounds(&node.bounds(slot));
        for (side, corner) in faces.iter_mut().zip([bounds.min, bounds.max]) {
            side.iter_mut().zip(corner.to_array()).for_each(|(face, coordinate)| face[slot] = coordinate);
        }
    }
    faces
}

/// The point of a triangle nearest to `point`, with its barycentric weights. The triangle may be a segment or a point.
#[inline(always)]
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
    let ((on_ab, along_ab), (on_ac, along_ac), (on_bc, along_bc)) =
        (on_edge(a, b), on_edge(a, c), on_edge(b, c));
    let nearer = |first: (DVec3, f64, f64), second: (DVec3, f64, f64)| {
        if second.0.distance_squared(point) < first.0.distance_squared(point) { second } else { first }
    };
    let nearest = nearer((on_ab, along_ab, 0.0), (on_ac, 0.0, along_ac));
    nearer(nearest, (on_bc, 1.0 - along_bc, along_bc))
}
