//! What steers a job from any thread, beside the handle that waits for it.

use super::result::ResultSlot;
use super::service::Inner;
use super::state::{JobId, State};
use super::{Priority, Progress};
use std::fmt;
use std::sync::Arc;

/// Steers a job: any number of clones, on any threads. Unlike [`super::JobHandle`] it does not own the job, so dropping
/// it changes nothing. On a job that has ended its calls do nothing.
///
/// ```
/// use raystream::schedule::{JobHandle, Priority};
/// use std::time::Duration;
///
/// /// Reports progress from another thread, and lets other jobs go first after a minute.
/// fn watch(job: &JobHandle) {
///     let control = job.control();
///     std::thread::spawn(move || {
///         for second in 1.. {
///             std::thread::sleep(Duration::from_secs(1));
///             if control.is_finished() {
///                 break;
///             }
///             println!("{:?}: {} tiles", control.name(), control.progress().tiles_done());
///             if second == 60 {
///                 control.set_priority(Priority::Background);
///             }
///         }
///     });
/// }
/// ```
#[derive(Clone)]
pub struct JobControl {
    /// `None` if the calling thread did the job itself, or if the service broke before the job got an id.
    id: Option<JobId>,
    name: Option<Arc<str>>,
    inner: Arc<Inner>,
    pub(super) result: Arc<ResultSlot>,
}

impl JobControl {
    pub(super) fn new(
        id: Option<JobId>,
        name: Option<Arc<str>>,
        inner: Arc<Inner>,
        result: Arc<ResultSlot>,
    ) -> Self {
        Self { id, name, inner, result }
    }

    /// The job's name ([`super::JobOptions::name`]).
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// How far the job is; of a job that has ended, its last progress. Never waits, so any code may call it, even the
    /// `Drop` of the job's own renderer.
    pub fn progress(&self) -> Progress {
        let running = self.change(|state, id, _| state.progress(id)).flatten();
        running.unwrap_or_else(|| self.result.last_progress())
    }

    /// Abandons the job: tasks under way end, no new ones begin. Returns at once.
    pub fn cancel(&self) {
        self.change(State::cancel);
    }

    /// Spawns no more tiles and finishes the paths in flight, so that every tile spawned is complete. Returns at once.
    pub fn stop(&self) {
        self.change(State::stop);
    }

    /// Changes how urgent the job is, from its next task on.
    pub fn set_priority(&self, priority: Priority) {
        self.change(|state, id, now_ns| state.set_priority(id, priority, now_ns));
    }

    /// Waits for the end of the job on a worker of the service's pool. Returns at once on other threads.
    pub(super) fn help(&self, is_patient: impl Fn() -> bool) {
        if let Some(workers) = &self.inner.workers {
            let nap = |nap| {
                self.result.wait_for(nap);
            };
            workers.wait_until(|| self.is_finished() || !is_patient(), nap);
        }
    }

    /// True if the job has ended and its callbacks have been called.
    pub fn is_finished(&self) -> bool {
        self.result.is_delivered()
    }

    fn change<T>(&self, change: impl FnOnce(&mut State, JobId, u64) -> T) -> Option<T> {
        let id = self.id?;
        self.inner.change(|state, now_ns| change(state, id, now_ns))
    }
}

impl fmt::Debug for JobControl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, is_finished) = (self.name(), self.is_finished());
        let mut fields = f.debug_struct("JobControl");
        fields.field("name", &name).field("is_finished", &is_finished).finish_non_exhaustive()
    }
}
