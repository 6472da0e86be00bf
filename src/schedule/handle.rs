//! A job as its owner sees it.

use super::report::{JobReport, Progress};
use super::service::Inner;
use super::state::{JobId, Receiver, State};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// It was cancelled: by its owner, or with the service.
    #[error("the job was cancelled")]
    Cancelled,
    /// The renderer or the host's tracer panicked. Other jobs go on.
    #[error("the job panicked: {0}")]
    Panicked(String),
    /// The scheduler itself panicked, which it should not; the service is of no more use.
    #[error("the scheduler failed: {0}; please report it")]
    Broken(String),
}

struct ResultState {
    last: Progress,
    /// Taken by [`JobHandle::wait`].
    outcome: Option<Result<JobReport, JobError>>,
}

/// Receives a job's result and keeps it for the owner.
#[derive(Default)]
pub(super) struct ResultSlot {
    letter: Mutex<Option<ResultState>>,
    arrived: Condvar,
}

impl Receiver for ResultSlot {
    fn receive(&self, last: Progress, outcome: Result<JobReport, JobError>) {
        *self.letter.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(ResultState { last, outcome: Some(outcome) });
        self.arrived.notify_all();
    }
}

impl ResultSlot {
    /// Tells the owner that no result will come.
    pub fn give_up(&self, why: &str) {
        let mut letter = self.letter.lock().unwrap_or_else(PoisonError::into_inner);
        letter.get_or_insert_with(|| ResultState {
            last: Progress::default(),
            outcome: Some(Err(JobError::Broken(why.to_owned()))),
        });
        self.arrived.notify_all();
    }

    fn last_progress(&self) -> Option<Progress> {
        let letter = self.letter.lock().unwrap_or_else(PoisonError::into_inner);
        letter.as_ref().map(|letter| letter.last)
    }
}

/// A job's handle. Dropping it cancels the job.
#[must_use = "dropping the handle cancels the job"]
pub struct JobHandle {
    /// None if the service broke before the job got a name.
    id: Option<JobId>,
    inner: Arc<Inner>,
    result: Arc<ResultSlot>,
}

impl JobHandle {
    pub(super) fn new(id: Option<JobId>, inner: Arc<Inner>, result: Arc<ResultSlot>) -> Self {
        Self { id, inner, result }
    }

    /// How far the job is.
    pub fn progress(&self) -> Progress {
        // A job that has left the scheduler is about to be in the letterbox.
        self.change(|state, id, _| state.progress(id)).flatten().unwrap_or_else(|| {
            self.wait_until_finished();
            self.result.last_progress().expect("the job is finished")
        })
    }

    fn change<T>(&self, change: impl FnOnce(&mut State, JobId, u64) -> T) -> Option<T> {
        let id = self.id?;
        self.inner.change(|state, now_ns| change(state, id, now_ns))
    }

    /// Abandons the job: tasks under way end, nothing new begins. Returns at once.
    pub fn cancel(&self) {
        self.change(State::cancel);
    }

    /// Spawns no more tiles and finishes what is in flight, so that what has been accumulated is
    /// complete for every tile spawned. Returns at once.
    pub fn stop(&self) {
        self.change(State::stop);
    }

    /// Whether the job has ended.
    pub fn is_finished(&self) -> bool {
        self.result.last_progress().is_some()
    }

    /// Waits at most that long; returns whether the job has ended.
    pub fn wait_for(&self, patience: Duration) -> bool {
        let letter = self.result.letter.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.result.arrived.wait_timeout_while(letter, patience, |letter| letter.is_none());
        waited.unwrap_or_else(PoisonError::into_inner).0.is_some()
    }

    /// Waits for the end of the job; the scheduler has then let go of the renderer. Not to be called
    /// from inside a job of the same service.
    ///
    /// # Errors
    /// [`JobError`] when the job was cancelled or panicked; a stopped job has a report.
    pub fn wait(self) -> Result<JobReport, JobError> {
        self.wait_until_finished();
        let mut letter = self.result.letter.lock().unwrap_or_else(PoisonError::into_inner);
        letter.as_mut().and_then(|letter| letter.outcome.take()).expect("only this takes the outcome")
    }

    fn wait_until_finished(&self) {
        let letter = self.result.letter.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.result.arrived.wait_while(letter, |letter| letter.is_none()));
    }
}

impl Drop for JobHandle {
    fn drop(&mut self) {
        if !self.is_finished() {
            self.cancel();
        }
    }
}
