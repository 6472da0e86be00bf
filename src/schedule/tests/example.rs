//! The worked example of the README ("A stream's life"), task by task.

use super::super::pool::Pool;
use super::super::report::{JobReport, Progress};
use super::super::service::prepare;
use super::super::state::{Next, Receiver, State};
use super::super::task::Work;
use super::super::{
    AnyRenderer, Batch, JobError, JobOptions, Lengths, Output, Renderer, ServiceOptions, TaskKind,
};
use super::blind;
use crate::stream::{ChunkScratch, Ray};
use std::sync::{Arc, Mutex};

/// One tile of 2000 rays: 1500 continue at the first hit, 375 of these at the second and none at the third. A payload
/// is a ray's depth and its number among the rays of that depth.
#[derive(Default)]
struct Example {
    emitted: Mutex<[u32; 3]>,
}

impl Example {
    fn emit(&self, out: &mut Output<'_, [u32; 2], u32>, depth: u32) {
        let mut emitted = self.emitted.lock().unwrap();
        out.ray(Ray::default(), [depth, emitted[depth as usize]]);
        emitted[depth as usize] += 1;
    }
}

impl Renderer for Example {
    type Payload = [u32; 2];
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        1
    }

    fn tile_rays(&self) -> usize {
        2000
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, _: u64, out: &mut Output<'_, [u32; 2], u32>) {
        (0..2000).for_each(|_| self.emit(out, 0));
    }

    fn shade(&self, batch: Batch<'_, [u32; 2]>, out: &mut Output<'_, [u32; 2], u32>) {
        for &[depth, number] in batch.payloads {
            let continues = [!number.is_multiple_of(4), number.is_multiple_of(4), false];
            if continues[depth as usize] {
                self.emit(out, depth + 1);
            }
        }
    }

    fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
}

#[derive(Default)]
struct Outbox(Mutex<Option<Result<JobReport, JobError>>>);

impl Receiver for Outbox {
    fn leave(&self, _: Progress) {}

    fn deliver(&self, outcome: Result<JobReport, JobError>) {
        *self.0.lock().unwrap() = Some(outcome);
    }
}

/// Two threads that take their steps in a given order.
struct Threads {
    state: State,
    work: [Option<Arc<dyn Work>>; 2],
    ended: bool,
    pool: Pool,
}

impl Threads {
    /// Does the thread's task, if it has one, and takes the next; returns the thread that is woken.
    fn step(&mut self, thread: usize) -> Option<usize> {
        if let Some(work) = self.work[thread].take() {
            work.work(thread, &mut ChunkScratch::default());
            self.state.finish(thread, 0, None);
        }
        self.work[thread] = match self.state.next(thread, 0) {
            Next::Work(work) => Some(work),
            Next::Sleep => None,
            Next::Exit => unreachable!("the service lives"),
        };
        self.state.check();
        let effects = self.state.take_effects();
        for ended in effects.ended {
            ended.submission.job.retire(&self.pool);
            ended.submission.receiver.deliver(ended.outcome);
            self.ended = true;
        }
        effects.wake[0]
    }
}

#[test]
fn the_example_of_the_readme_happens_as_it_says() {
    let pool = Pool::new(1);
    let outbox = Arc::new(Outbox::default());
    let options = JobOptions { timeline: true, ..JobOptions::default() };
    let renderer = Arc::new(Example::default());
    let receiver = Arc::clone(&outbox) as _;
    let submission =
        prepare(AnyRenderer::new(renderer), blind(), &options, (2, false), &pool, receiver).unwrap();
    let mut state = State::new(&ServiceOptions {
        host_threads: 2,
        device_thread: false,
        max_jobs: 1,
        ..Default::default()
    });
    state.submit(submission, 0);
    let mut threads = Threads { state, work: [None, None], ended: false, pool };

    let steps = [
        // Thread, the one that it wakes, and whether it has a task then.
        (0, None, true),
        (1, None, false),
        (0, Some(1), true),
        (1, None, true),
        (0, None, false),
        (1, None, true),
        (1, Some(0), true),
        (0, None, true),
        (1, None, false),
        (0, None, true),
        (0, None, true),
        (0, None, true),
        (0, None, false),
    ];
    for (index, &(thread, woken, has_task)) in steps.iter().enumerate() {
        assert!(!threads.ended);
        assert_eq!(threads.step(thread), woken, "step {index}");
        assert_eq!(threads.work[thread].is_some(), has_task, "step {index}");
    }
    assert!(threads.ended);

    let report = outbox.0.lock().unwrap().take().unwrap().unwrap();
    assert_eq!((report.limits.threshold, report.streams), (1024, 2));
    let lists = |need_more, trace, shade| [need_more, trace, shade];
    let expected = [
        (0, TaskKind::Spawn, 2000, lists(0, 1, 0)),
        (0, TaskKind::Trace, 1000, lists(0, 0, 0)),
        (1, TaskKind::Trace, 1000, lists(0, 0, 1)),
        (1, TaskKind::Shade, 2000, lists(0, 1, 0)),
        (1, TaskKind::Trace, 750, lists(0, 0, 0)),
        (0, TaskKind::Trace, 750, lists(0, 0, 1)),
        (0, TaskKind::Shade, 1500, lists(1, 0, 0)),
        (0, TaskKind::Trace, 375, lists(0, 0, 1)),
        (0, TaskKind::Shade, 375, lists(0, 0, 0)),
    ];
    let tasks = report.timeline.iter().map(|task| {
        let Lengths { need_more, trace, shade, .. } = task.lists;
        (task.thread, task.kind, task.rays, [need_more, trace, shade])
    });
    assert!(tasks.eq(expected), "{:?}", report.timeline);
}
