//! How fast a live view is, and what its threads do.

use raystream::schedule::{JobReport, TaskKind, ThreadKind};
use serde::Serialize;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The most tasks of a timeline; of more, the longest.
const MOST_TASKS: usize = 600;

/// The most samples of list lengths of a timeline.
const MOST_LISTS: usize = 120;

/// The time over which the frame rate is taken.
const WINDOW: Duration = Duration::from_secs(1);

/// The state of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum State {
    /// It follows the camera.
    Moving,
    /// It takes more samples of the full picture.
    Refining,
    /// It has all samples.
    Done,
}

/// Rays and shadow rays that each unit traced, per second of the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RaysPerSecond {
    /// Host threads.
    pub cpu: f64,
    /// The device.
    pub gpu: f64,
}

/// The share that one of the machines has in a view's moving frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct WorkerShare {
    /// Its name.
    pub name: String,
    /// `ready`; `late` if it has missed the last deadline; `away` if it has not read the scene, refuses, or does not
    /// answer.
    pub state: &'static str,
    /// Rows of its last tile.
    pub rows: u32,
    /// Milliseconds of its last tile, from the question to the answer.
    pub ms: f64,
    /// Tiles that came in time.
    pub tiles: u64,
    /// Tiles that did not.
    pub late: u64,
    /// Bytes of its tiles.
    pub bytes: u64,
}

/// The state and the speed of a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Statistics {
    /// The generation of the last frame.
    pub generation: u32,
    /// The state of the view.
    pub state: State,
    /// Moving frames of the last second; 0 while the camera rests.
    pub frames_per_second: f64,
    /// Share of the full width and height that moving frames have.
    pub share: f64,
    /// Mean samples of a pixel.
    pub spp: f64,
    /// Samples of a pixel when the picture is done.
    pub target_spp: u32,
    /// Milliseconds since the last change.
    pub elapsed_ms: u64,
    /// Rays per second.
    pub rays_per_second: RaysPerSecond,
    /// Name of the policy in use.
    pub policy: &'static str,
    /// Splats that were dropped.
    pub dropped_splats: u64,
    /// The machines that render moving frames, the coordinator first. Empty without workers on other machines.
    pub workers: Vec<WorkerShare>,
}

/// The number of streams in each list, and of paths in flight, at a time of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Lists {
    /// Microseconds since the frame began.
    pub time_us: u64,
    /// In none of the other lists: in EMPTY, or with a thread.
    pub empty: u32,
    /// In NEEDMORE.
    pub need_more: u32,
    /// In TRACE.
    pub trace: u32,
    /// In SHADE.
    pub shade: u32,
    /// Paths in flight.
    pub in_flight: u32,
}

/// The tasks of the threads and the lists of streams during a frame or a pass.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Timeline {
    /// Microseconds that the frame took.
    pub wall_us: u64,
    /// Names of the threads.
    pub threads: Vec<String>,
    /// Tasks: thread, kind (0 spawn, 1 shade, 2 trace, 3 dispatch), begin and end in microseconds since the frame
    /// began, rays.
    pub tasks: Vec<(u32, u8, u64, u64, u32)>,
    /// The lists over time.
    pub lists: Vec<Lists>,
}

impl Timeline {
    /// The timeline of a job.
    pub(super) fn of(report: &JobReport) -> Self {
        let micros = |ns: u64| ns / 1000;
        let name = |(index, kind): (usize, ThreadKind)| match kind {
            ThreadKind::Device => "device".to_owned(),
            _ => format!("host {index}"),
        };
        let threads = report.threads.iter().map(|thread| thread.kind).enumerate().map(name).collect();
        let kind = |kind| match kind {
            TaskKind::Spawn => 0,
            TaskKind::Shade => 1,
            TaskKind::Trace => 2,
            TaskKind::Dispatch => 3,
            TaskKind::Resolve => 4,
            _ => 5,
        };
        let mut tasks: Vec<_> = report
            .timeline
            .iter()
            .map(|task| (task.thread, kind(task.kind), micros(task.start_ns), micros(task.end_ns), task.rays))
            .collect();
        if tasks.len() > MOST_TASKS {
            tasks.sort_unstable_by_key(|&(_, _, start, end, _)| std::cmp::Reverse(end.saturating_sub(start)));
            tasks.truncate(MOST_TASKS);
            tasks.sort_unstable_by_key(|task| task.2);
        }
        let streams = report.streams as u32;
        let step = report.timeline.len().div_ceil(MOST_LISTS).max(1);
        let lists = report.timeline.iter().step_by(step).map(|task| {
            let [need_more, trace, shade] =
                [task.lists.need_more, task.lists.trace, task.lists.shade].map(u32::from);
            let empty = streams.saturating_sub(need_more + trace + shade);
            let in_flight = task.lists.in_flight;
            Lists { time_us: micros(task.end_ns), empty, need_more, trace, shade, in_flight }
        });
        Self { wall_us: (report.wall_s * 1e6) as u64, threads, tasks, lists: lists.collect() }
    }
}

/// Rays per second of a job.
pub(super) fn rays_per_second(report: &JobReport) -> RaysPerSecond {
    let of = |rays: u64| if report.wall_s > 0.0 { rays as f64 / report.wall_s } else { 0.0 };
    RaysPerSecond { cpu: of(report.cpu.rays), gpu: of(report.gpu.rays) }
}

/// Counts moving frames.
#[derive(Debug, Default)]
pub(super) struct FrameRate(VecDeque<Instant>);

impl FrameRate {
    /// Counts a frame.
    pub fn count(&mut self, now: Instant) {
        self.0.push_back(now);
        self.forget(now);
    }

    /// Frames per second over the last second; 0 if there was at most one frame.
    pub fn per_second(&mut self, now: Instant) -> f64 {
        self.forget(now);
        match (self.0.front(), self.0.back()) {
            (Some(&first), Some(&last)) if last > first => {
                (self.0.len() - 1) as f64 / (last - first).as_secs_f64()
            }
            _ => 0.0,
        }
    }

    fn forget(&mut self, now: Instant) {
        while self.0.front().is_some_and(|&at| now.saturating_duration_since(at) > WINDOW) {
            self.0.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_rate_is_that_of_the_last_second() {
        let (mut rate, start) = (FrameRate::default(), Instant::now());
        assert_eq!(rate.per_second(start), 0.0);
        for frame in 0..40 {
            rate.count(start + Duration::from_millis(50 * frame));
        }
        let end = start + Duration::from_millis(50 * 39);
        assert!((rate.per_second(end) - 20.0).abs() < 0.01);
        assert_eq!(rate.per_second(end + Duration::from_secs(3)), 0.0);
    }
}
