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

use super::instance_space::{InstanceSpace, Space, World};
use super::slabs::{Faces, Slabs};
use super::triangle::{Limits, Lines, test};
use crate::bvh::{Bvh, Child, Filter, LeafBlocks, MASKED, PRIMITIVE, WIDTH, WideTree};
use crate::geom::CanonicalRay;
#[cfg(target_arch = "aarch64")]
use crate::lanes::Neon;
use crate::lanes::{Lanes, Plain, SimdError, SimdLevel, first_lanes, spill, splat};
use crate::stream::{Hit, Ray, Tracer};
use std::cell::Cell;
use std::sync::Arc;

thread_local! {
    /// Taken by a call while it traces, so that a filter may trace on the same thread.
    static STACK: Cell<Vec<Entry>> = const { Cell::new(Vec::new()) };
}

/// A child to visit, and where the ray enters its box.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    enter: f32,
}

/// Traces one ray after the other, with the same answers as [`super::CpuTracer`]: the baseline that streams are
/// measured against, and the tracer for callers that have one ray at a time.
#[derive(Clone)]
pub struct SingleRayTracer {
    bvh: Arc<Bvh>,
    filter: Option<Arc<dyn Filter>>,
    simd: SimdLevel,
}

/// What all rays of a call share.
#[derive(Clone, Copy)]
struct Scene<'a> {
    bvh: &'a Bvh,
    filter: Option<&'a dyn Filter>,
}

impl SingleRayTracer {
    /// A tracer for this tree. Without a filter masked triangles are hit everywhere.
    ///
    /// # Errors
    /// When this processor lacks the level.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>, simd: SimdLevel) -> Result<Self, SimdError> {
        Ok(Self { bvh, filter, simd: simd.require()? })
    }

    fn dispatch<const ANY: bool>(&self, rays: &[Ray], answer: impl FnMut(usize, Hit)) {
        let scene = Scene { bvh: &self.bvh, filter: self.filter.as_deref() };
        let room = |bvh: &Bvh| WIDTH * bvh.wide().depth() + 1;
        let local = self.bvh.instances().iter().map(|instance| room(&instance.tree)).max();
        let len = room(&self.bvh) + local.unwrap_or(0);
        let mut stack = STACK.take();
        if stack.len() < len {
            stack.resize(len, Entry { child: Child::ROOT, enter: 0.0 });
        }
        match self.simd {
            // SAFETY: invariants 1 and 3.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe { x86::avx512::<ANY>(scene, rays, &mut stack, answer) },
            // SAFETY: invariants 1 and 3.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::avx2::<ANY>(scene, rays, &mut stack, answer) },
            // SAFETY: invariant 3.
            #[cfg(target_arch = "aarch64")]
            SimdLevel::Neon => unsafe { trace::<_, ANY>(Neon, scene, rays, &mut stack, answer) },
            // SAFETY: invariant 3.
            _ => unsafe { trace::<_, ANY>(Plain::<8>, scene, rays, &mut stack, answer) },
        }
        STACK.set(stack);
    }
}

impl Tracer for SingleRayTracer {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        self.dispatch::<false>(rays, |i, hit| hits[i] = hit);
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        self.dispatch::<true>(rays, |i, hit| occluded[i] = u32::from(!hit.is_miss()));
    }
}

/// Answers each ray with its nearest hit, or with any hit if `ANY`.
///
/// # Safety
/// Invariant 3.
#[inline(always)]
unsafe fn trace<E: Lanes, const ANY: bool>(
    e: E,
    scene: Scene<'_>,
    rays: &[Ray],
    stack: &mut [Entry],
    mut answer: impl FnMut(usize, Hit),
) {
    for (i, ray) in rays.iter().enumerate() {
        // SAFETY: the caller's contract.
        answer(i, unsafe { trace_one::<E, ANY>(e, scene, ray, stack) });
    }
}

/// A ray, the same in all lanes.
struct Query<'a, E: Lanes> {
    scene: Scene<'a>,
    slabs: Slabs<E>,
    octant: usize,
    lines: Lines<E>,
    t_min: E::F,
}

/// The nearest hit of a ray, or any hit if `ANY`.
///
/// # Safety
/// Invariant 3.
#[inline(always)]
unsafe fn trace_one<E: Lanes, const ANY: bool>(
    e: E,
    scene: Scene<'_>,
    ray: &Ray,
    stack: &mut [Entry],
) -> Hit {
    let wide = scene.bvh.wide();
    let ray = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, scene.bvh.scene_max_abs());
    let query = Query {
        scene,
        slabs: Slabs::of_ray(e, &ray),
        octant: (0..3).map(|axis| usize::from(ray.inverse[axis].is_sign_negative()) << axis).sum(),
        lines: Lines {
            origin: splat(e, ray.origin.to_array()),
            direction: splat(e, ray.direction.to_array()),
        },
        t_min: e.splat(ray.t_min),
    };
    let mut best = Hit { t: ray.t_max, ..Hit::NONE };
    // SAFETY: the caller's contract.
    unsafe {
        if scene.bvh.instances().is_empty() {
            let leaves = TriangleLeaves { space: World, blocks: wide.blocks() };
            visit_tree::<E, _, _, ANY>(e, World, wide, &leaves, &query, stack, &mut best);
        } else {
            visit_tree::<E, _, _, ANY>(e, World, wide, &InstanceLeaves, &query, stack, &mut best);
        }
    }
    if best.is_miss() { Hit::NONE } else { best }
}

/// The leaves of a tree.
trait Leaves {
    /// Visits a leaf: takes nearer hits and returns whether the search is over.
    ///
    /// # Safety
    /// Invariants 2 for the child and 3 for the stack, which is empty.
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        best: &mut Hit,
    ) -> bool;
}

/// Leaf blocks of triangles.
struct TriangleLeaves<'a, S> {
    space: S,
    blocks: &'a LeafBlocks,
}

/// The instances of a two-level tree.
struct InstanceLeaves;

/// Visits a tree, nearest children first. Returns whether the search is over.
///
/// # Safety
/// Invariants 2 and 3, the latter for the trees of the leaves, too.
#[inline(always)]
unsafe fn visit_tree<E: Lanes, S: Space, V: Leaves, const ANY: bool>(
    e: E,
    space: S,
    wide: &WideTree,
    leaves: &V,
    query: &Query<'_, E>,
    stack: &mut [Entry],
    best: &mut Hit,
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
            let faces = Faces::new(space.boxes(e, node, &mut buffer), query.octant);
            let (enter, leave) = query.slabs.clamped_distances(e, &faces, e.splat(best.t));
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
        } else if unsafe { leaves.visit::<E, ANY>(e, child, query, rest, best) } {
            return true;
        }
        child = loop {
            if top == 0 {
                return false;
            }
            top -= 1;
            // SAFETY: invariant 3; the entry was written.
            let entry = unsafe { *stack.add(top) };
            if entry.enter <= best.t {
                break entry.child;
            }
        };
    }
}

impl<S: Space> Leaves for TriangleLeaves<'_, S> {
    #[inline(always)]
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        _: &mut [Entry],
        best: &mut Hit,
    ) -> bool {
        let Query { slabs, octant, t_min, lines, .. } = query;
        // SAFETY: invariant 2.
        let block = unsafe { self.blocks.get_unchecked(child) };
        let limits = Limits { slabs, octant: *octant, t_min: *t_min, limit: e.splat(best.t) };
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
            let nearer = t < best.t || t == best.t && primitive < best.primitive;
            let rejected =
                || stored & MASKED != 0 && query.scene.filter.is_some_and(|f| !f.accepts(primitive, u, v));
            if nearer && !rejected() {
                *best = Hit { t, u, v, primitive };
                if ANY {
                    return true;
                }
            }
        }
        false
    }
}

impl Leaves for InstanceLeaves {
    #[inline(always)]
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        best: &mut Hit,
    ) -> bool {
        let instance = &query.scene.bvh.instances()[child.index()];
        let wide = instance.tree.wide();
        // SAFETY: the caller's contract.
        unsafe {
            match &instance.placement {
                None => {
                    let leaves = TriangleLeaves { space: World, blocks: wide.blocks() };
                    visit_tree::<E, _, _, ANY>(e, World, wide, &leaves, query, stack, best)
                }
                Some(placement) => {
                    let space = InstanceSpace::new(placement, instance.first_primitive, query.octant);
                    let leaves = TriangleLeaves { space, blocks: wide.blocks() };
                    visit_tree::<E, _, _, ANY>(e, space, wide, &leaves, query, stack, best)
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
    pub unsafe fn avx512<const ANY: bool>(
        scene: Scene<'_>,
        rays: &[Ray],
        stack: &mut [Entry],
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1); invariant 3.
        unsafe { trace::<_, ANY>(Avx512Eights::new(), scene, rays, stack, answer) };
    }

    /// # Safety
    /// Invariant 3.
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub unsafe fn avx2<const ANY: bool>(
        scene: Scene<'_>,
        rays: &[Ray],
        stack: &mut [Entry],
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1); invariant 3.
        unsafe { trace::<_, ANY>(Avx2::new(), scene, rays, stack, answer) };
    }
}
