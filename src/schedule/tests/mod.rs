//! Tests of the whole scheduler: simulated interleavings, then real threads.

mod example;
mod gated;
mod head_start;
mod ledger;
mod lifecycle;
mod policy;
mod queries;
mod scope;
mod simulator;
mod steering;
mod threads;
mod virtual_time;
mod workers;

use super::{JobError, JobHandle, JobOptions, JobReport, Priority, Service, ServiceOptions};
use ledger::Script;
use std::time::Duration;

pub use gated::{Gated, blind, wait_until};

const SCRIPT: Script =
    Script { seed: 1, tiles: 40, tile_rays: 300, max_depth: 6, shadow_rays_per_ray: 2, panic_at: None };

const SMALL: JobOptions = JobOptions {
    name: None,
    priority: Priority::Normal,
    in_flight: Some(3000),
    threshold: Some(400),
    batch_rays: 200,
    chunk_rays: 64,
    chunk_rays_most: 500,
    caller_rays: 0,
    shrink_streams: true,
    policy: None,
    timeline: true,
};

fn service(host_threads: usize, device_thread: bool) -> Service {
    let options = ServiceOptions { host_threads, device_thread, max_jobs: 3, ..Default::default() };
    Service::new(options).unwrap()
}

/// Waits for a job, for at most a minute.
fn outcome(job: JobHandle) -> Result<JobReport, JobError> {
    assert!(job.wait_for(Duration::from_secs(60)), "the job hangs: {:?}", job.progress());
    job.wait()
}
