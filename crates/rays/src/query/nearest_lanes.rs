//! Nearest points of many points, with the boxes of a node and the triangles of a leaf block in lanes.
//!
//! Lanes say in `f32` which triangles can be the nearest, with a bound of their rounding errors; `f64` decides among
//! those. So answers are to the bit those of [`super::nearest::nearest`].

use super::nearest::{Best, NearestPoint, around};
use crate::bvh::{Bvh, Child, LeafBlock, WIDTH, WideNode};
use crate::geom::MAX_COORDINATE;
use crate::lanes::{LaneBits, LaneTask, Lanes, SimdLevel, first_lanes, load, spill, splat};
use crate::trace::cpu::lane_math::{LaneVec3, cross, dot, max_abs, sub};
use glam::{DVec3, Vec3};

/// Finds the nearest points of `points` on a tree of triangles, at most `max_distance` away. Each search begins with
/// the triangle that the one before has found, so neighbours should follow each other.
pub(super) fn nearest_of_each(
    bvh: &Bvh,
    points: &[DVec3],
    max_distance: f32,
    answers: &mut [Option<NearestPoint>],
) {
    assert_eq!(points.len(), answers.len(), "one answer per point");
    if bvh.is_empty() || max_distance.is_nan() || max_distance < 0.0 {
        return answers.fill(None);
    }
    SimdLevel::run_eight(Search { bvh, points, max_distance, answers });
}

/// The search for the nearest points of many points.
struct Search<'a> {
    bvh: &'a Bvh,
    points: &'a [DVec3],
    max_distance: f32,
    answers: &'a mut [Option<NearestPoint>],
}

/// A child to visit.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    /// At most the squared distance of its box.
    squared: f32,
}

/// A point in `f32`.
#[derive(Clone, Copy)]
struct Near {
    /// The point, rounded.
    point: Vec3,
    /// The nearest numbers that are not greater and not less.
    below: Vec3,
    above: Vec3,
    /// At least the distance between the point and its rounded one.
    rounding: f32,
}

impl Near {
    fn new(point: DVec3) -> Self {
        let [x, y, z] = [around(point.x), around(point.y), around(point.z)];
        let (below, above) = (Vec3::new(x.0, y.0, z.0), Vec3::new(x.1, y.1, z.1));
        let rounding = (above - below).element_sum();
        Self { point: point.as_vec3(), below, above, rounding }
    }
}

/// The limits of a search, which shrink.
#[derive(Clone, Copy)]
struct Limits {
    distance: f32,
    squared: f32,
}

impl Limits {
    /// At least the distance of the best point so far.
    #[inline(always)]
    fn of(best: &Best) -> Self {
        let up = |number: f64| if number.is_finite() { (number as f32).next_up() } else { f32::INFINITY };
        Self { distance: up(best.squared.sqrt()), squared: up(best.squared) }
    }
}

impl LaneTask for Search<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { bvh, points, max_distance, answers } = self;
        let (nodes, blocks) = (bvh.wide().nodes(), bvh.wide().blocks());
        let mut stack: Vec<Entry> = Vec::with_capacity(WIDTH * bvh.wide().depth() + 1);
        let mut before = None;
        for (&point, answer) in points.iter().zip(answers) {
            *answer = None;
            let in_range = point.abs().cmple(DVec3::splat(MAX_COORDINATE.into())).all();
            if !in_range {
                continue;
            }
            let near = Near::new(point);
            let mut best = Best::within(max_distance);
            if let Some((corners, primitive)) = before {
                best.visit(point, corners, primitive);
            }
            let mut limits = Limits::of(&best);
            stack.push(Entry { child: Child::ROOT, squared: 0.0 });
            while let Some(Entry { child, squared }) = stack.pop() {
                if squared > limits.squared {
                    continue;
                }
                if child.is_block() {
                    visit_block(l, blocks.get(child), point, &near, &mut limits, &mut best);
                } else {
                    push_children(l, &nodes[child.index()], &near, limits.squared, &mut stack);
                }
            }
            before = best.triangle.or(before);
            *answer = best.answer();
        }
    }
}

/// Pushes the children of a node that may be near enough, the nearest on top.
#[cfg_attr(not(unoptimised), inline(always))]
fn push_children<L: Lanes>(l: L, node: &WideNode, near: &Near, limit: f32, stack: &mut Vec<Entry>) {
    // More than the rounding errors of the sum, in units of the sum, and more than those of underflow.
    const SHRINK: f32 = 1.0 - 1e-6;
    let (low, high) = (load(l, &node.faces[0]), load(l, &node.faces[1]));
    let (below, above) = (splat(l, near.below.to_array()), splat(l, near.above.to_array()));
    let zero = l.splat(0.0);
    let mut sum = zero;
    for axis in 0..3 {
        let outside = l.max(l.max(l.sub(low[axis], above[axis]), l.sub(below[axis], high[axis])), zero);
        sum = l.add(sum, l.mul(outside, outside));
    }
    let squared = l.sub(l.mul(sum, l.splat(SHRINK)), l.splat(f32::MIN_POSITIVE));
    // The boxes of vacant slots are infinitely far away.
    let mut some = l.le(0xff, squared, l.splat(limit.min(f32::MAX)));
    let squared = spill(l, squared);
    let first = stack.len();
    while some != 0 {
        let slot = some.trailing_zeros() as usize % WIDTH;
        some &= some - 1;
        let entry = Entry { child: node.children[slot], squared: squared[slot] };
        stack.push(entry);
        let mut at = stack.len() - 1;
        while at > first && stack[at - 1].squared < entry.squared {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = entry;
    }
}

/// Visits the triangles of a block that can be the nearest, the likeliest first.
#[cfg_attr(not(unoptimised), inline(always))]
fn visit_block<L: Lanes>(
    l: L,
    block: LeafBlock<'_>,
    point: DVec3,
    near: &Near,
    limits: &mut Limits,
    best: &mut Best,
) {
    let (squared, errors) = triangle_distances(l, block.vertices(l), near);
    let (squares, mut left) = (spill(l, squared), first_lanes::<L>(block.len()));
    loop {
        let reach = l.add(l.splat(limits.distance + near.rounding), errors);
        left = l.le(left, squared, l.mul(reach, reach));
        if left == 0 {
            return;
        }
        let row = nearest_lane(left, &squares);
        left &= !(1 << row);
        best.visit(point, block.corners(row), block.primitive(row));
        *limits = Limits::of(best);
    }
}

/// The lane of a mask that has the least number.
#[inline(always)]
fn nearest_lane(mask: LaneBits, numbers: &[f32]) -> usize {
    let (mut nearest, mut left) = (mask.trailing_zeros() as usize, mask & (mask - 1));
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        nearest = if numbers[lane] < numbers[nearest] { lane } else { nearest };
    }
    nearest
}

/// Share of the distance to a triangle's farthest corner by which a computed distance may exceed the exact one: more
/// than 2⁹ units of rounding.
const ERROR: f32 = 1.0 / (1 << 13) as f32;

/// Share of its longest possible area, squared, below which a triangle's plane is not computed.
const SLIVER: f32 = 1.0 / (1 << 8) as f32;

/// Share by which a point may lie outside of an edge that is computed as inside.
const EDGE: f32 = 1.0 / (1 << 15) as f32;

/// Squared distances of a point from triangles, and by how much the distances may be too large.
///
/// The distance from the plane, which is never greater than that from the triangle, where the point's projection may
/// lie inside; else the distance from the nearest edge. Slivers may be at the point.
#[cfg_attr(not(unoptimised), inline(always))]
fn triangle_distances<L: Lanes>(l: L, triangle: [LaneVec3<L>; 3], near: &Near) -> (L::F, L::F) {
    let point = splat(l, near.point.to_array());
    let [a, b, c] = [sub(l, triangle[0], point), sub(l, triangle[1], point), sub(l, triangle[2], point)];
    let (ab, bc, ca) = (sub(l, b, a), sub(l, c, b), sub(l, a, c));
    let reach = l.max(l.max(max_abs(l, a), max_abs(l, b)), max_abs(l, c));
    let edges = l.min(l.min(to_edge(l, a, ab), to_edge(l, b, bc)), to_edge(l, c, ca));
    let normal = cross(l, ab, ca);
    let length = dot(l, normal, normal);
    let height = dot(l, normal, a);
    let plane = l.mul(l.div(height, l.max(length, l.splat(f32::MIN_POSITIVE))), height);
    // The normal is that of the opposite side.
    let weights = l.max(
        l.max(dot(l, normal, cross(l, a, b)), dot(l, normal, cross(l, b, c))),
        dot(l, normal, cross(l, c, a)),
    );
    let tolerance = l.mul(l.mul(max_abs(l, normal), l.mul(reach, reach)), l.splat(EDGE));
    let inside = l.le(L::ALL, weights, tolerance);
    let distance = l.select(inside, l.min(plane, edges), edges);
    let longest = l.mul(dot(l, ab, ab), dot(l, ca, ca));
    let sliver = l.le(L::ALL, length, l.mul(longest, l.splat(SLIVER)));
    // The small number is for squares that underflow.
    (l.select(sliver, l.splat(0.0), distance), l.fma(reach, l.splat(ERROR), l.splat(1e-17)))
}

/// The squared distance of the origin from the segment that begins at `from` and goes along `edge`.
#[cfg_attr(not(unoptimised), inline(always))]
fn to_edge<L: Lanes>(l: L, from: LaneVec3<L>, edge: LaneVec3<L>) -> L::F {
    let length = l.max(dot(l, edge, edge), l.splat(f32::MIN_POSITIVE));
    let share = l.div(l.neg(dot(l, from, edge)), length);
    let share = l.min(l.max(share, l.splat(0.0)), l.splat(1.0));
    let at = [l.fma(share, edge[0], from[0]), l.fma(share, edge[1], from[1]), l.fma(share, edge[2], from[2])];
    dot(l, at, at)
}
