//! Rays against the triangles of leaf blocks: lists of rays, and pairs of a ray and a block.
//!
//! Unsafe code for rows, rays, answers, lists and pairs. Invariants 1, 2, 4, 5 and 6 are those of `substream`,
//! and:
//! 9. Arrays on the stack have an element for each lane of any vector, and are read only where they were written.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Space, splat_triangle};
use super::lane_math::LaneVec3;
use super::pair_stack::{BLOCK_BATCH, splat_id_pair};
use super::ray_lists::ListVector;
use super::slabs::{Boxes, Faces, Slabs};
use super::substream::{OctantStack, SubStream, Widths, prefetch_rows};
use super::triangle::{
    Bounds, BoundsFaces, EdgeValues, LaneHits, Limits, Lines, hits_inside, relative_corners, test,
};
use crate::bvh::{Child, LeafBlock, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{LaneBits, Lanes, MAX_LANES, both, first_lanes, keep, spill, splat_eights, splat_row};
use crate::stream::Hit;
use std::mem::MaybeUninit;

/// Triangles of a block that are tested together in any-hit queries: often the first ones decide.
const ANY_HIT_STEP: usize = 2;

/// Tests all rays of a list against the triangles of a block, many rays in a vector. Returns for any-hit queries how
/// many rays have become occluded.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2) of rays of `octant`.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn test_list<W: Lanes, E: Lanes, S: Space, const ANY: bool>(
    widths: Widths<W, E>,
    space: S,
    sub: &SubStream<'_>,
    block: LeafBlock<'_>,
    octant: usize,
    list: *mut u32,
    mut len: usize,
) -> u32 {
    let Widths { wide: w, eight: e } = widths;
    let corners = space.corners(e, &[block; 2]);
    let BoundsFaces { near, far } = Bounds::of(e, &corners).faces(octant);
    if !S::HAS_TIGHT_BLOCKS {
        let boxes = union_box(e, &near, &far, block.len(), octant);
        // SAFETY: the caller's contract.
        len = unsafe { keep_entering(w, sub, &Faces::new(&boxes, 0), list, len) };
    }
    let (near, far) = (keep(e, near), keep(e, far));
    let corners = [keep(e, corners[0]), keep(e, corners[1]), keep(e, corners[2])];
    let mut edges = [const { MaybeUninit::<EdgeValues<W>>::uninit() }; WIDTH];
    let (mut at, mut done) = (0, 0);
    while at < len {
        // SAFETY: invariant 2.
        let ids = unsafe { list.add(at) };
        let mut among = first_lanes::<W>(len - at);
        at += W::LANES;
        // SAFETY: invariant 2 for the ids, 1 for rays and rows.
        let (rays, row) = unsafe { (w.rows(sub.rays.cast(), ids), w.rows(sub.rows.cast(), ids)) };
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let [ix, iy, iz, sx, sy, sz, slack, limit] = row;
        if at < len {
            // SAFETY: invariant 2.
            unsafe {
                prefetch_rows(w, sub.rows.cast_const(), list.add(at));
                prefetch_rows(w, sub.rays, list.add(at));
            }
        }
        let slabs = Slabs::new(w, [ix, iy, iz], [sx, sy, sz], slack);
        let mut limits = Limits { slabs: &slabs, octant, t_min: w.max(t_min, w.splat(0.0)), limit };
        if ANY {
            among = w.le(among, w.splat(0.0), limit);
            done += among.count_ones();
        }
        let lines = Lines { origin: [ox, oy, oz], direction: [dx, dy, dz] };
        let mut inside = [0; WIDTH];
        let mut nearest = NearestHits::none(w);
        let mut next = 0;
        while next < block.len() && (!ANY || among != 0) {
            // First the edge values of several triangles, with all computations in flight at once. Then the rest of the
            // test for those that some line passes through; decided triangle by triangle, every second branch would be
            // mispredicted.
            let (first, mut some) = (next, 0);
            next = block.len().min(first + if ANY { ANY_HIT_STEP } else { WIDTH });
            for k in first..next {
                let values = EdgeValues::of(w, &lines, &splat_triangle(w, &corners, k));
                inside[k] = values.inside(w, among);
                some |= u32::from(inside[k] != 0) << k;
                edges[k].write(values);
            }
            while some != 0 && (!ANY || among != 0) {
                let k = some.trailing_zeros() as usize % WIDTH;
                some &= some - 1;
                let (triangle, id) = (splat_triangle(w, &corners, k), space.scene_id(block.id(k)));
                // SAFETY: invariant 9: bit `k` of `some` was set after the values were written.
                let values = unsafe { edges[k].assume_init_ref() };
                let faces = BoundsFaces { near: splat_row(w, &near, k), far: splat_row(w, &far, k) };
                let (mask, t) = hits_inside(w, inside[k] & among, &lines, &triangle, values, &faces, &limits);
                if mask == 0 {
                    continue;
                }
                let plain = id & MASKED == 0;
                if ANY && plain {
                    nearest.changed |= mask;
                    among &= !mask;
                } else if plain && w.eq(mask, t, limits.limit) == 0 {
                    nearest.take(w, id & PRIMITIVE, mask, t, values);
                    limits.limit = w.select(mask, t, limits.limit);
                } else {
                    let (u, v) = values.barycentrics(w);
                    let hits = LaneHits { mask, t, u, v };
                    // SAFETY: invariants 1 and 2.
                    let taken = unsafe { offer_each::<W, ANY>(w, sub, ids, id, &hits, &mut nearest) };
                    limits.limit = w.select(taken, t, limits.limit);
                    among &= if ANY { !taken } else { !0 };
                }
            }
        }
        if ANY {
            done -= among.count_ones();
        }
        // SAFETY: invariants 1 and 2.
        unsafe { nearest.record::<ANY>(w, sub, ids) };
    }
    done
}

/// The box around the first `len` of eight boxes, in all slots, from their near and far faces for rays of `octant`. Its
/// near faces come first.
#[inline(always)]
fn union_box<E: Lanes>(e: E, near: &LaneVec3<E>, far: &LaneVec3<E>, len: usize, octant: usize) -> Boxes {
    let among = (1 << len) - 1;
    let mut union = [[[0.0; WIDTH]; 3]; 2];
    for axis in 0..3 {
        let (inf, minus) = (e.splat(f32::INFINITY), e.splat(f32::NEG_INFINITY));
        let (near, far) = if octant >> axis & 1 == 0 {
            (e.lowest(e.select(among, near[axis], inf)), e.highest(e.select(among, far[axis], minus)))
        } else {
            (e.highest(e.select(among, near[axis], minus)), e.lowest(e.select(among, far[axis], inf)))
        };
        (union[0][axis], union[1][axis]) = ([near; WIDTH], [far; WIDTH]);
    }
    union
}

/// Removes the rays from a list that do not enter the box in slot 0, and returns its new length.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2).
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn keep_entering<W: Lanes>(
    w: W,
    sub: &SubStream<'_>,
    faces: &Faces<'_>,
    list: *mut u32,
    len: usize,
) -> usize {
    let mut end = list;
    for at in (0..len).step_by(W::LANES) {
        // SAFETY: invariants 1 and 2; what is written lies before what is read next.
        unsafe { ListVector::load::<true>(w, sub, list, at, len).append_entering(w, faces, 0, &mut end) };
    }
    // SAFETY: both point into the list (invariant 2).
    unsafe { end.offset_from_unsigned(list) }
}

/// The nearest hits of rays in lanes with the triangles of a block that are not recorded yet.
struct NearestHits<L: Lanes> {
    /// The lanes that have one.
    changed: LaneBits,
    t: L::F,
    edges: EdgeValues<L>,
    primitive: L::I,
}

impl<L: Lanes> NearestHits<L> {
    #[inline(always)]
    fn none(l: L) -> Self {
        let zero = l.splat(0.0);
        let edges = EdgeValues { u: zero, v: zero, w: zero };
        Self { changed: 0, t: zero, edges, primitive: l.splat_u32(0) }
    }

    /// Takes the hits of `mask`, which are nearer than all before.
    #[inline(always)]
    fn take(&mut self, l: L, primitive: u32, mask: LaneBits, t: L::F, edges: &EdgeValues<L>) {
        self.changed |= mask;
        self.t = l.select(mask, t, self.t);
        self.edges = EdgeValues {
            u: l.select(mask, edges.u, self.edges.u),
            v: l.select(mask, edges.v, self.edges.v),
            w: l.select(mask, edges.w, self.edges.w),
        };
        self.primitive = l.select_u32(mask, l.splat_u32(primitive), self.primitive);
    }

    /// Records the hits as the answers of the rays with these ids, one id per lane; none remain.
    ///
    /// # Safety
    /// Invariant 1 for the ids.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn record<const ANY: bool>(&mut self, l: L, sub: &SubStream<'_>, ids: *const u32) {
        let mut left = std::mem::take(&mut self.changed);
        if left == 0 {
            return;
        }
        // Any-hit queries discard the barycentric weights.
        let (u, v) = if ANY { (self.t, self.t) } else { self.edges.barycentrics(l) };
        let (ts, us, vs) = (spill(l, self.t), spill(l, u), spill(l, v));
        let mut primitives = [0; MAX_LANES];
        // SAFETY: invariant 9.
        unsafe { l.store_u32(primitives.as_mut_ptr(), self.primitive) };
        while left != 0 {
            let lane = left.trailing_zeros() as usize % MAX_LANES;
            left &= left - 1;
            let hit = Hit { t: ts[lane], u: us[lane], v: vs[lane], primitive: primitives[lane] };
            // SAFETY: invariant 1.
            unsafe { sub.record::<ANY>(*ids.add(lane), hit) };
        }
    }
}

/// Offers hits one by one: those that need the filter, and those that tie with the nearest so far. Returns the lanes
/// whose hits were recorded.
///
/// # Safety
/// Invariant 1 for the ids, one id per lane.
#[inline(always)]
unsafe fn offer_each<L: Lanes, const ANY: bool>(
    l: L,
    sub: &SubStream<'_>,
    ids: *const u32,
    stored: u32,
    hits: &LaneHits<L>,
    nearest: &mut NearestHits<L>,
) -> LaneBits {
    // SAFETY: invariant 1.
    unsafe { nearest.record::<ANY>(l, sub, ids) };
    let (ts, us, vs) = (spill(l, hits.t), spill(l, hits.u), spill(l, hits.v));
    let (mut taken, mut left) = (0, hits.mask);
    while left != 0 {
        let lane = left.trailing_zeros() as usize % MAX_LANES;
        left &= left - 1;
        // SAFETY: invariant 1.
        let accepted = unsafe { sub.offer::<ANY>(*ids.add(lane), stored, ts[lane], us[lane], vs[lane]) };
        taken |= u32::from(accepted) << lane;
    }
    taken
}

/// Tests the topmost pairs of rays and leaf blocks.
///
/// First come the edge values: each ray against all triangles of its block in eight lanes. Without a branch between
/// pairs, many are in flight at once. Triangles whose interior a line passes through become candidates, a few per
/// block, which [`test_candidates`] tests one to a lane as soon as they fill the lanes.
///
/// # Safety
/// The stack has pairs with leaf blocks, of rays of `octant`, and invariants 1, 4, 5 and 6 hold for it.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn test_pairs<W: Lanes, S: Space, const ANY: bool>(
    w: W,
    space: S,
    sub: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
) {
    let OctantStack { block_pairs, candidates, .. } = stack;
    let len = block_pairs.len().min(BLOCK_BATCH);
    candidates.reserve(len * WIDTH);
    let (ids, children) = block_pairs.pop(len);
    let batch = PairBatch { ids, children, len };
    // One pair in each eight lanes.
    let step = W::LANES / WIDTH;
    // With enough registers the next pairs are loaded before the current ones are tested: a test that waits for its
    // corners occupies the window in which the processor looks for work. (Not in a closure, which may not be inlined.)
    let early = W::LANES > WIDTH;
    // SAFETY: the caller's contract (invariants 1, 4 and 6).
    let mut next = unsafe { RelativePairs::load(w, space, sub, &batch, 0) };
    for i in (0..len).step_by(step) {
        for ahead in i + PREFETCH_DISTANCE..i + PREFETCH_DISTANCE + step {
            // SAFETY: invariants 4 and 6; the pair is one of the batch.
            unsafe { batch.prefetch(sub, ahead.min(len - 1)) };
        }
        let mut current = next;
        // SAFETY: the caller's contract (invariants 1, 4 and 6).
        unsafe {
            if early {
                next = RelativePairs::load(w, space, sub, &batch, (i + step).min(len - 1));
            } else {
                current = RelativePairs::load(w, space, sub, &batch, i);
            }
        }
        let edges = EdgeValues::of_relative(w, current.corners, current.direction);
        let inside = edges.inside(w, current.among);
        // SAFETY: the pairs are of the batch; invariant 6: there is room for all triangles of all pairs, and for a
        // vector beyond them.
        unsafe {
            let pair = [i, batch.second::<W>(i)];
            let rays = splat_id_pair(w, both(pair, |i| *ids.add(i)));
            let rays = w.or_u32(rays, w.load_u32(BLOCK_ROWS.as_ptr()));
            candidates.push_lanes(w, inside, rays, splat_id_pair(w, both(pair, |i| *children.add(i))));
        }
    }
    // SAFETY: the caller's contract; what was pushed satisfies invariant 5.
    unsafe { test_candidates::<W, S, ANY>(w, space, sub, octant, stack, W::LANES) };
}

/// The row of a triangle for each lane, when each eight lanes hold a block.
static BLOCK_ROWS: [u32; MAX_LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];

/// Tests the topmost candidates while at least `min` are pending: triangles whose interior or edge a ray's line passes
/// through. For any-hit queries the stack counts the rays that become occluded.
///
/// # Safety
/// The candidates are of rays of `octant`, and invariants 1, 4, 5 and 6 hold for the stack. `min` is at least 1.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn test_candidates<W: Lanes, S: Space, const ANY: bool>(
    w: W,
    space: S,
    sub: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
    min: usize,
) {
    let OctantStack { candidates, done, .. } = stack;
    while candidates.len() >= min {
        let among = first_lanes::<W>(candidates.len());
        let (ids, children) = candidates.pop(candidates.len().min(W::LANES));
        let (mut ray_ids, mut stored) = ([0; MAX_LANES], [0; MAX_LANES]);
        // SAFETY: invariant 6 for the vectors of ids and children, whose first stands in for lanes beyond the
        // stack's top; 4 and 5 for the triangles; 1 for rays and rows. The arrays are as long as the widest vector.
        let (rays, row, [a, b, c]) = unsafe {
            let ids = w.select_u32(among, w.load_u32(ids), w.splat_u32(*ids));
            let children = w.select_u32(among, w.load_u32(children), w.splat_u32(*children));
            let block_rows = w.and_u32(ids, w.splat_u32(WIDTH as u32 - 1));
            let (id, corners) = sub.tree.blocks.gather(w, children, block_rows);
            w.store_u32(ray_ids.as_mut_ptr(), w.xor_u32(ids, block_rows));
            w.store_u32(stored.as_mut_ptr(), id);
            (w.rows(sub.rays.cast(), ray_ids.as_ptr()), w.rows(sub.rows.cast(), ray_ids.as_ptr()), corners)
        };
        let triangle = [space.to_world(w, a), space.to_world(w, b), space.to_world(w, c)];
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let [ix, iy, iz, sx, sy, sz, slack, limit] = row;
        let slabs = Slabs::new(w, [ix, iy, iz], [sx, sy, sz], slack);
        let limits = Limits { slabs: &slabs, octant, t_min: w.max(t_min, w.splat(0.0)), limit };
        let lines = Lines { origin: [ox, oy, oz], direction: [dx, dy, dz] };
        let Some(hits) = test(w, among, &lines, &triangle, &limits) else {
            continue;
        };
        let (ts, us, vs) = (spill(w, hits.t), spill(w, hits.u), spill(w, hits.v));
        let mut left = hits.mask;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % MAX_LANES;
            left &= left - 1;
            let id = ray_ids[lane];
            // SAFETY: invariant 1.
            unsafe {
                // Another lane may have occluded the same ray.
                if ANY && (*sub.rows.byte_add(id as usize)).limit < 0.0 {
                    continue;
                }
                let taken = sub.offer::<ANY>(id, space.scene_id(stored[lane]), ts[lane], us[lane], vs[lane]);
                *done = done.wrapping_add(u32::from(ANY && taken));
            }
        }
    }
}

/// Number of pairs by which memory is prefetched before a pair is tested. If the whole batch were prefetched at once,
/// the prefetches would wait for each other.
const PREFETCH_DISTANCE: usize = 16;

/// Prefetches what the pairs need that [`test_pairs`] tests first.
#[inline(always)]
pub(super) fn prefetch_first_pairs(sub: &SubStream<'_>, stack: &OctantStack) {
    let pairs = &stack.block_pairs;
    let len = pairs.len().min(BLOCK_BATCH);
    let (ids, children) = pairs.at(pairs.len() - len);
    let batch = PairBatch { ids, children, len };
    for i in 0..len.min(PREFETCH_DISTANCE) {
        // SAFETY: invariants 4 and 6; the pair is one of the batch.
        unsafe { batch.prefetch(sub, i) };
    }
}

/// Pairs of rays and leaf blocks that are tested at once: where their ids and children lie, and how many there are.
struct PairBatch {
    ids: *const u32,
    children: *const u32,
    len: usize,
}

impl PairBatch {
    /// The pair in the second eight lanes if pair `i` is in the first. If there is none, the last pair stands in for
    /// it; its lanes are masked out.
    #[inline(always)]
    fn second<W: Lanes>(&self, i: usize) -> usize {
        (i + W::LANES / WIDTH).min(self.len) - 1
    }

    /// Prefetches what pair `i` needs.
    ///
    /// # Safety
    /// There is a pair `i`.
    #[inline(always)]
    unsafe fn prefetch(&self, sub: &SubStream<'_>, i: usize) {
        // SAFETY: the caller's contract (invariant 6).
        let (id, child) = unsafe { (*self.ids.add(i), *self.children.add(i)) };
        sub.tree.prefetch_block_and_ray(bytemuck::cast(child), sub.rays.wrapping_byte_add(id as usize));
    }
}

/// Pairs of rays and leaf blocks, one pair in each eight lanes, with the triangles relative to the rays' origins.
#[derive(Clone, Copy)]
struct RelativePairs<W: Lanes> {
    corners: [LaneVec3<W>; 3],
    direction: LaneVec3<W>,
    /// The lanes that have a triangle.
    among: LaneBits,
}

impl<W: Lanes> RelativePairs<W> {
    /// Pair `i` and, with sixteen lanes, the next one.
    ///
    /// # Safety
    /// There is a pair `i`. Invariants 1 and 4 hold for the pairs of the batch, whose children are leaf blocks.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load<S: Space>(w: W, space: S, sub: &SubStream<'_>, batch: &PairBatch, i: usize) -> Self {
        let pair = [i, batch.second::<W>(i)];
        // SAFETY: invariants 1 and 6.
        let rays = unsafe { both(pair, |i| &*sub.rays.byte_add(*batch.ids.add(i) as usize)) };
        // SAFETY: invariant 6.
        let children: [Child; 2] = unsafe { both(pair, |i| bytemuck::cast(*batch.children.add(i))) };
        // SAFETY: invariant 4.
        let blocks = unsafe { [sub.tree.block(children[0]), sub.tree.block(children[1])] };
        let triangles = space.corners(w, &blocks);
        let [first, second] = both(children, |child| (1 << child.triangles()) - 1);
        Self {
            corners: relative_corners(w, &splat_eights(w, both(rays, |ray| ray.origin)), &triangles),
            direction: splat_eights(w, both(rays, |ray| ray.direction)),
            among: (first | second << WIDTH) & first_lanes::<W>(WIDTH * (batch.len - i)),
        }
    }
}
