//! The traversal: dynamic ray streams over the eight-wide tree (Barringer and Akenine-Möller 2014,
//! *Dynamic Ray Stream Traversal*).
//!
//! Rays are sorted by the octant of their direction. Each octant has a stack of (child, list of rays);
//! a visit tests a list against the eight boxes of a node, many rays to a register, and appends the
//! survivors to a list for each child. So a node's memory is read once a list, not once a ray. Octants
//! take turns, two at a time, which gives each prefetch the time of a visit to arrive.
//!
//! Unsafe code, because lists, rows and nodes are reached without bounds checks. Invariants:
//! 1. Ids are byte offsets of rows and rays: `ROW_BYTES * i` for ray `i` of the sub-stream. Every id in
//!    a list, padding included, is of a ray of the sub-stream, so rows, rays and answers hold it.
//! 2. A list in an arena is followed by padding at least up to the next multiple of `PADDING` ids. Its ids ascend (what shafts
//!    tell rests on that, no access to memory).
//! 3. Before a visit to a list of `len` the arena has room for eight lists of `len + PADDING` beyond
//!    it, and the stack of entries for nine more.
//! 4. Children of nodes are in range: `Bvh::build` made them, and slots of `Child::NONE` have inverted
//!    boxes, so that their lists stay empty. Turns of slots are all different.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Space, World};
use super::packet::{self, Packet};
use super::ray_node_pairs::{Pairs, SHORT};
#[cfg(doc)]
use super::shaft;
use super::shaft::{Entered, Shafts};
use super::triangle::{Faces, Slabs};
use super::visit_order::Order;
use super::{instances, leaf, ray_node_pairs, setup, split_substreams};
use crate::bvh::{Bvh, Child, Filter, LeafBlocks, WIDTH, WideNode};
use crate::lanes::{Lanes, Prefetch};
use crate::stream::{Hit, Ray};

/// Ids of padding behind every list: as many as the widest lanes.
pub(super) const PADDING: usize = 16;

/// What the box tests need of a ray (see [`crate::geom::CanonicalRay`], whose `near` and `far` are
/// `shift ∓ slack * |inverse|`). As small as the ray itself, which stays where the caller has it: most
/// visits are to inner nodes, and a cache line then serves two neighbours.
#[derive(Clone, Copy, Default)]
#[repr(C, align(32))]
pub(super) struct Row {
    pub inverse: [f32; 3],
    pub shift: [f32; 3],
    pub slack: f32,
    /// Nearest hit so far, at first `t_max`; negative for a ray that is done.
    pub limit: f32,
}

/// [`Row::limit`] of a ray that is done: the least by its bits that is not −0, so that it enters hardly any box.
pub(super) const DONE: f32 = -f32::MIN_POSITIVE;

/// Bytes of a row and of a ray, in which ids count.
pub(super) const ROW_BYTES: usize = 32;

const _: () = assert!(size_of::<Row>() == ROW_BYTES && size_of::<Ray>() == ROW_BYTES);

/// A list of rays that are to visit a child.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    pub child: Child,
    /// Where in the arena the list starts.
    pub start: u32,
    pub len: u32,
    /// What [`OctantStack::done`] was when the list was made.
    pub mark: u32,
}

/// The pending visits of the rays of one octant.
#[derive(Default)]
pub(super) struct OctantStack {
    /// Lists, one above the other.
    pub ids: Vec<u32>,
    pub entries: Vec<Entry>,
    /// Rays that go on alone, to nodes and to blocks.
    pub pairs: [Pairs; 2],
    /// Triangles that rays' lines pass inside: see [`leaf::settle`].
    pub candidates: Pairs,
    /// How many rays have been found occluded, of all sub-streams.
    pub done: u32,
}

impl OctantStack {
    /// Makes room for ids up to `len`.
    #[inline(always)]
    pub fn reserve(&mut self, len: usize) {
        if self.ids.len() < len {
            self.grow(len);
        }
    }

    /// Forgets all visits that are pending: a filter that panicked may have left some.
    fn clear(&mut self) {
        let Self { entries, pairs: [nodes, blocks], candidates, .. } = self;
        entries.clear();
        for pairs in [nodes, blocks, candidates] {
            pairs.len = 0;
        }
    }

    /// Whether there are enough pairs of nodes, or of blocks, that lists have to wait.
    #[inline(always)]
    fn is_worth(&self, kind: usize) -> bool {
        self.pairs[kind].len >= if self.entries.is_empty() { 1 } else { ray_node_pairs::WORTH[kind] }
    }

    /// Whether pairs of blocks are what is done next: there are enough, and not of nodes that could make more.
    #[inline(always)]
    fn is_for_blocks(&self) -> bool {
        self.pairs[1].len >= ray_node_pairs::BLOCKS || self.is_worth(1) && !self.is_worth(0)
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, len: usize) {
        assert!(len < u32::MAX as usize, "lists of {len} ids");
        self.ids.resize(len.next_power_of_two(), 0);
    }
}

/// Memory that a thread keeps from call to call.
#[derive(Default)]
pub(super) struct Scratch {
    pub rows: Vec<Row>,
    pub shafts: Shafts,
    pub packets: Vec<Packet>,
    pub stacks: [OctantStack; 8],
    /// For the members of a tree of trees.
    pub below: OctantStack,
}

/// A sub-stream in the works.
#[derive(Clone, Copy)]
pub(super) struct SubStream<'a> {
    pub nodes: &'a [WideNode],
    pub blocks: &'a LeafBlocks,
    pub filter: Option<&'a dyn Filter>,
    pub scene_max_abs: f32,
    /// How the tree's memory is asked for.
    pub prefetch: Prefetch,
    /// A row for each ray (invariant 1).
    pub rows: *mut Row,
    /// Shafts that hold all rays, as many to each as [`shaft::RAYS`] says.
    pub shafts: *mut Shafts,
    /// The rays themselves (invariant 1).
    pub rays: *const Ray,
    pub answers: Answers,
}

/// Where the answers go: one for each ray (invariant 1).
#[derive(Clone, Copy)]
pub(super) enum Answers {
    /// Of closest-hit queries.
    Hits(*mut Hit),
    /// Of any-hit queries.
    Occluded(*mut u32),
}

/// Traces `rays` and writes `answers`, which are as many and hold misses. `ANY` says which they are, `MEMBERS` whether
/// the tree has members.
///
/// `rays_in_lanes` tests several rays at once, `children_in_lanes` one ray with eight triangles.
#[inline(always)]
pub(super) fn trace<W: Lanes, E: Lanes, const ANY: bool, const MEMBERS: bool>(
    (w, e): (W, E),
    bvh: &Bvh,
    filter: Option<&dyn Filter>,
    rays: &[Ray],
    answers: Answers,
    scratch: &mut Scratch,
) {
    const { assert!(W::LANES <= PADDING && E::LANES == WIDTH) };
    let wide = bvh.wide();
    let Scratch { rows, shafts, packets, stacks, below } = scratch;
    below.clear();
    for stack in stacks.iter_mut() {
        stack.clear();
        stack.entries.reserve(entries_of(wide.depth()));
    }
    let (mut first, mut left) = (0, rays);
    while !left.is_empty() {
        let rays;
        (rays, left) = left.split_at(if MEMBERS {
            left.len().min(split_substreams::MOST)
        } else {
            split_substreams::first(left)
        });
        rows.resize(rows.len().max(rays.len() + PADDING), Row::default());
        let job = SubStream {
            nodes: wide.nodes(),
            blocks: wide.blocks(),
            filter,
            scene_max_abs: bvh.scene_max_abs(),
            prefetch: Prefetch::all_over(wide.bytes()),
            rows: rows.as_mut_ptr(),
            shafts,
            rays: rays.as_ptr(),
            // SAFETY: there are as many answers as rays.
            answers: unsafe {
                match answers {
                    Answers::Hits(hits) => Answers::Hits(hits.add(first)),
                    Answers::Occluded(occluded) => Answers::Occluded(occluded.add(first)),
                }
            },
        };
        first += rays.len();
        if MEMBERS {
            let counts = setup::prepare(w, &job, rays, stacks);
            instances::traverse::<W, E, ANY>((w, e), &job, bvh.instances(), stacks, &counts, below);
            continue;
        }
        if packet::may_form(rays)
            && let Some(packet::Formed { origin, len, counts }) = packet::form(w, &job, rays, stacks, packets)
        {
            let all = packets.as_mut_ptr();
            traverse(&packet::Packets::<W, E, ANY> { w, e, job: &job, origin, all }, stacks, &counts);
            packet::answer(&job, &packets[..len]);
        } else {
            let counts = setup::prepare(w, &job, rays, stacks);
            traverse(&Loose::<W, E, _, ANY> { w, e, space: World, job: &job }, stacks, &counts);
        }
    }
}

/// Room for entries on the way down a tree: a visit takes one, leaves at most eight and may write one more.
#[inline(always)]
pub(super) fn entries_of(depth: usize) -> usize {
    (WIDTH - 1) * depth + WIDTH + 2
}

/// What lists hold and how they visit.
pub(super) trait Visit {
    /// Visits a node or block with the list of an entry.
    fn visit(&self, octant: usize, stack: &mut OctantStack, at: Entry);

    /// Makes the next visits of an octant; says whether there were any.
    fn step(&self, octant: usize, stack: &mut OctantStack) -> bool;
}

/// Octants that take turns. More would give prefetches more time, but come back to what they have in common when it has
/// left the nearer caches.
const AT_A_TIME: usize = 2;

/// Visits the root with the lists at the bottom of the arenas, of `counts` lengths, and everything
/// that this entails; a few octants at a time take turns.
#[inline(always)]
fn traverse(visitor: &impl Visit, stacks: &mut [OctantStack; 8], counts: &[usize; 8]) {
    let mut active = [0; 8];
    let mut len = 0;
    for octant in 0..8 {
        if counts[octant] > 0 {
            let root =
                Entry { child: Child::ROOT, start: 0, len: counts[octant] as u32, mark: stacks[octant].done };
            stacks[octant].entries.push(root);
            active[len] = octant;
            len += 1;
        }
    }
    let mut turn = 0;
    while len > 0 {
        let octant = active[turn];
        if visitor.step(octant, &mut stacks[octant]) {
            turn += 1;
        } else {
            len -= 1;
            active[turn] = active[len];
        }
        if turn >= len.min(AT_A_TIME) {
            turn = 0;
        }
    }
}

/// Loose rays: lists hold their ids.
pub(super) struct Loose<'a, W, E, S, const ANY: bool> {
    pub w: W,
    pub e: E,
    pub space: S,
    pub job: &'a SubStream<'a>,
}

impl<W: Lanes, E: Lanes, S: Space, const ANY: bool> Visit for Loose<'_, W, E, S, ANY> {
    #[inline(always)]
    fn visit(&self, octant: usize, stack: &mut OctantStack, mut at: Entry) {
        let Self { w, e, space, job } = *self;
        if ANY && stack.done.wrapping_sub(at.mark) > at.len / GAPS {
            // SAFETY: invariant 2.
            at.len = unsafe { keep_open(w, job, stack.ids.as_mut_ptr().add(at.start as usize), at.len) };
            if at.len == 0 {
                return;
            }
        }
        if !at.child.is_block() {
            // SAFETY: invariant 4.
            let node = unsafe { job.nodes.get_unchecked(at.child.index()) };
            return if ANY {
                inner::<_, _, _, true>(w, e, space, job, Order::LIKELY_FIRST, octant, stack, at)
            } else {
                let order = Order::front_to_back(node, space.order(octant));
                inner::<_, _, _, true>(w, e, space, job, order, octant, stack, at)
            };
        }
        // SAFETY: invariant 4, and 2 for the list.
        unsafe {
            let block = job.blocks.get_unchecked(at.child);
            let list = stack.ids.as_ptr().add(at.start as usize);
            let done =
                leaf::test_list::<W, E, S, ANY>(w, e, space, job, block, octant, list, at.len as usize);
            stack.done = stack.done.wrapping_add(done);
        }
    }

    /// Rays that are alone go first if there are enough: the lists below them wait for what they hit.
    #[inline(always)]
    fn step(&self, octant: usize, stack: &mut OctantStack) -> bool {
        let Self { w, e, space, job } = *self;
        if stack.is_for_blocks() {
            // SAFETY: these are pairs.
            unsafe { leaf::test_pairs::<W, S, ANY>(w, space, job, octant, stack) };
        } else if stack.is_worth(0) {
            ray_node_pairs::visit(w, e, space, job, octant, stack);
        } else if let Some(entry) = stack.entries.pop() {
            self.visit(octant, stack, entry);
        } else if stack.candidates.len > 0 {
            // SAFETY: these are candidates.
            unsafe { leaf::settle::<W, S, ANY>(w, space, job, octant, stack, 1) };
        } else {
            return false;
        }
        if stack.is_for_blocks() {
            // Other octants have their turn before these are tested.
            leaf::fetch_first(job, stack);
        }
        true
    }
}

/// A list is closed up when more rays than one in so many of it may be done.
const GAPS: u32 = 8;

/// Closes the gaps that rays leave in a list which are done since it was made; how many are left. What then lies behind
/// them are ids that were in it, which do for padding.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2).
#[inline(always)]
unsafe fn keep_open<W: Lanes>(w: W, job: &SubStream<'_>, list: *mut u32, len: u32) -> u32 {
    let (mut open, mut at) = (0, 0);
    // SAFETY: as the caller vouches; what is written lies before what is read next.
    unsafe {
        let limits = job.rows.cast_const().cast::<u32>().add(ROW_BYTES / 4 - 1);
        while at < len as usize {
            let ids = w.load_u32(list.add(at));
            let limit = w.from_bits(w.gather(limits, w.shr_u32(ids, 2)));
            let left = w.le(lanes_of::<W>(len as usize - at), w.splat(0.0), limit);
            w.append(list.add(open), left, ids);
            open += left.count_ones() as usize;
            at += W::LANES;
        }
    }
    open as u32
}

/// Tests a list against the boxes of a node and pushes a list for each child that some ray enters; the rays of
/// short lists go on alone if `ALONE`.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "inlined: a struct of them would only be taken apart again")]
pub(super) fn inner<W: Lanes, E: Lanes, S: Space, const ALONE: bool>(
    w: W,
    e: E,
    space: S,
    job: &SubStream<'_>,
    order: Order,
    octant: usize,
    stack: &mut OctantStack,
    entry: Entry,
) {
    let len = entry.len as usize;
    let base = entry.start as usize + len + PADDING;
    let stride = len + PADDING;
    stack.reserve(base + WIDTH * stride + PADDING);
    // SAFETY: invariant 4 for the node; 2 for reading the list; 3 for writing lists and entries;
    // 1 for the rows, since only ids of the list are written to lists.
    unsafe {
        let node = job.nodes.get_unchecked(entry.child.index());
        let ids = stack.ids.as_mut_ptr();
        let list = ids.add(entry.start as usize);
        let mut room = [[[0.0; WIDTH]; 3]; 2];
        let faces = Faces::of(space.boxes(e, node, &mut room), octant);
        let mut ends: [*mut u32; WIDTH] =
            std::array::from_fn(|slot| ids.add(begin_of(base, stride, order, slot)));
        debug_assert!(std::slice::from_raw_parts(list, len).is_sorted());
        let all = [*list, *list.add(len - 1)];
        if let Some(entered) = Entered::of(e, &*job.shafts, all, len, &faces, octant) {
            let boxes = faces.apart(e, entered.apart, octant);
            let faces = Faces::of(&boxes, 0);
            // Apart from the others, which then need no memory.
            let mut some = ends;
            for at in (0..len).step_by(W::LANES) {
                let mut slots = entered.between(*list.add(at), *list.add(len.min(at + W::LANES) - 1));
                if slots == 0 {
                    continue;
                }
                let abreast = Abreast::of::<false>(w, job, list, at, len);
                while slots != 0 {
                    let slot = slots.trailing_zeros() as usize % WIDTH;
                    slots &= slots - 1;
                    abreast.enter(w, &faces, slot, &mut some[slot]);
                }
            }
            ends = some;
        } else {
            for at in (0..len).step_by(W::LANES) {
                let abreast = Abreast::of::<true>(w, job, list, at, len);
                for (slot, end) in ends.iter_mut().enumerate() {
                    abreast.enter(w, &faces, slot, end);
                }
            }
        }
        push::<W, ALONE, true>(w, job, node, order, stack, base, stride, &ends);
    }
}

/// Rays of a list in lanes.
struct Abreast<W: Lanes> {
    among: u32,
    ids: W::I,
    slabs: Slabs<W>,
    limit: W::F,
}

impl<W: Lanes> Abreast<W> {
    /// Those from `at` on, for boxes as they are if `SLACK`, else for boxes that are moved apart; asks for the next.
    ///
    /// # Safety
    /// `list` is a list of `len` ids, more than `at` (invariants 1 and 2).
    #[inline(always)]
    unsafe fn of<const SLACK: bool>(
        w: W,
        job: &SubStream<'_>,
        list: *const u32,
        at: usize,
        len: usize,
    ) -> Self {
        // SAFETY: as the caller vouches.
        unsafe {
            let [ix, iy, iz, sx, sy, sz, slack, limit] = w.rows(job.rows.cast(), list.add(at));
            if at + W::LANES < len {
                fetch_rows(w, job.rows.cast_const(), list.add(at + W::LANES));
            }
            let (inverse, shift) = ([ix, iy, iz], [sx, sy, sz]);
            let slabs = if SLACK {
                Slabs::new(w, inverse, shift, slack)
            } else {
                Slabs::without_slack(inverse, shift)
            };
            Self { among: lanes_of::<W>(len - at), ids: w.load_u32(list.add(at)), slabs, limit }
        }
    }

    /// Appends those that enter the box of a slot.
    ///
    /// # Safety
    /// `end` is good for writing an id for each lane.
    #[inline(always)]
    unsafe fn enter(&self, w: W, faces: &Faces<'_>, slot: usize, end: &mut *mut u32) {
        let inside = self.slabs.enters(w, self.among, faces, slot, self.limit);
        // SAFETY: as the caller vouches.
        unsafe {
            w.append(*end, inside, self.ids);
            *end = end.add(inside.count_ones() as usize);
        }
    }
}

/// Where the list of a slot starts: the lowest is that of the child that is visited last.
#[inline(always)]
pub(super) fn begin_of(base: usize, stride: usize, order: Order, slot: usize) -> usize {
    base + (WIDTH - 1 - order.turn(slot)) * stride
}

/// Writes padding: the sub-stream's first ray.
///
/// # Safety
/// `to` is good for writing `PADDING` ids.
#[inline(always)]
unsafe fn pad<W: Lanes>(w: W, to: *mut u32) {
    for part in 0..PADDING / W::LANES {
        // SAFETY: as the caller vouches.
        unsafe { w.store_u32(to.add(part * W::LANES), w.splat_u32(0)) };
    }
}

/// Asks for the memory of a node.
#[inline(always)]
pub(super) fn fetch_node(job: &SubStream<'_>, child: Child) {
    let node = job.nodes.as_ptr().wrapping_add(child.index()).cast::<u8>();
    job.prefetch.each([0, 64, 128, 192].map(|line| node.wrapping_add(line)));
}

/// The lines that a block takes.
#[inline(always)]
pub(super) fn lines_of_block(job: &SubStream<'_>, child: Child) -> [*const u8; 4] {
    let block = job.blocks.address(child).cast::<u8>();
    // The last is where large blocks go on; of others it is one of the first three.
    [0, 64, 128, 24 * child.triangles()].map(|line| block.wrapping_add(line))
}

/// Asks for the memory of a child.
#[inline(always)]
fn fetch_child(job: &SubStream<'_>, child: Child) {
    if child.is_block() {
        job.prefetch.each(lines_of_block(job, child));
    } else {
        fetch_node(job, child);
    }
}

/// Asks for the memory of all children of a node.
#[inline(always)]
pub(super) fn fetch_children(job: &SubStream<'_>, node: &WideNode) {
    for child in node.children.into_iter().filter(|&child| child != Child::NONE) {
        fetch_child(job, child);
    }
}

/// Asks for the rows, or rays, that a list needs next: they have often left the nearer caches, and the lanes before them
/// give them time to come.
///
/// # Safety
/// `list` is good for reading ids for all lanes.
#[inline(always)]
pub(super) unsafe fn fetch_rows<L: Lanes, T>(_: L, rows: *const T, list: *const u32) {
    const { assert!(size_of::<T>() == ROW_BYTES) };
    for part in 0..L::LANES / WIDTH {
        let mut addresses = [rows; WIDTH];
        for (lane, address) in addresses.iter_mut().enumerate() {
            // SAFETY: as the caller vouches.
            *address = rows.wrapping_byte_add(unsafe { *list.add(part * WIDTH + lane) } as usize);
        }
        Prefetch::First.each(addresses);
    }
}

/// Pushes an entry for each child of a node whose list has something in it, pads the list and, if `FETCH`, asks for
/// the child's memory; the rays of short lists go on alone if `ALONE`.
///
/// # Safety
/// The lists start where [`begin_of`] says and end at `ends`; invariant 3 holds for the entries.
#[allow(clippy::too_many_arguments, reason = "inlined: a struct of them would only be taken apart again")]
#[inline(always)]
pub(super) unsafe fn push<W: Lanes, const ALONE: bool, const FETCH: bool>(
    w: W,
    job: &SubStream<'_>,
    node: &WideNode,
    order: Order,
    stack: &mut OctantStack,
    base: usize,
    stride: usize,
    ends: &[*mut u32; WIDTH],
) {
    let ids = stack.ids.as_mut_ptr();
    let mut filled = 0;
    for (slot, &end) in ends.iter().enumerate() {
        let start = ids.wrapping_add(begin_of(base, stride, order, slot));
        filled |= u32::from(end != start) << order.turn(slot);
    }
    if ALONE {
        stack.pairs.iter_mut().for_each(|pairs| pairs.reserve(WIDTH * PADDING));
    }
    let entries = stack.entries.as_mut_ptr();
    let mut top = stack.entries.len();
    while filled != 0 {
        let turn = filled.ilog2();
        filled &= !(1 << turn);
        let slot = order.slot(turn as usize);
        let (child, start) = (node.children[slot], begin_of(base, stride, order, slot));
        // SAFETY: as the caller vouches.
        unsafe {
            let begin = ids.add(start);
            let len = ends[slot].offset_from_unsigned(begin);
            entries.add(top).write(Entry { child, start: start as u32, len: len as u32, mark: stack.done });
            let kind = usize::from(child.is_block());
            // Both are written; what counts is which one moves on. No branch.
            let alone = ALONE && len <= SHORT;
            top += usize::from(!alone);
            // Read before padding is written over part of it: a read that several writes in flight overlap waits for them.
            if ALONE {
                stack.pairs[kind].push_list(w, begin, child, if alone { len } else { 0 });
            }
            pad(w, ends[slot]);
        }
        if FETCH {
            fetch_child(job, child);
        }
    }
    // SAFETY: the entries up to `top` were written.
    unsafe { stack.entries.set_len(top) };
}

/// The lanes that hold rays when `left` are left.
#[inline(always)]
pub(super) fn lanes_of<L: Lanes>(left: usize) -> u32 {
    let all = (1 << L::LANES) - 1;
    if left >= L::LANES { all } else { (1 << left) - 1 }
}
