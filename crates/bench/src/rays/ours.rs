//! raystream's contenders: the CPU tracers at each SIMD level, `query` and the service.

use super::Kind;
use super::contender::{Clock, Contender, Round};
use raystream::engine::PreparedScene;
use raystream::lanes::SimdLevel;
use raystream::query::{Mesh, SHARE_RAYS, in_shares};
use raystream::schedule::{JobOptions, Service, Tracers};
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::{CpuTracer, SingleRayTracer};
use std::sync::Arc;
use std::time::Instant;

/// The tracers at each of `levels`, then `query` (if no alpha test is needed) and the service at the detected level.
pub fn contenders<'a>(
    prepared: &PreparedScene,
    kind: Kind,
    clock: Clock<'a>,
    service: &'a Service,
    levels: &[SimdLevel],
) -> Vec<Contender<'a>> {
    let (bvh, filter) = (&prepared.bvh, &prepared.filter);
    let mut contenders = Vec::new();
    for &level in levels {
        if let Ok(tracer) = CpuTracer::new(bvh.clone(), filter.clone(), level) {
            contenders.push(tracer_alone("raystream", level, tracer, kind, clock));
        }
        if let Ok(tracer) = SingleRayTracer::new(bvh.clone(), filter.clone(), level) {
            contenders.push(tracer_alone("raystream single", level, tracer, kind, clock));
        }
    }
    if filter.is_none() {
        contenders.push(query(Mesh::of(bvh.clone()), kind, clock));
    }
    contenders.push(by_service(Tracers::cpu(prepared.tracers.host.clone()), service, kind));
    contenders
}

/// A tracer by itself, into memory that is already there.
fn tracer_alone<'a>(
    name: &str,
    level: SimdLevel,
    tracer: impl Tracer + 'a,
    kind: Kind,
    clock: Clock<'a>,
) -> Contender<'a> {
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    let round = move |rays: &Arc<[Ray]>| {
        hits.resize(if kind.is_any_hit() { 0 } else { rays.len() }, Hit::NONE);
        occluded.resize(if kind.is_any_hit() { rays.len() } else { 0 }, 0);
        Ok(clock.seconds(|| {
            if kind.is_any_hit() {
                in_shares(rays, &mut occluded, SHARE_RAYS, |_, rays, answers| tracer.occluded(rays, answers));
            } else {
                in_shares(rays, &mut hits, SHARE_RAYS, |_, rays, answers| tracer.closest(rays, answers));
            }
        }))
    };
    contender(name, level, clock.threads(), Box::new(round))
}

/// `query::Mesh`, into memory that is already there.
fn query(mesh: Mesh, kind: Kind, clock: Clock<'_>) -> Contender<'_> {
    let level = mesh.tracer().simd();
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    let round = move |rays: &Arc<[Ray]>| {
        hits.resize(if kind.is_any_hit() { 0 } else { rays.len() }, Hit::NONE);
        occluded.resize(if kind.is_any_hit() { rays.len() } else { 0 }, false);
        Ok(clock.seconds(|| {
            if kind.is_any_hit() {
                mesh.occluded_into(rays, &mut occluded);
            } else {
                mesh.closest_into(rays, &mut hits);
            }
        }))
    };
    contender("raystream query", level, clock.threads(), Box::new(round))
}

/// The service: from the rays to the vector of answers, whose memory is already there, with the job's start and end.
fn by_service(tracers: Tracers, service: &Service, kind: Kind) -> Contender<'_> {
    let threads = service.host_threads();
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    let round = move |rays: &Arc<[Ray]>| {
        let (tracers, rays, options) = (tracers.clone(), rays.clone(), JobOptions::default());
        let start = Instant::now();
        if kind.is_any_hit() {
            let memory = std::mem::take(&mut occluded);
            let job = service.occluded_into(tracers, rays, memory, options).expect("the default sizes fit");
            occluded = job.wait().expect("the host's tracer does not panic").0;
        } else {
            let memory = std::mem::take(&mut hits);
            let job = service.closest_into(tracers, rays, memory, options).expect("the default sizes fit");
            hits = job.wait().expect("the host's tracer does not panic").0;
        }
        Ok(start.elapsed().as_secs_f64())
    };
    contender("raystream service", SimdLevel::detect(), threads, Box::new(round))
}

fn contender<'a>(name: &str, level: SimdLevel, threads: usize, round: Round<'a>) -> Contender<'a> {
    let (name, simd) = (name.to_owned(), Some(level.name()));
    Contender { name, threads, simd, is_robust: true, is_slow: false, round }
}
