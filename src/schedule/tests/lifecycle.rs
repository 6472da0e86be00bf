//! Jobs that wait, are stopped, cancelled or dropped, or break their promises; and services that are dropped.

use super::super::{
    Batch, JobError, JobHandle, JobOptions, JobReport, Output, Progress, Renderer, Service, ServiceOptions,
    Tracers,
};
use super::gated::{Held, Holder};
use super::ledger::{Ledger, Script};
use super::{Gated, SCRIPT, SMALL, blind, outcome, service, wait_until};
use crate::stream::Ray;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

#[test]
fn a_stopped_job_finishes_what_it_has_spawned() {
    let service = service(2, false);
    let gated = Gated::new();
    let job = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) == 2);
    job.stop();
    assert!(!job.wait_for(Duration::from_millis(1)) && !job.is_finished());
    gated.open();
    let report = outcome(job).unwrap();
    assert!(report.stopped);
    assert_eq!((report.tiles, report.tiles_spawned), (50, 2));
    assert_eq!(gated.shaded.load(Relaxed), 2);
}

#[test]
fn a_cancelled_job_leaves_others_running_and_drops_its_renderer() {
    let service = service(3, false);
    let gated = Gated::new();
    let cancelled = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    let ledger = Ledger::new(SCRIPT);
    let other = service.submit(Arc::clone(&ledger), Tracers::cpu(Arc::clone(&ledger) as _), SMALL).unwrap();
    cancelled.cancel();
    gated.open();
    assert_eq!(outcome(cancelled), Err(JobError::Cancelled));
    assert!(Arc::into_inner(gated).is_some(), "the service has dropped the renderer");
    outcome(other).unwrap();
    ledger.check_complete();
}

#[test]
fn shading_ends_soon_after_a_cancel() {
    let service = service(1, false);
    let gated = Gated::in_shading(1000);
    let options = JobOptions { batch_rays: 10, ..JobOptions::default() };
    let job = service.submit(Arc::clone(&gated), blind(), options).unwrap();
    wait_until(|| gated.shaded.load(Relaxed) > 0);
    job.cancel();
    gated.open();
    assert_eq!(outcome(job), Err(JobError::Cancelled));
    assert_eq!(gated.shaded.load(Relaxed), 10, "one batch");
}

#[test]
fn dropping_a_handle_cancels() {
    let service = service(1, false);
    let gated = Gated::new();
    drop(service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap());
    gated.open();
    wait_until(|| Arc::strong_count(&gated) == 1);
    assert!(gated.spawned.load(Relaxed) <= 1);
}

#[test]
fn jobs_beyond_the_limit_wait_their_turn() {
    let options = ServiceOptions { host_threads: 2, device_thread: false, max_jobs: 1, ..Default::default() };
    let service = Service::new(options).unwrap();
    let renderers: Vec<_> = (0..3).map(|_| Gated::new()).collect();
    let submit =
        |gated: &Arc<Gated>| service.submit(Arc::clone(gated), blind(), JobOptions::default()).unwrap();
    let mut jobs: Vec<_> = renderers.iter().map(submit).collect();
    wait_until(|| renderers[0].spawned.load(Relaxed) == 2);
    renderers[1].open();
    renderers[2].open();
    assert!(!jobs[1].wait_for(Duration::from_millis(5)) && renderers[1].spawned.load(Relaxed) == 0);
    assert_eq!(jobs[1].progress().tiles, 50);
    // A waiting job can be cancelled or stopped.
    let waiting = jobs.remove(1);
    waiting.cancel();
    assert_eq!(outcome(waiting), Err(JobError::Cancelled));
    let stopped = submit(&renderers[2]);
    stopped.stop();
    assert_eq!(outcome(stopped).map(|report| (report.stopped, report.tiles_spawned)), Ok((true, 0)));
    renderers[0].open();
    for job in jobs {
        assert_eq!(outcome(job).unwrap().tiles_spawned, 50);
    }
    assert_eq!(renderers[2].shaded.load(Relaxed), 50);
}

#[test]
fn two_jobs_share_the_threads() {
    let service = service(1, false);
    let ledgers = [Ledger::new(SCRIPT), Ledger::new(Script { seed: 2, ..SCRIPT })];
    let gated = Gated::new();
    let gate = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    let jobs = ledgers.each_ref().map(|ledger| {
        service.submit(Arc::clone(ledger), Tracers::cpu(Arc::clone(ledger) as _), SMALL).unwrap()
    });
    gated.open();
    outcome(gate).unwrap();
    let reports = jobs.map(|job| outcome(job).unwrap());
    for ledger in &ledgers {
        ledger.check_complete();
    }
    // Both ran on the one thread, so neither had all of its time.
    for report in reports {
        assert!(report.threads[0].busy_s < report.wall_s);
    }
}

#[test]
fn an_endless_job_starves_no_other() {
    let service = service(1, false);
    let endless = Gated::with_tiles(u64::MAX);
    endless.open();
    let job = service.submit(Arc::clone(&endless), blind(), JobOptions::default()).unwrap();
    wait_until(|| endless.shaded.load(Relaxed) > 0);
    let ledger = Ledger::new(SCRIPT);
    let other = service.submit(Arc::clone(&ledger), Tracers::cpu(Arc::clone(&ledger) as _), SMALL).unwrap();
    outcome(other).unwrap();
    ledger.check_complete();
    assert!(job.progress().tiles_done() > 0 && !job.is_finished());
    job.stop();
    let report = outcome(job).unwrap();
    assert!(report.stopped && report.tiles == u64::MAX);
    assert_eq!(report.tiles_spawned, endless.shaded.load(Relaxed));
}

#[test]
fn dropping_the_service_cancels_what_runs_and_what_waits() {
    let options = ServiceOptions { host_threads: 2, device_thread: true, max_jobs: 1, ..Default::default() };
    let service = Service::new(options).unwrap();
    let (gated, other) = (Gated::new(), Gated::new());
    let running = service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
    let waiting = service.submit(Arc::clone(&other), blind(), JobOptions::default()).unwrap();
    wait_until(|| gated.spawned.load(Relaxed) == 2);
    std::thread::scope(|scope| {
        scope.spawn(|| drop(service));
        // The service is dropped while both threads have tasks.
        wait_until(|| waiting.is_finished());
        gated.open();
    });
    assert_eq!(outcome(running), Err(JobError::Cancelled));
    assert_eq!(waiting.progress().tiles_spawned, 0);
    waiting.stop();
    assert_eq!(outcome(waiting), Err(JobError::Cancelled));
}

/// The last reference to a service: who drops it drops the service.
impl Held for Arc<Service> {}

#[test]
fn a_service_may_be_dropped_on_its_own_thread() {
    let service = Arc::new(service(2, true));
    let gated = Gated::new();
    let owner = Holder { gated: Arc::clone(&gated), held: Arc::clone(&service) };
    let job = service.submit(Arc::new(owner), blind(), JobOptions::default()).unwrap();
    drop(service);
    gated.open();
    assert_eq!(outcome(job).map(|report| report.tiles_spawned), Ok(50));
}

/// Reads its job's progress when it is dropped.
struct LastWords {
    handle: Arc<OnceLock<JobHandle>>,
    progress: Sender<Progress>,
}

impl Held for LastWords {}

impl Drop for LastWords {
    fn drop(&mut self) {
        let handle = self.handle.get().expect("the handle was there before the gate opened");
        assert!(!handle.is_finished(), "the result is delivered after the renderer is dropped");
        self.progress.send(handle.progress()).expect("the test listens");
    }
}

#[test]
fn a_renderer_may_read_its_progress_while_it_is_dropped() {
    let service = service(2, false);
    let (handle, gated) = (Arc::new(OnceLock::new()), Gated::new());
    let (progress, received) = channel();
    let held = LastWords { handle: Arc::clone(&handle), progress };
    let renderer = Holder { gated: Arc::clone(&gated), held };
    let job = service.submit(Arc::new(renderer), blind(), JobOptions::default()).unwrap();
    assert!(handle.set(job).is_ok());
    gated.open();
    let last = received.recv_timeout(Duration::from_secs(60)).expect("progress returns");
    assert_eq!((last.tiles, last.tiles_done(), last.rays.camera), (50, 50, 50));
    let job = handle.get().unwrap();
    assert!(job.wait_for(Duration::from_secs(60)));
    assert_eq!(job.progress(), last, "and stays when the job has ended");
}

/// Breaks its promises, or panics in its drop.
struct Faulty {
    rays: usize,
    shadow_rays: usize,
    panics_in_drop: bool,
}

impl Renderer for Faulty {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        1
    }

    fn tile_rays(&self) -> usize {
        10
    }

    fn shadow_rays_per_ray(&self) -> usize {
        1
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, _: u64, out: &mut Output<'_, u32, u32>) {
        (0..10).for_each(|_| out.ray(Ray::default(), 0));
    }

    fn shade(&self, _: Batch<'_, u32>, out: &mut Output<'_, u32, u32>) {
        (0..self.rays).for_each(|_| out.ray(Ray::default(), 0));
        (0..self.shadow_rays).for_each(|_| out.shadow(Ray::default(), 0));
        let returns = self.panics_in_drop || self.rays + self.shadow_rays > 0;
        assert!(returns, "a shader that panics");
    }

    fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
}

impl Drop for Faulty {
    fn drop(&mut self) {
        if self.panics_in_drop {
            std::panic::resume_unwind(Box::new("a drop that panics"));
        }
    }
}

#[test]
fn a_faulty_renderer_fails_only_its_own_job() {
    let service = service(1, false);
    let run = |rays, shadow_rays, panics_in_drop| {
        let renderer = Arc::new(Faulty { rays, shadow_rays, panics_in_drop });
        outcome(service.submit(renderer, blind(), JobOptions::default().with_name("faulty")).unwrap())
    };
    let message = |outcome: Result<JobReport, JobError>| outcome.unwrap_err().to_string();
    let text = message(run(11, 0, false));
    assert!(text.contains("emitted 11 rays and 0 shadow rays where it promised at most 10 and 10"), "{text}");
    let text = message(run(0, 11, false));
    assert!(text.contains("emitted 0 rays and 11 shadow rays where it promised at most 10 and 10"), "{text}");
    assert_eq!(message(run(0, 0, false)), "job \"faulty\" panicked: a shader that panics");
    run(0, 0, true).unwrap();
    let ledger = Ledger::new(SCRIPT);
    let job = service.submit(Arc::clone(&ledger), Tracers::cpu(Arc::clone(&ledger) as _), SMALL).unwrap();
    outcome(job).unwrap();
    ledger.check_complete();
}

#[test]
fn a_service_without_workers_is_refused() {
    let refused = |host_threads, max_jobs| {
        let options = ServiceOptions { host_threads, max_jobs, ..Default::default() };
        Service::new(options).err().unwrap().to_string()
    };
    assert_eq!(refused(0, 1), "a service needs at least one host thread");
    assert_eq!(refused(1, 0), "a service needs at least one job at a time");
    let none = Service::new(ServiceOptions::default().with_max_queries(0)).err().unwrap().to_string();
    assert_eq!(none, "a service needs at least one query at a time");
}
