//! Triangles that rays may cross, for tests other than the canonical one: the half-open test of
//! [`crate::geom::HalfOpenRay`] and what is counted, summed and listed by it.
//!
//! Rays are traced as streams, in lists and pairs as in `ray_lists`. At a leaf, edge functions in lanes say for which
//! triangles the signs are certain. Those that the line certainly misses are dropped; all others are *candidates*,
//! which a [`TriangleSink`] tests one by one.
//!
//! Unsafe code for rows, rays, lists and pairs. Invariants 1 to 7 are those of `substream` and `child_lists`.
//! 8. What a vector is written to has an element for each of its lanes.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Space, splat_triangle};
use super::instances::VisitInstance;
use super::lane_math::{LaneVec3, add, cross, dot, max_abs, sub};
use super::pair_stack::{BLOCK_BATCH, splat_id_pair};
use super::ray_lists::visit_node;
use super::ray_node_pairs;
use super::substream::{DONE, OctantStack, ROW_BYTES, SubStream, Visitor, Widths, prefetch_rows, ray_index};
use super::triangle::{Lines, relative_corners};
use super::visit_order::VisitOrder;
use crate::bvh::{Child, LeafBlock, PRIMITIVE, WIDTH};
use crate::lanes::{
    LaneBits, Lanes, MAX_LANES, SingleLane, both, each, first_lanes, keep, splat, splat_eights,
};
use crate::stream::Ray;
use glam::Vec3;
use std::cell::RefCell;
use std::ptr;

/// A triangle that a ray may cross.
#[derive(Clone, Copy, Debug, Default)]
pub struct Candidate {
    /// Index of the ray.
    pub ray: usize,
    /// Primitive id.
    pub primitive: u32,
    /// Corners in the world.
    pub corners: [Vec3; 3],
}

/// Numbers of crossings, by the index of the ray.
#[derive(Debug)]
pub struct Tally<'a> {
    /// The numbers so far.
    pub counts: &'a mut [u32],
    /// The number from which on a ray needs no more.
    pub enough: u32,
}

/// Candidates in columns.
#[derive(Clone, Debug)]
pub struct CandidateColumns {
    /// The number of candidates. What lies beyond has no meaning.
    pub len: usize,
    /// Indices of the rays.
    pub rays: [u32; MAX_BATCH],
    pub origins: [[f32; MAX_BATCH]; 3],
    pub directions: [[f32; MAX_BATCH]; 3],
    pub t_min: [f32; MAX_BATCH],
    pub t_max: [f32; MAX_BATCH],
    /// Primitive ids.
    pub primitives: [u32; MAX_BATCH],
    /// Corners in the world, as `[corner][axis][candidate]`.
    pub corners: [[[f32; MAX_BATCH]; 3]; 3],
}

impl Default for CandidateColumns {
    /// No candidates.
    fn default() -> Self {
        let (numbers, zeros) = ([0; MAX_BATCH], [0.0; MAX_BATCH]);
        Self {
            len: 0,
            rays: numbers,
            origins: [zeros; 3],
            directions: [zeros; 3],
            t_min: zeros,
            t_max: zeros,
            primitives: numbers,
            corners: [[zeros; 3]; 3],
        }
    }
}

/// Tests the triangles that rays may cross.
pub trait TriangleSink {
    /// Takes a triangle that a ray may cross. Returns the `t` beyond which the ray needs no more triangles: +∞ for all,
    /// a negative number for none.
    fn take(&mut self, candidate: &Candidate) -> f32;

    /// Takes several at once, at most [`TriangleSink::batch`]: writes what [`TriangleSink::take`] returns for each.
    fn take_all(&mut self, candidates: &[Candidate], limits: &mut [f32]) {
        limits.iter_mut().zip(candidates).for_each(|(limit, candidate)| *limit = self.take(candidate));
    }

    /// Number of triangles that are best handed over together: many, unless what [`TriangleSink::take`] returns saves
    /// visits. At most [`MAX_BATCH`].
    fn batch(&self) -> usize {
        MAX_BATCH
    }

    /// The tally of crossings that `f32` is certain of; they are not taken then. `None`, always or never, if they are
    /// to be taken. Only for rays that are traced to the bit as they are tested.
    fn tally(&mut self) -> Option<Tally<'_>> {
        None
    }

    /// Memory for columns, always or never. Where there is some, tracers in lanes write candidates there for
    /// [`TriangleSink::take_columns`], and hand them over in no other way.
    fn columns(&mut self) -> Option<&mut CandidateColumns> {
        None
    }

    /// Takes the candidates in the columns. No ray needs fewer triangles after that.
    fn take_columns(&mut self) {}
}

/// The most triangles that are handed over together.
pub const MAX_BATCH: usize = 64;

const _: () = assert!(MAX_BATCH.is_multiple_of(MAX_LANES));

/// Place where candidates go.
#[derive(Clone, Copy)]
pub(super) struct Found<'a, 's> {
    pub sink: &'a RefCell<&'s mut (dyn TriangleSink + 's)>,
    /// Index of the sub-stream's first ray.
    pub first: usize,
    /// [`TriangleSink::batch`] of the sink.
    pub batch: usize,
    /// True if the sink has a tally.
    pub tallies: bool,
    /// True if the sink has columns.
    pub columns: bool,
}

/// Follows rays in lists and pairs, as `RayVisitor` does, and hands candidates to a sink.
pub(super) struct CandidateVisitor<'a, 's, W, E, S> {
    pub widths: Widths<W, E>,
    pub space: S,
    pub sub: &'a SubStream<'a>,
    pub found: Found<'a, 's>,
}

impl<W: Lanes, E: Lanes, S: Space> Visitor for CandidateVisitor<'_, '_, W, E, S> {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn step(&self, octant: usize, stack: &mut OctantStack) -> bool {
        let Self { widths, space, sub, .. } = *self;
        // SAFETY: the caller's contract.
        unsafe {
            if stack.has_block_batch() {
                self.test_pairs(stack);
            } else if stack.has_node_batch() {
                ray_node_pairs::visit_nodes(widths, space, sub, octant, stack);
            } else if let Some(entry) = stack.entries.pop() {
                if entry.child.is_block() {
                    let list = entry.start as usize..(entry.start + entry.len) as usize;
                    self.test_list(stack, entry.child, list);
                } else {
                    let order =
                        VisitOrder::front_to_back(sub.tree.node(entry.child), space.order_octant(octant));
                    visit_node::<_, _, _, true>(widths, space, sub, order, octant, stack, entry);
                }
            } else {
                self.hand_over(stack);
                return false;
            }
            if stack.candidates.len() >= self.found.batch {
                self.hand_over(stack);
            }
        }
        true
    }
}

impl<W: Lanes, E: Lanes, S: Space> CandidateVisitor<'_, '_, W, E, S> {
    /// Tests all rays of a list against the triangles of a block, many rays in a vector.
    ///
    /// # Safety
    /// Invariants 1, 2, 4 and 6. The child is a block, and the list lies in the stack's arena.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn test_list(&self, stack: &mut OctantStack, child: Child, list: std::ops::Range<usize>) {
        let Self { widths: Widths { wide: w, eight: e }, space, sub, .. } = *self;
        // SAFETY: invariant 4.
        let block = unsafe { sub.tree.block(child) };
        let corners = space.corners(e, &[block; 2]);
        let corners = [keep(e, corners[0]), keep(e, corners[1]), keep(e, corners[2])];
        let child = w.splat_u32(bytemuck::cast(child));
        for at in list.clone().step_by(W::LANES) {
            // SAFETY: invariant 2.
            let ids = unsafe { stack.arena.as_ptr().add(at) };
            let among = first_lanes::<W>(list.end - at);
            // SAFETY: invariant 2 for the ids, 1 for rays.
            let [ox, oy, oz, t_min, dx, dy, dz, t_max] = unsafe { w.rows(sub.rays.cast(), ids) };
            if at + W::LANES < list.end {
                // SAFETY: invariant 2.
                unsafe { prefetch_rows(w, sub.rays, ids.add(W::LANES)) };
            }
            let lines = Lines { origin: [ox, oy, oz], direction: [dx, dy, dz] };
            let whole = self.whole_rays(w, among, t_min, t_max);
            // SAFETY: invariant 2.
            let of_lanes = unsafe { w.load_u32(ids) };
            let (mut crossed, mut crossings) = (0, w.splat_u32(0));
            for row in 0..block.len() {
                let (some, certain) = candidates(w, among, whole, &lines, &splat_triangle(w, &corners, row));
                if certain != 0 {
                    crossed |= certain;
                    let more = w.add_u32(crossings, w.splat_u32(1));
                    crossings = w.select_u32(certain, more, crossings);
                }
                if some != 0 {
                    stack.candidates.reserve(MAX_LANES);
                    let ids = w.or_u32(of_lanes, w.splat_u32(row as u32));
                    // SAFETY: invariant 6, as reserved.
                    unsafe { stack.candidates.push_lanes(w, some, ids, child) };
                }
            }
            if crossed != 0 {
                let mut times = [0; MAX_LANES];
                // SAFETY: `times` is as long as the widest vector; invariants 1 and 2 for the ids.
                unsafe {
                    w.store_u32(times.as_mut_ptr(), crossings);
                    self.count(bits_of(crossed).map(|lane| (*ids.add(lane), times[lane])));
                }
            }
            if stack.candidates.len() >= self.found.batch {
                // SAFETY: the caller's contract; the candidates' rows are those of triangles in the block (invariant
                // 5).
                unsafe { self.hand_over(stack) };
            }
        }
    }

    /// Tests the topmost pairs of rays and blocks, one pair in each eight lanes.
    ///
    /// # Safety
    /// Invariants 1, 4 and 6.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn test_pairs(&self, stack: &mut OctantStack) {
        let Self { widths: Widths { wide: w, .. }, space, sub, .. } = *self;
        let OctantStack { block_pairs, candidates: found, .. } = stack;
        let len = block_pairs.len().min(BLOCK_BATCH);
        found.reserve(len * WIDTH);
        let (ids, children) = block_pairs.pop(len);
        let step = W::LANES / WIDTH;
        for i in (0..len).step_by(step) {
            // If there is no second pair, the last one stands in for it; its lanes are masked out.
            let pair = [i, (i + step).min(len) - 1];
            // SAFETY: invariant 6 for the pairs, 1 for the rays, 4 for the blocks.
            let (rays, ids, children, blocks) = unsafe {
                let ids = both(pair, |i| *ids.add(i));
                let children = both(pair, |i| *children.add(i));
                let blocks: [Child; 2] = both(children, bytemuck::cast);
                (both(ids, |id| &*sub.rays.byte_add(id as usize)), ids, children, blocks)
            };
            let [first, second] = both(blocks, |child| (1 << child.triangles()) - 1);
            let among = (first | second << WIDTH) & first_lanes::<W>(WIDTH * (len - i));
            // SAFETY: invariant 4.
            let triangle =
                space.corners(w, &unsafe { [sub.tree.block(blocks[0]), sub.tree.block(blocks[1])] });
            let lines = Lines {
                origin: splat_eights(w, both(rays, |ray| ray.origin)),
                direction: splat_eights(w, both(rays, |ray| ray.direction)),
            };
            let [t_min, t_max] = [both(rays, |ray| ray.t_min), both(rays, |ray| ray.t_max)];
            let whole = self.whole_rays(w, among, w.splat_eights(t_min), w.splat_eights(t_max));
            let (some, certain) = candidates(w, among, whole, &lines, &triangle);
            if certain != 0 {
                const EIGHT: LaneBits = (1 << WIDTH) - 1;
                let times = [certain & EIGHT, certain >> WIDTH & EIGHT].map(LaneBits::count_ones);
                // SAFETY: invariant 1, as above.
                unsafe { self.count([(ids[0], times[0]), (ids[1], times[1])].into_iter()) };
            }
            // SAFETY: invariant 6, as reserved.
            unsafe {
                let rows = w.load_u32(BLOCK_ROWS.as_ptr());
                found.push_lanes(w, some, w.or_u32(splat_id_pair(w, ids), rows), splat_id_pair(w, children));
            }
        }
    }

    /// The lanes whose ray has neither a beginning after its origin nor an end, if crossings are counted.
    #[inline(always)]
    fn whole_rays(&self, w: W, among: LaneBits, t_min: W::F, t_max: W::F) -> LaneBits {
        if !self.found.tallies {
            return 0;
        }
        w.le(w.le(among, t_min, w.splat(0.0)), w.splat(f32::INFINITY), t_max)
    }

    /// Counts crossings of rays, by id, and tells rays that need no more.
    ///
    /// # Safety
    /// Invariant 1 for the ids.
    #[inline(always)]
    unsafe fn count(&self, crossings: impl Iterator<Item = (u32, u32)>) {
        let Found { sink, first, .. } = self.found;
        let mut sink = sink.borrow_mut();
        let Some(Tally { counts, enough }) = sink.tally() else { return };
        for (id, times) in crossings {
            let count = &mut counts[first + ray_index(id)];
            *count += times;
            if *count >= enough {
                // SAFETY: the caller's contract.
                unsafe { (*self.sub.rows.byte_add(id as usize)).limit = DONE };
            }
        }
    }

    /// Hands all candidates to the sink.
    ///
    /// # Safety
    /// Invariants 1, 4, 5 and 6.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn hand_over(&self, stack: &mut OctantStack) {
        let Self { space, sub, found: Found { sink, first, batch, columns, .. }, .. } = *self;
        let count = stack.candidates.len();
        if count == 0 {
            return;
        }
        if columns {
            // SAFETY: the caller's contract.
            return unsafe { self.hand_over_columns(stack) };
        }
        let (ids, children) = stack.candidates.pop(count);
        let mut sink = sink.borrow_mut();
        let (mut some, mut rows, mut limits) =
            ([Candidate::default(); MAX_BATCH], [ptr::null_mut::<f32>(); MAX_BATCH], [0.0; MAX_BATCH]);
        let (mut len, batch) = (0, batch.min(MAX_BATCH));
        for i in 0..count {
            // SAFETY: invariant 6 for the candidates, 4 for the block, 1 for the row.
            let (id, block, limit) = unsafe {
                let (id, child): (u32, Child) = (*ids.add(i), bytemuck::cast(*children.add(i)));
                let ray = id as usize & !(WIDTH - 1);
                (id, sub.tree.block(child), &raw mut (*sub.rows.byte_add(ray)).limit)
            };
            // SAFETY: invariant 1.
            if unsafe { *limit } >= 0.0 {
                let row = id as usize % WIDTH;
                let primitive = space.scene_id(block.id(row)) & PRIMITIVE;
                let corners = world_corners(space, &block, row);
                some[len] = Candidate { ray: first + ray_index(id), primitive, corners };
                rows[len] = limit;
                len += 1;
            }
            if len == batch || i + 1 == count {
                sink.take_all(&some[..len], &mut limits[..len]);
                for k in 0..len {
                    // SAFETY: invariant 1. Adding +0 turns −0 into 0, as the integer comparisons of `Slabs` require of
                    // limits.
                    unsafe { *rows[k] = (*rows[k]).min(limits[k]) + 0.0 };
                }
                len = 0;
            }
        }
    }
}

impl<W: Lanes, E: Lanes, S: Space> CandidateVisitor<'_, '_, W, E, S> {
    /// Hands all candidates to the sink, in its columns.
    ///
    /// # Safety
    /// Invariants 1, 4, 5 and 6.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn hand_over_columns(&self, stack: &mut OctantStack) {
        let count = stack.candidates.len();
        let (ids, children) = stack.candidates.pop(count);
        let mut sink = self.found.sink.borrow_mut();
        for first in (0..count).step_by(MAX_BATCH) {
            let Some(columns) = sink.columns() else { return };
            columns.len = MAX_BATCH.min(count - first);
            for at in (0..columns.len).step_by(W::LANES) {
                // SAFETY: the caller's contract; there are candidates from `first + at` on.
                unsafe { self.write_columns(columns, at, ids.add(first + at), children.add(first + at)) };
            }
            sink.take_columns();
        }
    }

    /// Writes the candidates of a vector to columns, from `at` on.
    ///
    /// # Safety
    /// Invariants 1, 4, 5 and 6; the first candidate of the vector is one.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn write_columns(
        &self,
        columns: &mut CandidateColumns,
        at: usize,
        ids: *const u32,
        children: *const u32,
    ) {
        let Self { widths: Widths { wide: w, .. }, space, sub, found: Found { first, .. }, .. } = *self;
        // In the lanes beyond the last candidate the first one stands in.
        let some = first_lanes::<W>(columns.len - at);
        // SAFETY: invariant 6; the caller's contract for the first ones.
        let (ids, children) = unsafe {
            (
                w.select_u32(some, w.load_u32(ids), w.splat_u32(*ids)),
                w.select_u32(some, w.load_u32(children), w.splat_u32(*children)),
            )
        };
        let rows = w.and_u32(ids, w.splat_u32(WIDTH as u32 - 1));
        // SAFETY: invariants 4 and 5.
        let (stored, corners) = unsafe { sub.tree.blocks.gather(w, children, rows) };
        let mut offsets = [0; MAX_LANES];
        // SAFETY: invariant 8, as `offsets` has the most lanes.
        unsafe { w.store_u32(offsets.as_mut_ptr(), w.and_u32(ids, w.splat_u32(!(WIDTH as u32 - 1)))) };
        // SAFETY: invariant 1.
        let [ox, oy, oz, t_min, dx, dy, dz, t_max] = unsafe { w.rows(sub.rays.cast(), offsets.as_ptr()) };
        let index = w.add_u32(w.shr_u32(ids, ROW_BYTES.ilog2()), w.splat_u32(first as u32));
        let primitives = w.and_u32(space.scene_ids(w, stored), w.splat_u32(PRIMITIVE));
        let CandidateColumns { len: _, rays, origins, directions, t_min: from, t_max: to, .. } = columns;
        put_u32(w, at, rays, index);
        put(w, at, &mut origins[0], ox);
        put(w, at, &mut origins[1], oy);
        put(w, at, &mut origins[2], oz);
        put(w, at, &mut directions[0], dx);
        put(w, at, &mut directions[1], dy);
        put(w, at, &mut directions[2], dz);
        put(w, at, from, t_min);
        put(w, at, to, t_max);
        put_u32(w, at, &mut columns.primitives, primitives);
        for (corner, &local) in corners.iter().enumerate() {
            let [x, y, z] = space.to_world(w, local);
            put(w, at, &mut columns.corners[corner][0], x);
            put(w, at, &mut columns.corners[corner][1], y);
            put(w, at, &mut columns.corners[corner][2], z);
        }
    }
}

/// Writes a vector to a column, from `at` on.
///
/// # Panics
/// If the column has too few elements from there.
#[inline(always)]
fn put<L: Lanes>(l: L, at: usize, column: &mut [f32; MAX_BATCH], numbers: L::F) {
    let to = &mut column[at..at + L::LANES];
    // SAFETY: invariant 8, as `to` is cut.
    unsafe { l.store(to.as_mut_ptr(), numbers) };
}

/// [`put`] of whole numbers.
#[inline(always)]
fn put_u32<L: Lanes>(l: L, at: usize, column: &mut [u32; MAX_BATCH], numbers: L::I) {
    let to = &mut column[at..at + L::LANES];
    // SAFETY: invariant 8, as `to` is cut.
    unsafe { l.store_u32(to.as_mut_ptr(), numbers) };
}

/// The positions of the bits of a mask.
#[inline(always)]
fn bits_of(mut mask: LaneBits) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        let some = mask != 0;
        mask &= mask.wrapping_sub(1);
        some.then_some(lane % MAX_LANES)
    })
}

/// The corners of a triangle in the world.
#[inline(always)]
fn world_corners<S: Space>(space: S, block: &LeafBlock<'_>, row: usize) -> [Vec3; 3] {
    let l = SingleLane;
    each(block.corners(row), |corner| {
        let moved = space.to_world(l, splat(l, corner.to_array()));
        Vec3::from_array(each(moved, |coordinate| l.lowest(coordinate)))
    })
}

/// The row of a triangle for each lane, when each eight lanes hold a block.
static BLOCK_ROWS: [u32; MAX_LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];

/// Bound of the rounding errors of an edge function, relative to the product of the longest edge, the greatest distance
/// from the origin and the direction, each by its largest component: 78 units of rounding for the operations below to
/// first order, and a reserve.
const ERRORS: f32 = 100.0 / (1 << 24) as f32;

/// The least size of edges whose volume's sign is known: products of smaller ones may underflow.
const LEAST_EDGE: f32 = 1e-15;

/// The lanes of `among` whose ray may cross the triangle: all but those whose line two edges certainly have on
/// different sides. And the lanes of `whole`, rays without ends, that certainly cross it; they are not among the first.
///
/// The edge functions are those of the canonical test, but for edges that are computed from corners which are not
/// relative to the origin: so they are as exact as they can be. A ray crosses the triangle that its line crosses if the
/// volume between triangle and origin has the sign of the edge functions. Its errors have the same bound.
#[inline(always)]
fn candidates<L: Lanes>(
    l: L,
    among: LaneBits,
    whole: LaneBits,
    lines: &Lines<L>,
    triangle: &[LaneVec3<L>; 3],
) -> (LaneBits, LaneBits) {
    let Lines { origin, direction } = lines;
    let [p, q, r] = *triangle;
    let [a, b, c] = relative_corners(l, origin, triangle);
    let edges = [sub(l, r, p), sub(l, p, q), sub(l, q, r)];
    let u = dot(l, cross(l, edges[0], add(l, c, a)), *direction);
    let v = dot(l, cross(l, edges[1], add(l, a, b)), *direction);
    let w = dot(l, cross(l, edges[2], add(l, b, c)), *direction);
    let longest = largest(l, &edges);
    let reach = largest(l, &[a, b, c]);
    // The small numbers are for products that underflow.
    let product = l.fma(longest, reach, l.splat(1e-36));
    let small = l.splat(1e-37);
    let bound = l.fma(product, l.mul(max_abs(l, *direction), l.splat(ERRORS)), small);
    let lowest = l.min(l.min(u, v), w);
    let highest = l.max(l.max(u, v), w);
    let mut some = among & !l.lt(l.lt(among, bound, highest), lowest, l.neg(bound));
    if whole & some == 0 {
        return (some, 0);
    }
    let volume = dot(l, cross(l, edges[0], edges[1]), a);
    let bound_of_volume = l.fma(product, l.mul(longest, l.splat(ERRORS)), small);
    let large = l.le(whole & some, l.splat(LEAST_EDGE), longest);
    let [positive, negative] = [l.lt(large, bound, lowest), l.lt(large, highest, l.neg(bound))];
    let is_before = l.lt(positive, bound_of_volume, volume) | l.lt(negative, volume, l.neg(bound_of_volume));
    let is_behind = l.lt(positive, volume, l.neg(bound_of_volume)) | l.lt(negative, bound_of_volume, volume);
    some &= !(is_before | is_behind);
    (some, is_before)
}

/// True unless a ray's line certainly misses a triangle.
pub(super) fn is_candidate(ray: &Ray, corners: &[Vec3; 3]) -> bool {
    let l = SingleLane;
    let lines = Lines { origin: ray.origin, direction: ray.direction };
    candidates(l, 1, 0, &lines, &corners.map(|corner| corner.to_array())).0 != 0
}

/// The largest component of three vectors.
#[inline(always)]
fn largest<L: Lanes>(l: L, vectors: &[LaneVec3<L>; 3]) -> L::F {
    let [a, b, c] = *vectors;
    l.max(l.max(max_abs(l, a), max_abs(l, b)), max_abs(l, c))
}

/// Visits instances with a [`CandidateVisitor`].
pub(super) struct CandidateVisits<'a, 's, W, E> {
    pub widths: Widths<W, E>,
    pub found: Found<'a, 's>,
}

impl<W: Lanes, E: Lanes> VisitInstance for CandidateVisits<'_, '_, W, E> {
    #[inline(always)]
    unsafe fn visit_all<S: Space>(
        &self,
        space: S,
        sub: &SubStream<'_>,
        octant: usize,
        stack: &mut OctantStack,
    ) {
        let visitor = CandidateVisitor { widths: self.widths, space, sub, found: self.found };
        // SAFETY: the caller's contract.
        while unsafe { visitor.step(octant, stack) } {}
    }
}
