//! Small jobs beside large ones, on the state machine itself.

use super::super::pool::Pool;
use super::super::report::{JobReport, Progress};
use super::super::result::JobError;
use super::super::service::prepare;
use super::super::state::{JobId, Next, Receiver, State, Submission};
use super::super::{AnyRenderer, JobOptions, ServiceOptions, Tracers};
use super::SCRIPT;
use super::ledger::{Ledger, Script};
use crate::stream::ChunkScratch;
use std::sync::Arc;

struct Nobody;

impl Receiver for Nobody {
    fn leave(&self, _: Progress) {}

    fn deliver(&self, _: Result<JobReport, JobError>) {}
}

/// A service of one host thread.
struct OneThread {
    state: State,
    pool: Pool,
    scratch: ChunkScratch,
}

impl OneThread {
    fn new() -> Self {
        let options = ServiceOptions { host_threads: 1, device_thread: false, ..Default::default() };
        Self { state: State::new(&options), pool: Pool::new(2), scratch: ChunkScratch::default() }
    }

    fn submit(&mut self, tiles: u64, tile_rays: usize) -> JobId {
        let ledger = Ledger::new(Script { tiles, tile_rays, ..SCRIPT });
        let tracers = Tracers::cpu(Arc::clone(&ledger) as _);
        let options = JobOptions::default().with_caller_rays(0);
        let job =
            prepare(AnyRenderer::new(ledger), tracers, &options, (1, false), &self.pool, Arc::new(Nobody))
                .expect("it fits");
        self.state.submit(Submission { is_query: true, ..job }, 0)
    }

    /// Does tasks until a job has ended, at most so many. Returns how many.
    fn tasks_until(&mut self, job: JobId, most: usize) -> usize {
        for tasks in 0..most {
            if self.state.progress(job).is_none() {
                return tasks;
            }
            let Next::Work(work) = self.state.next(0, 0) else { panic!("there is work") };
            work.work(0, &mut self.scratch);
            self.state.finish(0, 0, None);
            for ended in self.state.take_effects().ended {
                ended.submission.job.retire(&self.pool);
            }
        }
        most
    }
}

#[test]
fn a_small_job_does_not_wait_for_a_turn() {
    // The least that one job of a few rays takes.
    let mut alone = OneThread::new();
    let small = alone.submit(1, 4);
    let least = alone.tasks_until(small, 1000);

    let mut thread = OneThread::new();
    let large = [thread.submit(10_000, 300), thread.submit(10_000, 300)];
    assert_eq!(thread.tasks_until(large[0], 300), 300, "it is larger than that");
    for _ in 0..50 {
        let small = thread.submit(1, 4);
        let tasks = thread.tasks_until(small, 1000);
        assert!(tasks <= least, "{tasks} tasks until a job has ended that takes {least}");
    }
}
