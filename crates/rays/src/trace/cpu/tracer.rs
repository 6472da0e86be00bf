//! The tracer that the engine uses.
//!
//! Unsafe code for calling functions that enable instructions. Invariant 1: a `CpuTracer` is made only for a level
//! whose instructions the processor has.
#![allow(unsafe_code, reason = "the invariants above")]

use super::accept::Filtered;
use super::crossings::TriangleSink;
use super::oracle::Oracle;
use super::scalar;
use super::substream::{Answers, Widths};
use super::traversal::{Scratch, trace, trace_candidates};
use crate::bvh::{Bvh, Filter};
#[cfg(target_arch = "aarch64")]
use crate::lanes::Neon;
use crate::lanes::{Eight, SimdError, SimdLevel};
use crate::stream::{Hit, Ray, Tracer};
use std::cell::Cell;
use std::fmt;
use std::sync::Arc;

thread_local! {
    /// Taken by a call while it traces, so that a filter may trace on the same thread.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Traces ray streams on the calling thread, with the instruction set chosen when it was made.
///
/// The more rays a call brings, the faster: 16k to 64k are best. Rays that are neighbours in the slice should be alike,
/// so keep image and path order. Each calling thread keeps a few megabytes of scratch memory. A filter that traces on
/// the same thread is supported, and uses scratch memory of its own.
#[derive(Clone)]
pub struct CpuTracer {
    oracle: Oracle,
    simd: SimdLevel,
}

impl CpuTracer {
    /// A tracer for this tree. Without a filter masked triangles are hit everywhere.
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

    /// Hands all triangles that rays may cross to a sink, with the indices of the rays, in no particular order.
    pub(crate) fn visit_candidates(&self, rays: &[Ray], sink: &mut dyn TriangleSink) {
        let bvh = self.oracle.bvh();
        let mut scratch = SCRATCH.take().unwrap_or_default();
        let memory = &mut *scratch;
        match self.simd {
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe { x86::avx512_candidates(bvh, rays, sink, memory) },
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::avx2_candidates(bvh, rays, sink, memory) },
            #[cfg(target_arch = "aarch64")]
            SimdLevel::Neon => trace_candidates(Widths { wide: Neon, eight: Neon }, bvh, rays, sink, memory),
            _ if cfg!(miri) => {
                trace_candidates(Widths { wide: Eight, eight: Eight }, bvh, rays, sink, memory)
            }
            _ => scalar::visit_candidates(bvh, rays, sink),
        }
        SCRATCH.set(Some(scratch));
    }

    fn dispatch<const ANY: bool>(&self, rays: &[Ray], answers: Answers<'_>) {
        if self.oracle.bvh().instances().is_empty() {
            self.dispatch_to::<ANY, false>(rays, answers);
        } else {
            self.dispatch_to::<ANY, true>(rays, answers);
        }
    }

    fn dispatch_to<const ANY: bool, const INSTANCED: bool>(&self, rays: &[Ray], mut answers: Answers<'_>) {
        let (bvh, filter) = (self.oracle.bvh(), self.oracle.filter());
        let mut scratch = SCRATCH.take().unwrap_or_default();
        let memory = &mut *scratch;
        match self.simd {
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => unsafe { x86::avx512::<ANY, INSTANCED>(bvh, filter, rays, answers, memory) },
            // SAFETY: invariant 1.
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => unsafe { x86::avx2::<ANY, INSTANCED>(bvh, filter, rays, answers, memory) },
            #[cfg(target_arch = "aarch64")]
            SimdLevel::Neon => {
                let widths = Widths { wide: Neon, eight: Neon };
                trace::<_, _, ANY, INSTANCED>(widths, bvh, filter, rays, answers, memory);
            }
            // Miri has no vector instructions, and checks what others run by plain lanes.
            _ if cfg!(miri) => {
                let widths = Widths { wide: Eight, eight: Eight };
                trace::<_, _, ANY, INSTANCED>(widths, bvh, filter, rays, answers, memory);
            }
            _ => scalar::trace::<_, ANY>(bvh, rays, Filtered(filter), |ray, hit| answers.set(ray, hit)),
        }
        SCRATCH.set(Some(scratch));
    }
}

impl fmt::Debug for CpuTracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { oracle, simd } = self;
        f.debug_struct("CpuTracer").field("oracle", oracle).field("simd", simd).finish()
    }
}

impl Tracer for CpuTracer {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        hits.fill(Hit::NONE);
        self.dispatch::<false>(rays, Answers::Hits(hits));
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        occluded.fill(0);
        self.dispatch::<true>(rays, Answers::Occluded(occluded));
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::*;
    use crate::lanes::{Avx2, Avx512, Avx512Eights};

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx512<const ANY: bool, const INSTANCED: bool>(
        bvh: &Bvh,
        filter: Option<&dyn Filter>,
        rays: &[Ray],
        answers: Answers<'_>,
        scratch: &mut Scratch,
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1).
        let widths = unsafe { Widths { wide: Avx512::new(), eight: Avx512Eights::new() } };
        trace::<_, _, ANY, INSTANCED>(widths, bvh, filter, rays, answers, scratch);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx2<const ANY: bool, const INSTANCED: bool>(
        bvh: &Bvh,
        filter: Option<&dyn Filter>,
        rays: &[Ray],
        answers: Answers<'_>,
        scratch: &mut Scratch,
    ) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1).
        let token = unsafe { Avx2::new() };
        let widths = Widths { wide: token, eight: token };
        trace::<_, _, ANY, INSTANCED>(widths, bvh, filter, rays, answers, scratch);
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx512_candidates(bvh: &Bvh, rays: &[Ray], sink: &mut dyn TriangleSink, scratch: &mut Scratch) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1).
        let widths = unsafe { Widths { wide: Avx512::new(), eight: Avx512Eights::new() } };
        trace_candidates(widths, bvh, rays, sink, scratch);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    pub fn avx2_candidates(bvh: &Bvh, rays: &[Ray], sink: &mut dyn TriangleSink, scratch: &mut Scratch) {
        // SAFETY: this function enables the instructions, so its callers run on a processor that has them (invariant
        // 1).
        let token = unsafe { Avx2::new() };
        trace_candidates(Widths { wide: token, eight: token }, bvh, rays, sink, scratch);
    }
}
