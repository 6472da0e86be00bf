//! The scheduler in virtual time: the state machine, the policies, the lists and the streams are the service's own; the
//! clock and what tasks cost are modelled. Rays stand for a thousand each, so a frame takes milliseconds.

mod clock;
mod frame;
mod grid;
mod h100;
mod machine;

use super::super::limits::Demand;
use super::super::pool::Pool;
use super::super::report::{JobReport, Progress};
use super::super::result::JobError;
use super::super::service::prepare;
use super::super::state::{Next, Receiver, State};
use super::super::task::Work;
use super::super::{AnyRenderer, JobOptions, Limits, Policy, ServiceOptions, Sharing, Tracers, Unit};
use crate::stream::ChunkScratch;
use clock::{Clock, Step};
use frame::{Done, Frame, GRAIN, Queue, TILE_RAYS};
use machine::{Device, Machine, Scene};
use std::sync::{Arc, Mutex};

/// From waking a thread until it runs.
const WAKE_NS: f64 = 5e3;

/// To take a stream from a device: to copy its rays into new memory.
const RECLAIM_NS: f64 = 150e3;

/// Who traces, and how.
#[derive(Clone, Copy, Debug)]
struct Run {
    scene: Scene,
    machine: Machine,
    unit: Unit,
    policy: Policy,
}

/// What became of a frame.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    seconds: f64,
    /// The device's share of the rays.
    device: f64,
    /// The share of the time in which its kernels ran.
    busy: f64,
}

#[derive(Default)]
struct Outbox(Mutex<Option<JobReport>>);

impl Receiver for Outbox {
    fn leave(&self, _: Progress) {}

    fn deliver(&self, outcome: Result<JobReport, JobError>) {
        *self.0.lock().unwrap() = Some(outcome.expect("nothing fails in virtual time"));
    }
}

struct Simulation {
    run: Run,
    state: State,
    clock: Clock,
    frame: Arc<Frame>,
    /// The task of each thread.
    threads: Vec<Option<Arc<dyn Work>>>,
    pool: Pool,
    scratch: ChunkScratch,
    queue: Arc<Queue>,
}

impl Run {
    /// The device, if it is used.
    fn device(&self) -> Option<Device> {
        self.machine.device.filter(|_| self.unit != Unit::Cpu)
    }

    /// The sizes that the job would have, in rays.
    fn limits(&self) -> Limits {
        let demand = Demand {
            tiles: (self.scene.rays.camera / TILE_RAYS as f64).ceil() as u64,
            tile_rays: TILE_RAYS,
            shadow_rays_per_ray: usize::from(self.scene.rays.shadow > 0.0),
            most_in_flight: usize::MAX,
            host_threads: self.machine.hosts,
            has_device: self.device().is_some(),
            bundle_rays: self.device().map(|device| device.bundle_rays),
        };
        Limits::derive(&JobOptions::default(), demand).expect("a real job's sizes fit each other")
    }

    /// Runs the frame.
    fn simulate(self) -> Outcome {
        let limits = self.limits();
        let grains = |rays: usize| Some((rays / GRAIN).max(1));
        let options = JobOptions {
            caller_rays: 0,
            in_flight: grains(limits.in_flight),
            threshold: grains(limits.threshold),
            batch_rays: (limits.batch_rays / GRAIN).max(1),
            chunk_rays: (limits.chunk_rays / GRAIN).max(1),
            chunk_rays_most: (limits.chunk_rays_most / GRAIN).max(1),
            policy: Some(self.policy),
            ..JobOptions::default()
        };
        let (hosts, has_device) = (self.machine.hosts, self.device().is_some());
        let bundle_rays = (limits.bundle_rays / GRAIN).max(1);
        let queue = Arc::new(Queue::new(bundle_rays));
        let frame = Arc::new(Frame::new(self.scene.rays));
        let mut simulation = Simulation {
            state: State::new(&ServiceOptions {
                host_threads: hosts,
                device_thread: has_device,
                max_jobs: 1,
                max_queries: 1,
                sharing: Sharing::Fair,
                rayon_pool: None,
            }),
            clock: Clock::new(&self.machine),
            threads: (0..hosts + usize::from(has_device)).map(|_| None).collect(),
            pool: Pool::new(1),
            scratch: ChunkScratch::default(),
            queue: Arc::clone(&queue),
            frame: Arc::clone(&frame),
            run: self,
        };
        for thread in 0..simulation.threads.len() {
            drop(simulation.state.next(thread, 0));
        }
        let tracers = Tracers {
            device: has_device.then_some(queue as _),
            unit: self.unit,
            ..Tracers::cpu(Arc::clone(&frame) as _)
        };
        let outbox = Arc::new(Outbox::default());
        let receiver = Arc::clone(&outbox) as _;
        let submission = prepare(
            AnyRenderer::new(frame),
            tracers,
            &options,
            (hosts, has_device),
            &simulation.pool,
            receiver,
        )
        .unwrap();
        simulation.state.submit(submission, 0);
        simulation.apply_effects();
        while let Some(thread) = simulation.clock.next() {
            simulation.step(thread);
        }
        let report = outbox.0.lock().unwrap().take().expect("the frame ends");
        let rays = (report.cpu.rays + report.gpu.rays) as f64;
        let seconds = report.wall_s;
        // A device may be busy with rays that host threads have traced again.
        let busy = simulation.clock.device_busy_ns / simulation.clock.now();
        Outcome { seconds, device: report.gpu.rays as f64 / rays, busy }
    }
}

impl Simulation {
    /// A thread has ended a step.
    fn step(&mut self, thread: usize) {
        let now_ns = self.clock.now_ns();
        if self.threads[thread].take().is_some() {
            self.state.finish(thread, now_ns, None);
        }
        self.queue.state().now = self.clock.now();
        if let Next::Work(work) = self.state.next(thread, now_ns) {
            work.work(thread, &mut self.scratch);
            self.threads[thread] = Some(work);
            let step = self.cost();
            self.clock.begin(thread, step);
        }
        self.apply_effects();
    }

    /// The step of the task that has just been given to a thread.
    fn cost(&mut self) -> Step {
        let Scene { trace_ns, shade_ns, resolve_ns, .. } = self.run.scene;
        let mut queue = self.queue.state();
        if let Some(rays) = queue.submitted.take() {
            let submit_ns = self.run.device().map_or(0.0, |device| device.submit_ns);
            queue.readable.push(self.clock.submit(rays));
            return Step::Compute(submit_ns);
        }
        if let Some((bundle, most_ns)) = queue.waited.take() {
            return Step::Sleep((queue.readable[bundle] - queue.now).clamp(0.0, most_ns));
        }
        let done = self.frame.take_done();
        if done == Done::default() && queue.resolved == 0 {
            return Step::Compute(RECLAIM_NS);
        }
        let Done { traced, shaded, .. } = done;
        let resolved = std::mem::take(&mut queue.resolved) as f64 * resolve_ns;
        Step::Compute(traced as f64 * trace_ns + shaded as f64 * shade_ns + resolved)
    }

    /// Wakes threads and delivers the result, as the service does.
    fn apply_effects(&mut self) {
        let effects = self.state.take_effects();
        for thread in effects.wake.into_iter().flatten() {
            self.clock.begin(thread, Step::Sleep(WAKE_NS));
        }
        for ended in effects.ended {
            ended.submission.job.retire(&self.pool);
            drop(ended.submission.work);
            ended.submission.receiver.deliver(ended.outcome);
        }
    }
}
