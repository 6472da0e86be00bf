//! The tracer that the engine uses.
//!
//! Unsafe code for calling functions that enable instructions. Invariant 1: a `CpuTracer` is made
//! only for a level that the processor has.
#![allow(unsafe_code, reason = "the invariants above")]

use super::substream::{Answers, Scratch, trace};
use super::{Oracle, SimdError, SimdLevel};
use crate::bvh::{Bvh, Filter};
#[cfg(target_arch = "aarch64")]
use crate::lanes::Neon;
use crate::lanes::Plain;
use crate::stream::{Hit, Ray, Tracer};
use std::cell::RefCell;
use std::sync::Arc;

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Traces ray streams on the calling thread with the instruction set chosen when it was made.
///
/// The more rays a call brings, the faster: 16k to 64k are best. Rays that lie near each other in the
/// slice should be alike; keep image and path order. Each thread that calls keeps a few megabytes of
/// scratch memory.
#[derive(Clone)]
pub struct CpuTracer {
    oracle: Oracle,
    simd: SimdLevel,
}

impl CpuTracer {
    /// A tracer for this tree; without a filter masked triangles are there everywhere.
    ///
    /// # Errors
    /// When this processor lacks the level.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>, simd: SimdLevel) -> Result<Self, SimdError> {
        Ok(Self { oracle: Oracle::new(bvh, filter), simd: simd.require()? })
    }

    /// The instruction set in use.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// The scalar reference over the same tree.
    pub fn oracle(&self) -> &Oracle {
        &self.oracle
    }

    /// The canonical hit of a ray and one triangle: see [`Oracle::canonical_hit`].
    pub fn canonical_hit(&self, ray: &Ray, primitive: u32) -> Option<Hit> {
        self.oracle.canonical_hit(ray, primitive)
    }

    fn dispatch<const ANY: bool>(&self, rays: &[Ray], answers: Answers) {
        if self.oracle.bvh().instances().is_empty() {
            self.dispatch_to::<ANY, false>(rays, answers);
        } else {
            self.dispatch_to::<ANY, true>(rays, answers);
        }
    }

    fn dispatch_to<const ANY: bool, const MEMBERS: bool>(&self, rays: &[Ray], answers: Answers) {
        let (bvh, filter) = (self.oracle.bvh(), self.oracle.filter());
        SCRATCH.with_borrow_mut(|scratch| match self.simd {
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe { x86::avx512::<ANY, MEMBERS>(bvh, filter, rays, answers, scratch) },
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::avx2::<ANY, MEMBERS>(bvh, filter, rays, answers, scratch) },
            #[cfg(target_arch = "aarch64")]
            SimdLevel::Neon => trace::<_, _, ANY, MEMBERS>((Neon, Neon), bvh, filter, rays, answers, scratch),
            _ => trace::<_, _, ANY, MEMBERS>((Plain::<8>, Plain::<8>), bvh, filter, rays, answers, scratch),
        });
    }
}

impl Tracer for CpuTracer {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        hits.fill(Hit::NONE);
        self.dispatch::<false>(rays, Answers::Hits(hits.as_mut_ptr()));
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        occluded.fill(0);
        self.dispatch::<true>(rays, Answers::Occluded(occluded.as_mut_ptr()));
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::*;
    use crate::lanes::{Avx2, Avx512, Avx512Eights};

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx512<const ANY: bool, const MEMBERS: bool>(
        bvh: &Bvh,
        filter: Option<&dyn Filter>,
        rays: &[Ray],
        answers: Answers,
        scratch: &mut Scratch,
    ) {
        // SAFETY: this function enables the instructions, so whoever calls it has them.
        let tokens = unsafe { (Avx512::new(), Avx512Eights::new()) };
        trace::<_, _, ANY, MEMBERS>(tokens, bvh, filter, rays, answers, scratch);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx2<const ANY: bool, const MEMBERS: bool>(
        bvh: &Bvh,
        filter: Option<&dyn Filter>,
        rays: &[Ray],
        answers: Answers,
        scratch: &mut Scratch,
    ) {
        // SAFETY: this function enables the instructions, so whoever calls it has them.
        let token = unsafe { Avx2::new() };
        trace::<_, _, ANY, MEMBERS>((token, token), bvh, filter, rays, answers, scratch);
    }
}
