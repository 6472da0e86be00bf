//! One job under the scheduler's lock: its lists and its account, behind a trait that hides the payload types.

use super::device_account::{BundleAccount, DeviceAccount};
use super::flights::{Answers, BundleId, Submitted};
use super::limits::BUNDLE_STREAMS;
use super::lists::{Lists, weight};
use super::on_device::WithDevice;
use super::policy::{Pace, PathLengths};
use super::pool::Pool;
use super::report::{JobReport, Lengths, Progress, TaskKind, TaskRecord, ThreadKind, ThreadReport};
use super::task::{Done, SharedJob, Task, TaskSlot};
use super::task_account::TaskAccount;
use super::task_times::TaskTimes;
use super::{JobError, JobOptions, Limits, Policy, Renderer, Rule, TaskSize, Unit, UnitReport, View, policy};
use crate::stream::{DeviceReport, Empty, RayStream, Resolve, Untraced, drop_quietly, paths};
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
    /// start of the service. The bundle that the task has submitted has the number `next`.
    fn finish(&mut self, thread: usize, next: BundleId, times: TaskTimes) -> Option<Submitted>;
    /// The device thread has waited for a bundle of the job.
    fn count_wait(&mut self, thread: usize, ns: u64);
    /// A device has traced a bundle of the job, or failed to. Returns answers that are to be dropped without the lock.
    fn end_bundle(
        &mut self,
        thread: usize,
        id: BundleId,
        answers: Answers,
        end_ns: u64,
    ) -> Vec<Box<dyn Resolve>>;
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
    /// Rays shaded, without shadow rays.
    steps_shaded: u64,
    /// Bundles with a device.
    with_device: WithDevice<R::Payload, R::ShadowPayload>,
    /// Streams, and rays and shadow rays, of the bundle that is being submitted.
    submitting: (usize, u64),
    device: DeviceAccount,
    /// True once the device is ready. Host threads trace alone until then.
    has_joined: bool,
    /// True if the renderer's tiles can be traced where they are.
    is_in_place: bool,
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
        let mut job = Self {
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
            steps_shaded: 0,
            with_device: WithDevice::new(),
            submitting: (0, 0),
            device: DeviceAccount::default(),
            has_joined: false,
            is_in_place: shared.renderer.in_place().is_some(),
            progress: Progress { tiles, tile_rays: limits.tile_rays as u64, ..Progress::default() },
            report: JobReport {
                stream_bytes: limits.stream.bytes::<R::Payload, R::ShadowPayload>(),
                ..JobReport::new(options, limits, tiles, events)
            },
            keep_timeline: options.timeline,
            shared,
        };
        job.join_device();
        job
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
        policy::threshold(self.paths_left(), self.shared.hosts, self.limits())
    }

    fn paths<State>(&self, stream: &RayStream<State, R::Payload, R::ShadowPayload>) -> usize {
        paths(stream.rays(), stream.shadow_rays(), self.limits().shadow_rays_per_path)
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
                let tile_rays = self.limits().tile_rays;
                self.in_flight += tile_rays;
                // A task that must be small is divided, which streams are.
                if self.is_in_place && self.unit == Unit::Cpu && size == TaskSize::Large {
                    return (Task::InPlace { tile }, TaskAccount::in_place(tile_rays));
                }
                let output = self.lists.output(thread);
                let paths = self.paths(&output) + tile_rays;
                (Task::Spawn { tile, output }, TaskAccount::new(rule, paths, 0))
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
                (task, TaskAccount::new(rule, paths, rays))
            }
            Rule::Trace | Rule::Flush => {
                let mut most = policy::chunk_rays(self.waiting_rays(), self.shared.hosts, self.limits());
                if self.unit != Unit::Cpu && self.has_joined && !self.device.is_known() {
                    // Until it is known what the device does better, no thread is away for long.
                    most = self.limits().chunk_rays;
                }
                let chunk = self
                    .lists
                    .next_chunk(most.min(policy::most_rays(size, self.tracing(), self.limits())), thread);
                let rays = chunk.len() as u64;
                (Task::Trace(chunk), TaskAccount::new(rule, 0, rays))
            }
            Rule::Resolve => {
                let (stream, waits) = self.lists.next_to_resolve();
                let (paths, rays) = (self.paths(&stream), weight(&stream) as u64);
                (Task::Resolve(stream), TaskAccount { waits, ..TaskAccount::new(rule, paths, rays) })
            }
            Rule::Submit => {
                // The first is small, so that it is soon known how fast the device is.
                let most = if self.device.is_new() { 1 } else { BUNDLE_STREAMS };
                let bundle = self.lists.next_bundle(most, thread);
                let (bundle, full_ns): (Vec<_>, Vec<_>) = bundle.into_iter().unzip();
                let paths = bundle.iter().map(|stream| self.paths(stream)).sum();
                let rays = bundle.iter().map(|stream| weight(stream) as u64).sum();
                self.device.full_ns = full_ns;
                self.submitting = (bundle.len(), rays);
                (Task::Submit(bundle), TaskAccount::new(rule, paths, rays))
            }
            Rule::Reclaim => {
                let stream = self.with_device.take_back().expect("a device has a stream");
                let (paths, rays) = (self.paths(&stream), weight(&stream) as u64);
                (Task::Reclaim(stream), TaskAccount::new(rule, paths, rays))
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
        end_ns: u64,
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
                self.steps_shaded += depths.0.iter().sum::<u64>();
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
            Done::TracedInPlace(rays) => {
                self.progress.tiles_spawned += 1;
                self.progress.rays += rays;
                self.progress.cpu_rays += rays.total();
                self.end_paths(account, 0);
                rays.total()
            }
            Done::Failed(error) => {
                self.abandon(error.of_job(self.report.name.clone()));
                account.rays
            }
            done => self.put_back_of_device(account, done, thread, end_ns),
        }
    }

    /// [`TypedJob::put_back`] for what a device had.
    fn put_back_of_device(
        &mut self,
        account: TaskAccount,
        done: Done<R::Payload, R::ShadowPayload>,
        thread: usize,
        end_ns: u64,
    ) -> u64 {
        match done {
            Done::Resolved { stream, report } => {
                self.progress.gpu_rays += account.rays;
                self.count_device(report);
                let [waited_ns, readable_ns] = account.waits;
                self.report.device_waits.full_to_dispatched.record(waited_ns);
                self.report.device_waits.dispatched_to_readable.record(readable_ns);
                self.lists.put_back_resolved(stream, thread);
                account.rays
            }
            Done::Unresolved(Untraced { stream, reason }) => {
                self.lists.put_back_untraced(stream, (thread, end_ns));
                self.lose_device(&reason);
                0
            }
            Done::Reclaimed(stream) => {
                self.lists.put_back_reclaimed(stream);
                account.rays
            }
            Done::Refused { streams, reason } => {
                self.submitting = (0, 0);
                for stream in streams {
                    self.lists.put_back_untraced(stream, (thread, end_ns));
                }
                self.lose_device(&reason);
                0
            }
            _ => unreachable!("other tasks know no device"),
        }
    }

    /// Counts what it took to make a stream's answers.
    fn count_device(&mut self, report: DeviceReport) {
        let gpu = &mut self.report.gpu;
        gpu.bytes_copied += report.bytes_copied;
        gpu.flagged += report.flagged;
        gpu.retraced += report.retraced;
        gpu.masked += report.masked;
        gpu.checked += report.checked;
    }

    /// Counts a bundle that the device has traced.
    fn count_bundle(&mut self, rays: u64, bundle: &BundleAccount, thread: usize, end_ns: u64) {
        let start_ns = self.device.note(rays, bundle, end_ns);
        self.report.gpu.busy_s += (end_ns - start_ns) as f64 * 1e-9;
        self.report.gpu.waiting_s += (end_ns - bundle.submitted_ns) as f64 * 1e-9;
        self.record(thread, TaskKind::Dispatch, rays, (start_ns, end_ns));
    }

    /// Takes note of a device that has become ready, or never will.
    fn join_device(&mut self) {
        match self.shared.joined.get() {
            Some(Ok(())) => self.has_joined = true,
            Some(Err(reason)) if self.unit != Unit::Cpu => {
                let device = &self.shared.device_name;
                self.report
                    .events
                    .push(format!("{device} cannot be used ({reason}); host threads trace alone"));
                self.unit = Unit::Cpu;
            }
            _ => {}
        }
    }

    /// Goes on without the device.
    fn lose_device(&mut self, reason: &str) {
        if self.unit != Unit::Cpu {
            self.unit = Unit::Cpu;
            let device = &self.shared.device_name;
            self.report.events.push(format!(
                "{device} failed ({reason}); the job goes on without it, with the same result"
            ));
        }
    }

    fn record(&mut self, thread: usize, kind: TaskKind, rays: u64, (start_ns, end_ns): (u64, u64)) {
        if self.keep_timeline {
            let (thread, rays) = (thread as u32, rays.min(u64::from(u32::MAX)) as u32);
            let lists = self.lengths();
            self.report.timeline.push(TaskRecord { thread, kind, rays, start_ns, end_ns, lists });
        }
    }
}

impl<R: Renderer> Job for TypedJob<R> {
    fn view(&self) -> View {
        View {
            unit: if self.has_joined { self.unit } else { Unit::Cpu },
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
            answered: self.lists.answered(),
            shade: self.lists.shade(),
            tasks: self.tasks + self.with_device.bundles(),
            cpu: self.tracing(),
            shading: self.shading,
            device: self.device.view(),
            bundle_rays: self.limits().bundle_rays,
            on_device: self.with_device.bundles() + usize::from(self.submitting.0 > 0),
            on_device_rays: self.with_device.rays() + self.submitting.1,
            with_device: self.with_device.streams(),
            failed: self.with_device.failed(),
            paths_left: self.paths_left(),
            lengths: PathLengths {
                shaded: self.steps_shaded,
                continued: self.progress.rays.continuation,
                rays: self.progress.rays.camera + self.progress.rays.continuation,
                shadow_rays: self.progress.rays.shadow,
            },
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

    fn finish(&mut self, thread: usize, next: BundleId, times: TaskTimes) -> Option<Submitted> {
        let TaskTimes { start_ns, end_ns, cpu_ns } = times;
        let account = self.accounts[thread].take().expect("a thread finishes what it has started");
        let done = match self.shared.swap_slot(thread, TaskSlot::Empty) {
            TaskSlot::Done(done) => done,
            TaskSlot::Empty | TaskSlot::Task(_) => unreachable!("a thread finishes after its work"),
        };
        self.tasks -= 1;
        if !self.has_joined {
            self.join_device();
        }
        let (ns, device_ns) = (end_ns - start_ns, cpu_ns.unwrap_or(end_ns - start_ns));
        self.busy_ns[thread] += ns;
        let (mut submitted, mut rays) = (None, account.rays);
        match done {
            Done::Submitted { streams, ticket } => {
                submitted = Some(Submitted { ticket, streams: streams.len() });
                let ahead = self.with_device.rays();
                let full_ns = std::mem::take(&mut self.device.full_ns);
                self.submitting = (0, 0);
                let bundle = BundleAccount { submitted_ns: end_ns, ahead, full_ns };
                self.with_device.push(next, streams, bundle);
            }
            done => rays = self.put_back(account, done, thread, end_ns),
        }
        match account.kind {
            Some(TaskKind::Trace) => self.trace_ns += ns,
            Some(TaskKind::Shade) => self.shading += Pace { rays, ns },
            Some(TaskKind::Resolve) => self.device.resolving += Pace { rays, ns: device_ns },
            None if account.rule == Rule::Submit => {
                self.device.submitted += 1;
                self.device.submitting_ns += device_ns;
            }
            _ => {}
        }
        if let Some(kind) = account.kind {
            self.record(thread, kind, rays, (start_ns, end_ns));
        }
        submitted
    }

    fn count_wait(&mut self, thread: usize, ns: u64) {
        self.busy_ns[thread] += ns;
    }

    fn end_bundle(
        &mut self,
        thread: usize,
        id: BundleId,
        answers: Answers,
        end_ns: u64,
    ) -> Vec<Box<dyn Resolve>> {
        let traced = self.with_device.end(id, answers);
        match traced.failed {
            Some(reason) => self.lose_device(&reason),
            None => self.count_bundle(traced.rays, &traced.account, thread, end_ns),
        }
        let submitted_ns = traced.account.submitted_ns;
        for (stream, full_ns) in traced.streams {
            let waited_ns = full_ns.map_or(0, |full_ns| submitted_ns.saturating_sub(full_ns));
            self.lists.put_back_answered(stream, [waited_ns, end_ns - submitted_ns]);
        }
        traced.left_over
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
        report.gpu.sending_s = self.device.submitting_ns as f64 * 1e-9;
        report.gpu.resolving_s = self.device.resolving.ns as f64 * 1e-9;
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
        let Self { lists, with_device, .. } = *self;
        // A device may still have shares of these.
        drop_quietly(with_device);
        pool.give(lists.into_empty());
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
        let with_device = self.with_device.paths(self.limits().shadow_rays_per_path);
        let with_threads = self.accounts.iter().flatten().map(TaskAccount::streams).sum::<usize>();
        let of_device = self.submitting.0 + self.with_device.streams() + self.with_device.failed();
        let out = with_threads + of_device;
        assert_eq!(streams + out, self.lists.made(), "streams are conserved");
        assert_eq!(in_lists + with_tasks + with_device, self.in_flight, "paths are conserved");
    }
}
