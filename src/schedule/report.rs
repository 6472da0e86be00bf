//! What a job tells about itself, during and after.

use super::Limits;

/// How far a job is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Tiles in all.
    pub tiles: u64,
    /// Tiles whose camera rays have been emitted.
    pub tiles_spawned: u64,
    /// Paths in flight.
    pub in_flight: u64,
    /// Most rays of a tile.
    pub tile_rays: u64,
    /// Rays emitted so far.
    pub rays: RayCounts,
    /// Rays and shadow rays traced by host threads.
    pub cpu_rays: u64,
    /// Rays and shadow rays traced by the device.
    pub gpu_rays: u64,
}

impl Progress {
    /// Tiles done, fewer than are spawned by as many as the paths in flight would fill; exact at the
    /// end.
    pub fn tiles_done(&self) -> u64 {
        self.tiles_spawned.saturating_sub(self.in_flight.div_ceil(self.tile_rays.max(1)))
    }

    /// Rays and shadow rays traced.
    pub fn rays_traced(&self) -> u64 {
        self.cpu_rays + self.gpu_rays
    }
}

/// Rays emitted, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// Rays that tiles spawned.
    pub camera: u64,
    /// Rays that shading emitted.
    pub continuation: u64,
    /// Shadow rays, of tiles and of shading.
    pub shadow: u64,
}

impl RayCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.camera + self.continuation + self.shadow
    }
}

/// What a unit did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnitReport {
    /// Rays and shadow rays traced.
    pub rays: u64,
    /// Seconds spent tracing, added up over threads.
    pub busy_s: f64,
    /// Bytes copied between host and device memory.
    pub bytes_copied: u64,
    /// Rays whose device answer a rounding error could have changed.
    pub flagged: u64,
    /// Rays traced again by the canonical test.
    pub retraced: u64,
    /// Rays of the device traced again by the CPU as a check.
    pub checked: u64,
    /// Of `busy_s`, seconds until streams were submitted to the device.
    pub sending_s: f64,
    /// Of `busy_s`, seconds from there until answers could be read.
    pub waiting_s: f64,
}

/// What kind of thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThreadKind {
    /// Spawns, shades and traces.
    Host,
    /// Feeds a device.
    Dispatch,
}

/// What a thread did during a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadReport {
    /// What kind of thread.
    pub kind: ThreadKind,
    /// Seconds in this job's tasks.
    pub busy_s: f64,
    /// Seconds suspended while the job ran. What is left of the job's time is other jobs' and the
    /// scheduler's own.
    pub idle_s: f64,
}

/// What kind of task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskKind {
    /// Emitting the camera rays of a tile.
    Spawn,
    /// Shading.
    Shade,
    /// Tracing a chunk on a host thread.
    Trace,
    /// Tracing a stream on the device.
    Dispatch,
}

/// One task of a timeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskRecord {
    /// The thread: host threads come first.
    pub thread: u32,
    /// What it did.
    pub kind: TaskKind,
    /// Rays and shadow rays: emitted by a spawn task, traced, or shaded and answered.
    pub rays: u32,
    /// When it began, in nanoseconds since the job began.
    pub start_ns: u64,
    /// When it ended, in nanoseconds since the job began.
    pub end_ns: u64,
}

/// What a job did. Only the counts of rays by kind are the same in every run.
#[derive(Clone, Debug, PartialEq)]
pub struct JobReport {
    /// Whether the job was stopped before all its tiles were spawned.
    pub stopped: bool,
    /// Tiles in all.
    pub tiles: u64,
    /// Tiles spawned.
    pub tiles_spawned: u64,
    /// Rays emitted, and so traced.
    pub rays: RayCounts,
    /// The host threads as a unit.
    pub cpu: UnitReport,
    /// The device.
    pub gpu: UnitReport,
    /// Host threads, then dispatch threads.
    pub threads: Vec<ThreadReport>,
    /// When its first turn came, in nanoseconds since the service began.
    pub begin_ns: u64,
    /// Seconds from the job's first turn to its end.
    pub wall_s: f64,
    /// Seconds the job waited for its turn.
    pub waited_s: f64,
    /// Share of the host threads' time that was idle after the last tile had been spawned, 0 to 1.
    pub tail_idle_share: f64,
    /// The most paths that were in flight, a tile under way counted in full; at most
    /// `limits.in_flight`.
    pub max_in_flight: usize,
    /// Streams the job had, those left by an earlier one included; at most `limits.streams`.
    pub streams: usize,
    /// The sizes used.
    pub limits: Limits,
    /// What a user should know: a lost device, for instance.
    pub events: Vec<String>,
    /// Every task in the order in which they ended, when asked for.
    pub timeline: Vec<TaskRecord>,
}
