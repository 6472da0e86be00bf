//! Tickets: a device thread submits bundles and waits for them, host threads take streams back meanwhile, and the first
//! answer counts. The threads follow the protocol of `src/schedule/README.md`; the lists, the bundles and the streams
//! are the engine's.

use super::Limits;
use super::device_account::BundleAccount;
use super::flights::{Flights, Submitted};
use super::lists::Lists;
use super::on_device::WithDevice;
use super::state::JobId;
use super::task::Work;
use crate::stream::{
    Answered, Capacity, Chunk, ChunkScratch, DeviceError, DeviceReport, DeviceStream, Full, Hit, OnDevice,
    Ray, RayStream, Resolve, Ticket, Traced, TracedChunk, Tracer,
};
use crate::{check, thread_count};
use loom::sync::{Arc, Condvar, Mutex};
use loom::thread;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

/// Bundles with the device: it traces one, and the next is there when it is done.
const QUEUED: usize = 2;
const JOB: JobId = JobId(0);

/// The canonical hit of the ray with a number.
fn canonical(ray: &Ray) -> Hit {
    Hit { t: 2.0, u: 0.0, v: 0.0, primitive: ray.origin[0] as u32 }
}

struct Cpu;

impl Tracer for Cpu {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        rays.iter().zip(hits).for_each(|(ray, hit)| *hit = canonical(ray));
    }

    fn occluded(&self, _: &[Ray], _: &mut [u32]) {}
}

/// A bundle under way. The device writes candidates, which are no hits yet, when it is done.
struct Bundle {
    shares: Vec<DeviceStream>,
    /// Waits that end before the device is done.
    waits: usize,
    is_lost: bool,
    /// Bundles that the device has.
    with_device: std::sync::Arc<AtomicUsize>,
}

impl Ticket for Bundle {
    fn wait(&mut self, _: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        if self.waits > 0 {
            self.waits -= 1;
            return Ok(None);
        }
        let answered = |share: &DeviceStream| {
            let mut answers = share.answers();
            let (hits, _) = answers.slices();
            for (ray, hit) in share.rays().iter().zip(hits) {
                *hit = Hit { t: 1.0, ..canonical(ray) };
            }
            Box::new(Confirm) as Box<dyn Resolve>
        };
        let resolves = self.shares.iter().map(answered).collect();
        self.with_device.fetch_sub(1, Relaxed);
        if self.is_lost { Err(DeviceError::Lost("as requested".to_owned())) } else { Ok(Some(resolves)) }
    }
}

/// Makes hits of candidates.
struct Confirm;

impl Resolve for Confirm {
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        let mut answers = stream.answers();
        let (hits, _) = answers.slices();
        for (ray, hit) in stream.rays().iter().zip(hits) {
            assert_eq!(*hit, Hit { t: 1.0, ..canonical(ray) }, "the device has written a candidate");
            *hit = canonical(ray);
        }
        Ok(DeviceReport::default())
    }
}

/// What the lock of the scheduler guards.
struct State {
    flights: Flights,
    /// `None` once it has ended.
    job: Option<Job>,
}

/// A job whose tiles have all been spawned and whose rays end at the first hit.
struct Job {
    lists: Lists<u32, ()>,
    with_device: WithDevice<u32, ()>,
    /// Tasks under way.
    tasks: usize,
    /// Streams that have not been shaded.
    left: usize,
    is_device_lost: bool,
}

/// A task and its streams.
enum Task {
    Trace(Chunk),
    Resolve(RayStream<Answered, u32, ()>),
    Reclaim(RayStream<OnDevice, u32, ()>),
    Shade(RayStream<Traced, u32, ()>),
    Submit(Vec<RayStream<Full, u32, ()>>),
    Wait(std::sync::Arc<dyn Work>),
}

/// A finished task.
enum Done {
    Traced(TracedChunk),
    Resolved(RayStream<Traced, u32, ()>),
    Reclaimed(RayStream<Full, u32, ()>),
    Shaded(RayStream<Traced, u32, ()>, Vec<u32>),
    Submitted(Vec<RayStream<OnDevice, u32, ()>>, Box<dyn Ticket>),
    Waited,
}

impl Job {
    /// A job whose streams, of one ray each, wait in TRACE.
    fn new(streams: usize) -> Self {
        let limits = Limits { shadow_rays_per_path: 1, bundle_rays: 1, streams };
        let mut lists = Lists::new(limits, Vec::new());
        for number in 0..streams {
            let mut stream = lists.output(0);
            stream.append(Capacity { rays: 1, shadow_rays: 0 }, None, |mut columns| {
                columns.rays.push(Ray::new([number as f32, 0.0, 0.0], [1.0, 0.0, 0.0]));
                columns.payloads.push(number as u32);
            });
            lists.put_back_output(stream, 1, (0, 0));
        }
        Self { lists, with_device: WithDevice::new(), tasks: 0, left: streams, is_device_lost: false }
    }

    /// The next task of a host thread: to resolve, to shade, to trace, and to take a stream from the device.
    fn next(&mut self) -> Option<Task> {
        let lists = &mut self.lists;
        if lists.answered() > 0 {
            Some(Task::Resolve(lists.next_to_resolve().0))
        } else if lists.shade() > 0 {
            Some(Task::Shade(lists.next_to_shade(0)))
        } else if lists.slot() || lists.trace() > 0 && self.is_device_lost {
            Some(Task::Trace(lists.next_chunk(1, 0)))
        } else {
            self.with_device.take_back().map(Task::Reclaim)
        }
    }
}

impl State {
    /// The next task of the device thread: to submit a bundle where there is room, or else to wait for the first.
    fn next_of_device(&mut self) -> Option<Task> {
        let has_room = self.flights.len() < QUEUED;
        if let Some(job) = &mut self.job
            && has_room
            && !job.is_device_lost
            && job.lists.trace() > 0
        {
            let bundle = job.lists.next_bundle(usize::MAX, 0);
            return Some(Task::Submit(bundle.into_iter().map(|(stream, _)| stream).collect()));
        }
        self.flights.may_be_waited_for().then(|| Task::Wait(self.flights.start_wait(1).1))
    }

    /// Takes back what a task leaves; returns what is to be dropped without the lock.
    fn finish(&mut self, done: Done, shaded: &Mutex<Vec<u32>>) -> Vec<Box<dyn Resolve>> {
        if let Done::Waited = done {
            return self.finish_wait();
        }
        let job = self.job.as_mut().expect("a job stays until its tasks are done");
        job.tasks -= 1;
        match done {
            Done::Traced(chunk) => job.lists.put_back_chunk(chunk, 0),
            Done::Resolved(stream) => job.lists.put_back_resolved(stream, 0),
            Done::Reclaimed(stream) => job.lists.put_back_reclaimed(stream),
            Done::Shaded(stream, numbers) => {
                job.left -= numbers.len();
                shaded.lock().expect("no panic").extend(numbers);
                job.lists.put_back_shaded(stream, 0);
            }
            Done::Submitted(streams, ticket) => {
                let id = self.flights.next_id();
                self.flights.push(JOB, Submitted { ticket, streams: streams.len() });
                let account = BundleAccount { full_ns: vec![None; streams.len()] };
                job.with_device.push(id, streams, account);
            }
            Done::Waited => unreachable!("it is no task of a job"),
        }
        Vec::new()
    }

    fn finish_wait(&mut self) -> Vec<Box<dyn Resolve>> {
        let (id, _, answers) = self.flights.finish_wait();
        let Some(answers) = answers else { return Vec::new() };
        let Some(job) = &mut self.job else { return answers.unwrap_or_default() };
        let traced = job.with_device.end(id, answers);
        job.is_device_lost |= traced.failed.is_some();
        for (stream, _) in traced.streams {
            job.lists.put_back_answered(stream, [0; 2]);
        }
        traced.left_over
    }
}

/// What threads share.
struct Service {
    state: Mutex<State>,
    woken: Condvar,
    shaded: Mutex<Vec<u32>>,
    /// Waits for a bundle that end before the device is done with it.
    waits: usize,
    /// True if the device is lost with the first bundle.
    is_lost: bool,
    /// Bundles that the device has.
    with_device: std::sync::Arc<AtomicUsize>,
}

impl Service {
    fn work(&self, task: Task, scratch: &mut ChunkScratch) -> Done {
        match task {
            Task::Trace(chunk) => Done::Traced(chunk.trace(&Cpu, scratch)),
            Task::Resolve(stream) => Done::Resolved(stream.resolve().expect("the device keeps no stream").0),
            Task::Reclaim(stream) => Done::Reclaimed(stream.take_back()),
            Task::Shade(mut stream) => {
                stream.take_shadows();
                let batch = stream.next_batch(usize::MAX);
                for (ray, hit) in batch.rays.iter().zip(batch.hits) {
                    assert_eq!(*hit, canonical(ray), "whoever has answered");
                }
                let numbers = batch.payloads.to_vec();
                Done::Shaded(stream, numbers)
            }
            Task::Submit(bundle) => {
                let (streams, shares): (_, Vec<_>) = bundle.into_iter().map(RayStream::give).unzip();
                let with_device = std::sync::Arc::clone(&self.with_device);
                assert!(with_device.fetch_add(1, Relaxed) < QUEUED, "two bundles are the most");
                let (waits, is_lost) = (self.waits, self.is_lost);
                Done::Submitted(streams, Box::new(Bundle { shares, waits, is_lost, with_device }))
            }
            Task::Wait(wait) => {
                wait.work(0, scratch);
                Done::Waited
            }
        }
    }

    /// A thread's life.
    fn serve(&self, is_host: bool) {
        let mut scratch = ChunkScratch::default();
        let mut state = self.state.lock().expect("no panic");
        loop {
            let task = match &mut state.job {
                Some(job) if is_host => job.next(),
                None if is_host => return,
                _ => state.next_of_device(),
            };
            let Some(task) = task else {
                if state.job.is_none() {
                    return;
                }
                state = self.woken.wait(state).expect("no panic");
                continue;
            };
            if !matches!(task, Task::Wait(_)) {
                state.job.as_mut().expect("the job whose task it is").tasks += 1;
            }
            drop(state);
            let done = self.work(task, &mut scratch);
            state = self.state.lock().expect("no panic");
            let left_over = state.finish(done, &self.shaded);
            let is_over = |job: &mut Job| job.tasks == 0 && job.left == 0;
            let ended = state.job.take_if(is_over);
            self.woken.notify_all();
            if ended.is_some() || !left_over.is_empty() {
                drop((state, left_over));
                if let Some(Job { lists, with_device, .. }) = ended {
                    drop(with_device);
                    // Streams of the lists are shared with no device: else this panics.
                    drop(lists.into_empty());
                }
                state = self.state.lock().expect("no panic");
            }
        }
    }
}

/// Runs a job of so many streams on the device thread and as many host threads as there are threads else.
fn run(streams: usize, waits: usize, is_lost: bool) {
    check(move || {
        let state = Mutex::new(State { flights: Flights::default(), job: Some(Job::new(streams)) });
        let (woken, shaded, with_device) = (Condvar::new(), Mutex::new(Vec::new()), Default::default());
        let service = Arc::new(Service { state, woken, shaded, waits, is_lost, with_device });
        let threads: Vec<_> = (1..thread_count())
            .map(|host| {
                let service = service.clone();
                thread::spawn(move || service.serve(host > 1))
            })
            .collect();
        service.serve(true);
        threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
        let mut shaded = service.shaded.lock().expect("no panic").clone();
        shaded.sort_unstable();
        assert!(shaded.iter().copied().eq(0..streams as u32), "each stream is shaded once: {shaded:?}");
        assert_eq!(service.with_device.load(Relaxed), 0, "every bundle is waited for to its end");
    });
}

#[test]
fn whoever_answers_first_each_stream_is_shaded_once() {
    run(3, 0, false);
}

#[test]
fn a_job_ends_without_a_bundle_that_is_late() {
    run(1, 1, false);
}

#[test]
fn streams_of_a_lost_device_come_back() {
    run(2, 0, true);
}
