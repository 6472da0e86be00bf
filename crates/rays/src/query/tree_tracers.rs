//! The tracers of a tree, and which of them a call uses.

use super::normals::{KeptNormals, TriangleNormals};
use super::shares::{answers_in_shares, in_shares};
use crate::bvh::Bvh;
use crate::stream::{Hit, Ray, Tracer};
use crate::trace::cpu::{CpuTracer, SimdLevel, SingleRayTracer};
use rayon::prelude::*;
use std::cell::Cell;
use std::ops::Range;
use std::sync::{Arc, LazyLock};

/// The largest number of rays that a thread traces at once.
pub const SHARE_RAYS: usize = 32 * 1024;

/// Number of rays whose hits one thread collects at a time.
const COLLECTED_AT_ONCE: usize = 1024;

thread_local! {
    /// Answers of any-hit queries, before they become `bool`.
    static ANSWERS: Cell<Vec<u32>> = const { Cell::new(Vec::new()) };
}

/// A tree with its tracers. Clones share the tree.
#[derive(Clone, Debug)]
pub struct TreeTracers {
    bvh: Arc<Bvh>,
    stream: CpuTracer,
    single: SingleRayTracer,
    normals: Arc<KeptNormals>,
}

impl TreeTracers {
    /// Of a tree that is built; masked triangles are hit everywhere. The processor must have the level.
    pub fn new(bvh: Arc<Bvh>, simd: SimdLevel) -> Self {
        let stream = CpuTracer::new(bvh.clone(), None, simd).expect("the processor has the level");
        let single = SingleRayTracer::new(bvh.clone(), None, simd).expect("the processor has the level");
        Self { bvh, stream, single, normals: Arc::default() }
    }

    pub fn bvh(&self) -> &Arc<Bvh> {
        &self.bvh
    }

    pub fn stream(&self) -> &CpuTracer {
        &self.stream
    }

    pub fn single(&self) -> &SingleRayTracer {
        &self.single
    }

    /// The normals of all triangles, if it is worth while to have them; `more` of them are asked for now.
    pub(super) fn normals_of_triangles(&self, more: usize) -> Option<&TriangleNormals> {
        self.normals.get(&self.bvh, more)
    }

    /// Changes the tree, which is copied first if clones share it.
    pub fn change<T>(&mut self, change: impl FnOnce(&mut Bvh) -> T) -> T {
        // The tracers' references are dropped first: else the tree would always be shared.
        static EMPTY: LazyLock<Arc<Bvh>> = LazyLock::new(|| Arc::new(Bvh::build(&[], &[], |_| false)));
        let (simd, empty) = (self.stream.simd(), EMPTY.clone());
        let mut bvh = std::mem::replace(&mut self.bvh, empty.clone());
        *self = Self::new(empty, simd);
        let result = change(Arc::make_mut(&mut bvh));
        *self = Self::new(bvh, simd);
        result
    }

    /// The nearest hit of each ray.
    ///
    /// # Panics
    /// If there are not as many hits as rays.
    pub fn closest_into(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        in_shares(rays, hits, SHARE_RAYS, |_, rays, hits| self.closest_here(rays, hits));
    }

    /// [`TreeTracers::closest_into`] on the calling thread.
    pub fn closest_here(&self, rays: &[Ray], hits: &mut [Hit]) {
        if rays.len() == 1 {
            self.single.closest(rays, hits);
        } else {
            self.stream.closest(rays, hits);
        }
    }

    /// For each ray, true if it hits anything.
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        answers_in_shares(rays, false, SHARE_RAYS, |_, rays, occluded| self.occluded_here(rays, occluded))
    }

    /// [`TreeTracers::occluded`] into memory of the caller.
    ///
    /// # Panics
    /// If there are not as many answers as rays.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        in_shares(rays, occluded, SHARE_RAYS, |_, rays, occluded| self.occluded_here(rays, occluded));
    }

    /// [`TreeTracers::occluded_into`] on the calling thread.
    pub fn occluded_here(&self, rays: &[Ray], occluded: &mut [bool]) {
        let mut answers = ANSWERS.take();
        answers.resize(rays.len(), 0);
        if rays.len() == 1 {
            self.single.occluded(rays, &mut answers);
        } else {
            self.stream.occluded(rays, &mut answers);
        }
        occluded.iter_mut().zip(&answers).for_each(|(occluded, answer)| *occluded = *answer != 0);
        ANSWERS.set(answers);
    }

    /// The nearest hit of each ray among those that `accepts` returns true for.
    pub fn closest_where(&self, rays: &[Ray], accepts: &(dyn Fn(usize, &Hit) -> bool + Sync)) -> Vec<Hit> {
        answers_in_shares(rays, Hit::NONE, SHARE_RAYS, |first, rays, hits| {
            self.single.closest_where(rays, hits, &mut |ray, hit| accepts(first + ray, hit));
        })
    }

    /// All hits of all rays, and which of them are of each ray.
    pub fn all_hits(&self, rays: &[Ray]) -> (Vec<Hit>, Vec<Range<usize>>) {
        let mut parts: Vec<(Vec<Hit>, Vec<Range<usize>>)> = if rays.len() <= COLLECTED_AT_ONCE {
            vec![self.collect(rays)]
        } else {
            rays.par_chunks(COLLECTED_AT_ONCE).map(|rays| self.collect(rays)).collect()
        };
        if parts.len() == 1 {
            return parts.remove(0);
        }
        let mut hits = Vec::with_capacity(parts.iter().map(|(hits, _)| hits.len()).sum());
        let mut ranges = Vec::with_capacity(rays.len());
        for (part_hits, part_ranges) in parts {
            let first = hits.len();
            ranges.extend(part_ranges.into_iter().map(|range| first + range.start..first + range.end));
            hits.extend(part_hits);
        }
        (hits, ranges)
    }

    /// [`TreeTracers::all_hits`] on the calling thread.
    fn collect(&self, rays: &[Ray]) -> (Vec<Hit>, Vec<Range<usize>>) {
        let (mut hits, mut ranges) = (Vec::new(), vec![0..0; rays.len()]);
        self.single.visit_hits(rays, |ray, hit| {
            let range: &mut Range<usize> = &mut ranges[ray];
            if range.start == range.end {
                range.start = hits.len();
            }
            hits.push(*hit);
            range.end = hits.len();
        });
        for range in &mut ranges {
            let hits: &mut [Hit] = &mut hits[range.clone()];
            hits.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        }
        (hits, ranges)
    }
}
