//! Tracing one ray after the other, as renderers without ray streams do: each ray is tested against the eight boxes of
//! a node, or the triangles of a leaf block, in lanes.
//!
//! Unsafe code for calling functions that enable instructions, and because nodes, blocks and the stack are accessed
//! without bounds checks. Invariants:
//! 1. A `SingleRayTracer` is made only for a level whose instructions the processor has.
//! 2. Children that are visited are in range: they are children of nodes of `Bvh::build`'s trees, or a root. Slots of
//!    `Child::NONE` have inverted boxes, which no ray enters.
//! 3. The stack has room for eight entries per level of the tree, and one more: a visit pops one entry and pushes at
//!    most eight. For a two-level tree it has as much room again for the deepest tree of an instance.
//! 4. Arrays that are written in lanes have as many elements, as `clamped_distances` asserts.
#![allow(unsafe_code, reason = "the invariants above")]

use super::accept::{Accept, Filtered};
use super::few_rays;
use super::instance_space::{InstanceSpace, Space, World};
use super::scalar;
use super::slabs::{Faces, Slabs};
use super::triangle::{Limits, Lines, test};
use crate::bvh::{Bvh, Child, Filter, LeafBlocks, MASKED, PRIMITIVE, WIDTH, WideTree};
use crate::geom::CanonicalRay;
#[cfg(target_arch = "aarch64")]
use crate::lanes::Neon;
use crate::lanes::{Eight, Lanes, SimdError, SimdLevel, first_lanes, spill, splat};
use crate::stream::{Hit, Ray, Tracer};
use std::cell::Cell;
use std::fmt;
use std::slice;
use std::sync::Arc;

thread_local! {
    /// Taken by a call while it traces, so that a filter may trace on the same thread.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Memory that a thread reuses from call to call.
#[derive(Default)]
struct Scratch {
    stack: Vec<Entry>,
    /// Of rays that take turns.
    few: few_rays::Stacks,
}

/// A child to visit, and where the ray enters its box.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    child: Child,
    enter: f32,
}

/// Traces one ray after the other, with the same answers as [`super::CpuTracer`]: the baseline that streams are
/// measured against, and the tracer for callers that have few rays at a time.
///
/// Stays on the calling thread, which keeps a few kilobytes of scratch memory. A filter may trace on the same thread.
#[derive(Clone)]
pub struct SingleRayTracer {
    bvh: Arc<Bvh>,
    filter: Option<Arc<dyn Filter>>,
    simd: SimdLevel,
    /// Entries that the stack needs (invariant 3).
    stack_len: usize,
}

/// A function decides hits that the filter accepts.
struct Where<'a> {
    filter: Filtered<'a>,
    accepts: &'a mut dyn FnMut(usize, &Hit) -> bool,
}

impl Accept for Where<'_> {
    #[inline(always)]
    fn accepts(&mut self, ray: usize, hit: &Hit, masked: bool) -> bool {
        self.filter.accepts(ray, hit, masked) && (self.accepts)(ray, hit)
    }
}

/// Search for a ray's hit, with what it has found so far.
pub(super) struct Search<'a, A> {
    pub best: Hit,
    /// Index of the ray.
    pub ray: usize,
    pub accept: &'a mut A,
}

impl SingleRayTracer {
    /// A tracer for this tree. Without a filter masked triangles are hit everywhere.
    ///
    /// # Errors
    /// When this processor lacks the level.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>, simd: SimdLevel) -> Result<Self, SimdError> {
        let room = |bvh: &Bvh| WIDTH * bvh.wide().depth() + 1;
        let local = bvh.instances().iter().map(|instance| room(&instance.tree)).max();
        let stack_len = room(&bvh) + local.unwrap_or(0);
        Ok(Self { bvh, filter, simd: simd.require()?, stack_len })
    }

    /// The nearest hit of a ray.
    pub fn closest_one(&self, ray: &Ray) -> Hit {
        let mut hit = Hit::NONE;
        self.closest(slice::from_ref(ray), slice::from_mut(&mut hit));
        hit
    }

    /// True if a ray hits anything.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        let mut occluded = 0;
        self.occluded(slice::from_ref(ray), slice::from_mut(&mut occluded));
        occluded != 0
    }

    /// The nearest hit of every ray among those that `accepts`, called with the index of the ray and a hit, returns
    /// true for. It is called for hits in no particular order, not for all of them, and after the filter. It may trace
    /// on the same thread.
    pub(crate) fn closest_where(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        accepts: &mut dyn FnMut(usize, &Hit) -> bool,
    ) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        let accept = Where { filter: Filtered(self.filter.as_deref()), accepts };
        self.dispatch::<_, false, true>(rays, accept, |i, hit| hits[i] = hit);
    }

    /// Calls `visit` with the index of the ray and each of its hits, in no particular order.
    pub(crate) fn visit_hits(&self, rays: &[Ray], mut visit: impl FnMut(usize, &Hit)) {
        // A search that accepts no hit never narrows, so it finds all.
        let mut accepts = |ray: usize, hit: &Hit| {
            visit(ray, hit);
            false
        };
        let accept = Where { filter: Filtered(self.filter.as_deref()), accepts: &mut accepts };
        self.dispatch::<_, false, false>(rays, accept, |_, _| {});
    }

    /// Traces one ray after the other, or all in turns if `IN_TURNS`. Trees of two levels know no turns.
    fn dispatch<A: Accept, const ANY: bool, const IN_TURNS: bool>(
        &self,
        rays: &[Ray],
        accept: A,
        answer: impl FnMut(usize, Hit),
    ) {
        let bvh = &*self.bvh;
        let mut scratch = SCRATCH.take().unwrap_or_default();
        let memory = &mut *scratch;
        if IN_TURNS {
            memory.few.reserve(bvh.wide().depth());
        }
        if memory.stack.len() < self.stack_len {
            memory.stack.resize(self.stack_len, Entry { child: Child::ROOT, enter: 0.0 });
        }
        match self.simd {
            // SAFETY: invariants 1 and 3.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe {
                x86::avx512::<A, ANY, IN_TURNS>(bvh, rays, memory, accept, answer)
            },
            // SAFETY: invariants 1 and 3.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::avx2::<A, ANY, IN_TURNS>(bvh, rays, memory, accept, answer) },
            // SAFETY: invariant 3.
            #[cfg(target_arch = "aarch64")]
            SimdLevel::Neon => unsafe {
                trace::<_, A, ANY, IN_TURNS>(Neon, bvh, rays, memory, accept, answer)
            },
            // SAFETY: invariant 3. Miri has no vector instructions, and checks what others run by plain lanes.
            _ if cfg!(miri) => unsafe {
                trace::<_, A, ANY, IN_TURNS>(Eight, bvh, rays, memory, accept, answer)
            },
            _ => scalar::trace::<A, ANY>(bvh, rays, accept, answer),
        }
        SCRATCH.set(Some(scratch));
    }
}

impl fmt::Debug for SingleRayTracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bvh, filter, simd, .. } = self;
        let mut output = f.debug_struct("SingleRayTracer");
        output.field("triangles", &bvh.len()).field("filtered", &filter.is_some()).field("simd", simd);
        output.finish_non_exhaustive()
    }
}

impl Tracer for SingleRayTracer {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        self.dispatch::<_, false, false>(rays, Filtered(self.filter.as_deref()), |i, hit| hits[i] = hit);
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        let accept = Filtered(self.filter.as_deref());
        self.dispatch::<_, true, false>(rays, accept, |i, hit| occluded[i] = u32::from(!hit.is_miss()));
    }
}

/// Answers each ray with its nearest hit, or with any hit if `ANY`.
///
/// # Safety
/// Invariant 3.
#[inline(always)]
unsafe fn trace<E: Lanes, A: Accept, const ANY: bool, const IN_TURNS: bool>(
    e: E,
    bvh: &Bvh,
    rays: &[Ray],
    scratch: &mut Scratch,
    mut accept: A,
    mut answer: impl FnMut(usize, Hit),
) {
    if IN_TURNS && bvh.instances().is_empty() {
        return few_rays::trace::<E, A, ANY>(e, bvh, rays, &mut scratch.few, accept, answer);
    }
    for (i, ray) in rays.iter().enumerate() {
        let mut search = Search { best: Hit::NONE, ray: i, accept: &mut accept };
        // SAFETY: the caller's contract.
        unsafe { trace_one::<E, A, ANY>(e, bvh, ray, &mut scratch.stack, &mut search) };
        answer(i, search.best);
    }
}

/// A ray, the same in all lanes.
pub(super) struct Query<'a, E: Lanes> {
    pub bvh: &'a Bvh,
    pub slabs: Slabs<E>,
    pub octant: usize,
    pub lines: Lines<E>,
    pub t_min: E::F,
}

/// Searches the nearest hit of a ray, or any hit if `ANY`.
///
/// # Safety
/// Invariant 3.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn trace_one<E: Lanes, A: Accept, const ANY: bool>(
    e: E,
    bvh: &Bvh,
    ray: &Ray,
    stack: &mut [Entry],
    search: &mut Search<'_, A>,
) {
    let wide = bvh.wide();
    let ray = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, bvh.scene_max_abs());
    let query = Query {
        bvh,
        slabs: Slabs::of_ray(e, &ray),
        octant: ray.octant(),
        lines: Lines {
            origin: splat(e, ray.origin.to_array()),
            direction: splat(e, ray.direction.to_array()),
        },
        t_min: e.splat(ray.t_min),
    };
    search.best.t = ray.t_max;
    // SAFETY: the caller's contract.
    unsafe {
        if bvh.instances().is_empty() {
            let leaves = TriangleLeaves { space: World, blocks: wide.blocks() };
            visit_tree::<E, _, _, A, ANY>(e, World, wide, &leaves, &query, stack, search);
        } else {
            visit_tree::<E, _, _, A, ANY>(e, World, wide, &InstanceLeaves, &query, stack, search);
        }
    }
    if search.best.is_miss() {
        search.best = Hit::NONE;
    }
}

/// The leaves of a tree.
pub(super) trait Leaves {
    /// Visits a leaf: takes nearer hits and returns whether the search is over.
    ///
    /// # Safety
    /// Invariants 2 for the child and 3 for the stack, which is empty.
    unsafe fn visit<E: Lanes, A: Accept, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        search: &mut Search<'_, A>,
    ) -> bool;
}

/// Leaf blocks of triangles.
pub(super) struct TriangleLeaves<'a, S> {
    pub space: S,
    pub blocks: &'a LeafBlocks,
}

/// The instances of a two-level tree.
struct InstanceLeaves;

/// Visits a tree, nearest children first. Returns whether the search is over.
///
/// # Safety
/// Invariants 2 and 3, the latter for the trees of the leaves, too.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn visit_tree<E: Lanes, S: Space, V: Leaves, A: Accept, const ANY: bool>(
    e: E,
    space: S,
    wide: &WideTree,
    leaves: &V,
    query: &Query<'_, E>,
    stack: &mut [Entry],
    search: &mut Search<'_, A>,
) -> bool {
    let nodes = wide.nodes();
    let (stack, rest) = stack.split_at_mut(WIDTH * wide.depth() + 1);
    let (stack, mut top) = (stack.as_mut_ptr(), 0);
    let mut child = Child::ROOT;
    loop {
        if !child.is_block() {
            // SAFETY: invariant 2.
            let node = unsafe { nodes.get_unchecked(child.index()) };
            let mut buffer = [[[0.0; WIDTH]; 3]; 2];
            let faces = Faces::new(space.boxes(e, child.index(), node, &mut buffer), query.octant);
            let (enter, leave) = query.slabs.clamped_distances(e, &faces, e.splat(search.best.t));
            let mut entered = e.le(0xff, enter, leave);
            if entered.is_power_of_two() {
                child = node.children[entered.trailing_zeros() as usize % WIDTH];
                continue;
            }
            let mut enters = [0.0; WIDTH];
            // SAFETY: invariant 4.
            unsafe { e.store(enters.as_mut_ptr(), enter) };
            let first = top;
            while entered != 0 {
                let slot = entered.trailing_zeros() as usize % WIDTH;
                entered &= entered - 1;
                let entry = Entry { child: node.children[slot], enter: enters[slot] };
                let mut at = top;
                top += 1;
                // SAFETY: invariant 3.
                unsafe {
                    // Insertion sort: the nearest of this node's children comes to lie on top.
                    while at > first && (*stack.add(at - 1)).enter < entry.enter {
                        *stack.add(at) = *stack.add(at - 1);
                        at -= 1;
                    }
                    *stack.add(at) = entry;
                }
            }
        // SAFETY: the caller's contract.
        } else if unsafe { leaves.visit::<E, A, ANY>(e, child, query, rest, search) } {
            return true;
        }
        child = loop {
            if top == 0 {
                return false;
            }
            top -= 1;
            // SAFETY: invariant 3; the entry was written.
            let entry = unsafe { *stack.add(top) };
            if entry.enter <= search.best.t {
                break entry.child;
            }
        };
    }
}

impl<S: Space> Leaves for TriangleLeaves<'_, S> {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit<E: Lanes, A: Accept, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        _: &mut [Entry],
        search: &mut Search<'_, A>,
    ) -> bool {
        let Query { slabs, octant, t_min, lines, .. } = query;
        // SAFETY: invariant 2.
        let block = unsafe { self.blocks.get_unchecked(child) };
        let limits = Limits { slabs, octant: *octant, t_min: *t_min, limit: e.splat(search.best.t) };
        let among = first_lanes::<E>(child.triangles());
        let triangles = self.space.corners(e, &[block; 2]);
        let Some(hits) = test(e, among, lines, &triangles, &limits) else {
            return false;
        };
        if hits.mask == 0 {
            return false;
        }
        let (ts, us, vs) = (spill(e, hits.t), spill(e, hits.u), spill(e, hits.v));
        let mut left = hits.mask;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let (t, u, v, stored) = (ts[lane], us[lane], vs[lane], self.space.scene_id(block.id(lane)));
            let primitive = stored & PRIMITIVE;
            let (hit, best) = (Hit { t, u, v, primitive }, &search.best);
            let nearer = t < best.t || t == best.t && primitive < best.primitive;
            if nearer && search.accept.accepts(search.ray, &hit, stored & MASKED != 0) {
                search.best = hit;
                if ANY {
                    return true;
                }
            }
        }
        false
    }
}

impl Leaves for InstanceLeaves {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit<E: Lanes, A: Accept, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        search: &mut Search<'_, A>,
    ) -> bool {
        let instance = &query.bvh.instances()[child.index()];
        let wide = instance.tree.wide();
        // SAFETY: the caller's contract.
        unsafe {
            match &instance.placement {
                None => {
                    let leaves = TriangleLeaves { space: World, blocks: wide.blocks() };
                    visit_tree::<E, _, _, A, ANY>(e, World, wide, &leaves, query, stack, search)
                }
                Some(placement) => {
                    let space = InstanceSpace::new(placement, instance.first_primitive, query.octant, None);
                    let leaves = TriangleLeaves { space, blocks: wide.blocks() };
                    visit_tree::<E, _, _, A, ANY>(e, space, wide, &leaves, query, stack, search)
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::*;
    use crate::lanes::{Avx2, Avx512Eights};

    /// # Safety
    /// Invariant 3.
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub unsafe fn avx512<A: Accept, const ANY: bool, const IN_TURNS: bool>(
        bvh: &Bvh,
        rays: &[Ray],
        scratch: &mut Scratch,
        accept: A,
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1); invariant 3.
        unsafe { trace::<_, A, ANY, IN_TURNS>(Avx512Eights::new(), bvh, rays, scratch, accept, answer) };
    }

    /// # Safety
    /// Invariant 3.
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub unsafe fn avx2<A: Accept, const ANY: bool, const IN_TURNS: bool>(
        bvh: &Bvh,
        rays: &[Ray],
        scratch: &mut Scratch,
        accept: A,
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1); invariant 3.
        unsafe { trace::<_, A, ANY, IN_TURNS>(Avx2::new(), bvh, rays, scratch, accept, answer) };
    }
}
