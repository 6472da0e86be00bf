//! Ray queries.

use super::super::{JobError, JobOptions, Priority, TaskKind, ThreadKind, Tracers, Unit};
use super::{Gated, blind, service, wait_until};
use crate::stream::{Blocking, BlockingTracer, DeviceError, DeviceReport, Hit, Queries, Ray, Tracer};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

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

impl BlockingTracer for ByOrigin {
    fn name(&self) -> &str {
        "a device"
    }

    fn max_rays(&self) -> usize {
        10_000
    }

    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        self.closest(queries.rays, queries.hits);
        self.occluded(queries.shadow_rays, queries.occluded);
        Ok(DeviceReport::default())
    }
}

#[test]
fn queries_answer_each_ray_in_its_place() {
    let service = service(4, false);
    for count in [0, 1, 512, 513, 16 * 1024, 100_001_usize] {
        let rays = (0..count).map(|i| Ray { origin: [i as f32, 7.0, 0.0], ..Ray::default() });
        let rays: Arc<[Ray]> = rays.collect();
        let tracers = Tracers::cpu(Arc::new(ByOrigin));
        let options = JobOptions::default().with_timeline(true);
        let closest = service.closest(tracers.clone(), Arc::clone(&rays), options.clone()).unwrap();
        let occluded = service.occluded(tracers, rays, options).unwrap();
        let (hits, report) = closest.wait().unwrap();
        assert_eq!((hits.len(), report.rays.camera, report.rays.shadow), (count, count as u64, 0));
        assert!(hits.iter().enumerate().all(|(i, hit)| hit.t == i as f32 && hit.primitive == 7));
        let (occluded, report) = occluded.wait().unwrap();
        assert_eq!((occluded.len(), report.rays.camera, report.rays.shadow), (count, 0, count as u64));
        assert!(occluded.iter().enumerate().all(|(i, &occluded)| occluded == i as u32 % 2));
        assert_eq!((report.cpu.rays, report.stopped, report.streams), (count as u64, false, 0));
        assert!(report.timeline.iter().all(|task| task.kind == TaskKind::Trace), "where they are");
        assert_eq!(report.timeline.iter().map(|task| u64::from(task.rays)).sum::<u64>(), count as u64);
    }
}

#[test]
fn tiles_in_place_are_no_larger_than_chunks_and_what_may_be_in_flight() {
    let service = service(1, false);
    let rays: Arc<[Ray]> = vec![Ray { origin: [3.0, 7.0, 0.0], ..Ray::default() }; 10_000].into();
    let longest = |options: JobOptions| {
        let ask = service.closest(Tracers::cpu(Arc::new(ByOrigin)), Arc::clone(&rays), options);
        let (hits, report) = ask.unwrap().wait().unwrap();
        assert_eq!(hits.len(), 10_000);
        report.timeline.iter().map(|task| task.rays).max()
    };
    let options = || JobOptions::default().with_timeline(true);
    assert_eq!(longest(options()), Some(10_000));
    assert_eq!(longest(options().with_chunk_rays(100, 700)), Some(700));
    assert_eq!(longest(JobOptions { in_flight: Some(3000), threshold: Some(1000), ..options() }), Some(3000));
}

#[test]
fn memory_of_answers_is_used_again() {
    let service = service(2, false);
    let tracers = Tracers::cpu(Arc::new(ByOrigin));
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    let mut memory = None;
    for count in [90_000_usize, 100, 70_000, 0, 90_000] {
        let rays = (0..count).map(|i| Ray { origin: [(2 * i) as f32, 7.0, 0.0], ..Ray::default() });
        let rays: Arc<[Ray]> = rays.collect();
        let ask = service.closest_into(tracers.clone(), Arc::clone(&rays), hits, JobOptions::default());
        hits = ask.unwrap().wait().unwrap().0;
        assert_eq!(hits.len(), count);
        assert!(hits.iter().enumerate().all(|(i, hit)| hit.t == (2 * i) as f32));
        assert_eq!(*memory.get_or_insert(hits.as_ptr()), hits.as_ptr());
        // What was there before is never an answer.
        occluded.resize(count, 9);
        let ask = service.occluded_into(tracers.clone(), rays, occluded, JobOptions::default());
        occluded = ask.unwrap().wait().unwrap().0;
        assert_eq!(occluded, vec![0; count]);
    }
}

#[test]
fn queries_of_a_device_go_through_streams_with_the_same_answers() {
    let service = service(2, true);
    for unit in [Unit::Gpu, Unit::Hybrid] {
        let rays = (0..100_001).map(|i| Ray { origin: [i as f32, 7.0, 0.0], ..Ray::default() });
        let rays: Arc<[Ray]> = rays.collect();
        let tracers = Tracers::cpu(Arc::new(ByOrigin)).with_device(Arc::new(Blocking::new(ByOrigin)), unit);
        // Several tiles in a stream, and batches that begin and end within tiles.
        let options = JobOptions { threshold: Some(40_000), batch_rays: 5000, ..JobOptions::default() };
        let ask = service.closest(tracers.clone(), Arc::clone(&rays), options.clone());
        let (hits, report) = ask.unwrap().wait().unwrap();
        assert!(hits.len() == rays.len() && hits.iter().enumerate().all(|(i, hit)| hit.t == i as f32));
        assert!(report.streams > 0 && report.cpu.rays + report.gpu.rays == 100_001, "{report:?}");
        let (occluded, _) = service.occluded(tracers, rays, options).unwrap().wait().unwrap();
        assert!(occluded.iter().enumerate().all(|(i, &occluded)| occluded == i as u32 % 2));
    }
}

#[test]
fn a_query_can_be_cancelled() {
    let service = service(1, false);
    let gated = Gated::new();
    let gate = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    let options = JobOptions::default().with_caller_rays(0);
    let query = service.closest(blind(), vec![Ray::default(); 10].into(), options).unwrap();
    assert!(!query.is_finished() && query.progress().tiles == 1);
    query.cancel();
    assert_eq!(query.wait().err(), Some(JobError::Cancelled));
    gated.open();
    gate.wait().unwrap();
}

/// Remembers the threads that call it.
#[derive(Default)]
struct Witness(Mutex<Vec<std::thread::ThreadId>>);

impl Tracer for Witness {
    fn closest(&self, _: &[Ray], hits: &mut [Hit]) {
        self.0.lock().unwrap().push(std::thread::current().id());
        hits.fill(Hit::NONE);
    }

    fn occluded(&self, _: &[Ray], _: &mut [u32]) {
        panic!("a tracer that panics");
    }
}

#[test]
fn few_rays_are_traced_by_the_caller_and_the_report_says_so() {
    let service = service(2, false);
    let rays = |count| vec![Ray::default(); count].into();
    let ask = |count, options: JobOptions, unit| {
        let witness = Arc::new(Witness::default());
        let tracers = Tracers { unit, ..Tracers::cpu(Arc::clone(&witness) as _) };
        let (hits, report) = service.closest(tracers, rays(count), options).unwrap().wait().unwrap();
        assert_eq!((hits.len(), report.cpu.rays), (count, count as u64));
        let by_caller = witness.0.lock().unwrap().iter().all(|&thread| thread == std::thread::current().id());
        let kinds: Vec<_> = report.threads.iter().map(|thread| thread.kind).collect();
        assert_eq!(kinds == [ThreadKind::Caller], by_caller, "{kinds:?}");
        assert!(by_caller || kinds == [ThreadKind::Host; 2]);
        (by_caller, report)
    };
    let options = JobOptions::default;
    let (by_caller, report) = ask(512, options().with_timeline(true).with_name("pick"), Unit::Cpu);
    assert!(by_caller && report.name.as_deref() == Some("pick") && report.streams == 0);
    let [task] = report.timeline[..] else { panic!("one task") };
    assert_eq!((task.kind, task.rays, task.thread), (TaskKind::Trace, 512, 0));
    assert_eq!(report.threads[0].busy_s, report.wall_s);
    assert!(!ask(513, options(), Unit::Cpu).0);
    assert!(!ask(1, options().with_caller_rays(0), Unit::Cpu).0);
    assert!(!ask(1, options().with_priority(Priority::Background), Unit::Cpu).0);
    // There is no GPU.
    let (by_caller, report) = ask(1, options(), Unit::Gpu);
    assert!(by_caller && report.events == ["there is no GPU; host threads trace alone"]);
    assert!(service.closest(blind(), rays(1), options().with_batch_rays(0)).is_err(), "as for other queries");

    let occluded =
        service.occluded(Tracers::cpu(Arc::new(Witness::default())), rays(1), options().with_name("pick"));
    let error = occluded.unwrap().wait().unwrap_err();
    assert_eq!(error.to_string(), "job \"pick\" panicked: a tracer that panics");
}

#[test]
fn a_stopped_query_has_answers_to_its_first_rays() {
    let service = service(1, false);
    let gated = Gated::new();
    let gate = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    let rays: Arc<[Ray]> =
        (0..50_000).map(|i| Ray { origin: [i as f32, 7.0, 0.0], ..Ray::default() }).collect();
    let ask = || {
        service.closest(Tracers::cpu(Arc::new(ByOrigin)), Arc::clone(&rays), JobOptions::default()).unwrap()
    };
    let (none, all) = (ask(), ask());
    none.stop();
    let (hits, report) = none.wait().unwrap();
    assert!(hits.is_empty() && report.stopped);
    gated.open();
    gate.wait().unwrap();
    assert_eq!(all.wait().unwrap().0.len(), 50_000);
}
