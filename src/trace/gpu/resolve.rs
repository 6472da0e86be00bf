//! The host's half of a dispatch: candidates become canonical answers.

use super::layout::{Candidates, MORE, OCCLUDED};
use crate::bvh::{Bvh, Filter};
use crate::geom::CanonicalRay;
use crate::stream::{DeviceReport, Hit, MISS, Ray, Tracer};
use std::sync::Arc;

/// What it takes to say which candidate is the hit. Its methods are inlined into the caller, which may
/// be compiled for instructions that they like (`fused`).
pub(super) struct Resolver {
    pub bvh: Arc<Bvh>,
    /// The say in hits of masked triangles.
    pub filter: Option<Arc<dyn Filter>>,
    /// Traces what the candidates leave open.
    pub cpu: Arc<dyn Tracer>,
}

impl Resolver {
    /// Writes every ray's canonical hit over its candidates, which lie in its place.
    #[inline(always)]
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> DeviceReport {
        let mut report = DeviceReport::default();
        let mut open = Vec::new();
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
                _ => open.push(index),
            }
        }
        report.retraced = open.len() as u64;
        let again: Vec<Ray> = open.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![Hit::NONE; again.len()];
        self.cpu.closest(&again, &mut answers);
        for (index, answer) in open.into_iter().zip(answers) {
            hits[index] = answer;
        }
        report
    }

    /// Writes whether every ray is occluded over the candidate in its place.
    #[inline(always)]
    pub fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) -> DeviceReport {
        let mut report = DeviceReport::default();
        let mut open = Vec::new();
        for (index, ray) in rays.iter().enumerate() {
            let found = occluded[index];
            occluded[index] = (found == OCCLUDED).into();
            if found == OCCLUDED || found == MISS {
                continue;
            }
            report.flagged += 1;
            let primitive = found & !MORE;
            let known = (primitive as usize) < self.bvh.len();
            if known && self.test(&self.prepare(ray), primitive).is_some() {
                occluded[index] = 1;
            } else if !known || found != primitive {
                open.push(index);
            }
        }
        report.retraced = open.len() as u64;
        let again: Vec<Ray> = open.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![0; again.len()];
        self.cpu.occluded(&again, &mut answers);
        for (index, answer) in open.into_iter().zip(answers) {
            occluded[index] = answer;
        }
        report
    }

    /// The nearest canonical hit among the candidates, ties to the lowest primitive. `None` when one
    /// is no primitive, as a broken device may answer.
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

    #[inline(always)]
    fn test(&self, ray: &CanonicalRay, primitive: u32) -> Option<Hit> {
        let [v0, v1, v2] = self.bvh.corners(primitive);
        let hit = ray.triangle(v0, v1, v2)?;
        let there = match &self.filter {
            Some(filter) if self.bvh.is_masked(primitive) => filter.accepts(primitive, hit.u, hit.v),
            _ => true,
        };
        there.then_some(Hit { t: hit.t, u: hit.u, v: hit.v, primitive })
    }
}
