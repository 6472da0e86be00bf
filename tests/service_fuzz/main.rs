//! Random sequences of calls to the service: jobs and queries that are submitted, steered, awaited, dropped, forgotten
//! or abandoned with their service, with plug-ins that lie, panic and die. Nothing may abort, hang or leak.
//!
//! Runs `RAYSTREAM_SERVICE_SEQUENCES` sequences (default 1500). A failure names its seed; `RAYSTREAM_SERVICE_SEED` runs
//! that alone.

mod plugins;

use plugins::{Blind, Counted, Device, Live, Random, Script};
use raystream::schedule::{
    InteractiveClient, JobControl, JobError, JobHandle, JobOptions, Policy, Priority, QueryHandle, Service,
    ServiceOptions, Sharing, Tracers, Unit,
};
use raystream::stream::{Hit, Ray};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::task::{Context, Wake, Waker};
use std::thread::{self, JoinHandle, Thread};
use std::time::{Duration, Instant};

/// No sequence takes nearly as long.
const PATIENCE: Duration = Duration::from_secs(60);

/// What a sequence may still use.
enum Held {
    Job(JobHandle, Option<Arc<Script>>),
    Query(QueryHandle<Hit>, usize),
}

/// One sequence of calls.
struct Sequence {
    random: Random,
    live: Arc<Live>,
    held: Vec<Held>,
    controls: Vec<JobControl>,
    clients: Vec<InteractiveClient>,
    steering: Vec<JoinHandle<()>>,
}

/// Wakes the thread that waits for a future.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// Waits for a future on this thread.
fn block_on<F: Future + Unpin>(mut future: F) -> F::Output {
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    loop {
        let polled = Pin::new(&mut future).poll(&mut Context::from_waker(&waker));
        if let std::task::Poll::Ready(output) = polled {
            return output;
        }
        thread::park();
    }
}

fn poll<F: Future + Unpin>(future: &mut F) {
    drop(Pin::new(future).poll(&mut Context::from_waker(Waker::noop())));
}

impl Sequence {
    fn priority(&mut self) -> Priority {
        self.random.pick(&Priority::ALL)
    }

    fn tracers(&mut self) -> Tracers {
        let random = &mut self.random;
        let host = Arc::new(Blind::new(random, &self.live));
        let device = random.one_in(2).then(|| Arc::new(Device::new(random, &self.live)) as _);
        let mut tracers = Tracers::cpu(host);
        tracers.device = device;
        tracers.unit = random.pick(&[Unit::Cpu, Unit::Gpu, Unit::Hybrid]);
        tracers
    }

    fn options(&mut self) -> JobOptions {
        let priority = self.priority();
        let random = &mut self.random;
        let mut options = JobOptions::default()
            .with_priority(priority)
            .with_batch_rays(random.pick(&[1, 50, 8192]))
            .with_chunk_rays(random.pick(&[1, 16, 1024]), random.pick(&[1024, 64 << 10]))
            .with_caller_rays(random.pick(&[0, 512]))
            .with_policy(random.one_in(3).then(|| random.pick(&Policy::ALL)))
            .with_timeline(random.one_in(3));
        if random.one_in(2) {
            options = options.with_threshold(random.pick(&[20, 40, 1000]));
        }
        if random.one_in(3) {
            options = options.with_in_flight(random.pick(&[1, 300, 5000]));
        }
        // Sizes that must be refused.
        if random.one_in(40) {
            options = options.with_chunk_rays(9, 8);
        }
        if random.one_in(2) { options.with_name("fuzz") } else { options }
    }

    /// Calls the service once, or a handle.
    fn step(&mut self, service: &Service) {
        match self.random.below(12) {
            0..3 => self.submit(service),
            3..5 => self.ask(service),
            5 => self.borrow(service),
            6 if self.clients.len() < 3 => self.clients.push(service.interactive()),
            6 => drop(self.clients.pop()),
            7 if self.random.one_in(4) => service.free_streams(),
            7 => self.steer_from_another_thread(),
            8 => thread::sleep(Duration::from_micros(self.random.next() % 200)),
            _ if self.held.is_empty() => {}
            _ => {
                let index = self.random.below(self.held.len());
                let held = self.held.swap_remove(index);
                self.use_up(held);
            }
        }
    }

    fn submit(&mut self, service: &Service) {
        let script = Arc::new(Script::new(&mut self.random, &self.live));
        let (tracers, options) = (self.tracers(), self.options());
        let Ok(job) = service.submit(Arc::clone(&script), tracers, options) else {
            drop_quietly(script);
            return;
        };
        self.controls.push(job.control());
        for _ in 0..self.random.below(3) {
            let counted = Counted::new(&self.live, |live| &live.callbacks);
            let panics = self.random.one_in(4);
            let control = job.control();
            job.on_end(move |_| {
                drop((counted, control.progress()));
                if panics {
                    resume_unwind(Box::new("a callback that panics"));
                }
            });
        }
        // Without it the service drops the last reference to the renderer.
        let script = if self.random.one_in(2) {
            Some(script)
        } else {
            drop_quietly(script);
            None
        };
        self.held.push(Held::Job(job, script));
    }

    fn ask(&mut self, service: &Service) {
        let count = self.random.pick(&[0, 1, 16, 600, 20_000]);
        let rays: Arc<[Ray]> = vec![Ray { origin: [f32::NAN; 3], ..Ray::default() }; count].into();
        let (tracers, options) = (self.tracers(), self.options());
        if self.random.one_in(3) {
            let query = service.occluded(tracers, rays, options);
            query.into_iter().for_each(|query| drop(query.wait()));
        } else if let Ok(query) = service.closest(tracers, rays, options) {
            self.controls.push(query.control());
            let counted = Counted::new(&self.live, |live| &live.callbacks);
            query.on_end(move |answer| drop((counted, answer.map(|(hits, _)| hits.len()).is_ok())));
            self.held.push(Held::Query(query, count));
        }
    }

    fn borrow(&mut self, service: &Service) {
        let scripts = [0, 1].map(|_| Script::new(&mut self.random, &self.live));
        let ending = self.random.below(5);
        let setups = [0, 1].map(|_| (self.tracers(), self.options()));
        let panicked = catch_unwind(AssertUnwindSafe(|| {
            service.scope(|scope| {
                for (script, (tracers, options)) in scripts.iter().zip(setups) {
                    let Ok(job) = scope.submit(script, tracers, options) else { continue };
                    match ending {
                        0 => drop(job),
                        1 => std::mem::forget(job),
                        2 => job.detach(),
                        3 => drop(job.wait()),
                        _ => resume_unwind(Box::new("a scope that panics")),
                    }
                }
            });
        }));
        assert!(panicked.is_ok() || ending == 4);
        scripts.into_iter().for_each(drop_quietly);
    }

    fn steer_from_another_thread(&mut self) {
        let mut random = Random(self.random.next());
        if self.controls.is_empty() {
            return;
        }
        let controls = [0, 1].map(|_| self.random.pick(&self.controls));
        let steer = move || {
            for control in controls {
                match random.below(5) {
                    0 => control.cancel(),
                    1 => control.stop(),
                    2 => control.set_priority(random.pick(&Priority::ALL)),
                    3 => drop(control.progress()),
                    _ => drop(format!("{control:?}")),
                }
            }
        };
        self.steering.push(thread::spawn(steer));
    }

    fn use_up(&mut self, held: Held) {
        let priority = self.priority();
        let way = self.random.below(10);
        match held {
            Held::Job(mut job, script) => {
                match way {
                    0 => drop(job),
                    1 => std::mem::forget(job),
                    2 => job.detach(),
                    3 => job.cancel(),
                    4 => job.stop(),
                    5 => {
                        job.set_priority(priority);
                        return self.held.push(Held::Job(job, script));
                    }
                    6 => {
                        poll(&mut job);
                        drop(job);
                    }
                    7 => drop(job.try_wait()),
                    8 => check(block_on(job), script.as_deref()),
                    _ => check(job.wait(), script.as_deref()),
                }
                drop_quietly(script);
            }
            Held::Query(mut query, count) => match way {
                0 => drop(query),
                1 => std::mem::forget(query),
                2 => query.detach(),
                3 => query.cancel(),
                4 => query.stop(),
                5 => {
                    query.set_priority(priority);
                    self.held.push(Held::Query(query, count));
                }
                6 => {
                    poll(&mut query);
                    drop(query);
                }
                7 => drop(query.try_wait()),
                8 => drop(block_on(query)),
                _ => match query.wait() {
                    Ok((hits, report)) => assert!(hits.len() == count || report.stopped),
                    Err(error) => assert!(!matches!(error, JobError::Broken(_)), "{error}"),
                },
            },
        }
    }
}

/// A job that has a report has shaded all its rays.
fn check(outcome: Result<raystream::schedule::JobReport, JobError>, script: Option<&Script>) {
    match outcome {
        Ok(report) => {
            assert_eq!(report.cpu.rays + report.gpu.rays, report.rays.total());
            let rays = report.rays.camera + report.rays.continuation;
            assert!(script.is_none_or(|script| script.shaded.load(SeqCst) == rays));
        }
        Err(error) => assert!(!matches!(error, JobError::Broken(_)), "{error}"),
    }
}

fn drop_quietly<T>(value: T) {
    drop(catch_unwind(AssertUnwindSafe(|| drop(value))));
}

fn run(seed: u64) {
    let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let options = ServiceOptions::default()
        .with_host_threads(1 + random.below(3))
        .with_device_thread(!random.one_in(3))
        .with_max_jobs(1 + random.below(2))
        .with_max_queries(1 + random.below(2))
        .with_sharing(random.pick(&[Sharing::Fair, Sharing::FirstIn]));
    let service = Service::new(options).expect("threads can be started");
    let live = Arc::new(Live::default());
    let mut sequence = Sequence {
        random,
        live: Arc::clone(&live),
        held: Vec::new(),
        controls: Vec::new(),
        clients: Vec::new(),
        steering: Vec::new(),
    };
    for _ in 0..4 + sequence.random.below(16) {
        sequence.step(&service);
    }
    if sequence.random.one_in(2) {
        // The service goes first, with all that runs.
        drop(service);
        while let Some(held) = sequence.held.pop() {
            sequence.use_up(held);
        }
    } else {
        while let Some(held) = sequence.held.pop() {
            sequence.use_up(held);
        }
        drop(service);
    }
    sequence.steering.drain(..).for_each(|thread| thread.join().expect("controls do not panic"));
    drop(sequence);
    let Live { renderers, tracers, arrays, callbacks } = &*live;
    let left = [renderers, tracers, arrays, callbacks].map(|count| count.load(SeqCst));
    assert_eq!(left, [0; 4], "renderers, tracers, device arrays and callbacks are dropped");
}

#[test]
fn random_sequences_neither_abort_nor_hang_nor_leak() {
    let number = |name| std::env::var(name).ok().map(|text| text.parse::<u64>().expect("a number"));
    let seeds = match number("RAYSTREAM_SERVICE_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("RAYSTREAM_SERVICE_SEQUENCES").unwrap_or(1500),
    };
    // Plug-ins that emit too much are told so by a panic, on purpose.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let name = thread::current().name().map(str::to_owned).unwrap_or_default();
        if !name.starts_with("host") && !name.starts_with("dispatch") {
            hook(info);
        }
    }));
    let (next, done) = (AtomicU64::new(seeds.start), AtomicU64::new(0));
    let began = Instant::now();
    thread::scope(|scope| {
        let work = || {
            while let Some(seed) = Some(next.fetch_add(1, SeqCst)).filter(|seed| seeds.contains(seed)) {
                if let Err(payload) = catch_unwind(|| run(seed)) {
                    eprintln!("seed {seed} failed");
                    next.store(seeds.end, SeqCst);
                    resume_unwind(payload);
                }
                done.fetch_add(1, SeqCst);
            }
        };
        let workers: Vec<_> = (0..2).map(|_| scope.spawn(work)).collect();
        // The watchdog.
        let (mut last, mut since) = (0, Instant::now());
        while !workers.iter().all(|worker| worker.is_finished()) {
            thread::sleep(Duration::from_millis(20));
            let now = done.load(SeqCst);
            if now != last {
                (last, since) = (now, Instant::now());
            }
            if since.elapsed() > PATIENCE {
                eprintln!("a sequence near seed {} hangs", next.load(SeqCst));
                std::process::abort();
            }
        }
    });
    println!("{} sequences in {:.1} s", done.load(SeqCst), began.elapsed().as_secs_f64());
}
