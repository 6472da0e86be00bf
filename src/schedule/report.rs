//! What a job tells about itself, during and after.

use super::{DeviceWaits, Limits};

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

/// Depths that are counted apart; the last stands for all beyond.
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
    /// Counts one ray after the other; those of one depth mostly follow each other.
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

    /// Down to the deepest ray.
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
    /// Seconds of these after the last tile had been spawned.
    pub tail_idle_s: f64,
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
    /// The job's lists then.
    pub lists: Lengths,
}

/// How many streams are in a job's lists.
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
    /// Rays but for shadow rays, by depth.
    pub depths: Depths,
    /// The host threads as a unit.
    pub cpu: UnitReport,
    /// The device.
    pub gpu: UnitReport,
    /// How long streams waited for it.
    pub device_waits: DeviceWaits,
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
    /// Seconds from then to the end.
    pub tail_s: f64,
    /// The most paths that were in flight, a tile under way counted in full; at most
    /// `limits.in_flight`.
    pub max_in_flight: usize,
    /// Streams the job had, those left by an earlier one included; at most `limits.streams`.
    pub streams: usize,
    /// Bytes of a stream that is full to its capacity, payloads and answers included. Streams are made as
    /// they are needed, so the job's rays took at most `streams` times that.
    pub stream_bytes: usize,
    /// The sizes used.
    pub limits: Limits,
    /// What a user should know: a lost device, for instance.
    pub events: Vec<String>,
    /// Every task in the order in which they ended, when asked for.
    pub timeline: Vec<TaskRecord>,
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
