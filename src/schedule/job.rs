//! One job under the scheduler's lock: its lists and its account, behind a trait that hides the payload types.

use super::lists::Lists;
use super::policy::Pace;
use super::pool::Pool;
use super::report::{JobReport, Lengths, Progress, TaskKind, TaskRecord, ThreadKind, ThreadReport};
use super::task::{Done, SharedJob, Task, TaskSlot};
use super::{JobError, JobOptions, Limits, Policy, Renderer, Rule, TaskSize, Unit, UnitReport, View, policy};
use crate::stream::{Empty, RayStream, Untraced, paths};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A job of any payload types, as the holder of the lock sees it. Every `start` is followed by one `finish` of the
/// same thread.
pub(super) trait Job: Send {
    /// What the policy sees of the job.
    fn view(&self) -> View;
    /// Takes a task out of the lists and puts it into the thread's slot; returns about how many rays the task has.
    /// The view must allow the rule.
    fn start(&mut self, thread: usize, rule: Rule, size: TaskSize) -> u64;
    /// Takes the finished task out of the thread's slot and returns its streams to the lists. Times count from the
    /// start of the service.
    fn finish(&mut self, thread: usize, start_ns: u64, end_ns: u64);
    /// Spawns no more tiles.
    fn stop(&mut self);
    /// Starts no more tasks; the job's outcome is this error, or an earlier one.
    fn abandon(&mut self, why: JobError);
    /// True if the last tile has been spawned.
    fn all_spawned(&self) -> bool;
    /// True if the job has no work left and no task under way.
    fn is_over(&self) -> bool;
    fn progress(&self) -> Progress;
    /// The result of a job that is over. [`super::state::State`] adds wall time, idle time and the tail.
    fn outcome(&mut self, begin_ns: u64) -> Result<JobReport, JobError>;
    /// Returns the streams of a job that is over to the pool. Called without the lock.
    fn retire(self: Box<Self>, pool: &Pool);
    #[cfg(test)]
    fn check(&self);
}

/// What a task under way counts for.
#[derive(Clone, Copy)]
struct TaskAccount {
    kind: TaskKind,
    /// Paths in flight in the task's streams, and those that it may spawn. 0 for a chunk, whose paths are counted with
    /// its stream.
    paths: usize,
    /// Rays and shadow rays in the task, for its record; 0 for a spawn task, whose rays are known at its end.
    rays: u64,
    /// When a dispatched stream became full, if it had to wait.
    full_ns: Option<u64>,
}

impl TaskAccount {
    fn new(kind: TaskKind, paths: usize, rays: u64) -> Self {
        Self { kind, paths, rays, full_ns: None }
    }
}

pub(super) struct TypedJob<R: Renderer> {
    shared: Arc<SharedJob<R>>,
    lists: Lists<R::Payload, R::ShadowPayload>,
    policy: Policy,
    unit: Unit,
    next_tile: u64,
    /// Spawning ends before this tile: the number of tiles, or less when stopped.
    end_tile: u64,
    /// Tasks under way.
    tasks: usize,
    ended: Option<JobError>,
    in_flight: usize,
    /// The task under way of each thread.
    accounts: Vec<Option<TaskAccount>>,
    /// Of each thread.
    busy_ns: Vec<u64>,
    /// Of all host threads, tracing.
    trace_ns: u64,
    /// How fast host threads shade.
    shading: Pace,
    /// Of all dispatch threads.
    dispatch_ns: u64,
    progress: Progress,
    report: JobReport,
    keep_timeline: bool,
}

impl<R: Renderer> TypedJob<R> {
    pub fn new(
        shared: Arc<SharedJob<R>>,
        streams: Vec<RayStream<Empty, R::Payload, R::ShadowPayload>>,
        options: &JobOptions,
        unit: Unit,
        tiles: u64,
        events: Vec<String>,
    ) -> Self {
        let limits = shared.limits;
        let threads = shared.slots.len();
        Self {
            lists: Lists::new(limits, streams),
            policy: options.policy.unwrap_or_else(|| Policy::of(unit)),
            unit,
            next_tile: 0,
            end_tile: tiles,
            tasks: 0,
            ended: None,
            in_flight: 0,
            accounts: vec![None; threads],
            busy_ns: vec![0; threads],
            trace_ns: 0,
            shading: Pace::default(),
            dispatch_ns: 0,
            progress: Progress { tiles, tile_rays: limits.tile_rays as u64, ..Progress::default() },
            report: JobReport {
                stream_bytes: limits.stream.bytes::<R::Payload, R::ShadowPayload>(),
                ..JobReport::new(options, limits, tiles, events)
            },
            keep_timeline: options.timeline,
            shared,
        }
    }

    fn limits(&self) -> &Limits {
        &self.shared.limits
    }

    /// Paths that have not ended or not begun. Never grows.
    fn paths_left(&self) -> u64 {
        let tile_rays = self.limits().tile_rays as u64;
        (self.end_tile - self.next_tile).saturating_mul(tile_rays).saturating_add(self.in_flight as u64)
    }

    fn lengths(&self) -> Lengths {
        let short = |len: usize| len.min(u16::MAX.into()) as u16;
        Lengths {
            need_more: short(self.lists.need_more()),
            trace: short(self.lists.trace()),
            shade: short(self.lists.shade()),
            in_flight: self.in_flight as u32,
        }
    }

    /// Rays that wait to be traced or spawned.
    fn waiting_rays(&self) -> u64 {
        (self.end_tile - self.next_tile)
            .saturating_mul(self.limits().tile_rays as u64)
            .saturating_add(self.lists.rays_to_trace() as u64)
    }

    /// How fast host threads trace.
    fn tracing(&self) -> Pace {
        Pace { rays: self.progress.cpu_rays, ns: self.trace_ns }
    }

    fn threshold(&self) -> usize {
        policy::threshold(self.paths_left(), self.shared.hosts, self.has_device(), self.limits())
    }

    fn paths<State>(&self, stream: &RayStream<State, R::Payload, R::ShadowPayload>) -> usize {
        paths(stream.rays(), stream.shadow_rays(), self.limits().shadow_rays_per_path)
    }

    /// True if a device traces for this job.
    fn has_device(&self) -> bool {
        self.unit != Unit::Cpu
    }

    fn take(
        &mut self,
        thread: usize,
        rule: Rule,
        size: TaskSize,
    ) -> (Task<R::Payload, R::ShadowPayload>, TaskAccount) {
        match rule {
            Rule::Spawn => {
                let tile = self.next_tile;
                self.next_tile += 1;
                let output = self.lists.output(thread);
                let tile_rays = self.limits().tile_rays;
                self.in_flight += tile_rays;
                let paths = self.paths(&output) + tile_rays;
                (Task::Spawn { tile, output }, TaskAccount::new(TaskKind::Spawn, paths, 0))
            }
            Rule::Shade => {
                let input = self.lists.next_to_shade(thread);
                let output = self.lists.output(thread);
                let (rays, shadow_rays) = (input.rays_left(), input.shadow_rays_left());
                let input_paths = paths(rays, shadow_rays, self.limits().shadow_rays_per_path);
                let paths = self.paths(&output) + input_paths;
                let rays = (rays + shadow_rays) as u64;
                let most_rays = policy::most_rays(size, self.shading, self.limits());
                let task = Task::Shade { input, output, threshold: self.threshold(), most_rays };
                (task, TaskAccount::new(TaskKind::Shade, paths, rays))
            }
            Rule::Trace | Rule::Flush => {
                let most = policy::chunk_rays(
                    self.waiting_rays(),
                    self.shared.hosts,
                    self.has_device(),
                    self.limits(),
                );
                let chunk = self
                    .lists
                    .next_chunk(most.min(policy::most_rays(size, self.tracing(), self.limits())), thread);
                let rays = chunk.len() as u64;
                (Task::Trace(chunk), TaskAccount::new(TaskKind::Trace, 0, rays))
            }
            Rule::Dispatch => {
                let (stream, full_ns) = self.lists.next_to_dispatch(thread);
                let rays = (stream.rays() + stream.shadow_rays()) as u64;
                let paths = self.paths(&stream);
                let account = TaskAccount { full_ns, ..TaskAccount::new(TaskKind::Dispatch, paths, rays) };
                (Task::Dispatch(stream), account)
            }
        }
    }

    /// Replaces the paths that a task was given by those that it has left.
    fn end_paths(&mut self, account: TaskAccount, left: usize) {
        assert!(left <= account.paths, "a task leaves no more paths than it was given");
        self.in_flight -= account.paths - left;
    }

    /// Takes back what a task leaves; returns the rays for the task's record.
    fn put_back(
        &mut self,
        account: TaskAccount,
        done: Done<R::Payload, R::ShadowPayload>,
        thread: usize,
        (start_ns, end_ns): (u64, u64),
    ) -> u64 {
        match done {
            Done::Spawned { output, emitted } => {
                self.progress.tiles_spawned += 1;
                self.progress.rays.camera += emitted.rays;
                self.progress.rays.shadow += emitted.shadow_rays;
                self.end_paths(account, self.paths(&output));
                self.lists.put_back_output(output, self.threshold(), (thread, end_ns));
                emitted.rays + emitted.shadow_rays
            }
            Done::Shaded { input, output, emitted, depths } => {
                self.report.depths += depths;
                self.progress.rays.continuation += emitted.rays;
                self.progress.rays.shadow += emitted.shadow_rays;
                let rays_left = input.rays_left();
                self.end_paths(account, self.paths(&output) + rays_left);
                self.lists.put_back_output(output, self.threshold(), (thread, end_ns));
                self.lists.put_back_shaded(input, thread);
                account.rays - rays_left as u64
            }
            Done::Traced(chunk) => {
                self.progress.cpu_rays += account.rays;
                self.lists.put_back_chunk(chunk, thread);
                account.rays
            }
            Done::Dispatched { stream, report } => {
                self.progress.gpu_rays += account.rays;
                let gpu = &mut self.report.gpu;
                gpu.bytes_copied += report.bytes_copied;
                gpu.flagged += report.flagged;
                gpu.retraced += report.retraced;
                gpu.masked += report.masked;
                gpu.checked += report.checked;
                gpu.sending_s += report.sending_ns as f64 * 1e-9;
                gpu.waiting_s += report.waiting_ns as f64 * 1e-9;
                let waited_ns = account.full_ns.map_or(0, |full_ns| start_ns.saturating_sub(full_ns));
                let waits = &mut self.report.device_waits;
                waits.full_to_dispatched.record(waited_ns + report.sending_ns);
                waits.dispatched_to_readable.record(report.waiting_ns);
                self.lists.put_back_dispatched(stream, thread);
                account.rays
            }
            Done::Undispatched(Untraced { stream, reason }) => {
                self.lists.put_back_untraced(stream, (thread, end_ns));
                if self.has_device() {
                    self.unit = Unit::Cpu;
                    let device = &self.shared.device_name;
                    self.report.events.push(format!(
                        "{device} failed ({reason}); the job goes on without it, with the same result"
                    ));
                }
                0
            }
            Done::Panicked(message) => {
                self.abandon(JobError::Panicked { job: self.report.name.clone(), message });
                account.rays
            }
        }
    }
}

impl<R: Renderer> Job for TypedJob<R> {
    fn view(&self) -> View {
        View {
            unit: self.unit,
            policy: self.policy,
            ended: self.ended.is_some(),
            tiles_left: self.end_tile - self.next_tile,
            tile_fits: self.in_flight + self.limits().tile_rays <= self.limits().in_flight,
            need_more: self.lists.need_more(),
            need_more_rays: self.lists.need_more_rays(),
            trace: self.lists.trace(),
            trace_rays: self.lists.trace_rays(),
            waiting_rays: self.waiting_rays(),
            slot: self.lists.slot(),
            shade: self.lists.shade(),
            tasks: self.tasks,
            cpu: self.tracing(),
            gpu: Pace { rays: self.progress.gpu_rays, ns: self.dispatch_ns },
        }
    }

    fn start(&mut self, thread: usize, rule: Rule, size: TaskSize) -> u64 {
        let (task, account) = self.take(thread, rule, size);
        assert!(self.in_flight <= self.limits().in_flight, "no more than N paths are in flight");
        self.report.max_in_flight = self.report.max_in_flight.max(self.in_flight);
        self.tasks += 1;
        let former = self.accounts[thread].replace(account);
        assert!(former.is_none(), "a thread has one task at a time");
        self.shared.swap_slot(thread, TaskSlot::Task(task));
        account.rays.max(account.paths as u64)
    }

    fn finish(&mut self, thread: usize, start_ns: u64, end_ns: u64) {
        let account = self.accounts[thread].take().expect("a thread finishes what it has started");
        let done = match self.shared.swap_slot(thread, TaskSlot::Empty) {
            TaskSlot::Done(done) => done,
            TaskSlot::Empty | TaskSlot::Task(_) => unreachable!("a thread finishes after its work"),
        };
        self.tasks -= 1;
        let ns = end_ns - start_ns;
        self.busy_ns[thread] += ns;
        match account.kind {
            TaskKind::Trace => self.trace_ns += ns,
            TaskKind::Dispatch => self.dispatch_ns += ns,
            TaskKind::Spawn | TaskKind::Shade => {}
        }
        let rays = self.put_back(account, done, thread, (start_ns, end_ns));
        if account.kind == TaskKind::Shade {
            self.shading += Pace { rays, ns };
        }
        if self.keep_timeline {
            let (thread, rays) = (thread as u32, rays.min(u64::from(u32::MAX)) as u32);
            let lists = self.lengths();
            self.report.timeline.push(TaskRecord {
                thread,
                kind: account.kind,
                rays,
                start_ns,
                end_ns,
                lists,
            });
        }
    }

    fn stop(&mut self) {
        self.report.stopped |= self.next_tile < self.end_tile;
        self.end_tile = self.next_tile;
    }

    fn abandon(&mut self, why: JobError) {
        self.shared.abandoned.store(true, Ordering::Relaxed);
        self.ended.get_or_insert(why);
    }

    fn all_spawned(&self) -> bool {
        self.progress.tiles_spawned == self.end_tile
    }

    fn is_over(&self) -> bool {
        self.tasks == 0 && (self.ended.is_some() || (self.all_spawned() && self.in_flight == 0))
    }

    fn progress(&self) -> Progress {
        Progress { in_flight: self.in_flight as u64, ..self.progress }
    }

    fn outcome(&mut self, begin_ns: u64) -> Result<JobReport, JobError> {
        if let Some(why) = self.ended.take() {
            return Err(why);
        }
        let mut report = self.report.clone();
        report.timeline = std::mem::take(&mut self.report.timeline);
        for record in &mut report.timeline {
            record.start_ns -= begin_ns;
            record.end_ns -= begin_ns;
        }
        report.begin_ns = begin_ns;
        report.tiles_spawned = self.progress.tiles_spawned;
        report.rays = self.progress.rays;
        report.streams = self.lists.made();
        report.cpu = UnitReport {
            rays: self.progress.cpu_rays,
            busy_s: self.trace_ns as f64 * 1e-9,
            ..UnitReport::default()
        };
        report.shading = self.shading;
        report.gpu.rays = self.progress.gpu_rays;
        report.gpu.busy_s = self.dispatch_ns as f64 * 1e-9;
        report.threads = self
            .busy_ns
            .iter()
            .enumerate()
            .map(|(thread, &ns)| ThreadReport {
                kind: ThreadKind::of(thread, self.shared.hosts),
                busy_s: ns as f64 * 1e-9,
                idle_s: 0.0,
                tail_idle_s: 0.0,
            })
            .collect();
        Ok(report)
    }

    fn retire(self: Box<Self>, pool: &Pool) {
        pool.give(self.lists.into_empty());
    }

    #[cfg(test)]
    fn check(&self) {
        let (streams, in_lists) = self.lists.count();
        assert!(self.in_flight <= self.limits().in_flight);
        assert!(self.lists.made() <= self.limits().streams);
        if self.ended.is_some() {
            return;
        }
        let with_tasks: usize = self.accounts.iter().flatten().map(|account| account.paths).sum();
        let with_threads = self.accounts.iter().flatten().map(|account| match account.kind {
            TaskKind::Shade => 2,
            TaskKind::Spawn | TaskKind::Dispatch => 1,
            TaskKind::Trace => 0,
        });
        assert_eq!(streams + with_threads.sum::<usize>(), self.lists.made(), "streams are conserved");
        assert_eq!(in_lists + with_tasks, self.in_flight, "paths are conserved");
    }
}
