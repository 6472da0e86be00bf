//! A seeded driver in one thread of the same state machine that the service's threads drive: random interleavings of
//! host threads and a device thread, tasks of random length, jobs that are submitted, stopped, cancelled or panic, and
//! devices that die. [`HISTORIES`] seeds are run, or as many as `RAYSTREAM_HISTORIES` asks for.

use super::super::pool::Pool;
use super::super::report::{JobReport, Progress};
use super::super::result::JobError;
use super::super::service::prepare;
use super::super::state::{JobId, Next, Receiver, State, Submission};
use super::super::task::Work;
use super::super::{
    AnyRenderer, JobOptions, Policy, Priority, ServiceOptions, Sharing, TaskKind, Tracers, Unit,
};
use super::ledger::{FakeDevice, Fate, Ledger, Script, mix};
use crate::stream::ChunkScratch;
use std::sync::{Arc, Mutex};

/// Of simulated time. Tasks of a few rays take about as long as a small task should.
const STEP_NS: u64 = 20_000;

/// A small seeded generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(1);
        mix(self.0)
    }

    /// One of `least..=most`.
    fn range(&mut self, least: usize, most: usize) -> usize {
        least + (self.next() % (most - least + 1) as u64) as usize
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }

    fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.range(0, choices.len() - 1)]
    }
}

enum Status {
    /// Will take a task.
    Ready,
    /// Has a task. Ends it one time in `slowness` when chosen.
    Working {
        work: Arc<dyn Work>,
        slowness: u64,
    },
    /// Waits on its condition variable.
    Suspended {
        notified: bool,
    },
    Exited,
}

#[derive(Default)]
struct Outbox(Mutex<Option<Result<JobReport, JobError>>>);

impl Receiver for Outbox {
    fn leave(&self, _: Progress) {}

    fn deliver(&self, outcome: Result<JobReport, JobError>) {
        let former = self.0.lock().unwrap().replace(outcome);
        assert!(former.is_none(), "a job has one result");
    }
}

struct Case {
    id: JobId,
    ledger: Arc<Ledger>,
    outbox: Arc<Outbox>,
    panics: bool,
    cancelled: bool,
    stopped: bool,
}

#[derive(Default)]
struct Tally {
    complete: usize,
    stopped: usize,
    cancelled: usize,
    panicked: usize,
    lost: usize,
    tasks: usize,
}

struct Simulation {
    random: Random,
    state: State,
    pool: Pool,
    hosts: usize,
    threads: Vec<Status>,
    cases: Vec<Case>,
    now_ns: u64,
    scratch: ChunkScratch,
    /// Registered interactive clients.
    clients: usize,
    /// True if host threads are workers of a pool, which do other things between tasks.
    in_pool: bool,
    tasks: usize,
}

impl Simulation {
    fn new(seed: u64) -> Self {
        let mut random = Random(mix(seed));
        let (hosts, device_thread) = (random.range(1, 5), !random.one_in(4));
        let sharing = random.pick(&[Sharing::Fair, Sharing::FirstIn]);
        let mut simulation = Self {
            state: State::new(&ServiceOptions {
                host_threads: hosts,
                device_thread,
                max_jobs: random.range(1, 3),
                max_queries: random.range(1, 3),
                sharing,
                rayon_pool: None,
            }),
            pool: Pool::new(2),
            hosts,
            threads: (0..hosts + usize::from(device_thread)).map(|_| Status::Ready).collect(),
            cases: Vec::new(),
            now_ns: 0,
            scratch: ChunkScratch::default(),
            clients: 0,
            in_pool: random.one_in(3),
            random,
            tasks: 0,
        };
        if simulation.in_pool {
            for host in 0..hosts {
                drop(simulation.state.next(host, 0));
                simulation.threads[host] = Status::Suspended { notified: false };
            }
        }
        simulation
    }

    fn submit(&mut self) {
        let random = &mut self.random;
        let panics = random.one_in(8);
        let script = Script {
            seed: random.next(),
            tiles: random.range(0, 10) as u64,
            tile_rays: random.range(1, 24),
            max_depth: random.range(1, 5),
            shadow_rays_per_ray: random.range(0, 2),
            panic_at: panics.then(|| random.next() % 60),
        };
        let fate = if random.one_in(2) { Fate::Lives } else { Fate::any(random.next(), random.next() % 12) };
        let ledger = Ledger::new(script);
        let device = Arc::new(FakeDevice {
            ledger: Arc::clone(&ledger),
            fate,
            bundle_rays: random.range(1, 200),
            patience: random.next() % 4,
            delay: Default::default(),
            ready_after: if random.one_in(3) { random.next() % 60 } else { 0 },
            counts: Default::default(),
        });
        let tracers = Tracers {
            device: (!random.one_in(6)).then_some(device as _),
            unit: random.pick(&[Unit::Cpu, Unit::Gpu, Unit::Hybrid, Unit::Hybrid]),
            ..Tracers::cpu(Arc::clone(&ledger) as _)
        };
        let chunk_rays = random.range(1, 8);
        let options = JobOptions {
            name: Some("scripted".into()),
            priority: random.pick(&Priority::ALL),
            caller_rays: 0,
            in_flight: Some(script.tile_rays + random.range(0, 100)),
            threshold: Some(random.range(1, 40)),
            batch_rays: random.range(1, 16),
            chunk_rays,
            chunk_rays_most: chunk_rays + random.range(0, 60),
            shrink_streams: !random.one_in(4),
            policy: (!random.one_in(5)).then(|| random.pick(&Policy::ALL)),
            timeline: true,
        };
        let outbox = Arc::new(Outbox::default());
        let receiver = Arc::clone(&outbox) as _;
        let threads = (self.hosts, self.threads.len() > self.hosts);
        let submission =
            prepare(AnyRenderer::new(Arc::clone(&ledger)), tracers, &options, threads, &self.pool, receiver)
                .unwrap();
        let submission = Submission { is_query: self.random.one_in(3), ..submission };
        let id = self.state.submit(submission, self.now_ns);
        self.cases.push(Case { id, ledger, outbox, panics, cancelled: false, stopped: false });
        self.apply_effects();
    }

    /// Notifies threads and delivers results, as the service does.
    fn apply_effects(&mut self) {
        let effects = self.state.take_effects();
        let all = 0..if effects.wake_all { self.threads.len() } else { 0 };
        // A pool's workers need not come to a service that closes.
        let needed = |thread: &usize| !(effects.wake_all && self.in_pool && *thread < self.hosts);
        for thread in effects.wake.into_iter().flatten().chain(all).filter(needed) {
            if let Status::Suspended { notified } = &mut self.threads[thread] {
                *notified = true;
            }
        }
        for ended in effects.ended {
            ended.submission.job.retire(&self.pool);
            drop(ended.submission.work);
            ended.submission.receiver.deliver(ended.outcome);
        }
        self.state.check();
    }

    /// One thread makes one step; false when none can.
    fn step(&mut self) -> bool {
        self.now_ns += (1 + self.random.next() % 10) * STEP_NS;
        let awake = |status: &Status| match status {
            Status::Ready | Status::Working { .. } => true,
            Status::Suspended { notified } => *notified,
            Status::Exited => false,
        };
        let able: Vec<_> = (0..self.threads.len()).filter(|&thread| awake(&self.threads[thread])).collect();
        if able.is_empty() {
            return false;
        }
        let thread = self.random.pick(&able);
        let is_seat = self.in_pool && thread < self.hosts;
        if is_seat && matches!(self.threads[thread], Status::Suspended { .. }) {
            // The worker that was to take this seat may have one already, which it has left between two tasks.
            let between = self.threads[..self.hosts].iter().any(|status| matches!(status, Status::Ready));
            if between && self.random.one_in(2) {
                self.state.decline(thread, self.now_ns);
                self.threads[thread] = Status::Suspended { notified: false };
                self.state.check();
                return true;
            }
        }
        let status = std::mem::replace(&mut self.threads[thread], Status::Ready);
        let is_ready = matches!(status, Status::Ready);
        match status {
            Status::Working { work, slowness } if !self.random.one_in(slowness) => {
                self.threads[thread] = Status::Working { work, slowness };
                return true;
            }
            Status::Working { work, .. } => {
                work.work(thread, &mut self.scratch);
                drop(work);
                self.state.finish(thread, self.now_ns, None);
                self.tasks += 1;
                if is_seat {
                    self.state.pause(self.now_ns);
                    self.apply_effects();
                    return true;
                }
            }
            Status::Ready | Status::Suspended { .. } => {}
            Status::Exited => unreachable!("threads that have exited make no step"),
        }
        assert!(!self.state.is_asleep(thread), "only threads that have been woken go on");
        if is_seat && is_ready && self.random.one_in(4) {
            // Its worker waits for a job.
            let work = self.state.try_next(thread, self.now_ns);
            let slowness = self.random.pick(&[1, 3]);
            self.threads[thread] = work.map_or(Status::Ready, |work| Status::Working { work, slowness });
            self.apply_effects();
            return true;
        }
        self.threads[thread] = match self.state.next(thread, self.now_ns) {
            Next::Work(work) => Status::Working { work, slowness: self.random.pick(&[1, 1, 3, 40]) },
            Next::Sleep => Status::Suspended { notified: false },
            Next::Exit => Status::Exited,
        };
        self.apply_effects();
        true
    }

    fn disturb(&mut self) {
        let index = self.random.range(0, self.cases.len() - 1);
        let case = &mut self.cases[index];
        let unfinished = case.outbox.0.lock().unwrap().is_none();
        if self.random.one_in(3) {
            self.state.set_priority(case.id, self.random.pick(&Priority::ALL), self.now_ns);
        } else if self.random.one_in(2) {
            case.cancelled |= unfinished;
            self.state.cancel(case.id, self.now_ns);
        } else {
            case.stopped |= unfinished;
            self.state.stop(case.id, self.now_ns);
        }
        self.apply_effects();
    }

    /// An interactive client is registered, or taken off the list.
    fn come_or_go(&mut self) {
        let comes = self.clients == 0 || (self.clients < 3 && self.random.one_in(2));
        self.clients = if comes { self.clients + 1 } else { self.clients - 1 };
        self.state.register(comes);
    }

    fn run(mut self, tally: &mut Tally) {
        let mut to_submit = self.random.range(1, 5);
        let disturbed = self.random.one_in(3);
        let close_after = self.random.one_in(10).then(|| self.random.range(1, 2000));
        let mut steps = 0;
        loop {
            if to_submit > 0 && self.random.one_in(20) {
                self.submit();
                to_submit -= 1;
            }
            if disturbed && !self.cases.is_empty() && self.random.one_in(150) {
                self.disturb();
            }
            if self.random.one_in(100) {
                self.come_or_go();
            }
            let moved = self.step();
            steps += 1;
            assert!(steps < 2_000_000, "the jobs come to an end");
            if close_after.is_some_and(|limit| steps > limit) {
                self.cases
                    .iter_mut()
                    .for_each(|case| case.cancelled |= case.outbox.0.lock().unwrap().is_none());
                break;
            }
            if !moved && to_submit == 0 {
                assert!(self.state.is_idle(), "nothing waits while all threads are suspended");
                break;
            }
        }
        self.state.close(self.now_ns);
        self.apply_effects();
        while self.step() {}
        let seats = if self.in_pool { self.hosts } else { 0 };
        let gone = |(index, status): (usize, &Status)| {
            matches!(status, Status::Exited) || (index < seats && matches!(status, Status::Suspended { .. }))
        };
        assert!(self.threads.iter().enumerate().all(gone), "every thread exits");
        tally.tasks += self.tasks;
        self.cases.into_iter().for_each(|case| case.check(tally));
    }
}

impl Case {
    fn check(self, tally: &mut Tally) {
        let outcome = self.outbox.0.lock().unwrap().take().expect("every job has a result");
        match outcome {
            Ok(report) => {
                let [camera, continuation, shadow] = self.ledger.check_complete();
                assert_eq!(
                    [camera, continuation, shadow],
                    [report.rays.camera, report.rays.continuation, report.rays.shadow]
                );
                assert_eq!(report.cpu.rays + report.gpu.rays, report.rays.total());
                assert!(report.max_in_flight <= report.limits.in_flight);
                assert!(report.streams <= report.limits.streams);
                assert!((0.0..=1.0).contains(&report.tail_idle_share));
                assert_eq!(report.tiles_spawned, self.ledger.tiles_spawned());
                assert!(self.stopped || !report.stopped);
                assert_eq!(report.stopped, report.tiles_spawned < report.tiles);
                let traced = report
                    .timeline
                    .iter()
                    .filter(|task| matches!(task.kind, TaskKind::Trace | TaskKind::Resolve));
                let traced: u64 = traced.map(|task| u64::from(task.rays)).sum();
                assert_eq!(traced, report.rays.total(), "the timeline has every ray");
                assert_eq!(report.shading.rays, report.rays.total(), "every ray is shaded");
                tally.stopped += usize::from(report.stopped);
                tally.complete += usize::from(!report.stopped);
                tally.lost += usize::from(report.events.iter().any(|event| event.contains("device failed")));
            }
            Err(JobError::Broken(why) | JobError::Stopped(why)) => panic!("{why}"),
            Err(JobError::Cancelled) => {
                assert!(self.cancelled, "only cancelled jobs are");
                tally.cancelled += 1;
            }
            Err(JobError::Panicked { job, message }) => {
                assert_eq!(job.as_deref(), Some("scripted"));
                assert!(self.panics, "only scripted panics happen: {message}");
                assert_eq!(message, "as the script says");
                tally.panicked += 1;
            }
        }
    }
}

fn simulate(seeds: std::ops::Range<u64>) {
    let mut tally = Tally::default();
    for seed in seeds {
        let run = std::panic::AssertUnwindSafe(|| Simulation::new(seed).run(&mut tally));
        if let Err(payload) = std::panic::catch_unwind(run) {
            eprintln!("seed {seed} failed");
            std::panic::resume_unwind(payload);
        }
    }
    let Tally { complete, stopped, cancelled, panicked, lost, tasks } = tally;
    println!(
        "{tasks} tasks; jobs: {complete} complete ({lost} lost a device), {stopped} stopped, \
         {cancelled} cancelled, {panicked} panicked"
    );
    let least = complete.min(stopped).min(cancelled).min(panicked).min(lost);
    assert!(least > 100, "every ending is simulated often");
}

/// Histories that are simulated.
const HISTORIES: u64 = 10_000;

/// A half of the histories asked for.
fn half() -> u64 {
    std::env::var("RAYSTREAM_HISTORIES").map_or(HISTORIES, |n| n.parse().expect("a number")) / 2
}

/// In two halves, which run in parallel.
#[test]
fn nothing_is_lost_in_any_interleaving() {
    simulate(0..half());
}

#[test]
fn nothing_is_lost_in_any_other_interleaving() {
    simulate(half()..2 * half());
}
