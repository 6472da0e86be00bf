//! A job's handle: what the caller that submitted it holds.

use super::report::{JobReport, Progress};
use super::service::Inner;
use super::state::{JobId, Receiver, State};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// The job was cancelled: through its handle, or with the service.
    #[error("the job was cancelled")]
    Cancelled,
    /// The renderer or the host's tracer panicked. Other jobs go on.
    #[error("the job panicked: {0}")]
    Panicked(String),
    /// The scheduler itself panicked, which is a bug; the service is unusable from then on.
    #[error("the scheduler failed: {0}; please report it")]
    Broken(String),
}

#[derive(Default)]
struct ResultState {
    /// Progress at the moment when the job left the scheduler, which is before its outcome is delivered.
    last: Progress,
    is_delivered: bool,
    /// `None` before it is delivered, and after [`JobHandle::wait`] has taken it.
    outcome: Option<Result<JobReport, JobError>>,
}

/// Receives a job's result and keeps it for the handle.
#[derive(Default)]
pub(super) struct ResultSlot {
    state: Mutex<ResultState>,
    delivered: Condvar,
}

impl Receiver for ResultSlot {
    fn leave(&self, last: Progress) {
        self.lock().last = last;
    }

    fn deliver(&self, outcome: Result<JobReport, JobError>) {
        self.lock().deliver(outcome);
        self.delivered.notify_all();
    }
}

impl ResultSlot {
    /// Delivers [`JobError::Broken`], unless the job has an outcome.
    pub fn give_up(&self, why: &str) {
        let mut state = self.lock();
        if !state.is_delivered {
            state.deliver(Err(JobError::Broken(why.to_owned())));
        }
        self.delivered.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, ResultState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ResultState {
    fn deliver(&mut self, outcome: Result<JobReport, JobError>) {
        (self.is_delivered, self.outcome) = (true, Some(outcome));
    }
}

/// A job's handle. Dropping it cancels the job.
#[must_use = "dropping the handle cancels the job"]
pub struct JobHandle {
    /// `None` if the service broke before the job got an id.
    id: Option<JobId>,
    inner: Arc<Inner>,
    result: Arc<ResultSlot>,
}

impl JobHandle {
    pub(super) fn new(id: Option<JobId>, inner: Arc<Inner>, result: Arc<ResultSlot>) -> Self {
        Self { id, inner, result }
    }

    /// How far the job is; of a job that has ended, its last progress. Never waits, so any code may call it, even the
    /// `Drop` of the job's own renderer.
    pub fn progress(&self) -> Progress {
        self.change(|state, id, _| state.progress(id)).flatten().unwrap_or_else(|| self.result.lock().last)
    }

    fn change<T>(&self, change: impl FnOnce(&mut State, JobId, u64) -> T) -> Option<T> {
        let id = self.id?;
        self.inner.change(|state, now_ns| change(state, id, now_ns))
    }

    /// Abandons the job: tasks under way end, no new ones begin. Returns at once.
    pub fn cancel(&self) {
        self.change(State::cancel);
    }

    /// Spawns no more tiles and finishes the paths in flight, so that every tile spawned is complete. Returns at once.
    pub fn stop(&self) {
        self.change(State::stop);
    }

    /// Whether the job has ended.
    pub fn is_finished(&self) -> bool {
        self.result.lock().is_delivered
    }

    /// Waits for at most `patience`; returns whether the job has ended.
    pub fn wait_for(&self, patience: Duration) -> bool {
        let state = self.result.lock();
        let waited = self.result.delivered.wait_timeout_while(state, patience, |state| !state.is_delivered);
        waited.unwrap_or_else(PoisonError::into_inner).0.is_delivered
    }

    /// Waits for the end of the job. The service has dropped its reference to the renderer by then. Must not be called
    /// from inside a job of the same service, which may wait for ever.
    ///
    /// # Errors
    /// [`JobError`] when the job was cancelled or panicked; a stopped job has a report.
    pub fn wait(self) -> Result<JobReport, JobError> {
        let state = self.result.lock();
        let waited = self.result.delivered.wait_while(state, |state| !state.is_delivered);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        state.outcome.take().expect("only this takes the outcome, and it consumes the handle")
    }
}

impl Drop for JobHandle {
    fn drop(&mut self) {
        if !self.is_finished() {
            self.cancel();
        }
    }
}
