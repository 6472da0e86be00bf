//! The traversal: traces a slice of rays through a tree, one sub-stream after the other. See the [module](super) for
//! the algorithm.
//!
//! Unsafe code for visits. This file establishes invariants 1 to 8 of `substream`, `child_lists` and `packet`.
#![allow(unsafe_code, reason = "the invariants above")]

use super::accept::Filtered;
use super::crossings::{CandidateVisitor, CandidateVisits, Found, TriangleSink};
use super::instance_space::World;
use super::packet::{self, Packet, PacketSet, PacketVisitor};
use super::ray_lists::RayVisitor;
use super::shaft::Shafts;
use super::split_substreams::{MAX_RAYS, first_len};
use super::substream::{
    AnswerPointer, Answers, OctantStack, Row, SubStream, Visitor, Widths, entry_capacity,
};
use super::tree_view::TreeView;
use super::{few_rays, instances, setup};
use crate::bvh::{Bvh, Filter, WIDTH};
use crate::lanes::{Lanes, MAX_LANES};
use crate::stream::Ray;
use std::cell::RefCell;
use std::ptr;

/// Octants that take turns. More would give prefetches more time, but what their visits share would have left the
/// nearest caches in between.
const ACTIVE_OCTANTS: usize = 2;

/// Up to this many rays are no stream: they take turns. `raystream bench small` shows where a stream becomes faster.
const FEW_RAYS: usize = 32;

/// Memory that a thread reuses from call to call.
#[derive(Default)]
pub(super) struct Scratch {
    rows: Vec<Row>,
    shafts: Shafts,
    packets: Vec<Packet>,
    stacks: [OctantStack; 8],
    /// For visits of the trees of instances.
    local: OctantStack,
    few: few_rays::Stacks,
}

/// Traces `rays` and writes `answers`, which are misses beforehand. `ANY` says whether any hit is asked for (then
/// `answers` are of any-hit queries), `INSTANCED` whether the tree has two levels.
///
/// # Panics
/// If there is not one answer per ray.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn trace<W: Lanes, E: Lanes, const ANY: bool, const INSTANCED: bool>(
    widths: Widths<W, E>,
    bvh: &Bvh,
    filter: Option<&dyn Filter>,
    rays: &[Ray],
    mut answers: Answers<'_>,
    scratch: &mut Scratch,
) {
    const { assert!(W::LANES <= MAX_LANES && E::LANES == WIDTH) };
    assert_eq!(rays.len(), answers.len(), "one answer per ray");
    if !INSTANCED && rays.len() <= FEW_RAYS {
        scratch.few.reserve(bvh.wide().depth());
        let answer = |ray, hit| answers.set(ray, hit);
        return few_rays::trace::<E, _, ANY>(
            widths.eight,
            bvh,
            rays,
            &mut scratch.few,
            Filtered(filter),
            answer,
        );
    }
    let w = widths.wide;
    let tree = TreeView::new(bvh.wide(), filter);
    let Scratch { rows, shafts, packets, stacks, local, .. } = scratch;
    local.clear();
    for stack in stacks.iter_mut() {
        stack.clear();
        // Invariant 3.
        stack.entries.reserve(entry_capacity(bvh.wide().depth()));
    }
    let mut left = rays;
    while !left.is_empty() {
        let len = if INSTANCED { left.len().min(MAX_RAYS) } else { first_len(left) };
        let rays;
        (rays, left) = left.split_at(len);
        let answers = answers.split_first(len);
        if !INSTANCED
            && packet::may_form(rays)
            && let Some(set) = packet::form(w, bvh.scene_max_abs(), rays, stacks, packets)
        {
            let PacketSet { origin, len, counts } = set;
            let visitor =
                PacketVisitor::<W, E, ANY> { widths, tree: &tree, origin, packets: packets.as_mut_ptr() };
            // SAFETY: the lists are those of `form`, whose entries name packets (invariants 2 and 8); 3 as reserved
            // above; 4, because visits start at the root; 6 and 7, because no pairs and no lists of children are
            // pending.
            unsafe { traverse(&visitor, stacks, &counts) };
            packet::write_answers(answers, &packets[..len]);
            continue;
        }
        let counts = setup::prepare(w, bvh.scene_max_abs(), rays, rows, shafts, stacks);
        let (rays, rows) = (rays.as_ptr(), rows.as_mut_ptr());
        let sub = SubStream { tree, rows, rays, shafts, answers: answers.into() };
        // SAFETY: the rows and lists are those of `prepare` for these rays, and there are as many answers (invariants 1
        // and 2); 3 as reserved above; 4, because visits start at the root; 5 to 7, because nothing else is pending.
        unsafe {
            if INSTANCED {
                let instances = bvh.instances();
                let visits = instances::HitVisits::<W, E, ANY> { widths };
                instances::traverse(widths, &visits, &sub, instances, stacks, &counts, local);
            } else {
                let visitor = RayVisitor::<W, E, _, ANY> { widths, space: World, sub: &sub };
                traverse(&visitor, stacks, &counts);
            }
        }
    }
}

/// Hands all triangles that rays may cross to a sink, with the rays' indices.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn trace_candidates<W: Lanes, E: Lanes>(
    widths: Widths<W, E>,
    bvh: &Bvh,
    rays: &[Ray],
    sink: &mut dyn TriangleSink,
    scratch: &mut Scratch,
) {
    const { assert!(W::LANES <= MAX_LANES && E::LANES == WIDTH) };
    let (tree, batch) = (TreeView::new(bvh.wide(), None), sink.batch());
    let (tallies, columns) = (sink.tally().is_some(), sink.columns().is_some());
    let Scratch { rows, shafts, stacks, local, .. } = scratch;
    local.clear();
    for stack in stacks.iter_mut() {
        stack.clear();
        // Invariant 3.
        stack.entries.reserve(entry_capacity(bvh.wide().depth()));
    }
    let sink = RefCell::new(sink);
    for (part, rays) in rays.chunks(MAX_RAYS).enumerate() {
        let found = Found { sink: &sink, first: part * MAX_RAYS, batch, tallies, columns };
        let counts = setup::prepare(widths.wide, bvh.scene_max_abs(), rays, rows, shafts, stacks);
        // No answers are written.
        let answers = AnswerPointer::Occluded(ptr::null_mut());
        let sub = SubStream { tree, rows: rows.as_mut_ptr(), rays: rays.as_ptr(), shafts, answers };
        // SAFETY: the rows and lists are those of `prepare` for these rays (invariants 1 and 2), and a
        // `CandidateVisitor` writes no answers; 3 as reserved above; 4, because visits start at the root; 5 to 7,
        // because nothing else is pending.
        unsafe {
            if bvh.instances().is_empty() {
                let visitor = CandidateVisitor { widths, space: World, sub: &sub, found };
                traverse(&visitor, stacks, &counts);
            } else {
                let visits = CandidateVisits { widths, found };
                instances::traverse(widths, &visits, &sub, bvh.instances(), stacks, &counts, local);
            }
        }
    }
}

/// Visits the root with the lists at the bottom of the arenas, which have `counts` elements, and makes all visits that
/// follow. A few octants take turns, so that a prefetch has the time of another octant's visit to arrive.
///
/// # Safety
/// The visitor's invariants hold for the stacks and the lists.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn traverse(visitor: &impl Visitor, stacks: &mut [OctantStack; 8], counts: &[usize; 8]) {
    let mut active = [0; 8];
    let mut len = 0;
    for octant in 0..8 {
        if counts[octant] > 0 {
            stacks[octant].push_root(counts[octant]);
            active[len] = octant;
            len += 1;
        }
    }
    let mut turn = 0;
    while len > 0 {
        let octant = active[turn];
        // SAFETY: the caller's contract.
        if unsafe { visitor.step(octant, &mut stacks[octant]) } {
            turn += 1;
        } else {
            len -= 1;
            active[turn] = active[len];
        }
        if turn >= len.min(ACTIVE_OCTANTS) {
            turn = 0;
        }
    }
}
