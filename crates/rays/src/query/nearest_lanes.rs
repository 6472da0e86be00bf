//! Nearest points of many points, with the boxes of a node and the triangles of a leaf block in lanes.
//!
//! Lanes compute a lower and an upper bound of each triangle's distance in `f32`. A search lists the triangles whose
//! lower bound is not above the least upper bound so far. When it ends, `f64` decides among those that are left, one or
//! two as a rule. So answers are to the bit those of [`super::nearest::nearest`].

use super::nearest::{Best, NearestPoint, around};
use crate::bvh::{Bvh, Child, LeafBlocks, WIDTH, WideNode};
use crate::geom::MAX_COORDINATE;
use crate::lanes::{LaneTask, Lanes, SimdLevel, first_lanes, load, spill, splat};
use crate::trace::cpu::TreeView;
use crate::trace::cpu::lane_math::{LaneVec3, cross, dot, max_abs, sub};
use glam::{DVec3, Vec3};

/// Finds the nearest points of `points` on a tree of triangles, at most `max_distance` away. Each search begins with
/// the distance from the point that the one before has found, so neighbours should follow each other.
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

/// A triangle that may be the nearest.
#[derive(Clone, Copy)]
struct Candidate {
    block: Child,
    row: u32,
    /// A lower bound of its distance.
    least: f32,
}

/// An upper bound of the distance of the nearest triangle, and one of its square.
#[derive(Clone, Copy)]
struct Limit {
    distance: f32,
    squared: f32,
}

impl Limit {
    #[inline(always)]
    fn new(distance: f32) -> Self {
        Self { distance, squared: (distance * distance).next_up() }
    }
}

impl LaneTask for Search<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { bvh, points, max_distance, answers } = self;
        let (nodes, blocks) = (bvh.wide().nodes(), bvh.wide().blocks());
        let tree = TreeView::new(bvh.wide(), None);
        let mut children = Vec::with_capacity(WIDTH * bvh.wide().depth() + 1);
        let mut triangles: Vec<Candidate> = Vec::new();
        let mut before: Option<DVec3> = None;
        for (&point, answer) in points.iter().zip(answers) {
            *answer = None;
            let in_range = point.abs().cmple(DVec3::splat(MAX_COORDINATE.into())).all();
            if !in_range {
                continue;
            }
            let near = Near::new(point);
            let known = before.map_or(f32::INFINITY, |on_mesh| farthest(point, on_mesh));
            let mut limit = Limit::new(max_distance.min(known));
            children.push(Entry { child: Child::ROOT, squared: 0.0 });
            while let Some(Entry { child, squared }) = children.pop() {
                if squared > limit.squared {
                    continue;
                }
                if child.is_block() {
                    list_triangles(l, child, blocks, &near, &mut limit, &mut triangles);
                } else {
                    let node = &nodes[child.index()];
                    push_children(l, &tree, node, &near, limit.squared, &mut children);
                }
            }
            let mut best = Best::within(max_distance);
            for Candidate { block, row, least } in triangles.drain(..) {
                if least <= limit.distance {
                    let (block, row) = (blocks.get(block), row as usize);
                    best.visit(point, block.corners(row), block.primitive(row));
                }
            }
            *answer = best.answer();
            before = answer.map(|nearest| nearest.position64).or(before);
        }
    }
}

/// An upper bound of the distance of a point from one on a triangle, which was computed in `f64`.
#[inline(always)]
fn farthest(point: DVec3, on_triangle: DVec3) -> f32 {
    // Many times the error of the point on the triangle.
    let error = 1e-14 * (point.abs() + on_triangle.abs()).max_element();
    ((point.distance(on_triangle) + error) as f32).next_up()
}

/// Pushes the children of a node that may be near enough, the nearest on top.
#[cfg_attr(not(unoptimised), inline(always))]
fn push_children<L: Lanes>(
    l: L,
    tree: &TreeView<'_>,
    node: &WideNode,
    near: &Near,
    limit: f32,
    stack: &mut Vec<Entry>,
) {
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
        tree.prefetch_either(entry.child);
        let mut at = stack.len() - 1;
        while at > first && stack[at - 1].squared < entry.squared {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = entry;
    }
}

/// Lists the triangles of a block that can be the nearest.
#[cfg_attr(not(unoptimised), inline(always))]
fn list_triangles<L: Lanes>(
    l: L,
    child: Child,
    blocks: &LeafBlocks,
    near: &Near,
    limit: &mut Limit,
    triangles: &mut Vec<Candidate>,
) {
    let block = blocks.get(child);
    let [least, most] = triangle_distances(l, block.vertices(l), near);
    let all = first_lanes::<L>(block.len());
    let nearer = l.lt(all, most, l.splat(limit.distance));
    if nearer != 0 {
        *limit = Limit::new(l.lowest(l.select(nearer, most, l.splat(f32::INFINITY))));
    }
    let (mut some, least) = (l.le(all, least, l.splat(limit.distance)), spill(l, least));
    while some != 0 {
        let row = some.trailing_zeros();
        some &= some - 1;
        triangles.push(Candidate { block: child, row, least: least[row as usize] });
    }
}

/// Share of the distance to a triangle's farthest corner by which a computed distance may differ from the exact one:
/// more than 2⁹ units of rounding.
const ERROR: f32 = 1.0 / (1 << 13) as f32;

/// Share of the product of two edges' squared lengths below which a triangle is a sliver: the distance from its plane
/// is divided by this share in place of the area, so it is too small.
const SLIVER: f32 = 1.0 / (1 << 8) as f32;

/// Tolerance of the test on which side of an edge a point lies, as a share of two edges' lengths times the squared
/// distance of the farthest corner.
const EDGE: f32 = 1.0 / (1 << 15) as f32;

/// A lower and an upper bound of the distance of a point from each triangle.
///
/// The distance from the plane where the point's projection lies inside, else from the nearest edge. Where that is not
/// certain, the plane is never farther than the triangle, and the edges are never nearer. Rounding moves each corner by
/// less than the error, so what is said of edges and plane holds for a triangle that is moved so little.
#[cfg_attr(not(unoptimised), inline(always))]
fn triangle_distances<L: Lanes>(l: L, triangle: [LaneVec3<L>; 3], near: &Near) -> [L::F; 2] {
    let point = splat(l, near.point.to_array());
    let [a, b, c] = [sub(l, triangle[0], point), sub(l, triangle[1], point), sub(l, triangle[2], point)];
    let (ab, bc, ca) = (sub(l, b, a), sub(l, c, b), sub(l, a, c));
    let reach = l.max(l.max(max_abs(l, a), max_abs(l, b)), max_abs(l, c));
    let edges = l.min(l.min(to_edge(l, a, ab), to_edge(l, b, bc)), to_edge(l, c, ca));
    let normal = cross(l, ab, ca);
    let length = dot(l, normal, normal);
    let height = dot(l, normal, a);
    let longest = l.mul(l.mul(dot(l, ab, ab), dot(l, ca, ca)), l.splat(SLIVER));
    let plane = l.mul(l.div(height, l.max(l.max(length, longest), l.splat(f32::MIN_POSITIVE))), height);
    // The normal is that of the opposite side.
    let weights = l.max(
        l.max(dot(l, normal, cross(l, a, b)), dot(l, normal, cross(l, b, c))),
        dot(l, normal, cross(l, c, a)),
    );
    let tolerance = l.mul(l.mul(l.mul(max_abs(l, ab), max_abs(l, ca)), l.mul(reach, reach)), l.splat(EDGE));
    // If the projection is outside, the plane is farther than any edge; NaN counts as 0.
    let outside = l.max(l.sub(weights, tolerance), l.splat(0.0));
    let least = l.min(l.fma(outside, l.splat(f32::MAX), plane), edges);
    let inside = l.lt(l.lt(L::ALL, longest, length), weights, l.neg(tolerance));
    let most = l.select(inside, l.min(plane, edges), edges);
    // The small number is for squares that underflow.
    let error = l.add(l.fma(reach, l.splat(ERROR), l.splat(1e-17)), l.splat(near.rounding));
    [l.sub(l.sqrt(least), error), l.add(l.sqrt(most), error)]
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
