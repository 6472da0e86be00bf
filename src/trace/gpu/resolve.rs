//! Resolves candidates: turns a device's answers into canonical ones, on the host.
//!
//! This runs on the dispatch thread, after the answers have been read back. It is a known cost: about 48 ns for each
//! ray that is no miss (`with_fma.rs`), one ray at a time, so that one dispatch thread resolves about 20 million rays a
//! second at most. Reports count the time as the device's (`UnitReport::busy_s`). The vectors of undecided rays are
//! allocated in each dispatch.

use super::layout::{Candidates, MORE, OCCLUDED};
use crate::bvh::{Bvh, Filter};
use crate::geom::{CanonicalHit, CanonicalRay};
use crate::stream::{DeviceReport, Hit, MISS, Ray, Tracer};
use std::sync::Arc;

/// Decides which candidate is the hit. Its methods are inlined into the caller, which may be compiled for instructions
/// that make them faster ([`super::with_fma`]).
pub(super) struct Resolver {
    pub bvh: Arc<Bvh>,
    /// Decides about candidates on masked triangles.
    pub filter: Option<Arc<dyn Filter>>,
    /// Traces undecided rays.
    pub cpu: Arc<dyn Tracer>,
}

impl Resolver {
    /// Replaces every ray's [`Candidates`], which lie in its hit's memory, by its canonical hit.
    #[inline(always)]
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> DeviceReport {
        let mut report = DeviceReport::default();
        let mut undecided = Vec::new();
        for (index, ray) in rays.iter().enumerate() {
            let found: &Candidates = &bytemuck::cast(hits[index]);
            let complete = found.rest == f32::MAX;
            if found.first == MISS && complete {
                hits[index] = Hit::NONE;
                continue;
            }
            report.flagged += u64::from(found.second != MISS || !complete);
            match self.nearest(ray, found) {
                Some(nearest) if complete || nearest.t < found.rest => hits[index] = nearest,
                _ => undecided.push(index),
            }
        }
        report.retraced = undecided.len() as u64;
        let again: Vec<Ray> = undecided.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![Hit::NONE; again.len()];
        self.cpu.closest(&again, &mut answers);
        for (index, answer) in undecided.into_iter().zip(answers) {
            hits[index] = answer;
        }
        report
    }

    /// Replaces every ray's answer of `trace_any` by whether it is occluded: 1 or 0.
    #[inline(always)]
    pub fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) -> DeviceReport {
        let mut report = DeviceReport::default();
        let mut undecided = Vec::new();
        for (index, ray) in rays.iter().enumerate() {
            let found = occluded[index];
            occluded[index] = (found == OCCLUDED).into();
            if found == OCCLUDED || found == MISS {
                continue;
            }
            report.flagged += 1;
            let primitive = found & !MORE;
            let exists = (primitive as usize) < self.bvh.len();
            if exists && self.test(&self.prepare(ray), primitive).is_some() {
                occluded[index] = 1;
            } else if !exists || found != primitive {
                undecided.push(index);
            }
        }
        report.retraced = undecided.len() as u64;
        let again: Vec<Ray> = undecided.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![0; again.len()];
        self.cpu.occluded(&again, &mut answers);
        for (index, answer) in undecided.into_iter().zip(answers) {
            occluded[index] = answer;
        }
        report
    }

    /// The nearest canonical hit among the candidates; of equally near ones that with the lowest primitive id. `None`
    /// if a candidate is no primitive, which a broken device may answer.
    #[inline(always)]
    fn nearest(&self, ray: &Ray, candidates: &Candidates) -> Option<Hit> {
        let prepared = self.prepare(ray);
        let mut best = Hit::NONE;
        for primitive in [candidates.first, candidates.second, candidates.third] {
            if primitive == MISS {
                break;
            }
            if primitive as usize >= self.bvh.len() {
                return None;
            }
            if let Some(hit) = self.test(&prepared, primitive)
                && (hit.t < best.t || hit.t == best.t && hit.primitive < best.primitive)
            {
                best = hit;
            }
        }
        Some(best)
    }

    #[inline(always)]
    fn prepare(&self, ray: &Ray) -> CanonicalRay {
        CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, self.bvh.scene_max_abs())
    }

    /// The canonical hit of one primitive, if there is one and the filter accepts it.
    #[inline(always)]
    fn test(&self, ray: &CanonicalRay, primitive: u32) -> Option<Hit> {
        let CanonicalHit { t, u, v } = self.bvh.accepted_hit(ray, primitive, self.filter.as_deref())?;
        Some(Hit { t, u, v, primitive })
    }
}
