//! A job as its owner sees it.

use super::report::{JobReport, Progress};
use super::service::Inner;
use super::state::{JobId, Receiver};
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
}

struct Letter {
    last: Progress,
    /// Taken by [`JobHandle::wait`].
    outcome: Option<Result<JobReport, JobError>>,
}

/// Receives a job's result and keeps it for the owner.
#[derive(Default)]
pub(super) struct Letterbox {
    letter: Mutex<Option<Letter>>,
    arrived: Condvar,
}

impl Receiver for Letterbox {
    fn receive(&self, last: Progress, outcome: Result<JobReport, JobError>) {
        *self.letter.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(Letter { last, outcome: Some(outcome) });
        self.arrived.notify_all();
    }
}

impl Letterbox {
    fn last_progress(&self) -> Option<Progress> {
        let letter = self.letter.lock().unwrap_or_else(PoisonError::into_inner);
        letter.as_ref().map(|letter| letter.last)
    }
}

/// A job's handle. Dropping it cancels the job.
#[must_use = "dropping the handle cancels the job"]
pub struct JobHandle {
    id: JobId,
    inner: Arc<Inner>,
    letterbox: Arc<Letterbox>,
}

impl JobHandle {
    pub(super) fn new(id: JobId, inner: Arc<Inner>, letterbox: Arc<Letterbox>) -> Self {
        Self { id, inner, letterbox }
    }

    /// How far the job is.
    pub fn progress(&self) -> Progress {
        let now = self.inner.change(|state, _| state.progress(self.id));
        // A job that has left the scheduler is about to be in the letterbox.
        now.unwrap_or_else(|| {
            self.wait_until_finished();
            self.letterbox.last_progress().expect("the job is finished")
        })
    }

    /// Abandons the job: tasks under way end, nothing new begins. Returns at once.
    pub fn cancel(&self) {
        self.inner.change(|state, now_ns| state.cancel(self.id, now_ns));
    }

    /// Spawns no more tiles and finishes what is in flight, so that what has been accumulated is
    /// complete for every tile spawned. Returns at once.
    pub fn stop(&self) {
        self.inner.change(|state, now_ns| state.stop(self.id, now_ns));
    }

    /// Whether the job has ended.
    pub fn is_finished(&self) -> bool {
        self.letterbox.last_progress().is_some()
    }

    /// Waits at most that long; returns whether the job has ended.
    pub fn wait_for(&self, patience: Duration) -> bool {
        let letter = self.letterbox.letter.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.letterbox.arrived.wait_timeout_while(letter, patience, |letter| letter.is_none());
        waited.unwrap_or_else(PoisonError::into_inner).0.is_some()
    }

    /// Waits for the end of the job; the scheduler has then let go of the renderer. Not to be called
    /// from inside a job of the same service.
    ///
    /// # Errors
    /// [`JobError`] when the job was cancelled or panicked; a stopped job has a report.
    pub fn wait(self) -> Result<JobReport, JobError> {
        self.wait_until_finished();
        let mut letter = self.letterbox.letter.lock().unwrap_or_else(PoisonError::into_inner);
        letter.as_mut().and_then(|letter| letter.outcome.take()).expect("only this takes the outcome")
    }

    fn wait_until_finished(&self) {
        let letter = self.letterbox.letter.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.letterbox.arrived.wait_while(letter, |letter| letter.is_none()));
    }
}

impl Drop for JobHandle {
    fn drop(&mut self) {
        if !self.is_finished() {
            self.cancel();
        }
    }
}
