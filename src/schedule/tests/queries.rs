//! Ray queries.

use super::super::{JobError, JobOptions, Tracers};
use super::{Gated, blind, service, wait_until};
use crate::stream::{Hit, Ray, Tracer};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

/// Answers by the ray's origin.
struct ByOrigin;

impl Tracer for ByOrigin {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = Hit { t: ray.origin[0], primitive: ray.origin[1] as u32, ..Hit::NONE };
        }
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = ray.origin[0] as u32 % 2;
        }
    }
}

#[test]
fn queries_answer_each_ray_in_its_place() {
    let service = service(4, 0);
    for count in [0, 1, 16 * 1024, 100_001_usize] {
        let rays = (0..count).map(|i| Ray { origin: [i as f32, 7.0, 0.0], ..Ray::default() });
        let rays: Arc<[Ray]> = rays.collect();
        let tracers = Tracers::cpu(Arc::new(ByOrigin));
        // Several tiles in a stream, and batches that begin and end within tiles.
        let options = JobOptions { threshold: Some(40_000), batch_rays: 5000, ..JobOptions::default() };
        let closest = service.closest(tracers.clone(), Arc::clone(&rays), options.clone()).unwrap();
        let occluded = service.occluded(tracers, rays, options).unwrap();
        let (hits, report) = closest.wait().unwrap();
        assert_eq!((hits.len(), report.rays.camera, report.rays.shadow), (count, count as u64, 0));
        assert!(hits.iter().enumerate().all(|(i, hit)| hit.t == i as f32 && hit.primitive == 7));
        let (occluded, report) = occluded.wait().unwrap();
        assert_eq!((occluded.len(), report.rays.camera, report.rays.shadow), (count, 0, count as u64));
        assert!(occluded.iter().enumerate().all(|(i, &occluded)| occluded == i as u32 % 2));
    }
}

#[test]
fn a_query_can_be_cancelled() {
    let service = service(1, 0);
    let gated = Gated::new();
    let gate = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    let query = service.closest(blind(), vec![Ray::default(); 10].into(), JobOptions::default()).unwrap();
    assert!(!query.is_finished() && query.progress().tiles == 1);
    query.cancel();
    assert_eq!(query.wait().err(), Some(JobError::Cancelled));
    gated.open();
    gate.wait().unwrap();
}
