//! What a job reports, while it runs and afterwards.

use super::{DeviceWaits, JobOptions, Limits, Pace};
use std::sync::Arc;

/// Progress of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Tiles in all.
    pub tiles: u64,
    /// Tiles whose camera rays have been emitted.
    pub tiles_spawned: u64,
    /// Paths in flight.
    pub in_flight: u64,
    /// The most rays of a tile.
    pub tile_rays: u64,
    /// Rays emitted so far.
    pub rays: RayCounts,
    /// Rays and shadow rays traced by host threads.
    pub cpu_rays: u64,
    /// Rays and shadow rays traced by the device.
    pub gpu_rays: u64,
}

impl Progress {
    /// Tiles done: those spawned, less as many as the paths in flight would fill. Exact at the end.
    pub fn tiles_done(&self) -> u64 {
        self.tiles_spawned.saturating_sub(self.in_flight.div_ceil(self.tile_rays.max(1)))
    }

    /// Rays and shadow rays traced.
    pub fn rays_traced(&self) -> u64 {
        self.cpu_rays + self.gpu_rays
    }
}

/// Rays emitted, by kind: the same in every run of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// Rays that were spawned.
    pub camera: u64,
    /// Rays that shading emitted.
    pub continuation: u64,
    /// Shadow rays, spawned or emitted by shading.
    pub shadow: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.camera += other.camera;
        self.continuation += other.continuation;
        self.shadow += other.shadow;
    }
}

impl RayCounts {
    /// Rays of all kinds.
    pub fn total(&self) -> u64 {
        self.camera + self.continuation + self.shadow
    }
}

/// Number of depths that are counted separately; the last also counts all deeper rays.
pub const DEPTHS: usize = 16;

/// Rays whose nearest hit was shaded, by depth ([`super::Renderer::depth`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Depths(pub [u64; DEPTHS]);

impl Default for Depths {
    fn default() -> Self {
        Self([0; DEPTHS])
    }
}

impl Depths {
    /// Counts rays. Consecutive rays mostly have the same depth, which is what this is quick for.
    #[inline]
    pub(super) fn count(&mut self, depths: impl Iterator<Item = u32>) {
        let (mut last, mut run) = (0, 0);
        for depth in depths {
            if depth != last {
                self.0[(last as usize).min(DEPTHS - 1)] += std::mem::take(&mut run);
                last = depth;
            }
            run += 1;
        }
        self.0[(last as usize).min(DEPTHS - 1)] += run;
    }

    /// The counts down to the deepest ray.
    pub fn used(&self) -> &[u64] {
        let len = self.0.iter().rposition(|&rays| rays > 0).map_or(0, |deepest| deepest + 1);
        &self.0[..len]
    }
}

impl std::ops::AddAssign for Depths {
    fn add_assign(&mut self, other: Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, rays)| *sum += rays);
    }
}

/// Account of a unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnitReport {
    /// Rays and shadow rays traced.
    pub rays: u64,
    /// Seconds spent tracing, added up over threads. For a device, seconds in which it had a bundle.
    pub busy_s: f64,
    /// Bytes copied between host and device memory.
    pub bytes_copied: u64,
    /// Rays whose device answer a rounding error could have changed.
    pub flagged: u64,
    /// Rays traced again by the canonical test.
    pub retraced: u64,
    /// Rays among those whose candidates a filter decides about, as far as the device says so.
    pub masked: u64,
    /// Rays that the CPU traced again to check the device.
    pub checked: u64,
    /// CPU seconds in which the device thread submitted bundles; on systems other than Linux those of the clock.
    pub sending_s: f64,
    /// Seconds from the submission of bundles until they were traced, added up over bundles.
    pub waiting_s: f64,
    /// CPU seconds in which host threads made answers of what the device had written, counted likewise.
    pub resolving_s: f64,
}

/// Kind of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ThreadKind {
    /// Spawns, shades and traces.
    Host,
    /// Submits bundles to devices and waits for them.
    Device,
    /// The thread that asked a query and traced it itself ([`JobOptions::caller_rays`]).
    Caller,
}

impl ThreadKind {
    /// The kind of a thread of a service, whose first `hosts` threads are host threads.
    pub(super) fn of(thread: usize, hosts: usize) -> Self {
        if thread < hosts { Self::Host } else { Self::Device }
    }
}

/// Account of a thread during a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadReport {
    /// The kind of thread.
    pub kind: ThreadKind,
    /// Seconds in this job's tasks.
    pub busy_s: f64,
    /// Seconds suspended while the job ran. The rest of the job's time went to other jobs and to the scheduler.
    pub idle_s: f64,
    /// Seconds of `idle_s` after the last tile had been spawned.
    pub tail_idle_s: f64,
}

/// Kind of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TaskKind {
    /// Emitting the camera rays of a tile.
    Spawn,
    /// Shading.
    Shade,
    /// Tracing a chunk on a host thread.
    Trace,
    /// Tracing a bundle on the device: from the answer before, or from the bundle's submission if that was later.
    Dispatch,
    /// Making the answers of a stream that the device has traced.
    Resolve,
}

/// One task of a timeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskRecord {
    /// Index of the thread; the device thread comes last.
    pub thread: u32,
    /// The kind of task.
    pub kind: TaskKind,
    /// Rays and shadow rays that the task emitted (spawn), traced (trace, dispatch), resolved or shaded.
    pub rays: u32,
    /// Begin of the task, in nanoseconds since the job began.
    pub start_ns: u64,
    /// End of the task, in nanoseconds since the job began.
    pub end_ns: u64,
    /// The job's lists when the task ended.
    pub lists: Lengths,
}

/// Numbers of streams in a job's lists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lengths {
    /// In NEEDMORE.
    pub need_more: u16,
    /// In TRACE.
    pub trace: u16,
    /// In SHADE.
    pub shade: u16,
    /// Paths in flight, wherever they are.
    pub in_flight: u32,
}

/// Account of a job. Only the counts of rays (`rays` and `depths`) are the same in every run.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct JobReport {
    /// The job's name ([`JobOptions::name`]).
    pub name: Option<Arc<str>>,
    /// True if the job was stopped before all its tiles were spawned.
    pub stopped: bool,
    /// Tiles in all.
    pub tiles: u64,
    /// Tiles spawned.
    pub tiles_spawned: u64,
    /// Rays emitted, and so traced.
    pub rays: RayCounts,
    /// Rays without shadow rays, by depth.
    pub depths: Depths,
    /// The host threads, or the calling thread, as a unit.
    pub cpu: UnitReport,
    /// The device.
    pub gpu: UnitReport,
    /// Waiting times of streams for the device.
    pub device_waits: DeviceWaits,
    /// The pace at which host threads shaded, shadow rays included.
    pub shading: Pace,
    /// Host threads, then the device thread; or the calling thread alone, if it has traced the query itself.
    pub threads: Vec<ThreadReport>,
    /// Time of admission, in nanoseconds since the service began.
    pub begin_ns: u64,
    /// Seconds from there to the job's end.
    pub wall_s: f64,
    /// Seconds from the job's submission until it was admitted.
    pub waited_s: f64,
    /// Share of the host threads' time after the last tile had been spawned that they were suspended, 0 to 1.
    pub tail_idle_share: f64,
    /// Seconds from the last tile's spawning to the end.
    pub tail_s: f64,
    /// The most paths that were in flight, counting a tile under way in full; at most `limits.in_flight`.
    pub max_in_flight: usize,
    /// Streams of the job, including those that an earlier job had left; at most `limits.streams`.
    pub streams: usize,
    /// Bytes of a stream that is full to its capacity, including payloads and answers. Streams are allocated as they
    /// are needed, so the job's rays took at most `streams` times this.
    pub stream_bytes: usize,
    /// The sizes used.
    pub limits: Limits,
    /// Sentences for the user, of a lost device for instance.
    pub events: Vec<String>,
    /// The renderer's remarks on its result ([`super::Renderer::warnings`]): dropped splats, for instance.
    pub warnings: Vec<String>,
    /// All tasks in the order in which they ended, if [`JobOptions::timeline`] asks for them.
    pub timeline: Vec<TaskRecord>,
}

impl JobReport {
    /// Of a job that has done nothing yet.
    pub(super) fn new(options: &JobOptions, limits: Limits, tiles: u64, events: Vec<String>) -> Self {
        Self {
            name: options.name.clone(),
            stopped: false,
            tiles,
            tiles_spawned: 0,
            rays: Default::default(),
            depths: Default::default(),
            cpu: Default::default(),
            gpu: Default::default(),
            device_waits: Default::default(),
            shading: Default::default(),
            threads: Vec::new(),
            begin_ns: 0,
            wall_s: 0.0,
            waited_s: 0.0,
            tail_idle_share: 0.0,
            tail_s: 0.0,
            max_in_flight: 0,
            streams: 0,
            stream_bytes: 0,
            limits,
            events,
            warnings: Vec::new(),
            timeline: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_counted_whatever_their_order() {
        let mut depths = Depths::default();
        assert!(depths.used().is_empty());
        depths.count([0, 0, 2, 2, 2, 1, 0, 999].into_iter());
        depths.count(std::iter::empty());
        assert_eq!(depths.used()[..3], [3, 1, 3]);
        assert_eq!((depths.used().len(), depths.0[DEPTHS - 1]), (DEPTHS, 1));
    }
}
