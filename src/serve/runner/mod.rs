//! Works on jobs: a few threads, each with one unit at a time, all on the same scheduler.
//!
//! A unit is a range of samples of a frame. Its partial film is on the disk before the ledger knows of it, and the
//! films of a frame are added up once all are there. So whatever ends the process, the ledger never knows of a film
//! that is not there, and no sample is counted twice.

mod fair;
mod results;
mod task;
mod units;
mod watch;

pub use results::PICTURE;

use super::ledger::{Job, JobState, Ledger, LedgerError, UnitRow};
use super::store::Store;
use super::{Limits, Pictures, SceneReader};
use crate::schedule::Priority;
use fair::Candidate;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;
use task::Task;
use watch::UnitWatch;

/// Units under way at the same time: while the last paths of one end, others keep the threads busy.
const UNITS_IN_FLIGHT: usize = 3;

/// Tasks under way at the same time. Those beyond [`UNITS_IN_FLIGHT`] are for jobs with none: a job does not wait for
/// the long units of others, and the scheduler shares the processors.
const TASKS_IN_FLIGHT: usize = 8;

/// Active jobs that are looked at for the next unit.
const LOOKED_AT: usize = 64;

/// How long a thread sleeps that finds nothing to do, unless it is woken; and after the disk or ledger has refused.
const NAP: Duration = Duration::from_secs(2);

/// Works on jobs.
pub struct Runner {
    pub(super) ledger: Arc<Ledger>,
    pub(super) store: Arc<Store>,
    pub(super) reader: SceneReader,
    pub(super) limits: Limits,
    state: Mutex<State>,
    changed: Condvar,
    ending: AtomicBool,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

/// What is under way.
#[derive(Default)]
struct State {
    runs: HashMap<String, Run>,
    /// Counts calls of [`Runner::wake`].
    wakes: u64,
}

/// A job that is worked on.
#[derive(Default)]
struct Run {
    given: u64,
    /// The tasks under way: which, and what steers it.
    tasks: Vec<(TaskKey, Arc<UnitWatch>)>,
}

/// What a thread can do for a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TaskKey {
    Plan,
    Unit { frame: u32, first: u32 },
    Fold { frame: u32 },
}

impl std::fmt::Debug for Runner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Runner").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl Runner {
    /// Starts the threads. Jobs that an earlier process left go on.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn start(
        ledger: Arc<Ledger>,
        store: Arc<Store>,
        pictures: Arc<dyn Pictures>,
        limits: Limits,
    ) -> std::io::Result<Arc<Self>> {
        let runner = Arc::new(Self {
            ledger,
            store,
            reader: SceneReader::new(pictures, limits),
            limits,
            state: Mutex::default(),
            changed: Condvar::new(),
            ending: AtomicBool::new(false),
            threads: Mutex::default(),
        });
        for index in 0..TASKS_IN_FLIGHT {
            let own = Arc::clone(&runner);
            let thread = std::thread::Builder::new().name(format!("task {index}")).stack_size(8 << 20);
            let thread = thread.spawn(move || own.work())?;
            runner.threads.lock().expect("no holder panics").push(thread);
        }
        Ok(runner)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder panics")
    }

    /// Tells that there may be something to do.
    pub fn wake(&self) {
        self.state().wakes += 1;
        self.changed.notify_all();
    }

    /// Stops what is under way for a job that the ledger does not call active any more. Returns at once.
    pub fn stop_job(&self, job: &str) {
        let state = self.state();
        let tasks = state.runs.get(job).into_iter().flat_map(|run| &run.tasks);
        tasks.for_each(|(_, watch)| watch.stop());
    }

    /// Changes how urgent the units of a job are that are under way.
    pub fn set_priority(&self, job: &str, priority: Priority) {
        let state = self.state();
        let tasks = state.runs.get(job).into_iter().flat_map(|run| &run.tasks);
        tasks.for_each(|(_, watch)| watch.set_priority(priority));
        drop(state);
        self.wake();
    }

    /// The share of a job that the units under way have done.
    pub fn share(&self, job: &str) -> f64 {
        let state = self.state();
        state.runs.get(job).map_or(0.0, |run| run.tasks.iter().map(|(_, watch)| watch.share()).sum())
    }

    /// Stops all units and waits for the threads. Their jobs go on when the service is started again.
    pub fn stop(&self) {
        self.ending.store(true, SeqCst);
        for run in self.state().runs.values() {
            run.tasks.iter().for_each(|(_, watch)| watch.stop());
        }
        self.wake();
        for thread in std::mem::take(&mut *self.threads.lock().expect("no holder panics")) {
            // Its panic has been reported.
            let _ = thread.join();
        }
    }

    /// A thread: does tasks until the service ends.
    fn work(&self) {
        let mut seen = 0;
        while !self.ending.load(SeqCst) {
            let next = self.next().unwrap_or_else(|error| {
                log::warn!("{error}; the next try is in {} s", NAP.as_secs());
                None
            });
            if let Some((job, task, watch)) = next {
                self.perform(&job, &task, &watch);
                continue;
            }
            let state = self.state();
            if state.wakes == seen && !self.ending.load(SeqCst) {
                drop(self.changed.wait_timeout(state, NAP));
                seen = self.state().wakes;
            } else {
                seen = state.wakes;
            }
        }
    }

    /// Chooses the next task and takes note of it.
    fn next(&self) -> Result<Option<(Job, Task, Arc<UnitWatch>)>, LedgerError> {
        let mut state = self.state();
        let jobs = self.ledger.active(LOOKED_AT)?;
        let running: HashSet<&str> = jobs.iter().map(|job| &*job.id).collect();
        state.runs.retain(|id, run| !run.tasks.is_empty() || running.contains(&**id));
        let entry = fair::entry(state.runs.values().map(|run| run.given));
        let candidates: Vec<Candidate> = jobs
            .iter()
            .map(|job| {
                let given = state.runs.get(&job.id).map_or(entry, |run| run.given);
                Candidate { priority: job.priority, given, seq: job.seq }
            })
            .collect();
        let in_flight: usize = state.runs.values().map(|run| run.tasks.len()).sum();
        for index in fair::order(&candidates) {
            let job = &jobs[index];
            let under_way: Vec<TaskKey> = state
                .runs
                .get(&job.id)
                .map_or(Vec::new(), |run| run.tasks.iter().map(|task| task.0).collect());
            if in_flight >= UNITS_IN_FLIGHT && !under_way.is_empty() {
                continue;
            }
            let Some(task) = self.task_of(job, &under_way)? else { continue };
            let weight = task.samples(job) as f64 / job.demand.samples().max(1) as f64;
            let watch = Arc::new(UnitWatch::new(job.priority, weight));
            let run =
                state.runs.entry(job.id.clone()).or_insert_with(|| Run { given: entry, ..Run::default() });
            run.given += task.samples(job);
            run.tasks.push((task.key(), Arc::clone(&watch)));
            return Ok(Some((job.clone(), task, watch)));
        }
        Ok(None)
    }

    /// What can be done for a job beside what is under way.
    fn task_of(&self, job: &Job, under_way: &[TaskKey]) -> Result<Option<Task>, LedgerError> {
        if !job.is_planned {
            return Ok((!under_way.contains(&TaskKey::Plan)).then_some(Task::Plan));
        }
        let is_free = |task: &Task| !under_way.contains(&task.key());
        let folds = self.ledger.unfolded(&job.id)?.into_iter().map(|frame| Task::Fold { frame });
        if let Some(fold) = folds.into_iter().find(is_free) {
            return Ok(Some(fold));
        }
        let units = self.ledger.open_units(&job.id, UNITS_IN_FLIGHT)?;
        let unit = units.into_iter().map(Task::Unit).find(is_free);
        if unit.is_none() && under_way.is_empty() {
            self.ledger.finish_if_whole(&job.id)?;
        }
        Ok(unit)
    }

    /// Does a task, whatever happens in it.
    fn perform(&self, job: &Job, task: &Task, watch: &Arc<UnitWatch>) {
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.run(job, task, watch)));
        let result = done.unwrap_or_else(|_| Err(task::Failure::Job("it panicked; see the log".into())));
        let nap = self.conclude(job, task, result);
        let mut state = self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            run.tasks.retain(|(_, other)| !Arc::ptr_eq(other, watch));
        }
        drop(state);
        if nap && !self.ending.load(SeqCst) {
            std::thread::sleep(NAP);
        }
        self.wake();
    }

    /// Writes down what became of a task. Returns whether to wait before the next.
    fn conclude(&self, job: &Job, task: &Task, result: Result<(), task::Failure>) -> bool {
        let result_name = match &result {
            Ok(()) => "done",
            Err(task::Failure::Stopped) => "stopped",
            Err(task::Failure::Disk(_)) => "disk",
            Err(task::Failure::Job(_)) => "failed",
        };
        metrics::counter!("raystream_units_total", "result" => result_name).increment(1);
        match result {
            Ok(()) | Err(task::Failure::Stopped) => false,
            Err(task::Failure::Disk(error)) => {
                log::warn!("job {}: {error}; the next try is in {} s", job.id, NAP.as_secs());
                true
            }
            Err(task::Failure::Job(error)) => {
                let attempts = match task {
                    Task::Unit(unit) => self.ledger.reopen_unit(&job.id, unit.clone()),
                    Task::Plan | Task::Fold { .. } => Ok(task::MOST_ATTEMPTS),
                };
                let failed = attempts.and_then(|attempts| {
                    log::warn!("job {}: {error}", job.id);
                    if attempts < task::MOST_ATTEMPTS {
                        return Ok(());
                    }
                    let active = &[JobState::Queued, JobState::Running];
                    self.stop_job(&job.id);
                    self.ledger.set_state(&job.id, active, JobState::Failed, Some(error)).map(drop)
                });
                failed.inspect_err(|error| log::warn!("job {}: {error}", job.id)).is_err()
            }
        }
    }
}

impl Task {
    /// Pixels × samples that the task takes.
    fn samples(&self, job: &Job) -> u64 {
        match self {
            Self::Unit(UnitRow { first, end, .. }) => job.demand.pixels() * u64::from(end - first),
            Self::Plan | Self::Fold { .. } => 0,
        }
    }

    fn key(&self) -> TaskKey {
        match *self {
            Self::Plan => TaskKey::Plan,
            Self::Unit(UnitRow { frame, first, .. }) => TaskKey::Unit { frame, first },
            Self::Fold { frame } => TaskKey::Fold { frame },
        }
    }
}
