//! `raystream bench schedule`: the cost of the scheduler itself. Jobs of tasks that do nothing, or take a known time,
//! on any number of threads.

use super::Spread;
use raystream::schedule::{
    Batch, JobError, JobOptions, LimitsError, Output, Renderer, Service, ServiceError, ServiceOptions,
    ThreadKind, Tracers,
};
use raystream::stream::{Hit, Ray, Tracer};
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Numbers of host threads.
    pub threads: Vec<usize>,
    /// Durations of a task. It sleeps, so that more threads than cores can be measured.
    pub loads: Vec<Duration>,
    /// About how many tasks a job has.
    pub tasks: u64,
    /// Rounds; each job runs once a round.
    pub rounds: usize,
}

/// Results of one job with one number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Always `one ray a task`.
    pub configuration: &'static str,
    /// Host threads.
    pub threads: usize,
    /// Duration of a task, in microseconds.
    pub load_us: f64,
    /// True if every task was recorded.
    pub timeline: bool,
    /// Tasks of a job.
    pub tasks: u64,
    /// Tasks per second.
    pub tasks_per_s: Spread,
    /// Nanoseconds of a thread for each task, without the task itself and without suspension: the scheduler, the wait
    /// for its lock, and whatever else ran on the thread's core.
    pub overhead_ns: Spread,
    /// Share of the threads' time that was spent on tasks.
    pub busy_share: Spread,
}

/// Error of the measurement.
#[derive(Debug, thiserror::Error)]
pub enum ScheduleError {
    /// The threads cannot be started.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The job's sizes contradict each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// A job failed.
    #[error(transparent)]
    Job(#[from] JobError),
}

/// Rays after the camera ray on each path.
const BOUNCES: u32 = 7;

/// Each tile spawns one ray; each stream holds one; each ray is traced and shaded by a task of its own.
const TASKS_PER_TILE: u64 = 1 + 2 * (1 + BOUNCES as u64);

/// A renderer and tracer: each call is one task and takes a known time.
struct Drill {
    tiles: u64,
    load: Duration,
    calls: AtomicU64,
    /// Nanoseconds in calls; not measured where they do nothing.
    worked_ns: AtomicU64,
}

impl Drill {
    fn task(&self) {
        self.calls.fetch_add(1, Relaxed);
        if !self.load.is_zero() {
            let started = Instant::now();
            std::thread::sleep(self.load);
            self.worked_ns.fetch_add(started.elapsed().as_nanos() as u64, Relaxed);
        }
    }
}

impl Renderer for Drill {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.tiles
    }

    fn tile_rays(&self) -> usize {
        1
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, _tile: u64, out: &mut Output<'_, u32, u32>) {
        self.task();
        out.ray(Ray::default(), BOUNCES);
    }

    fn shade(&self, batch: Batch<'_, u32>, out: &mut Output<'_, u32, u32>) {
        self.task();
        for (ray, &bounces) in batch.rays.iter().zip(batch.payloads).filter(|(_, bounces)| **bounces > 0) {
            out.ray(*ray, bounces - 1);
        }
    }

    fn shadow(&self, _rays: &[Ray], _payloads: &[u32], _occluded: &[u32]) {}
}

impl Tracer for Drill {
    fn closest(&self, _rays: &[Ray], hits: &mut [Hit]) {
        self.task();
        hits.fill(Hit::NONE);
    }

    fn occluded(&self, _rays: &[Ray], occluded: &mut [u32]) {
        occluded.fill(0);
    }
}

/// Measures jobs with every number of threads and every load; those without load also with a timeline.
///
/// # Errors
/// When a job cannot be run.
pub fn run(options: &Options) -> Result<Vec<Row>, ScheduleError> {
    let mut rows = Vec::new();
    for &threads in &options.threads {
        let service = Service::new(
            ServiceOptions::default().with_host_threads(threads).with_device_thread(false).with_max_jobs(1),
        )?;
        for &load in &options.loads {
            for timeline in [false, true] {
                if timeline && !load.is_zero() {
                    continue;
                }
                rows.push(measure(&service, load, timeline, options)?);
            }
        }
    }
    Ok(rows)
}

fn measure(
    service: &Service,
    load: Duration,
    timeline: bool,
    options: &Options,
) -> Result<Row, ScheduleError> {
    let threads = service.host_threads();
    let (mut rates, mut overheads, mut busy) = (Vec::new(), Vec::new(), Vec::new());
    let mut tasks = 0;
    // A job whose tasks sleep has as many as fit a second.
    let most = Duration::from_secs(1).as_nanos() as u64 * threads as u64 / load.as_nanos().max(1) as u64;
    let tiles = options.tasks.min(most).div_ceil(TASKS_PER_TILE).max(1);
    for round in 0..=options.rounds {
        let drill = Arc::new(Drill { tiles, load, calls: AtomicU64::new(0), worked_ns: AtomicU64::new(0) });
        let one = JobOptions::default()
            .with_in_flight(4 * threads)
            .with_threshold(1)
            .with_batch_rays(1)
            .with_chunk_rays(1, 1)
            .with_timeline(timeline);
        let report =
            service.submit(Arc::clone(&drill), Tracers::cpu(Arc::clone(&drill) as _), one)?.wait()?;
        tasks = drill.calls.load(Relaxed);
        let hosts = report.threads.iter().filter(|thread| thread.kind == ThreadKind::Host);
        let idle_s: f64 = hosts.map(|thread| thread.idle_s).sum();
        let worked_s = drill.worked_ns.load(Relaxed) as f64 * 1e-9;
        let all_s = report.wall_s * threads as f64;
        // The first round starts threads and allocates streams.
        if round > 0 {
            rates.push(tasks as f64 / report.wall_s);
            overheads.push((all_s - idle_s - worked_s) / tasks as f64 * 1e9);
            busy.push(worked_s / all_s);
        }
    }
    Ok(Row {
        configuration: "one ray a task",
        threads,
        load_us: load.as_secs_f64() * 1e6,
        timeline,
        tasks,
        tasks_per_s: Spread::of_rates(rates),
        overhead_ns: Spread::of_times(overheads),
        busy_share: Spread::of_rates(busy),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_is_counted_and_takes_its_time() {
        let load = Duration::from_micros(300);
        let options =
            Options { threads: vec![1, 3], loads: vec![Duration::ZERO, load], tasks: 500, rounds: 2 };
        let rows = run(&options).expect("two services");
        assert_eq!(rows.len(), 2 * 3);
        for row in &rows {
            assert_eq!(row.tasks, 500u64.div_ceil(TASKS_PER_TILE) * TASKS_PER_TILE);
            assert!(row.overhead_ns.median > 0.0 && row.overhead_ns.best <= row.overhead_ns.worst);
            if row.load_us > 0.0 {
                assert!(row.busy_share.median > 0.05 && row.busy_share.best <= 1.0);
                assert!(row.tasks_per_s.best <= row.threads as f64 / load.as_secs_f64());
            }
        }
    }
}
