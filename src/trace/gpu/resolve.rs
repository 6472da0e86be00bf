//! Resolves candidates: turns a device's answers into canonical ones, on the host.
//!
//! This runs on host threads, once the answers are in a stream's memory. A device that makes exact hits (`exact`)
//! leaves only undecided rays, which are traced again. Otherwise most hit rays have a single candidate that
//! no filter decides: those are tested in lanes, a ray and its candidate in each. The others take one test after the
//! other. The vectors of undecided rays are allocated in each dispatch.

use super::layout::{Candidates, MORE, OCCLUDED};
use super::undecided::Undecided;
use crate::bvh::{Bvh, Filter};
use crate::geom::{CanonicalHit, CanonicalRay};
use crate::lanes::{LaneTask, Lanes, MAX_LANES, SimdLevel};
use crate::stream::{DeviceReport, Hit, MISS, Ray, Tracer};
use crate::trace::cpu::ray_triangle_pairs::RayTrianglePairs;
use glam::Vec3;
use std::sync::Arc;

/// Rays whose candidates are looked up together, so that their memory arrives meanwhile.
const WINDOW: usize = 64;

/// Decides which candidate is the hit.
pub(super) struct Resolver {
    pub bvh: Arc<Bvh>,
    /// Decides about candidates on masked triangles.
    pub filter: Option<Arc<dyn Filter>>,
    /// Traces undecided rays.
    pub cpu: Arc<dyn Tracer>,
}

impl Resolver {
    /// Makes canonical answers of a dispatch's, of both kinds.
    pub fn resolve(
        &self,
        (rays, hits, undecided): (&[Ray], &mut [Hit], Option<Undecided>),
        (shadow_rays, occluded, undecided_shadows): (&[Ray], &mut [u32], Option<Undecided>),
    ) -> DeviceReport {
        let mut report = match undecided {
            Some(undecided) => self.trace_undecided(rays, hits, undecided),
            None => self.closest(rays, hits),
        };
        report += match undecided_shadows {
            Some(undecided) => self.trace_undecided_shadows(shadow_rays, occluded, undecided),
            None => self.occluded(shadow_rays, occluded),
        };
        report
    }

    /// Replaces every ray's [`Candidates`], which lie in its hit's memory, by its canonical hit.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> DeviceReport {
        let Resolved { mut report, undecided } =
            SimdLevel::detect().run(Closest { resolver: self, rays, hits: &mut *hits });
        report.retraced = undecided.len() as u64;
        self.trace_again(rays, hits, undecided);
        report
    }

    /// Traces the rays that the device left undecided, where it has made hits of its candidates. So it does where an
    /// answer is no hit, which a broken device may answer.
    pub fn trace_undecided(&self, rays: &[Ray], hits: &mut [Hit], undecided: Undecided) -> DeviceReport {
        let (undecided, masked) = match undecided {
            Undecided::Listed { rays: listed, masked } => {
                // One pass without branches, in which nothing is written.
                let last = self.bvh.len() as u32;
                let is_wrong = |hit: &Hit| hit.primitive.wrapping_add(1) > last;
                let wrong = hits.iter().fold(0, |wrong, hit| wrong + usize::from(is_wrong(hit)));
                if wrong == listed.len() { (listed, masked) } else { (self.without_hits(hits), masked) }
            }
            Undecided::InAnswers => (self.without_hits(hits), 0),
        };
        let retraced = undecided.len() as u64;
        self.trace_again(rays, hits, undecided);
        DeviceReport { flagged: retraced, retraced, masked: masked as u64, ..DeviceReport::default() }
    }

    /// Rays whose answers name no primitive and are no misses.
    fn without_hits(&self, hits: &[Hit]) -> Vec<usize> {
        let is_hit = |hit: &Hit| hit.is_miss() || self.exists(hit.primitive);
        (0..hits.len()).filter(|&index| !is_hit(&hits[index])).collect()
    }

    fn trace_again(&self, rays: &[Ray], hits: &mut [Hit], undecided: Vec<usize>) {
        let again: Vec<Ray> = undecided.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![Hit::NONE; again.len()];
        self.cpu.closest(&again, &mut answers);
        for (index, answer) in undecided.into_iter().zip(answers) {
            hits[index] = answer;
        }
    }

    /// [`Resolver::trace_undecided`] for shadow rays.
    pub fn trace_undecided_shadows(
        &self,
        rays: &[Ray],
        occluded: &mut [u32],
        undecided: Undecided,
    ) -> DeviceReport {
        let (undecided, masked) = match undecided {
            Undecided::Listed { rays, masked } => (rays, masked),
            Undecided::InAnswers => ((0..rays.len()).filter(|&ray| occluded[ray] > 1).collect(), 0),
        };
        let retraced = undecided.len() as u64;
        self.trace_shadows_again(rays, occluded, undecided);
        DeviceReport { flagged: retraced, retraced, masked: masked as u64, ..DeviceReport::default() }
    }

    fn trace_shadows_again(&self, rays: &[Ray], occluded: &mut [u32], undecided: Vec<usize>) {
        let again: Vec<Ray> = undecided.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![0; again.len()];
        self.cpu.occluded(&again, &mut answers);
        for (index, answer) in undecided.into_iter().zip(answers) {
            occluded[index] = answer;
        }
    }

    /// Replaces every ray's answer of `trace_any` by whether it is occluded: 1 or 0.
    pub fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) -> DeviceReport {
        let Resolved { mut report, undecided } =
            SimdLevel::detect().run(Occluded { resolver: self, rays, occluded: &mut *occluded });
        report.retraced = undecided.len() as u64;
        self.trace_shadows_again(rays, occluded, undecided);
        report
    }

    /// Writes the hit of a ray with any candidates, or adds it to the undecided ones.
    #[inline(always)]
    fn decide(
        &self,
        index: usize,
        ray: &Ray,
        candidates: &Candidates,
        hits: &mut [Hit],
        undecided: &mut Vec<usize>,
    ) {
        let rest = candidates.rest;
        match self.nearest(ray, candidates) {
            Some(nearest) if rest == f32::MAX || nearest.t < rest => hits[index] = nearest,
            _ => undecided.push(index),
        }
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
            if !self.exists(primitive) {
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
    fn exists(&self, primitive: u32) -> bool {
        (primitive as usize) < self.bvh.len()
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

/// The decisions of a dispatch's candidates.
struct Resolved {
    report: DeviceReport,
    /// Indices of rays that the CPU has to trace.
    undecided: Vec<usize>,
}

/// Replaces candidates by hits, except those of undecided rays.
struct Closest<'a> {
    resolver: &'a Resolver,
    rays: &'a [Ray],
    hits: &'a mut [Hit],
}

impl LaneTask for Closest<'_> {
    type Output = Resolved;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Resolved {
        let Self { resolver, rays, hits } = self;
        let (mut report, mut undecided) = (DeviceReport::default(), Vec::new());
        let mut single = SingleCandidates::new();
        for (window, window_rays) in rays.chunks(WINDOW).enumerate() {
            let first = window * WINDOW;
            let (mut found, mut count) = ([(0, 0); WINDOW], 0);
            for (ray, window_ray) in window_rays.iter().enumerate() {
                let index = first + ray;
                let candidates: Candidates = bytemuck::cast(hits[index]);
                let is_complete = candidates.rest == f32::MAX;
                if candidates.first == MISS && is_complete {
                    hits[index] = Hit::NONE;
                } else if candidates.second == MISS && is_complete && resolver.exists(candidates.first) {
                    found[count] = (index, candidates.first);
                    count += 1;
                    resolver.bvh.prefetch_reference(candidates.first);
                } else {
                    report.flagged += 1;
                    resolver.decide(index, window_ray, &candidates, hits, &mut undecided);
                }
            }
            for &(_, primitive) in &found[..count] {
                resolver.bvh.prefetch_triangle(primitive);
            }
            for &(index, primitive) in &found[..count] {
                let (corners, is_masked) = resolver.bvh.corners_and_mask(primitive);
                if is_masked && resolver.filter.is_some() {
                    let candidates: Candidates = bytemuck::cast(hits[index]);
                    resolver.decide(index, &rays[index], &candidates, hits, &mut undecided);
                    continue;
                }
                single.push(index, &rays[index], primitive, &corners);
                if single.pairs.len() == L::LANES {
                    single.resolve(l, resolver.bvh.scene_max_abs(), hits);
                }
            }
        }
        single.resolve(l, resolver.bvh.scene_max_abs(), hits);
        Resolved { report, undecided }
    }
}

/// Rays with one candidate each that no filter decides.
struct SingleCandidates {
    pairs: RayTrianglePairs,
    primitives: [u32; MAX_LANES],
    /// The rays' indices.
    indices: [usize; MAX_LANES],
}

impl SingleCandidates {
    fn new() -> Self {
        Self { pairs: RayTrianglePairs::default(), primitives: [0; MAX_LANES], indices: [0; MAX_LANES] }
    }

    #[inline(always)]
    fn push(&mut self, index: usize, ray: &Ray, primitive: u32, corners: &[Vec3; 3]) {
        let pair = self.pairs.len();
        (self.indices[pair], self.primitives[pair]) = (index, primitive);
        self.pairs.push(ray, corners);
    }

    /// Writes the hits of all rays; none remain.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn resolve<L: Lanes>(&mut self, l: L, scene_max_abs: f32, hits: &mut [Hit]) {
        let len = self.pairs.len();
        let found = self.pairs.take_hits(l, scene_max_abs, &self.primitives);
        for pair in 0..len {
            hits[self.indices[pair]] = found[pair];
        }
    }
}

/// Replaces answers of `trace_any` by whether rays are occluded, except those of undecided rays.
struct Occluded<'a> {
    resolver: &'a Resolver,
    rays: &'a [Ray],
    occluded: &'a mut [u32],
}

impl LaneTask for Occluded<'_> {
    type Output = Resolved;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, _: L) -> Resolved {
        let Self { resolver, rays, occluded } = self;
        let (mut report, mut undecided) = (DeviceReport::default(), Vec::new());
        for (index, ray) in rays.iter().enumerate() {
            let found = occluded[index];
            occluded[index] = (found == OCCLUDED).into();
            if found == OCCLUDED || found == MISS {
                continue;
            }
            report.flagged += 1;
            let primitive = found & !MORE;
            let exists = resolver.exists(primitive);
            if exists && resolver.test(&resolver.prepare(ray), primitive).is_some() {
                occluded[index] = 1;
            } else if !exists || found != primitive {
                undecided.push(index);
            }
        }
        Resolved { report, undecided }
    }
}
