//! The traversal: dynamic ray streams over the eight-wide tree (Barringer and Akenine-Möller 2014,
//! *Dynamic Ray Stream Traversal*).
//!
//! Rays are sorted by the octant of their direction. Each octant has a stack of (child, list of rays);
//! a visit tests a list against the eight boxes of a node, many rays to a register, and appends the
//! survivors to a list for each child. So a node's memory is read once a list, not once a ray. The
//! octants take turns, which gives each prefetch the time of several visits to arrive.
//!
//! Unsafe code, because lists, rows and nodes are reached without bounds checks. Invariants:
//! 1. Ids are byte offsets of 32-byte rows: `32 * i` for ray `i` of the sub-stream. Every id in a list,
//!    padding included, is of a ray of the sub-stream, so `rows`, `rays`, and the answers hold it.
//! 2. A list of `len` ids in an arena is followed by padding to at least `len + PADDING` readable ids.
//! 3. Before a visit to a list of `len` the arena has room for eight lists of `len + PADDING` beyond
//!    it, and the stack of entries for eight more.
//! 4. Children of nodes are in range: `Bvh::build` made them, and slots of `Child::NONE` have inverted
//!    boxes, so that their lists stay empty.
#![allow(unsafe_code)]

use super::lanes::{Lanes, prefetch};
use super::{leaf, setup};
use crate::bvh::{Block, Bvh, Child, Filter, WIDTH, WideNode};
use crate::stream::{Hit, Ray};

/// Ids of padding behind every list: as many as the widest lanes.
pub(super) const PADDING: usize = 16;

/// The most rays of a sub-stream: what its rows and lists take still fits a second-level cache.
const SUB_STREAM: usize = 32 * 1024;

/// What the box tests need of a ray: see [`crate::geom::CanonicalRay`], whose `near` and `far` are
/// `shift ∓ slack * |inverse|`.
#[derive(Clone, Copy, Default)]
#[repr(C, align(32))]
pub(super) struct Row {
    pub inverse: [f32; 3],
    pub shift: [f32; 3],
    pub slack: f32,
    /// Nearest hit so far, at first `t_max`; negative for a ray that is done.
    pub limit: f32,
}

/// A list of rays that are to visit a child.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    start: u32,
    len: u32,
}

/// The pending visits of the rays of one octant.
#[derive(Default)]
pub(super) struct OctantStack {
    /// Lists, one above the other.
    pub ids: Vec<u32>,
    entries: Vec<Entry>,
}

impl OctantStack {
    /// Makes room for ids up to `len`.
    #[inline(always)]
    pub fn reserve(&mut self, len: usize) {
        if self.ids.len() < len {
            self.grow(len);
        }
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
    pub stacks: [OctantStack; 8],
}

/// A sub-stream in the works.
pub(super) struct Job<'a> {
    nodes: &'a [WideNode],
    blocks: &'a [Block],
    pub filter: Option<&'a dyn Filter>,
    pub scene_max_abs: f32,
    /// The rays, as many as `rows` (invariant 1).
    pub rays: *const Ray,
    pub rows: *mut Row,
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

/// Traces `rays` and writes `answers`, which are as many and hold misses. `ANY` says which they are.
///
/// `rays_in_lanes` tests several rays at once, `children_in_lanes` one ray with eight triangles.
#[inline(always)]
pub(super) fn trace<W: Lanes, E: Lanes, const ANY: bool>(
    (w, e): (W, E),
    bvh: &Bvh,
    filter: Option<&dyn Filter>,
    rays: &[Ray],
    answers: Answers,
    scratch: &mut Scratch,
) {
    const { assert!(W::LANES <= PADDING && E::LANES == WIDTH) };
    let wide = bvh.wide();
    let Scratch { rows, stacks } = scratch;
    // A visit takes one entry and leaves at most eight.
    let entries = (WIDTH - 1) * wide.depth() + WIDTH + 1;
    for stack in stacks.iter_mut() {
        stack.entries.clear();
        stack.entries.reserve(entries);
    }
    for (i, rays) in rays.chunks(SUB_STREAM).enumerate() {
        let first = i * SUB_STREAM;
        rows.resize(rows.len().max(rays.len() + PADDING), Row::default());
        let job = Job {
            nodes: wide.nodes(),
            blocks: wide.blocks(),
            filter,
            scene_max_abs: bvh.scene_max_abs(),
            rays: rays.as_ptr(),
            rows: rows.as_mut_ptr(),
            // SAFETY: there are as many answers as rays.
            answers: unsafe {
                match answers {
                    Answers::Hits(hits) => Answers::Hits(hits.add(first)),
                    Answers::Occluded(occluded) => Answers::Occluded(occluded.add(first)),
                }
            },
        };
        let counts = setup::prepare(w, &job, rays, stacks);
        let mut active = [0; 8];
        let mut len = 0;
        for octant in (0..8).filter(|&octant| counts[octant] > 0) {
            let root = Entry { child: Child::ROOT, start: 0, len: counts[octant] as u32 };
            stacks[octant].entries.push(root);
            active[len] = octant;
            len += 1;
        }
        while len > 0 {
            let mut turn = 0;
            while turn < len {
                let octant = active[turn];
                match stacks[octant].entries.pop() {
                    Some(entry) => {
                        visit::<W, E, ANY>(w, e, &job, octant, &mut stacks[octant], entry);
                        turn += 1;
                    }
                    None => {
                        len -= 1;
                        active[turn] = active[len];
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn visit<W: Lanes, E: Lanes, const ANY: bool>(
    w: W,
    e: E,
    job: &Job<'_>,
    octant: usize,
    stack: &mut OctantStack,
    entry: Entry,
) {
    if !entry.child.is_block() {
        return inner(w, job, octant, stack, entry);
    }
    // SAFETY: invariant 4, and 2 for the list.
    unsafe {
        let block = job.blocks.get_unchecked(entry.child.index());
        let list = stack.ids.as_ptr().add(entry.start as usize);
        leaf::visit::<W, E, ANY>(w, e, job, block, entry.child.triangles(), octant, list, entry.len as usize);
    }
}

/// Tests a list against the boxes of a node and pushes a list for each child that some ray enters.
#[inline(always)]
fn inner<W: Lanes>(w: W, job: &Job<'_>, octant: usize, stack: &mut OctantStack, entry: Entry) {
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
        let face = |side: usize, axis: usize| node.faces[side ^ (octant >> axis & 1)][axis].as_ptr();
        let near = [face(0, 0), face(0, 1), face(0, 2)];
        let far = [face(1, 0), face(1, 1), face(1, 2)];
        // The farthest child's list lowest: it is visited last.
        let begin = |slot: usize| base + (WIDTH - 1 - (slot ^ octant)) * stride;
        let mut ends: [*mut u32; WIDTH] = std::array::from_fn(|slot| ids.add(begin(slot)));
        let zero = w.splat(0.0);
        let mut at = 0;
        while at < len {
            let among = lanes_of::<W>(len - at);
            let [ix, iy, iz, sx, sy, sz, slack, limit] = w.rows(job.rows.cast(), list.add(at));
            let [px, py, pz] = [ix, iy, iz].map(|inverse| w.mul(slack, w.abs(inverse)));
            let (nx, ny, nz) = (w.sub(sx, px), w.sub(sy, py), w.sub(sz, pz));
            let (fx, fy, fz) = (w.add(sx, px), w.add(sy, py), w.add(sz, pz));
            let chunk = w.load_ids(list.add(at));
            for (slot, end) in ends.iter_mut().enumerate() {
                let plane = |faces: *const f32, inverse, constant| {
                    w.fma(w.splat(*faces.add(slot)), inverse, constant)
                };
                let enter = w.max(plane(near[0], ix, nx), plane(near[1], iy, ny));
                let enter = w.max(w.max(plane(near[2], iz, nz), enter), zero);
                let leave = w.min(plane(far[0], ix, fx), plane(far[1], iy, fy));
                let leave = w.min(w.min(plane(far[2], iz, fz), leave), limit);
                let inside = w.le(among, enter, leave);
                w.append(*end, inside, chunk);
                *end = end.add(inside.count_ones() as usize);
            }
            at += W::LANES;
        }
        // Without branches: which children are entered is hard to foresee.
        let padding = w.splat_id(*list);
        let entries = stack.entries.as_mut_ptr();
        let mut top = stack.entries.len();
        for order in (0..WIDTH).rev() {
            let slot = order ^ octant;
            let (child, start) = (node.children[slot], begin(slot));
            for k in (0..PADDING).step_by(W::LANES) {
                w.store_ids(ends[slot].add(k), padding);
            }
            let len = ends[slot].offset_from_unsigned(ids.add(start));
            entries.add(top).write(Entry { child, start: start as u32, len: len as u32 });
            top += usize::from(len > 0);
            let target = if child.is_block() {
                job.blocks.as_ptr().wrapping_add(child.index()).cast::<u8>()
            } else {
                job.nodes.as_ptr().wrapping_add(child.index()).cast::<u8>()
            };
            let target = if len > 0 { target } else { std::ptr::from_ref(node).cast() };
            for line in 0..4 {
                prefetch(target.wrapping_add(64 * line));
            }
        }
        stack.entries.set_len(top);
    }
}

/// The lanes that hold rays when `left` are left.
#[inline(always)]
pub(super) fn lanes_of<L: Lanes>(left: usize) -> u32 {
    let all = (1 << L::LANES) - 1;
    if left >= L::LANES { all } else { (1 << left) - 1 }
}
