//! One job under the scheduler's lock: its lists and its account, without its types.

use super::lists::Lists;
use super::policy::Pace;
use super::pool::Pool;
use super::report::{JobReport, Lengths, Progress, TaskKind, TaskRecord, ThreadReport};
use super::task::{Done, Task, TaskSlot, Workplace};
use super::{JobError, JobOptions, Limits, Policy, Renderer, Rule, Unit, UnitReport, View, policy};
use crate::stream::{Empty, RayStream, Untraced, paths};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A job whose types do not matter, as the holder of the lock sees it. Every `start` is followed by
/// one `finish` of the same thread.
pub(super) trait Job: Send {
    /// What the policy may know.
    fn view(&self) -> View;
    /// Takes a task out of the lists and lays it on the thread's desk; returns about how many rays
    /// there are in it. The rule must be allowed by the view.
    fn start(&mut self, thread: usize, rule: Rule) -> u64;
    /// Takes the finished task from the thread's desk back into the lists. Times since the service
    /// began.
    fn finish(&mut self, thread: usize, start_ns: u64, end_ns: u64);
    /// Spawns no more tiles.
    fn stop(&mut self);
    /// Gives the job up: no more tasks.
    fn abandon(&mut self, why: JobError);
    /// Whether the last tile has been spawned.
    fn all_spawned(&self) -> bool;
    /// Whether there is nothing to do and no task under way.
    fn is_over(&self) -> bool;
    fn progress(&self) -> Progress;
    /// The result of a job that is over, without what the threads know: their idle time, the wall
    /// clock, the tail.
    fn outcome(&mut self, begin_ns: u64) -> Result<JobReport, JobError>;
    /// Gives the streams of a job that is over to the pool. Not under the lock.
    fn retire(self: Box<Self>, pool: &Pool);
    #[cfg(test)]
    fn check(&self);
}

/// What a thread has of a job.
#[derive(Clone, Copy)]
struct TaskAccount {
    kind: TaskKind,
    /// Paths in flight that are with the thread: those in its streams, and those it may spawn. A
    /// chunk's stay with its stream.
    paths: usize,
    /// Rays in the task, for the record; those of a spawn task are known at its end.
    rays: u64,
    /// Since when a stream that is dispatched has been full, if it had to wait.
    full_ns: Option<u64>,
}

impl TaskAccount {
    fn new(kind: TaskKind, paths: usize, rays: u64) -> Self {
        Self { kind, paths, rays, full_ns: None }
    }
}

pub(super) struct TypedJob<R: Renderer> {
    place: Arc<Workplace<R>>,
    lists: Lists<R::Payload, R::ShadowPayload>,
    policy: Policy,
    unit: Unit,
    next_tile: u64,
    /// Where spawning ends: at all tiles, earlier when stopped.
    last_tile: u64,
    /// Tasks under way.
    tasks: usize,
    ended: Option<JobError>,
    in_flight: usize,
    holds: Vec<Option<TaskAccount>>,
    busy_ns: Vec<u64>,
    trace_ns: u64,
    dispatch_ns: u64,
    progress: Progress,
    report: JobReport,
    keep_timeline: bool,
}

impl<R: Renderer> TypedJob<R> {
    pub fn new(
        place: Arc<Workplace<R>>,
        streams: Vec<RayStream<Empty, R::Payload, R::ShadowPayload>>,
        options: &JobOptions,
        unit: Unit,
        tiles: u64,
        events: Vec<String>,
    ) -> Self {
        let limits = place.limits;
        let threads = place.desks.len();
        Self {
            lists: Lists::new(limits, streams),
            policy: options.policy.unwrap_or_else(|| Policy::of(unit)),
            unit,
            next_tile: 0,
            last_tile: tiles,
            tasks: 0,
            ended: None,
            in_flight: 0,
            holds: vec![None; threads],
            busy_ns: vec![0; threads],
            trace_ns: 0,
            dispatch_ns: 0,
            progress: Progress { tiles, tile_rays: limits.tile_rays as u64, ..Progress::default() },
            report: JobReport {
                stopped: false,
                tiles,
                tiles_spawned: 0,
                rays: Default::default(),
                depths: Default::default(),
                cpu: Default::default(),
                gpu: Default::default(),
                device_waits: Default::default(),
                threads: Vec::new(),
                begin_ns: 0,
                wall_s: 0.0,
                waited_s: 0.0,
                tail_idle_share: 0.0,
                tail_s: 0.0,
                max_in_flight: 0,
                streams: 0,
                stream_bytes: limits.stream.bytes::<R::Payload, R::ShadowPayload>(),
                limits,
                events,
                timeline: Vec::new(),
            },
            keep_timeline: options.timeline,
            place,
        }
    }

    fn limits(&self) -> &Limits {
        &self.place.limits
    }

    /// Paths that have not ended or not begun; never grows.
    fn left(&self) -> u64 {
        let tile_rays = self.limits().tile_rays as u64;
        (self.last_tile - self.next_tile).saturating_mul(tile_rays).saturating_add(self.in_flight as u64)
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
        (self.last_tile - self.next_tile)
            .saturating_mul(self.limits().tile_rays as u64)
            .saturating_add(self.lists.rays_to_trace() as u64)
    }

    fn threshold(&self) -> usize {
        policy::threshold(self.left(), self.place.hosts, self.has_device(), self.limits())
    }

    fn paths<State>(&self, stream: &RayStream<State, R::Payload, R::ShadowPayload>) -> usize {
        paths(stream.rays(), stream.shadow_rays(), self.limits().shadow_rays_per_path)
    }

    /// A device is used by this job.
    fn has_device(&self) -> bool {
        self.unit != Unit::Cpu
    }

    fn take(&mut self, rule: Rule) -> (Task<R::Payload, R::ShadowPayload>, TaskAccount) {
        match rule {
            Rule::Spawn => {
                let tile = self.next_tile;
                self.next_tile += 1;
                let output = self.lists.output();
                let tile_rays = self.limits().tile_rays;
                self.in_flight += tile_rays;
                let paths = self.paths(&output) + tile_rays;
                (Task::Spawn { tile, output }, TaskAccount::new(TaskKind::Spawn, paths, 0))
            }
            Rule::Shade => {
                let input = self.lists.next_to_shade();
                let output = self.lists.output();
                let (rays, shadow_rays) = (input.rays_left(), input.shadow_rays_left());
                let held = paths(rays, shadow_rays, self.limits().shadow_rays_per_path);
                let paths = self.paths(&output) + held;
                let rays = (rays + shadow_rays) as u64;
                (
                    Task::Shade { input, output, threshold: self.threshold() },
                    TaskAccount::new(TaskKind::Shade, paths, rays),
                )
            }
            Rule::Trace | Rule::Flush => {
                let most = policy::chunk_rays(
                    self.waiting_rays(),
                    self.place.hosts,
                    self.has_device(),
                    self.limits(),
                );
                let chunk = self.lists.next_chunk(most);
                let rays = chunk.len() as u64;
                (Task::Trace(chunk), TaskAccount::new(TaskKind::Trace, 0, rays))
            }
            Rule::Dispatch => {
                let (stream, full_ns) = self.lists.next_to_dispatch();
                let rays = (stream.rays() + stream.shadow_rays()) as u64;
                let paths = self.paths(&stream);
                let hold = TaskAccount { full_ns, ..TaskAccount::new(TaskKind::Dispatch, paths, rays) };
                (Task::Dispatch(stream), hold)
            }
        }
    }

    /// Replaces the paths accounted to a task by those it has left.
    fn account(&mut self, hold: TaskAccount, left: usize) {
        assert!(left <= hold.paths, "a task leaves no more paths than it was given");
        self.in_flight -= hold.paths - left;
    }

    /// Returns the rays of the task's record.
    fn put_back(
        &mut self,
        hold: TaskAccount,
        done: Done<R::Payload, R::ShadowPayload>,
        (start_ns, end_ns): (u64, u64),
    ) -> u64 {
        match done {
            Done::Spawned { output, emitted } => {
                self.progress.tiles_spawned += 1;
                self.progress.rays.camera += emitted.rays;
                self.progress.rays.shadow += emitted.shadow_rays;
                self.account(hold, self.paths(&output));
                self.lists.park(output, self.threshold(), end_ns);
                emitted.rays + emitted.shadow_rays
            }
            Done::Shaded { input, output, emitted, depths } => {
                self.report.depths += depths;
                self.progress.rays.continuation += emitted.rays;
                self.progress.rays.shadow += emitted.shadow_rays;
                let rays_left = input.rays_left();
                self.account(hold, self.paths(&output) + rays_left);
                self.lists.park(output, self.threshold(), end_ns);
                self.lists.put_back_shaded(input);
                hold.rays - rays_left as u64
            }
            Done::Traced(chunk) => {
                self.progress.cpu_rays += hold.rays;
                self.lists.put_back_chunk(chunk);
                hold.rays
            }
            Done::Dispatched { stream, report } => {
                self.progress.gpu_rays += hold.rays;
                let gpu = &mut self.report.gpu;
                gpu.bytes_copied += report.bytes_copied;
                gpu.flagged += report.flagged;
                gpu.retraced += report.retraced;
                gpu.checked += report.checked;
                gpu.sending_s += report.sending_ns as f64 * 1e-9;
                gpu.waiting_s += report.waiting_ns as f64 * 1e-9;
                let waited_ns = hold.full_ns.map_or(0, |full_ns| start_ns.saturating_sub(full_ns));
                let waits = &mut self.report.device_waits;
                waits.full_to_dispatched.record(waited_ns + report.sending_ns);
                waits.dispatched_to_readable.record(report.waiting_ns);
                self.lists.put_back_dispatched(stream);
                hold.rays
            }
            Done::Undispatched(Untraced { stream, reason }) => {
                self.lists.put_back_untraced(stream, end_ns);
                if self.has_device() {
                    self.unit = Unit::Cpu;
                    let device = &self.place.device_name;
                    self.report.events.push(format!(
                        "{device} failed ({reason}); the job goes on without it, with the same result"
                    ));
                }
                0
            }
            Done::Panicked(message) => {
                self.abandon(JobError::Panicked(message));
                hold.rays
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
            tiles_left: self.last_tile - self.next_tile,
            tile_fits: self.in_flight + self.limits().tile_rays <= self.limits().in_flight,
            need_more: self.lists.need_more(),
            need_more_rays: self.lists.need_more_rays(),
            trace: self.lists.trace(),
            trace_rays: self.lists.trace_rays(),
            waiting_rays: self.waiting_rays(),
            slot: self.lists.slot(),
            shade: self.lists.shade(),
            tasks: self.tasks,
            served: 0,
            cpu: Pace { rays: self.progress.cpu_rays, ns: self.trace_ns },
            gpu: Pace { rays: self.progress.gpu_rays, ns: self.dispatch_ns },
        }
    }

    fn start(&mut self, thread: usize, rule: Rule) -> u64 {
        let (task, hold) = self.take(rule);
        assert!(self.in_flight <= self.limits().in_flight, "no more than N paths are in flight");
        self.report.max_in_flight = self.report.max_in_flight.max(self.in_flight);
        self.tasks += 1;
        let former = self.holds[thread].replace(hold);
        assert!(former.is_none(), "a thread has one task at a time");
        self.place.swap_slot(thread, TaskSlot::Task(task));
        hold.rays.max(hold.paths as u64)
    }

    fn finish(&mut self, thread: usize, start_ns: u64, end_ns: u64) {
        let hold = self.holds[thread].take().expect("a thread finishes what it has started");
        let done = match self.place.swap_slot(thread, TaskSlot::Clear) {
            TaskSlot::Done(done) => done,
            TaskSlot::Clear | TaskSlot::Task(_) => unreachable!("a thread finishes after its work"),
        };
        self.tasks -= 1;
        let ns = end_ns - start_ns;
        self.busy_ns[thread] += ns;
        match hold.kind {
            TaskKind::Trace => self.trace_ns += ns,
            TaskKind::Dispatch => self.dispatch_ns += ns,
            TaskKind::Spawn | TaskKind::Shade => {}
        }
        let rays = self.put_back(hold, done, (start_ns, end_ns));
        if self.keep_timeline {
            let (thread, rays) = (thread as u32, rays.min(u64::from(u32::MAX)) as u32);
            let lists = self.lengths();
            self.report.timeline.push(TaskRecord { thread, kind: hold.kind, rays, start_ns, end_ns, lists });
        }
    }

    fn stop(&mut self) {
        self.report.stopped |= self.next_tile < self.last_tile;
        self.last_tile = self.next_tile;
    }

    fn abandon(&mut self, why: JobError) {
        self.place.abandoned.store(true, Ordering::Relaxed);
        self.ended.get_or_insert(why);
    }

    fn all_spawned(&self) -> bool {
        self.progress.tiles_spawned == self.last_tile
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
        report.gpu.rays = self.progress.gpu_rays;
        report.gpu.busy_s = self.dispatch_ns as f64 * 1e-9;
        report.threads = self
            .busy_ns
            .iter()
            .enumerate()
            .map(|(thread, &ns)| ThreadReport {
                kind: super::state::kind(thread, self.place.hosts),
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
        let held: usize = self.holds.iter().flatten().map(|hold| hold.paths).sum();
        let with_threads = self.holds.iter().flatten().map(|hold| match hold.kind {
            TaskKind::Shade => 2,
            TaskKind::Spawn | TaskKind::Dispatch => 1,
            TaskKind::Trace => 0,
        });
        assert_eq!(streams + with_threads.sum::<usize>(), self.lists.made(), "streams are conserved");
        assert_eq!(in_lists + held, self.in_flight, "paths are conserved");
    }
}
