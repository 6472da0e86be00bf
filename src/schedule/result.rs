//! A job's outcome on its way from the service's threads to those who wait for it.

use super::report::{JobReport, Progress};
use super::state::Receiver;
use crate::stream::{Stopped, drop_quietly, panic_message};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

/// Reason why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// The job was cancelled: through its handle, or with the service.
    #[error("the job was cancelled")]
    Cancelled,
    /// The renderer or the host's tracer panicked. Other jobs go on.
    #[error("{} panicked: {message}", called(job.as_deref()))]
    Panicked {
        /// The job's name ([`super::JobOptions::name`]).
        job: Option<Arc<str>>,
        /// What the panic said.
        message: String,
    },
    /// The renderer's code cannot go on, for a reason of its own: a shader's loop that does not end. Other jobs go on.
    #[error("{0}")]
    Stopped(String),
    /// The scheduler itself panicked, which is a bug; the service is unusable from then on.
    #[error("the scheduler failed: {0}; please report it")]
    Broken(String),
}

impl JobError {
    /// The error for what a job's code has thrown.
    pub(super) fn of(thrown: Box<dyn Any + Send>, job: Option<Arc<str>>) -> Self {
        let is_stopped = thrown.is::<Stopped>();
        let message = panic_message(thrown);
        if is_stopped { Self::Stopped(message) } else { Self::Panicked { job, message } }
    }

    /// The error with the job's name.
    pub(super) fn of_job(self, job: Option<Arc<str>>) -> Self {
        match self {
            Self::Panicked { message, .. } => Self::Panicked { job, message },
            other => other,
        }
    }
}

fn called(name: Option<&str>) -> String {
    name.map_or_else(|| "the job".to_owned(), |name| format!("job {name:?}"))
}

/// What a job leaves: its report, or why there is none.
pub(super) type Outcome = Result<JobReport, JobError>;

/// Called with the outcome.
pub(super) type Callback = Box<dyn FnOnce(&Outcome) + Send>;

#[derive(Default)]
struct ResultState {
    /// Progress at the moment when the job left the scheduler, which is before its outcome is delivered.
    last: Progress,
    is_delivered: bool,
    /// `None` before it is delivered, and after the handle has taken it.
    outcome: Option<Outcome>,
    callbacks: Vec<Callback>,
    /// Of the task that polled the handle last.
    waker: Option<Waker>,
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

    fn deliver(&self, outcome: Outcome) {
        // Callbacks run without the lock, since they may look at the job; they may also add others.
        let waker = loop {
            let mut state = self.lock();
            if state.is_delivered {
                return;
            }
            let callbacks = std::mem::take(&mut state.callbacks);
            if callbacks.is_empty() {
                (state.is_delivered, state.outcome) = (true, Some(outcome));
                break state.waker.take();
            }
            drop(state);
            callbacks.into_iter().for_each(|callback| call(callback, &outcome));
        };
        self.delivered.notify_all();
        let wake = AssertUnwindSafe(|| waker.into_iter().for_each(Waker::wake));
        if let Err(payload) = catch_unwind(wake) {
            drop_quietly(payload);
        }
    }
}

impl ResultSlot {
    /// Delivers [`JobError::Broken`], unless the job has an outcome.
    pub fn give_up(&self, why: &str) {
        self.deliver(Err(JobError::Broken(why.to_owned())));
    }

    /// A slot whose job has already ended.
    pub fn delivered(last: Progress, outcome: Outcome) -> Self {
        let state =
            ResultState { last, is_delivered: true, outcome: Some(outcome), ..ResultState::default() };
        Self { state: Mutex::new(state), delivered: Condvar::new() }
    }

    /// The progress of a job that has left the scheduler.
    pub fn last_progress(&self) -> Progress {
        self.lock().last
    }

    pub fn is_delivered(&self) -> bool {
        self.lock().is_delivered
    }

    /// Waits for at most `patience`; returns whether the outcome has been delivered.
    pub fn wait_for(&self, patience: Duration) -> bool {
        let waited = self.delivered.wait_timeout_while(self.lock(), patience, |state| !state.is_delivered);
        waited.unwrap_or_else(PoisonError::into_inner).0.is_delivered
    }

    /// Waits for the outcome and takes it; `None` if it has been taken before.
    pub fn wait(&self) -> Option<Outcome> {
        let waited = self.delivered.wait_while(self.lock(), |state| !state.is_delivered);
        waited.unwrap_or_else(PoisonError::into_inner).outcome.take()
    }

    /// Takes the outcome, if it is there.
    pub fn take(&self) -> Option<Outcome> {
        self.lock().outcome.take()
    }

    /// Takes the outcome, or has the task woken when it is there.
    ///
    /// # Panics
    /// If it has been taken before.
    pub fn poll(&self, context: &mut Context<'_>) -> Poll<Outcome> {
        // Cloning and dropping a waker is foreign code, which may come back here.
        let waker = context.waker().clone();
        let mut state = self.lock();
        if state.is_delivered {
            return Poll::Ready(state.outcome.take().expect("a job's outcome is taken once"));
        }
        let former = state.waker.replace(waker);
        drop(state);
        drop(former);
        Poll::Pending
    }

    /// Calls `callback` with the outcome when it is there: now if it is. Drops it if the outcome has been taken.
    pub fn on_end(&self, callback: Callback) {
        let mut state = self.lock();
        if !state.is_delivered {
            state.callbacks.push(callback);
            return;
        }
        let outcome = state.outcome.clone();
        drop(state);
        match outcome {
            Some(outcome) => call(callback, &outcome),
            None => drop(callback),
        }
    }

    fn lock(&self) -> MutexGuard<'_, ResultState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Calls foreign code. A panic in it is of no consequence to the job, which has ended.
fn call(callback: Callback, outcome: &Outcome) {
    if let Err(payload) = catch_unwind(AssertUnwindSafe(|| callback(outcome))) {
        drop_quietly(payload);
    }
}
