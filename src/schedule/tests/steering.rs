//! What steers jobs: controls, priorities, callbacks, futures, interactive clients.

use super::super::{JobControl, JobError, JobHandle, JobOptions, Priority, QueryHandle, ServiceOptions};
use super::super::{Service, Tracers};
use super::ledger::Ledger;
use super::{Gated, SCRIPT, SMALL, blind, outcome, service, wait_until};
use crate::stream::{Hit, Ray};
use std::pin::pin;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, mpsc};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};
use std::time::Duration;

const SOON: Duration = Duration::from_secs(60);

fn submit(service: &Service, gated: &Arc<Gated>, options: JobOptions) -> JobHandle {
    service.submit(Arc::clone(gated), blind(), options).unwrap()
}

/// A job whose only thread waits at the gate.
fn held(service: &Service, options: JobOptions) -> (Arc<Gated>, JobHandle) {
    let gated = Gated::new();
    let job = submit(service, &gated, options);
    wait_until(|| gated.spawned.load(Relaxed) > 0);
    (gated, job)
}

/// Wakes the thread that waits for a future, and counts.
struct Unpark(Thread, AtomicUsize);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.1.fetch_add(1, Relaxed);
        self.0.unpark();
    }
}

/// Runs a future on this thread, as `pollster` does. Returns its output and how often it was woken.
fn block_on<F: Future>(future: F) -> (F::Output, usize) {
    let unpark = Arc::new(Unpark(thread::current(), AtomicUsize::new(0)));
    let waker = Waker::from(Arc::clone(&unpark));
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(&waker)) {
            return (output, unpark.1.load(Relaxed));
        }
        thread::park_timeout(SOON);
    }
}

#[test]
fn handles_and_controls_can_be_sent_shared_and_printed() {
    fn all<T: Send + Sync + std::fmt::Debug + Unpin>() {}
    all::<JobControl>();
    all::<JobHandle>();
    all::<QueryHandle<Hit>>();
    all::<Service>();
}

#[test]
fn controls_steer_from_other_threads_and_outlive_the_handle() {
    let service = service(1, false);
    let (gated, job) = held(&service, JobOptions::default().with_name("a frame"));
    let controls = [job.control(), job.control()];
    let [control, other] = controls.clone();
    assert_eq!(
        (control.name(), control.progress().tiles, control.is_finished()),
        (Some("a frame"), 50, false)
    );
    assert!(format!("{control:?}").contains("a frame"));
    drop(controls);
    thread::spawn(move || control.stop()).join().unwrap();
    gated.open();
    assert!(outcome(job).unwrap().stopped);
    assert!(other.is_finished() && other.progress().tiles_spawned == 1);
    // Nothing happens to a job that has ended.
    other.cancel();
    other.stop();
    other.set_priority(Priority::Background);
}

#[test]
fn a_result_is_taken_once_without_waiting() {
    let service = service(1, false);
    let (gated, mut job) = held(&service, JobOptions::default());
    assert_eq!(job.try_wait(), None);
    gated.open();
    assert!(job.wait_for(SOON));
    assert_eq!(job.try_wait().unwrap().unwrap().tiles_spawned, 50);
    assert_eq!(job.try_wait(), None);
    let called = Arc::new(());
    let witness = Arc::clone(&called);
    job.on_end(move |_| drop(witness));
    assert_eq!(Arc::strong_count(&called), 1, "a callback that comes too late is dropped");
}

#[test]
fn a_job_is_a_future() {
    let service = service(2, false);
    let (gated, job) = held(&service, JobOptions::default());
    let opener = thread::spawn(move || {
        thread::sleep(Duration::from_millis(5));
        gated.open();
    });
    let (outcome, _) = block_on(job);
    assert_eq!(outcome.unwrap().tiles_spawned, 50);
    opener.join().unwrap();

    // Two at once, and one that has long ended.
    let rays: Arc<[Ray]> = vec![Ray::default(); 3000].into();
    let ask = || service.closest(blind(), Arc::clone(&rays), JobOptions::default()).unwrap();
    let (first, second) = (ask(), ask());
    assert!(second.wait_for(SOON));
    let (hits, _) = block_on(async { first.await.unwrap().0.len() + second.await.unwrap().0.len() });
    assert_eq!(hits, 6000);
}

#[test]
fn the_last_waker_is_woken_once_and_foreign_panics_in_it_are_caught() {
    struct Angry;
    impl Wake for Angry {
        fn wake(self: Arc<Self>) {
            std::panic::resume_unwind(Box::new("a waker that panics"));
        }
    }
    let service = service(1, false);
    let (gated, mut job) = held(&service, JobOptions::default());
    let poll = |job: &mut JobHandle, waker: &Waker| {
        std::pin::Pin::new(job).poll(&mut Context::from_waker(waker)).is_ready()
    };
    let unpark = |_| Arc::new(Unpark(thread::current(), AtomicUsize::new(0)));
    let [first, last] = [0, 1].map(unpark);
    assert!(!poll(&mut job, &Waker::from(Arc::clone(&first))));
    assert!(!poll(&mut job, &Waker::from(Arc::clone(&last))));
    gated.open();
    assert!(job.wait_for(SOON));
    wait_until(|| last.1.load(Relaxed) == 1);
    assert_eq!(first.1.load(Relaxed), 0);
    assert!(poll(&mut job, Waker::noop()));

    let (gated, mut job) = held(&service, JobOptions::default());
    assert!(!poll(&mut job, &Waker::from(Arc::new(Angry))));
    gated.open();
    outcome(job).unwrap();
    let (gated, job) = held(&service, JobOptions::default());
    gated.open();
    outcome(job).unwrap();
}

#[test]
fn dropping_a_future_half_way_cancels() {
    let service = service(1, false);
    let (gated, job) = held(&service, JobOptions::default());
    let mut job = Box::pin(job);
    assert!(job.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
    drop(job);
    gated.open();
    wait_until(|| Arc::strong_count(&gated) == 1);
    assert!(gated.spawned.load(Relaxed) <= 1);
}

#[test]
fn callbacks_are_called_once_whenever_they_come_and_may_panic() {
    let service = service(1, false);
    let (gated, job) = held(&service, JobOptions::default());
    let (sender, received) = mpsc::channel();
    let tell = |what: &'static str| {
        let sender = sender.clone();
        move |outcome: &Result<_, JobError>| sender.send((what, outcome.is_ok())).unwrap()
    };
    job.on_end(tell("first"));
    job.on_end(|_| std::panic::resume_unwind(Box::new("a callback that panics")));
    let (control, late) = (job.control(), tell("from a callback"));
    job.on_end(move |outcome| {
        assert!(!control.is_finished() && control.progress().tiles_spawned == 50);
        late(outcome);
    });
    gated.open();
    assert!(job.wait_for(SOON));
    job.on_end(tell("late"));
    outcome(job).unwrap();
    let all: Vec<_> = received.try_iter().collect();
    assert_eq!(all, [("first", true), ("from a callback", true), ("late", true)]);

    let (gated, job) = held(&service, JobOptions::default());
    job.on_end(tell("cancelled"));
    drop(job);
    gated.open();
    assert_eq!(received.recv_timeout(SOON), Ok(("cancelled", false)));

    let rays: Arc<[Ray]> = vec![Ray::default(); 3000].into();
    for caller_rays in [0, 5000] {
        let options = JobOptions::default().with_caller_rays(caller_rays);
        let query = service.occluded(blind(), Arc::clone(&rays), options).unwrap();
        let lengths = Arc::new(Mutex::new(Vec::new()));
        let seen = Arc::clone(&lengths);
        query.on_end(move |outcome| seen.lock().unwrap().push(outcome.unwrap().0.len()));
        assert_eq!(query.wait().unwrap().0.len(), 3000);
        assert_eq!(*lengths.lock().unwrap(), [3000]);
    }
}

#[test]
fn a_detached_job_runs_to_its_end() {
    let service = service(1, false);
    let (gated, job) = held(&service, JobOptions::default());
    job.detach();
    gated.open();
    wait_until(|| Arc::strong_count(&gated) == 1);
    assert_eq!(gated.shaded.load(Relaxed), 50);
}

/// The order in which jobs end that were submitted while the only thread was held.
fn order(jobs: &[(&'static str, JobOptions)], change: impl Fn(&[JobHandle])) -> Vec<&'static str> {
    let options = ServiceOptions {
        host_threads: 1,
        device_thread: false,
        max_jobs: 1 + jobs.len(),
        ..Default::default()
    };
    let service = Service::new(options).unwrap();
    let (gate, first) = held(&service, JobOptions::default().with_priority(Priority::Interactive));
    let ended = Arc::new(Mutex::new(Vec::new()));
    let handles: Vec<_> = jobs
        .iter()
        .map(|(name, options)| {
            let gated = Gated::new();
            gated.open();
            let (ended, name) = (Arc::clone(&ended), *name);
            let job = submit(&service, &gated, options.clone());
            job.on_end(move |_| ended.lock().unwrap().push(name));
            job
        })
        .collect();
    change(&handles);
    gate.open();
    outcome(first).unwrap();
    handles.into_iter().for_each(|job| drop(outcome(job).unwrap()));
    Arc::into_inner(ended).unwrap().into_inner().unwrap()
}

#[test]
fn jobs_end_in_the_order_of_their_priorities() {
    let at = |priority| JobOptions::default().with_priority(priority);
    let (low, normal, high) = (Priority::Background, Priority::Normal, Priority::Interactive);
    let jobs = [("low", at(low)), ("normal", at(normal)), ("high", at(high))];
    assert_eq!(order(&jobs, |_| ()), ["high", "normal", "low"]);
    let changed = order(&jobs, |jobs| {
        jobs[0].set_priority(high);
        jobs[2].control().set_priority(low);
    });
    assert_eq!(changed, ["low", "normal", "high"]);
}

#[test]
fn a_background_job_waits_for_all_others() {
    let service = service(1, false);
    let endless = Gated::with_tiles(u64::MAX);
    endless.open();
    let frame = submit(&service, &endless, JobOptions::default());
    let ledger = Ledger::new(SCRIPT);
    let options = JobOptions { priority: Priority::Background, ..SMALL };
    let patient =
        service.submit(Arc::clone(&ledger), Tracers::cpu(Arc::clone(&ledger) as _), options).unwrap();
    assert!(!patient.wait_for(Duration::from_millis(20)) && patient.progress().tiles_spawned == 0);
    frame.set_priority(Priority::Background);
    outcome(patient).unwrap();
    ledger.check_complete();
    frame.cancel();
}

#[test]
fn queries_and_interactive_jobs_do_not_wait_for_frames_to_end() {
    let options = ServiceOptions { host_threads: 2, device_thread: false, max_jobs: 1, ..Default::default() };
    let service = Service::new(options).unwrap();
    let endless = Gated::with_tiles(u64::MAX);
    endless.open();
    let frame = submit(&service, &endless, JobOptions::default());
    let (queued, preview) = (Gated::new(), Gated::new());
    let waiting = submit(&service, &queued, JobOptions::default());
    preview.open();
    outcome(submit(&service, &preview, JobOptions::default().with_priority(Priority::Interactive))).unwrap();
    let rays: Arc<[Ray]> = vec![Ray::default(); 3000].into();
    for priority in [Priority::Interactive, Priority::Normal] {
        let options = JobOptions::default().with_priority(priority);
        let query = service.closest(blind(), Arc::clone(&rays), options).unwrap();
        assert!(query.wait_for(SOON));
    }
    assert_eq!(queued.spawned.load(Relaxed), 0, "max_jobs still bounds frames");
    // A waiting frame that becomes interactive waits no longer.
    waiting.set_priority(Priority::Interactive);
    queued.open();
    outcome(waiting).unwrap();
    frame.cancel();
}

#[test]
fn queries_have_a_bound_of_their_own() {
    let options =
        ServiceOptions { host_threads: 1, device_thread: false, max_queries: 2, ..Default::default() };
    let service = Service::new(options).unwrap();
    let (gate, first) = held(&service, JobOptions::default());
    let rays: Arc<[Ray]> = vec![Ray::default(); 3000].into();
    let ask = || service.closest(blind(), Arc::clone(&rays), JobOptions::default()).unwrap();
    let queries: Vec<_> = (0..5).map(|_| ask()).collect();
    gate.open();
    outcome(first).unwrap();
    let waited = queries.into_iter().map(|query| query.wait().unwrap().1.waited_s > 0.0);
    assert_eq!(waited.collect::<Vec<_>>(), [false, false, true, true, true]);
}

#[test]
fn tasks_are_small_while_an_interactive_client_is_registered() {
    let shaded_before = |client: bool| {
        let service = service(1, false);
        let client = client.then(|| service.interactive());
        let gated = Gated::in_shading(1000);
        let sizes = JobOptions::default().with_batch_rays(10).with_chunk_rays(10, 2000);
        let frame = submit(&service, &gated, sizes);
        wait_until(|| gated.shaded.load(Relaxed) > 0);
        let options = JobOptions::default().with_priority(Priority::Interactive).with_caller_rays(0);
        let query = service.closest(blind(), vec![Ray::default()].into(), options).unwrap();
        let (shaded, seen) = (Arc::new(AtomicUsize::new(0)), Arc::clone(&gated));
        let store = Arc::clone(&shaded);
        query.on_end(move |_| store.store(seen.shaded.load(Relaxed) as usize, Relaxed));
        gated.open();
        query.wait().unwrap();
        outcome(frame).unwrap();
        drop(client);
        assert_eq!(gated.shaded.load(Relaxed), 1000);
        shaded.load(Relaxed)
    };
    assert_eq!((shaded_before(false), shaded_before(true)), (1000, 10));
}
