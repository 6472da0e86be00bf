//! One ray after the other, as renderers without ray streams trace: each ray meets the eight boxes of a
//! node, or the triangles of a block, in lanes.
//!
//! Unsafe code for calling functions that enable instructions, and because nodes, blocks and the stack
//! are reached without bounds checks. Invariants:
//! 1. A `SingleRayTracer` is made only for a level that the processor has.
//! 2. Children of nodes are in range: `Bvh::build` made them, and slots of `Child::NONE` have inverted
//!    boxes, which no ray enters.
//! 3. The stack has room for eight entries for each inner node on the longest way down, and one more: a
//!    visit takes one entry and leaves at most eight. Over members there is as much again for the deepest.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Own, Space, World};
use super::substream::lanes_of;
use super::triangle::{Faces, Range, Slabs, Vector, test};
use super::{SimdError, SimdLevel};
use crate::bvh::{Bvh, Child, Filter, LeafBlocks, MASKED, PRIMITIVE, WIDTH, WideTree};
use crate::geom::CanonicalRay;
#[cfg(target_arch = "aarch64")]
use crate::lanes::Neon;
use crate::lanes::{Lanes, Plain, spill, splat};
use crate::stream::{Hit, Ray, Tracer};
use std::cell::RefCell;
use std::sync::Arc;

thread_local! {
    static STACK: RefCell<Vec<Entry>> = const { RefCell::new(Vec::new()) };
}

/// A child to visit, and where the ray enters it.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    enter: f32,
}

/// Traces one ray after the other, with the same answers as [`super::CpuTracer`]: what streams are measured
/// against, and the tracer of those who have but one ray at a time.
#[derive(Clone)]
pub struct SingleRayTracer {
    bvh: Arc<Bvh>,
    filter: Option<Arc<dyn Filter>>,
    simd: SimdLevel,
}

/// What is the same for all rays of a call.
#[derive(Clone, Copy)]
struct Tree<'a> {
    bvh: &'a Bvh,
    filter: Option<&'a dyn Filter>,
}

impl SingleRayTracer {
    /// A tracer for this tree; without a filter masked triangles are there everywhere.
    ///
    /// # Errors
    /// When this processor lacks the level.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>, simd: SimdLevel) -> Result<Self, SimdError> {
        Ok(Self { bvh, filter, simd: simd.require()? })
    }

    fn dispatch<const ANY: bool>(&self, rays: &[Ray], answer: impl FnMut(usize, Hit)) {
        let tree = Tree { bvh: &self.bvh, filter: self.filter.as_deref() };
        STACK.with_borrow_mut(|stack| {
            let room = |bvh: &Bvh| WIDTH * bvh.wide().depth() + 1;
            let below = self.bvh.instances().iter().map(|member| room(&member.tree)).max();
            let most = room(&self.bvh) + below.unwrap_or(0);
            if stack.len() < most {
                stack.resize(most, Entry { child: Child::ROOT, enter: 0.0 });
            }
            match self.simd {
                // SAFETY: invariants 1 and 3.
                #[cfg(target_arch = "x86_64")]
                SimdLevel::Avx512 => unsafe { x86::avx512::<ANY>(tree, rays, stack, answer) },
                // SAFETY: invariants 1 and 3.
                #[cfg(target_arch = "x86_64")]
                SimdLevel::Avx2 => unsafe { x86::avx2::<ANY>(tree, rays, stack, answer) },
                // SAFETY: invariant 3.
                #[cfg(target_arch = "aarch64")]
                SimdLevel::Neon => unsafe { trace::<_, ANY>(Neon, tree, rays, stack, answer) },
                // SAFETY: invariant 3.
                _ => unsafe { trace::<_, ANY>(Plain::<8>, tree, rays, stack, answer) },
            }
        });
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

/// Answers each ray with its nearest hit; with some hit if `ANY`.
///
/// # Safety
/// Invariant 3.
#[inline(always)]
unsafe fn trace<E: Lanes, const ANY: bool>(
    e: E,
    tree: Tree<'_>,
    rays: &[Ray],
    stack: &mut [Entry],
    mut answer: impl FnMut(usize, Hit),
) {
    for (i, ray) in rays.iter().enumerate() {
        // SAFETY: as the caller vouches.
        answer(i, unsafe { one::<E, ANY>(e, tree, ray, stack) });
    }
}

/// A ray on its way.
struct Query<'a, E: Lanes> {
    tree: Tree<'a>,
    slabs: Slabs<E>,
    octant: usize,
    origin: Vector<E>,
    direction: Vector<E>,
    t_min: E::F,
}

/// # Safety
/// Invariant 3.
#[inline(always)]
unsafe fn one<E: Lanes, const ANY: bool>(e: E, tree: Tree<'_>, ray: &Ray, stack: &mut [Entry]) -> Hit {
    let wide = tree.bvh.wide();
    let ray = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, tree.bvh.scene_max_abs());
    let query = Query {
        tree,
        slabs: Slabs::of(e, &ray),
        octant: (0..3).map(|axis| usize::from(ray.inverse[axis].is_sign_negative()) << axis).sum(),
        origin: splat(e, ray.origin.to_array()),
        direction: splat(e, ray.direction.to_array()),
        t_min: e.splat(ray.t_min),
    };
    let mut best = Hit { t: ray.t_max, ..Hit::NONE };
    // SAFETY: as the caller vouches.
    unsafe {
        if tree.bvh.instances().is_empty() {
            let triangles = Triangles { space: World, blocks: wide.blocks() };
            walk::<E, _, _, ANY>(e, World, wide, &triangles, &query, stack, &mut best);
        } else {
            walk::<E, _, _, ANY>(e, World, wide, &Members, &query, stack, &mut best);
        }
    }
    if best.is_miss() { Hit::NONE } else { best }
}

/// What the leaves of a tree are.
trait Leaves {
    /// Visits one: takes nearer hits, says whether the search is over.
    ///
    /// # Safety
    /// Invariants 2 for the child and 3 for the stack, which nothing is on.
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        best: &mut Hit,
    ) -> bool;
}

/// Blocks of triangles.
struct Triangles<'a, S> {
    space: S,
    blocks: &'a LeafBlocks,
}

/// The members of a tree of placed trees.
struct Members;

/// Goes down a tree, nearest children first; says whether the search is over.
///
/// # Safety
/// Invariants 2 and 3, and what `leaves` asks of the stack above.
#[inline(always)]
unsafe fn walk<E: Lanes, S: Space, V: Leaves, const ANY: bool>(
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
            let mut room = [[[0.0; WIDTH]; 3]; 2];
            let faces = Faces::of(space.boxes(e, node, &mut room), query.octant);
            let (enter, leave) = query.slabs.cross_each(e, &faces, e.splat(best.t));
            let mut entered = e.le(0xff, enter, leave);
            if entered.is_power_of_two() {
                child = node.children[entered.trailing_zeros() as usize & 7];
                continue;
            }
            let mut enters = [0.0; WIDTH];
            // SAFETY: there are as many numbers as lanes, as `cross_each` has asserted.
            unsafe { e.store(enters.as_mut_ptr(), enter) };
            let first = top;
            while entered != 0 {
                let slot = entered.trailing_zeros() as usize & 7;
                entered &= entered - 1;
                let entry = Entry { child: node.children[slot], enter: enters[slot] };
                let mut at = top;
                top += 1;
                // SAFETY: invariant 3.
                unsafe {
                    // The nearest of this node's comes to lie on top.
                    while at > first && (*stack.add(at - 1)).enter < entry.enter {
                        *stack.add(at) = *stack.add(at - 1);
                        at -= 1;
                    }
                    *stack.add(at) = entry;
                }
            }
        // SAFETY: as the caller vouches.
        } else if unsafe { leaves.visit::<E, ANY>(e, child, query, rest, best) } {
            return true;
        }
        child = loop {
            if top == 0 {
                return false;
            }
            top -= 1;
            // SAFETY: invariant 3; it was written.
            let entry = unsafe { *stack.add(top) };
            if entry.enter <= best.t {
                break entry.child;
            }
        };
    }
}

impl<S: Space> Leaves for Triangles<'_, S> {
    #[inline(always)]
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        _: &mut [Entry],
        best: &mut Hit,
    ) -> bool {
        let Query { slabs, octant, t_min, .. } = query;
        // SAFETY: invariant 2.
        let block = unsafe { self.blocks.get_unchecked(child) };
        let range = Range { slabs, octant: *octant, t_min: *t_min, limit: e.splat(best.t) };
        let among = lanes_of::<E>(child.triangles());
        let triangles = self.space.triangles(e, &[block; 2]);
        let Some(hits) = test(e, among, &query.origin, query.direction, &triangles, &range) else {
            return false;
        };
        if hits.mask == 0 {
            return false;
        }
        let (ts, us, vs) = (spill(e, hits.t), spill(e, hits.u), spill(e, hits.v));
        let mut left = hits.mask;
        while left != 0 {
            let lane = left.trailing_zeros() as usize & 7;
            left &= left - 1;
            let (t, u, v, stored) = (ts[lane], us[lane], vs[lane], self.space.id(block.id(lane)));
            let primitive = stored & PRIMITIVE;
            let nearer = t < best.t || t == best.t && primitive < best.primitive;
            let refused =
                || stored & MASKED != 0 && query.tree.filter.is_some_and(|f| !f.accepts(primitive, u, v));
            if nearer && !refused() {
                *best = Hit { t, u, v, primitive };
                if ANY {
                    return true;
                }
            }
        }
        false
    }
}

impl Leaves for Members {
    #[inline(always)]
    unsafe fn visit<E: Lanes, const ANY: bool>(
        &self,
        e: E,
        child: Child,
        query: &Query<'_, E>,
        stack: &mut [Entry],
        best: &mut Hit,
    ) -> bool {
        let member = &query.tree.bvh.instances()[child.index()];
        let wide = member.tree.wide();
        // SAFETY: as the caller vouches.
        unsafe {
            match &member.placement {
                None => {
                    let triangles = Triangles { space: World, blocks: wide.blocks() };
                    walk::<E, _, _, ANY>(e, World, wide, &triangles, query, stack, best)
                }
                Some(placement) => {
                    let own = Own::new(placement, member.first_primitive, query.octant);
                    let triangles = Triangles { space: own, blocks: wide.blocks() };
                    walk::<E, _, _, ANY>(e, own, wide, &triangles, query, stack, best)
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
        tree: Tree<'_>,
        rays: &[Ray],
        stack: &mut [Entry],
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so whoever calls it has them; invariant 3.
        unsafe { trace::<_, ANY>(Avx512Eights::new(), tree, rays, stack, answer) };
    }

    /// # Safety
    /// Invariant 3.
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub unsafe fn avx2<const ANY: bool>(
        tree: Tree<'_>,
        rays: &[Ray],
        stack: &mut [Entry],
        answer: impl FnMut(usize, Hit),
    ) {
        // SAFETY: this function enables the instructions, so whoever calls it has them; invariant 3.
        unsafe { trace::<_, ANY>(Avx2::new(), tree, rays, stack, answer) };
    }
}
