//! Queries of few rays, which the calling thread traces itself: waking another thread would take longer.

use super::limits::Demand;
use super::queries::{Answer, Query};
use super::report::{
    JobReport, Progress, RayCounts, TaskKind, TaskRecord, ThreadKind, ThreadReport, UnitReport,
};
use super::result::ResultSlot;
use super::service::unit_used;
use super::{
    JobControl, JobError, JobHandle, JobOptions, Lengths, Limits, LimitsError, Priority, QueryHandle,
    Service, Tracers, Unit,
};
use crate::stream::Ray;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

impl Service {
    /// True if the calling thread is to trace a query. A background query must not take a processor from others; a
    /// query for the device alone is the device's.
    pub(super) fn is_for_caller(&self, tracers: &Tracers, rays: usize, options: &JobOptions) -> bool {
        rays <= options.caller_rays
            && options.priority != Priority::Background
            && unit_used(tracers, "", self.inner.threads().1).0 != Unit::Gpu
    }

    /// Answers a query on the calling thread.
    pub(super) fn trace_here<A: Answer>(
        &self,
        tracers: &Tracers,
        rays: &[Ray],
        mut answers: Vec<A>,
        options: &JobOptions,
    ) -> Result<QueryHandle<A>, LimitsError> {
        let (limits, events) = self.limits_here(tracers, rays.len(), options)?;
        let start_ns = self.inner.now_ns();
        answers.clear();
        answers.resize(rays.len(), A::default());
        let traced = catch_unwind(AssertUnwindSafe(|| A::trace(&*tracers.host, rays, &mut answers)));
        let end_ns = self.inner.now_ns();
        let count = rays.len() as u64;
        let rays = A::count(count);
        let mut progress =
            Progress { tiles: u64::from(count > 0), tile_rays: count.max(1), ..Progress::default() };
        let outcome = match traced {
            Ok(()) => {
                progress = Progress { tiles_spawned: progress.tiles, rays, cpu_rays: count, ..progress };
                Ok(report(
                    JobReport::new(options, limits, progress.tiles, events),
                    rays,
                    (start_ns, end_ns),
                    options,
                ))
            }
            Err(thrown) => Err(JobError::of(thrown, options.name.clone())),
        };
        let result = Arc::new(ResultSlot::delivered(progress, outcome));
        let control = JobControl::new(None, options.name.clone(), Arc::clone(&self.inner), result);
        Ok(QueryHandle::new(JobHandle::new(control), Arc::new(Query::answered(answers))))
    }

    /// The sizes that the query would have in the lists, and what there is to say about its unit.
    fn limits_here(
        &self,
        tracers: &Tracers,
        rays: usize,
        options: &JobOptions,
    ) -> Result<(Limits, Vec<String>), LimitsError> {
        let (host_threads, device_thread) = self.inner.threads();
        let (_, event) =
            unit_used(tracers, tracers.device.as_ref().map_or("", |device| device.name()), device_thread);
        let demand = Demand {
            tiles: u64::from(rays > 0),
            tile_rays: rays.max(1),
            shadow_rays_per_ray: 0,
            most_in_flight: usize::MAX,
            host_threads,
            has_device: false,
            bundle_rays: None,
        };
        Ok((Limits::derive(options, demand)?, event.into_iter().collect()))
    }
}

/// The report of a query that the calling thread has traced between two times.
fn report(
    empty: JobReport,
    rays: RayCounts,
    (start_ns, end_ns): (u64, u64),
    options: &JobOptions,
) -> JobReport {
    let (seconds, count) = ((end_ns - start_ns) as f64 * 1e-9, rays.total());
    let record = TaskRecord {
        thread: 0,
        kind: TaskKind::Trace,
        rays: count as u32,
        start_ns: 0,
        end_ns: end_ns - start_ns,
        lists: Lengths::default(),
    };
    JobReport {
        tiles_spawned: empty.tiles,
        rays,
        cpu: UnitReport { rays: count, busy_s: seconds, ..UnitReport::default() },
        threads: vec![ThreadReport {
            kind: ThreadKind::Caller,
            busy_s: seconds,
            idle_s: 0.0,
            tail_idle_s: 0.0,
        }],
        begin_ns: start_ns,
        wall_s: seconds,
        timeline: if options.timeline { vec![record] } else { Vec::new() },
        ..empty
    }
}
