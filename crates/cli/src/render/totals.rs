//! Totals over the jobs of a command.

use crate::events::Events;
use crate::setup::Setup;
use crate::stats::{MemoryStats, ThreadStats, Units};
use crate::timeline::{Curve, Timeline, thread_names};
use raystream::meters::Series;
use raystream::schedule::{Depths, JobReport, RayCounts, TaskRecord, ThreadKind, ThreadReport};
use std::collections::BTreeMap;
use std::time::Instant;

/// Sums over jobs of one service, whether they ran in sequence or at the same time.
#[derive(Default)]
pub struct Totals {
    pub rays: RayCounts,
    pub units: Units,
    pub events: Events,
    /// Energy by meter, in joules.
    pub joules: BTreeMap<String, f64>,
    /// Maximum paths in flight of any job.
    pub peak_rays_in_flight: usize,
    /// Maximum bytes of any job's ray streams.
    pub stream_bytes: usize,
    /// Rays traced by depth.
    pub depths: Depths,
    /// Idle share of the tail of the job that ended last.
    pub tail_idle_share: f64,
    /// Length of that tail in seconds.
    pub tail_s: f64,
    /// Number of jobs.
    pub jobs: usize,
    /// All tasks, one job after the other, in nanoseconds since the service began.
    tasks: Vec<TaskRecord>,
    /// Busy time by thread.
    pub threads: Vec<ThreadReport>,
    begin_ns: Option<u64>,
    end_ns: u64,
}

impl Totals {
    /// Adds a job.
    pub fn add(&mut self, report: &JobReport) {
        self.begin_ns = Some(self.begin_ns.map_or(report.begin_ns, |begin_ns| begin_ns.min(report.begin_ns)));
        self.end_ns = self.end_ns.max(report.begin_ns + (report.wall_s * 1e9) as u64);
        self.rays.camera += report.rays.camera;
        self.rays.continuation += report.rays.continuation;
        self.rays.shadow += report.rays.shadow;
        self.units.add(report);
        self.events.recover(report.events.iter().cloned());
        self.peak_rays_in_flight = self.peak_rays_in_flight.max(report.max_in_flight);
        self.stream_bytes = self.stream_bytes.max(report.streams * report.stream_bytes);
        self.depths += report.depths;
        self.tail_idle_share = report.tail_idle_share;
        self.tail_s = report.tail_s;
        self.jobs += 1;
        self.tasks.extend(report.timeline.iter().map(|task| {
            let (start_ns, end_ns) = (task.start_ns + report.begin_ns, task.end_ns + report.begin_ns);
            TaskRecord { start_ns, end_ns, ..*task }
        }));
        if self.threads.is_empty() {
            self.threads.clone_from(&report.threads);
        } else {
            for (sum, thread) in self.threads.iter_mut().zip(&report.threads) {
                sum.busy_s += thread.busy_s;
                sum.tail_idle_s = thread.tail_idle_s;
            }
        }
    }

    /// Memory use: the shared tree and the ray streams.
    pub fn memory(&self, setup: &Setup) -> MemoryStats {
        let (tree_bytes, triangles) = (setup.prepared.bvh.bytes(), setup.prepared.scene.mesh.triangles.len());
        MemoryStats::of(tree_bytes, triangles, self.stream_bytes, self.peak_rays_in_flight)
    }

    /// Seconds from the first job's start to the last job's end.
    pub fn wall_s(&self) -> f64 {
        (self.end_ns - self.begin_ns.unwrap_or(self.end_ns)) as f64 * 1e-9
    }

    /// The timeline of all tasks, with the curves recorded meanwhile.
    pub fn timeline(&self, setup: &Setup, recorded: Vec<Series>) -> Timeline {
        let begin_ns = self.begin_ns.unwrap_or(0);
        let task = |task: &TaskRecord| {
            let (start_ns, end_ns) = (task.start_ns - begin_ns, task.end_ns - begin_ns);
            TaskRecord { start_ns, end_ns, ..*task }
        };
        let began = setup.service.began();
        let curve = |series: Series| {
            let since = |at: Instant| at.saturating_duration_since(began).as_nanos() as u64;
            let points: Vec<_> = series.points.iter().map(|&(at, number)| (since(at), number)).collect();
            // The last reading before the start holds at the start.
            let first = points.iter().rposition(|point| point.0 <= begin_ns).unwrap_or(0);
            let during = points[first..].iter().take_while(|point| point.0 <= self.end_ns);
            let points = during.map(|&(at_ns, number)| (at_ns.saturating_sub(begin_ns), number)).collect();
            Curve { name: series.name, unit: series.unit, points }
        };
        Timeline {
            threads: thread_names(&self.threads),
            tasks: self.tasks.iter().map(task).collect(),
            is_one_job: self.jobs == 1,
            curves: recorded.into_iter().map(curve).filter(|curve| !curve.points.is_empty()).collect(),
        }
    }

    /// Busy and idle time by thread, over all jobs.
    pub fn thread_stats(&self) -> Vec<ThreadStats> {
        let wall_s = self.wall_s();
        let idle_s = |thread: &ThreadReport| (wall_s - thread.busy_s).max(0.0);
        self.threads
            .iter()
            .map(|thread| ThreadStats { idle_s: idle_s(thread), ..ThreadStats::of(thread) })
            .collect()
    }

    /// Share of the host threads' time spent on tasks.
    pub fn busy_share(&self) -> f64 {
        let hosts = || self.threads.iter().filter(|thread| thread.kind == ThreadKind::Host);
        let busy_s: f64 = hosts().map(|thread| thread.busy_s).sum();
        busy_s / (hosts().count() as f64 * self.wall_s()).max(f64::MIN_POSITIVE)
    }
}
