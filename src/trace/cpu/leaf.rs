//! A list of rays meets a block of triangles.
//!
//! Unsafe code for rows and answers. The invariants are those of `substream`.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Space, triangle};
use super::ray_node_pairs::{BLOCKS, ids_of_eights};
use super::substream::{
    Answers, DONE, OctantStack, PADDING, ROW_BYTES, SubStream, fetch_rows, lanes_of, lines_of_block,
};
use super::triangle::{Bounds, Hits, Passing, Range, Slabs, Vector, reach, seen, test};
use crate::bvh::{Child, LeafBlock, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{Lanes, keep, spill, splat_eights, splat_row};
use crate::stream::Hit;
use std::mem::MaybeUninit;

/// Tests all rays of a list with the triangles of a block, many rays to a register. Answers
/// for any hit how many rays are done by it.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2), and all its rays are of the octant.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "inlined: a struct of them would only be taken apart again")]
pub(super) unsafe fn test_list<L: Lanes, E: Lanes, S: Space, const ANY: bool>(
    l: L,
    e: E,
    space: S,
    job: &SubStream<'_>,
    block: LeafBlock<'_>,
    octant: usize,
    list: *const u32,
    len: usize,
) -> u32 {
    let corners = space.triangles(e, &[block; 2]);
    let [near, far] = Bounds::of(e, &corners).faces(octant);
    let (near, far) = (keep(e, near), keep(e, far));
    let corners = [keep(e, corners[0]), keep(e, corners[1]), keep(e, corners[2])];
    let mut passing = [const { MaybeUninit::<Passing<L>>::uninit() }; WIDTH];
    let (mut at, mut done) = (0, 0);
    while at < len {
        // SAFETY: invariant 2.
        let ids = unsafe { list.add(at) };
        let mut among = lanes_of::<L>(len - at);
        at += L::LANES;
        // SAFETY: invariant 1.
        let (rays, row) = unsafe { (l.rows(job.rays.cast(), ids), l.rows(job.rows.cast(), ids)) };
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let [ix, iy, iz, sx, sy, sz, slack, limit] = row;
        if at < len {
            // SAFETY: invariant 2.
            unsafe {
                fetch_rows(l, job.rows.cast_const(), list.add(at));
                fetch_rows(l, job.rays, list.add(at));
            }
        }
        let slabs = Slabs::new(l, [ix, iy, iz], [sx, sy, sz], slack);
        let mut range = Range { slabs: &slabs, octant, t_min: l.max(t_min, l.splat(0.0)), limit };
        if ANY {
            among = l.le(among, l.splat(0.0), limit);
            done += among.count_ones();
        }
        let (origin, direction) = ([ox, oy, oz], [dx, dy, dz]);
        let mut inside = [0; WIDTH];
        let mut nearest = Nearest::none(l);
        let mut next = 0;
        while next < block.len() && (!ANY || among != 0) {
            // First where lines pass the triangles, of which all are in the works at once, then the rest for those that
            // some pass inside: were that decided one by one, every other guess would be wrong.
            let (first, mut some) = (next, 0);
            next = block.len().min(first + if ANY { FIRST } else { WIDTH });
            for k in first..next {
                let by = Passing::of(l, &origin, direction, &triangle(l, &corners, k));
                inside[k] = by.inside(l, among);
                some |= u32::from(inside[k] != 0) << k;
                passing[k].write(by);
            }
            while some != 0 && (!ANY || among != 0) {
                let k = some.trailing_zeros() as usize % WIDTH;
                some &= some - 1;
                let (triangle, id) = (triangle(l, &corners, k), space.id(block.id(k)));
                // SAFETY: it was written, for otherwise none passed inside.
                let by = unsafe { passing[k].assume_init_ref() };
                let faces = [splat_row(l, &near, k), splat_row(l, &far, k)];
                let (mask, t) = reach(l, inside[k] & among, &origin, direction, &triangle, by, faces, &range);
                if mask == 0 {
                    continue;
                }
                let plain = id & MASKED == 0;
                if ANY && plain {
                    nearest.changed |= mask;
                    among &= !mask;
                } else if plain && l.eq(mask, t, range.limit) == 0 {
                    nearest.take(l, id & PRIMITIVE, mask, t, by);
                    range.limit = l.select(mask, t, range.limit);
                } else {
                    let (u, v) = by.weights(l);
                    let hits = Hits { mask, t, u, v };
                    // SAFETY: as the caller vouches.
                    let taken = unsafe { offer_each::<L, ANY>(l, job, ids, id, &hits, &mut nearest) };
                    range.limit = l.select(taken, t, range.limit);
                    among &= if ANY { !taken } else { !0 };
                }
            }
        }
        if ANY {
            done -= among.count_ones();
        }
        // SAFETY: as the caller vouches.
        unsafe { nearest.put::<ANY>(l, job, ids) };
    }
    done
}

/// Triangles of a block that are tested together for any hit: often the first ones decide.
const FIRST: usize = 2;

/// The nearest hits of rays in lanes with a block, not yet put where answers go.
struct Nearest<L: Lanes> {
    /// Lanes that have one.
    changed: u32,
    t: L::F,
    passing: Passing<L>,
    primitive: L::I,
}

impl<L: Lanes> Nearest<L> {
    #[inline(always)]
    fn none(l: L) -> Self {
        let zero = l.splat(0.0);
        let passing = Passing { u: zero, v: zero, w: zero };
        Self { changed: 0, t: zero, passing, primitive: l.splat_u32(0) }
    }

    /// Takes the hits of `mask`, nearer than all before.
    #[inline(always)]
    fn take(&mut self, l: L, primitive: u32, mask: u32, t: L::F, passing: &Passing<L>) {
        self.changed |= mask;
        self.t = l.select(mask, t, self.t);
        self.passing = Passing {
            u: l.select(mask, passing.u, self.passing.u),
            v: l.select(mask, passing.v, self.passing.v),
            w: l.select(mask, passing.w, self.passing.w),
        };
        self.primitive = l.select_u32(mask, l.splat_u32(primitive), self.primitive);
    }

    /// Puts them to the answers of the rays of `ids`, and has none then.
    ///
    /// # Safety
    /// Invariant 1 for `ids`, one for each lane.
    #[inline(always)]
    unsafe fn put<const ANY: bool>(&mut self, l: L, job: &SubStream<'_>, ids: *const u32) {
        let mut left = std::mem::take(&mut self.changed);
        if left == 0 {
            return;
        }
        // Any hit is as good as another.
        let (u, v) = if ANY { (self.t, self.t) } else { self.passing.weights(l) };
        let (ts, us, vs) = (spill(l, self.t), spill(l, u), spill(l, v));
        let mut primitives = [0; 16];
        // SAFETY: sixteen are enough for any lanes.
        unsafe { l.store_u32(primitives.as_mut_ptr(), self.primitive) };
        while left != 0 {
            let lane = left.trailing_zeros() as usize & 15;
            left &= left - 1;
            // SAFETY: as the caller vouches.
            unsafe {
                let id = *ids.add(lane);
                job.put::<ANY>(
                    id,
                    Hit { t: ts[lane], u: us[lane], v: vs[lane], primitive: primitives[lane] },
                );
            }
        }
    }
}

/// Offers hits one by one: those that need the filter's word, or that tie with the nearest so far. Says
/// which were taken.
///
/// # Safety
/// Invariant 1 for `ids`, one for each lane.
#[inline(always)]
unsafe fn offer_each<L: Lanes, const ANY: bool>(
    l: L,
    job: &SubStream<'_>,
    ids: *const u32,
    stored: u32,
    hits: &Hits<L>,
    nearest: &mut Nearest<L>,
) -> u32 {
    // SAFETY: as the caller vouches.
    unsafe { nearest.put::<ANY>(l, job, ids) };
    let (ts, us, vs) = (spill(l, hits.t), spill(l, hits.u), spill(l, hits.v));
    let (mut taken, mut left) = (0, hits.mask);
    while left != 0 {
        let lane = left.trailing_zeros() as usize & 15;
        left &= left - 1;
        // SAFETY: as the caller vouches.
        let accepted = unsafe { job.offer::<ANY>(*ids.add(lane), stored, ts[lane], us[lane], vs[lane]) };
        taken |= u32::from(accepted) << lane;
    }
    taken
}

/// Tests the topmost pairs of rays and blocks.
///
/// First which lines pass inside which triangles, each ray with all triangles of its block in eight lanes and without a branch, so
/// that many are in the works at once; then the rest for those, a few of a block, one in each lane, as soon as they fill
/// the lanes.
///
/// # Safety
/// The stack has pairs of blocks. Of these, invariant 1 holds for the ids and 4 for the blocks, and all rays are of the octant.
#[inline(always)]
pub(super) unsafe fn test_pairs<W: Lanes, S: Space, const ANY: bool>(
    w: W,
    space: S,
    job: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
) {
    let OctantStack { pairs: [_, blocks], candidates, .. } = stack;
    let len = blocks.len.min(BLOCKS);
    blocks.len -= len;
    candidates.reserve(len * WIDTH);
    let (ids, children) = blocks.at(blocks.len);
    // As many pairs at once as there are eights of lanes.
    let step = W::LANES / WIDTH;
    // Where there are registers enough the next pairs are made ready before those at hand are tested: a test that waits for its
    // corners takes up the window in which the processor looks for work. Not in a closure, which need not be inlined.
    let early = W::LANES > WIDTH;
    // SAFETY: as the caller vouches.
    let mut next = unsafe { Ready::of(w, space, job, ids, children, 0, len) };
    for i in (0..len).step_by(step) {
        for ahead in i + AHEAD..i + AHEAD + step {
            let ahead = ahead.min(len - 1);
            // SAFETY: as the caller vouches.
            unsafe { fetch_pair(job, *ids.add(ahead), *children.add(ahead)) };
        }
        let mut now = next;
        // SAFETY: as the caller vouches.
        unsafe {
            if early {
                next = Ready::of(w, space, job, ids, children, (i + step).min(len - 1), len);
            } else {
                now = Ready::of(w, space, job, ids, children, i, len);
            }
        }
        let inside = Passing::seen(w, now.corners, now.direction).inside(w, now.among);
        // SAFETY: as the caller vouches; there is room for all triangles of all pairs, and for what lanes write behind.
        unsafe {
            let two = [i, other::<W>(i, len)];
            let rays = w.or_u32(ids_of_eights(w, two.map(|i| *ids.add(i))), w.load_u32(ROWS.as_ptr()));
            candidates.push_lanes(w, inside, rays, ids_of_eights(w, two.map(|i| *children.add(i))));
        }
    }
    // SAFETY: as the caller vouches.
    unsafe { settle::<W, S, ANY>(w, space, job, octant, stack, W::LANES) };
}

/// Tests the topmost candidates as long as there are `least`: triangles whose inside, or edge, a ray's line passes. They are pairs
/// of the ray's id with the triangle's row in the bits that ids leave free, and the block. Counts for any hit the rays
/// that are done by it.
///
/// # Safety
/// Of the stack's candidates, invariant 1 holds for the ids and 4 for the blocks, and all rays are of the octant.
#[inline(always)]
pub(super) unsafe fn settle<W: Lanes, S: Space, const ANY: bool>(
    w: W,
    space: S,
    job: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
    least: usize,
) {
    let OctantStack { candidates, done, .. } = stack;
    while candidates.len >= least {
        let among = lanes_of::<W>(candidates.len);
        candidates.len -= candidates.len.min(W::LANES);
        // SAFETY: as the caller vouches; where there are none, in the lanes behind them, the first stands in. Arrays are as long as
        // the widest lanes.
        let (rays, row, triangle, ray_ids, stored) = unsafe {
            let (mut ray_ids, mut stored) = ([0; PADDING], [0; PADDING]);
            let (ids, children) = candidates.at(candidates.len);
            let ids = w.select_u32(among, w.load_u32(ids), w.splat_u32(*ids));
            let children = w.select_u32(among, w.load_u32(children), w.splat_u32(*children));
            let rows = w.and_u32(ids, w.splat_u32(WIDTH as u32 - 1));
            let (id, [a, b, c]) = job.blocks.gather(w, children, rows);
            w.store_u32(ray_ids.as_mut_ptr(), w.xor_u32(ids, rows));
            w.store_u32(stored.as_mut_ptr(), id);
            let (rays, row) =
                (w.rows(job.rays.cast(), ray_ids.as_ptr()), w.rows(job.rows.cast(), ray_ids.as_ptr()));
            (rays, row, [space.place(w, a), space.place(w, b), space.place(w, c)], ray_ids, stored)
        };
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let [ix, iy, iz, sx, sy, sz, slack, limit] = row;
        let slabs = Slabs::new(w, [ix, iy, iz], [sx, sy, sz], slack);
        let range = Range { slabs: &slabs, octant, t_min: w.max(t_min, w.splat(0.0)), limit };
        let Some(hits) = test(w, among, &[ox, oy, oz], [dx, dy, dz], &triangle, &range) else {
            continue;
        };
        let (ts, us, vs) = (spill(w, hits.t), spill(w, hits.u), spill(w, hits.v));
        let mut left = hits.mask;
        while left != 0 {
            let lane = left.trailing_zeros() as usize & 15;
            left &= left - 1;
            let id = ray_ids[lane];
            // SAFETY: invariant 1.
            unsafe {
                // Another lane may have had the same ray.
                if ANY && (*job.rows.byte_add(id as usize)).limit < 0.0 {
                    continue;
                }
                let taken = job.offer::<ANY>(id, space.id(stored[lane]), ts[lane], us[lane], vs[lane]);
                *done = done.wrapping_add(u32::from(ANY && taken));
            }
        }
    }
}

/// How many pairs before a pair is tested its memory is asked for. Asked for all at once, they would wait for each other.
const AHEAD: usize = 16;

/// Asks for what the pairs need that [`test_pairs`] tests first.
#[inline(always)]
pub(super) fn fetch_first(job: &SubStream<'_>, stack: &OctantStack) {
    let blocks = &stack.pairs[1];
    let len = blocks.len.min(BLOCKS);
    let (ids, children) = blocks.at(blocks.len - len);
    for i in 0..len.min(AHEAD) {
        // SAFETY: there are so many pairs.
        unsafe { fetch_pair(job, *ids.add(i), *children.add(i)) };
    }
}

/// Asks for what a pair needs.
#[inline(always)]
fn fetch_pair(job: &SubStream<'_>, id: u32, child: u32) {
    let [a, b, c, d] = lines_of_block(job, bytemuck::cast(child));
    job.prefetch.each([a, b, c, d, job.rays.wrapping_byte_add(id as usize).cast()]);
}

const _: () = assert!(WIDTH <= ROW_BYTES);

/// The rows of a block, and those of the next.
static ROWS: [u32; 2 * WIDTH] = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];

/// The pair in the second eight lanes when pair `i` is in the first. Behind the last it stands in for another, which counts for
/// nothing.
#[inline(always)]
fn other<W: Lanes>(i: usize, len: usize) -> usize {
    (i + W::LANES / WIDTH).min(len) - 1
}

/// Pairs of rays and blocks, one in each eight lanes, up to where edge functions begin.
#[derive(Clone, Copy)]
struct Ready<W: Lanes> {
    /// From the rays' origins.
    corners: [Vector<W>; 3],
    direction: Vector<W>,
    /// Those with triangles.
    among: u32,
}

impl<W: Lanes> Ready<W> {
    /// Pair `i` and the one after it.
    ///
    /// # Safety
    /// `ids` and `children` lead to `len` pairs, for which holds what [`test_pairs`] asks, and `i` is less than that.
    #[inline(always)]
    unsafe fn of<S: Space>(
        w: W,
        space: S,
        job: &SubStream<'_>,
        ids: *const u32,
        children: *const u32,
        i: usize,
        len: usize,
    ) -> Self {
        let two = [i, other::<W>(i, len)];
        // SAFETY: as the caller vouches.
        let rays = unsafe { two.map(|i| &*job.rays.byte_add(*ids.add(i) as usize)) };
        // SAFETY: as the caller vouches.
        let blocks: [Child; 2] = unsafe { two.map(|i| bytemuck::cast(*children.add(i))) };
        // SAFETY: as the caller vouches.
        let triangles = space.triangles(w, &unsafe { blocks.map(|block| job.blocks.get_unchecked(block)) });
        let [first, second] = blocks.map(|block| (1 << block.triangles()) - 1);
        Self {
            corners: seen(w, &splat_eights(w, rays.map(|ray| ray.origin)), &triangles),
            direction: splat_eights(w, rays.map(|ray| ray.direction)),
            among: (first | second << WIDTH) & lanes_of::<W>(WIDTH * (len - i)),
        }
    }
}

impl SubStream<'_> {
    /// Takes a candidate that passed all tests but those of ties, of rivals in other lanes and of the
    /// filter, if it passes these too; says whether it did.
    ///
    /// # Safety
    /// Invariant 1 holds for `id`.
    #[inline(always)]
    unsafe fn offer<const ANY: bool>(&self, id: u32, stored: u32, t: f32, u: f32, v: f32) -> bool {
        let primitive = stored & PRIMITIVE;
        let refused =
            || stored & MASKED != 0 && self.filter.is_some_and(|filter| !filter.accepts(primitive, u, v));
        let index = id as usize / ROW_BYTES;
        if let Answers::Hits(hits) = self.answers
            && !ANY
        {
            // SAFETY: invariant 1.
            let (row, hit) = unsafe { (&*self.rows.add(index).cast_const(), &*hits.add(index).cast_const()) };
            // The row says how near the hit is: only a tie must read it.
            if !(t < row.limit || t == row.limit && primitive < hit.primitive) {
                return false;
            }
        }
        if refused() {
            return false;
        }
        // SAFETY: as the caller vouches.
        unsafe { self.put::<ANY>(id, Hit { t, u, v, primitive }) };
        true
    }

    /// Makes a hit the answer of a ray so far.
    ///
    /// # Safety
    /// Invariant 1 holds for `id`.
    #[inline(always)]
    unsafe fn put<const ANY: bool>(&self, id: u32, hit: Hit) {
        let index = id as usize / ROW_BYTES;
        // SAFETY: as the caller vouches.
        unsafe {
            (*self.rows.add(index)).limit = if ANY { DONE } else { hit.t };
            match self.answers {
                Answers::Occluded(occluded) => *occluded.add(index) = 1,
                Answers::Hits(hits) => *hits.add(index) = hit,
            }
        }
    }
}
