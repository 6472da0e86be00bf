//! Tracing a few rays, which take turns on one thread.
//!
//! Each ray goes depth first and visits the nearest child first, as it does alone ([`single`](super::single)). But it
//! makes one step at a time, and the others make theirs while its next node or leaf block comes from memory. A visit of
//! a node has no branch that depends on its result, so the processor works on the visits of several rays at once.
//!
//! Unsafe code, because nodes, blocks and stacks are accessed without bounds checks. Invariants:
//! 1. Children that are visited are in range: they are children of nodes of `Bvh::build`'s trees, or a root. Slots of
//!    `Child::NONE` have inverted boxes, which no ray enters.
//! 2. Each stack has room for [`capacity`] entries: a visit of a node pops one entry and pushes at most eight, so eight
//!    for each level of the tree are enough, after the first; and pushing writes a vector. The first is
//!    [`Child::NONE`]: a ray that pops it is done.
//! 3. What a turn says of near faces is 0 or [`UPPER`] for each axis, so faces lie in the node. Offsets in `FIRST_IDS`
//!    are those of consecutive rays. Arrays that are read or written in lanes have as many elements.
#![allow(unsafe_code, reason = "the invariants above")]

use super::accept::Accept;
use super::instance_space::World;
use super::setup::{self, FIRST_IDS, RowColumns};
use super::single::{Leaves, Query, Search, TriangleLeaves};
use super::slabs::{Faces, Slabs};
use super::tree_view::TreeView;
use super::triangle::Lines;
use crate::bvh::{Bvh, Child, WIDTH};
use crate::lanes::{Lanes, first_lanes, from_index, load_eights, splat};
use crate::stream::{Hit, Ray};

/// Rays that take turns.
pub(super) const AT_ONCE: usize = 16;

/// Memory that a thread reuses from call to call.
#[derive(Default)]
pub(super) struct Stacks {
    /// The children to visit, a stack for each ray, as bits of [`Child`].
    children: Vec<u32>,
    /// Distances at which the rays enter their boxes, as bits of numbers.
    enters: Vec<u32>,
}

impl Stacks {
    /// Makes room for a tree of this depth.
    pub fn reserve(&mut self, depth: usize) {
        let len = AT_ONCE * capacity(depth);
        if self.children.len() < len {
            self.children.resize(len, 0);
            self.enters.resize(len, 0);
        }
    }
}

/// Entries that the stack of a ray has room for (invariant 2).
fn capacity(depth: usize) -> usize {
    1 + WIDTH * depth + WIDTH
}

/// A ray on its way through the tree.
#[derive(Clone, Copy)]
struct Turn {
    /// Bytes from the lower faces across each axis to the near ones.
    near: [u8; 3],
    octant: u8,
    /// The child that it visits next; [`Child::NONE`] at the end.
    child: Child,
    /// Start and end of its stack.
    bottom: u32,
    top: u32,
    best: Hit,
}

/// The slab test's constants of rays, one column each.
#[derive(Default)]
struct Columns {
    inverse: [[f32; AT_ONCE]; 3],
    near: [[f32; AT_ONCE]; 3],
    far: [[f32; AT_ONCE]; 3],
}

/// The size of a face, and how many bytes further than the lower faces of a node the upper ones are.
const FACE: usize = size_of::<[f32; WIDTH]>();
const UPPER: usize = 3 * FACE;

/// The slots of a node, as the bits of numbers.
static SLOTS: [f32; WIDTH] = {
    let mut slots = [0.0; WIDTH];
    let mut slot = 0;
    while slot < WIDTH {
        slots[slot] = f32::from_bits(slot as u32);
        slot += 1;
    }
    slots
};

/// Answers each ray with its nearest hit, or with any hit if `ANY`.
///
/// # Panics
/// If no room was made in the stacks for a tree of this depth, or the tree has two levels.
#[inline(always)]
pub(super) fn trace<E: Lanes, A: Accept, const ANY: bool>(
    e: E,
    bvh: &Bvh,
    rays: &[Ray],
    stacks: &mut Stacks,
    mut accept: A,
    mut answer: impl FnMut(usize, Hit),
) {
    assert!(bvh.instances().is_empty() && stacks.children.len() >= AT_ONCE * capacity(bvh.wide().depth()));
    for (part, rays) in rays.chunks(AT_ONCE).enumerate() {
        let mut part = Part {
            bvh,
            tree: TreeView::new(bvh.wide(), None),
            rays,
            first: part * AT_ONCE,
            children: stacks.children.as_mut_ptr(),
            enters: stacks.enters.as_mut_ptr(),
            columns: Columns::default(),
        };
        // SAFETY: the stacks are long enough (invariant 2).
        unsafe { part.trace::<E, A, ANY>(e, &mut accept, &mut answer) };
    }
}

/// Appends a ray to a list if a condition holds, without a branch.
#[inline(always)]
fn append(list: &mut [u32; AT_ONCE], len: &mut usize, ray: usize, condition: bool) {
    list[*len % AT_ONCE] = ray as u32;
    *len += usize::from(condition);
}

/// Rays that are traced together, at most [`AT_ONCE`], and what they share.
struct Part<'a> {
    bvh: &'a Bvh,
    tree: TreeView<'a>,
    rays: &'a [Ray],
    /// The index of the first ray.
    first: usize,
    /// The stacks of all rays (invariant 2).
    children: *mut u32,
    enters: *mut u32,
    columns: Columns,
}

impl Part<'_> {
    /// Answers each ray.
    ///
    /// # Safety
    /// Invariant 2 for the stacks.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn trace<E: Lanes, A: Accept, const ANY: bool>(
        &mut self,
        e: E,
        accept: &mut A,
        answer: &mut impl FnMut(usize, Hit),
    ) {
        let none = Turn { near: [0; 3], octant: 0, child: Child::NONE, bottom: 0, top: 0, best: Hit::NONE };
        let mut turns = [none; AT_ONCE];
        // The rays whose next child is an inner node. Those whose next is a leaf block: of this round, and of the next.
        let (mut at_nodes, mut at_blocks) = ([0; AT_ONCE], [[0; AT_ONCE]; 2]);
        let (mut nodes, mut blocks, mut now) = (0, 0, 0);
        let capacity = capacity(self.bvh.wide().depth());
        for start in (0..self.rays.len()).step_by(WIDTH) {
            let octants = self.columns.set(e, self.bvh.scene_max_abs(), self.rays, start);
            for (ray, octant) in (start..self.rays.len()).zip(octants) {
                let bottom = (ray * capacity) as u32;
                // SAFETY: invariant 2.
                unsafe { *self.children.add(bottom as usize) = bytemuck::cast(Child::NONE) };
                let best = Hit { t: self.rays[ray].t_max, ..Hit::NONE };
                let near = [0, 1, 2].map(|axis| (octant >> axis & 1) as u8 * UPPER as u8);
                turns[ray] = Turn {
                    near,
                    octant: octant as u8 % 8,
                    child: Child::ROOT,
                    bottom,
                    top: bottom + 1,
                    best,
                };
                append(&mut at_nodes, &mut nodes, ray, octant < 8);
            }
        }
        while nodes + blocks > 0 {
            // What is kept of a list lies before what is read next. A block is tested one round after it is found: it
            // has time to arrive.
            let (old_nodes, mut found, next) = (nodes, 0, 1 - now);
            nodes = 0;
            for at in 0..old_nodes {
                let ray = at_nodes[at % AT_ONCE] as usize % AT_ONCE;
                // SAFETY: invariants 1 and 2.
                let child = unsafe { self.visit_node(e, ray, &mut turns[ray]) };
                self.tree.prefetch_either(child);
                append(&mut at_nodes, &mut nodes, ray, !child.is_block());
                append(&mut at_blocks[next], &mut found, ray, child.is_block() && child != Child::NONE);
            }
            for at in 0..blocks {
                let ray = at_blocks[now][at % AT_ONCE] as usize % AT_ONCE;
                // SAFETY: invariants 1 and 2.
                let next_child = unsafe { self.visit_block::<E, A, ANY>(e, ray, &mut turns[ray], accept) };
                let Some(child) = next_child else { continue };
                self.tree.prefetch_either(child);
                append(&mut at_nodes, &mut nodes, ray, !child.is_block());
                append(&mut at_blocks[next], &mut found, ray, child.is_block() && child != Child::NONE);
            }
            (blocks, now) = (found, next);
        }
        for (ray, turn) in turns[..self.rays.len()].iter().enumerate() {
            answer(self.first + ray, if turn.best.is_miss() { Hit::NONE } else { turn.best });
        }
    }

    /// Visits the node that is next for a ray: pushes the children that the ray enters, but for the nearest, and
    /// returns what is next then.
    ///
    /// # Safety
    /// Invariant 1 for the child, which is a node, and 2 for the stack.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_node<E: Lanes>(&self, e: E, ray: usize, turn: &mut Turn) -> Child {
        // SAFETY: invariant 1.
        let node = unsafe { self.tree.node(turn.child) };
        let lower = &raw const node.faces;
        // SAFETY: invariant 3.
        let face = |offset: usize| unsafe { &*lower.byte_add(offset).cast::<[f32; WIDTH]>() };
        let [x, y, z] = [turn.near[0] as usize, turn.near[1] as usize, turn.near[2] as usize];
        let near = [face(x), face(y + FACE), face(z + 2 * FACE)];
        let far = [face(UPPER - x), face(UPPER - y + FACE), face(UPPER - z + 2 * FACE)];
        let slabs = self.columns.slabs(e, ray);
        let (enter, leave) = slabs.clamped_distances(e, &Faces { near, far }, e.splat(turn.best.t));
        let entered = e.le(0xff, enter, leave);
        // The slot stands in the last bits of the distance, so the least of all says which it is. An infinite distance
        // would become no number.
        let (slots, upper) = (load_eights(e, [&SLOTS; 2]), e.splat_u32(!(WIDTH as u32 - 1)));
        let with_slot = e.or_u32(e.and_u32(e.bits(e.min(enter, e.splat(f32::MAX))), upper), e.bits(slots));
        let nearest = e.lowest(e.select(entered, e.from_bits(with_slot), e.splat(f32::INFINITY)));
        let slot = nearest.to_bits() as usize % WIDTH;
        let others = entered & !(1 << slot);
        // SAFETY: invariant 2.
        unsafe {
            let top = turn.top as usize;
            let words = e.bits(load_eights(e, [bytemuck::cast_ref(&node.children); 2]));
            e.append(self.children.add(top), others, words);
            e.append(self.enters.add(top), others, e.bits(enter));
            let top = top + others.count_ones() as usize;
            let popped: Child = bytemuck::cast(*self.children.add(top - 1));
            turn.child = if entered == 0 { popped } else { node.children[slot] };
            turn.top = (top - usize::from(entered == 0)) as u32;
        }
        turn.child
    }

    /// Visits the leaf block that is next for a ray, and returns what is next then; `None` if the search is over.
    ///
    /// # Safety
    /// Invariant 1 for the child, which is a block, and 2 for the stack.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_block<E: Lanes, A: Accept, const ANY: bool>(
        &self,
        e: E,
        ray: usize,
        turn: &mut Turn,
        accept: &mut A,
    ) -> Option<Child> {
        let Ray { origin, direction, t_min, .. } = self.rays[ray];
        let query = Query {
            bvh: self.bvh,
            slabs: self.columns.slabs(e, ray),
            octant: turn.octant as usize,
            lines: Lines { origin: splat(e, origin), direction: splat(e, direction) },
            t_min: e.splat(t_min.max(0.0)),
        };
        let limit = turn.best.t;
        let mut search = Search { best: turn.best, ray: self.first + ray, accept };
        let leaves = TriangleLeaves { space: World, blocks: self.bvh.wide().blocks() };
        // SAFETY: invariant 1; leaf blocks of triangles need no stack.
        let is_over = unsafe { leaves.visit::<E, A, ANY>(e, turn.child, &query, &mut [], &mut search) };
        turn.best = search.best;
        if is_over {
            return None;
        }
        // SAFETY: invariant 2.
        unsafe {
            if turn.best.t < limit {
                turn.top = self.keep_nearer(e, turn);
            }
            turn.top -= 1;
            turn.child = bytemuck::cast(*self.children.add(turn.top as usize));
        }
        Some(turn.child)
    }

    /// Keeps the entries of a stack that the ray enters before its hit or there, and the first. Returns the new end.
    ///
    /// # Safety
    /// Invariant 2.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep_nearer<E: Lanes>(&self, e: E, turn: &Turn) -> u32 {
        let (bottom, top) = (turn.bottom as usize + 1, turn.top as usize);
        let mut kept = bottom;
        for at in (bottom..top).step_by(WIDTH) {
            // SAFETY: invariant 2. What is written lies before what is read next.
            unsafe {
                let (child, enter) = (e.load_u32(self.children.add(at)), e.load(self.enters.add(at).cast()));
                let near = e.le(first_lanes::<E>(top - at), enter, e.splat(turn.best.t));
                e.append(self.children.add(kept), near, child);
                e.append(self.enters.add(kept), near, e.bits(enter));
                kept += near.count_ones() as usize;
            }
        }
        kept as u32
    }
}

impl Columns {
    /// Sets the columns of the rays from `first` on, as many as there are lanes. Returns their octants; 8 for a ray
    /// that hits nothing by definition.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn set<E: Lanes>(&mut self, e: E, scene_max_abs: f32, rays: &[Ray], first: usize) -> [u32; WIDTH] {
        const { assert!(E::LANES == WIDTH && AT_ONCE.is_multiple_of(WIDTH)) };
        let mut some = [Ray::default(); WIDTH];
        let count = rays.len().min(first + WIDTH) - first;
        some[..count].copy_from_slice(&rays[first..first + count]);
        let among = first_lanes::<E>(count);
        // SAFETY: invariant 3.
        let rays = unsafe { e.rows(some.as_ptr().cast(), FIRST_IDS.as_ptr()) };
        let RowColumns { columns, valid, negative } = setup::row_columns(e, scene_max_abs, among, rays);
        let [ix, iy, iz, sx, sy, sz, slack, _] = columns;
        let Slabs { inverse, near, far } = Slabs::new(e, [ix, iy, iz], [sx, sy, sz], slack);
        for axis in 0..3 {
            for (column, values) in
                [(&mut self.inverse, inverse), (&mut self.near, near), (&mut self.far, far)]
            {
                let column = &mut column[axis][first..first + WIDTH];
                // SAFETY: invariant 3.
                unsafe { e.store(column.as_mut_ptr(), values[axis]) };
            }
        }
        let bit = |mask: u32, lane: usize| mask >> lane & 1;
        from_index(|lane| {
            let octant: u32 = (0..3).map(|axis| bit(negative[axis], lane) << axis).sum();
            octant | (1 - bit(valid, lane)) << 3
        })
    }

    /// The constants of a ray in all lanes.
    #[inline(always)]
    fn slabs<E: Lanes>(&self, e: E, ray: usize) -> Slabs<E> {
        let ray = ray % AT_ONCE;
        let Self { inverse: i, near: n, far: f } = self;
        Slabs {
            inverse: splat(e, [i[0][ray], i[1][ray], i[2][ray]]),
            near: splat(e, [n[0][ray], n[1][ray], n[2][ray]]),
            far: splat(e, [f[0][ray], f[1][ray], f[2][ray]]),
        }
    }
}
