//! A job's handle: what the caller that submitted it holds.

use super::report::{JobReport, Progress};
use super::{JobControl, JobError, Priority};
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

/// A job's handle: the right to its result. Dropping it cancels the job, unless the job has ended or the handle is
/// [detached](Self::detach). [`Self::control`] makes what steers the job from other threads.
///
/// It is a future of the job's result, for any executor. Dropping the future cancels the job.
///
/// ```
/// use raystream::schedule::{JobOptions, JobReport, Renderer, Service, Tracers};
/// use std::error::Error;
/// use std::sync::Arc;
///
/// async fn render<R: Renderer + 'static>(
///     service: &Service,
///     renderer: Arc<R>,
///     tracers: Tracers,
/// ) -> Result<JobReport, Box<dyn Error>> {
///     let job = service.submit(renderer, tracers, JobOptions::default().with_name("left eye"))?;
///     job.on_end(|outcome| println!("{}", if outcome.is_ok() { "done" } else { "failed" }));
///     Ok(job.await?)
/// }
/// ```
#[derive(Debug)]
#[must_use = "dropping the handle cancels the job"]
pub struct JobHandle {
    control: JobControl,
    is_detached: bool,
}

impl JobHandle {
    pub(super) fn new(control: JobControl) -> Self {
        Self { control, is_detached: false }
    }

    /// A control of the job for any thread, as often as one likes.
    pub fn control(&self) -> JobControl {
        self.control.clone()
    }

    /// See [`JobControl::name`].
    pub fn name(&self) -> Option<&str> {
        self.control.name()
    }

    /// See [`JobControl::progress`].
    pub fn progress(&self) -> Progress {
        self.control.progress()
    }

    /// See [`JobControl::cancel`].
    pub fn cancel(&self) {
        self.control.cancel();
    }

    /// See [`JobControl::stop`].
    pub fn stop(&self) {
        self.control.stop();
    }

    /// See [`JobControl::set_priority`].
    pub fn set_priority(&self, priority: Priority) {
        self.control.set_priority(priority);
    }

    /// See [`JobControl::is_finished`].
    pub fn is_finished(&self) -> bool {
        self.control.is_finished()
    }

    /// Calls `callback` once with the job's result: when the job has ended, or at once if it has. It is called on one
    /// of the service's threads, before [`Self::wait`] returns; so it should be short, and must not wait for this job.
    /// A panic in it is caught. It is dropped without a call if the result has been taken ([`Self::try_wait`]).
    pub fn on_end(&self, callback: impl FnOnce(&Result<JobReport, JobError>) + Send + 'static) {
        self.control.result.on_end(Box::new(callback));
    }

    /// Gives the handle up and lets the job run to its end. Callbacks are still called; dropping the service still
    /// cancels the job.
    pub fn detach(mut self) {
        self.is_detached = true;
    }

    /// Waits for at most `patience`; returns whether the job has ended.
    pub fn wait_for(&self, patience: Duration) -> bool {
        let began = Instant::now();
        self.control.help(|| began.elapsed() < patience);
        self.control.result.wait_for(patience.saturating_sub(began.elapsed()))
    }

    /// The job's result if the job has ended, without waiting; `None` before, and `None` once it has been returned.
    pub fn try_wait(&mut self) -> Option<Result<JobReport, JobError>> {
        self.control.result.take()
    }

    /// Waits for the end of the job. The service has dropped its reference to the renderer by then. Must not be called
    /// from inside a job of the same service, which may wait for ever.
    ///
    /// # Errors
    /// [`JobError`] when the job was cancelled or panicked; a stopped job has a report.
    ///
    /// # Panics
    /// If [`Self::try_wait`], or polling the handle, has returned the result.
    pub fn wait(self) -> Result<JobReport, JobError> {
        self.control.help(|| true);
        self.control.result.wait().expect("a job's result is taken once")
    }
}

impl Future for JobHandle {
    type Output = Result<JobReport, JobError>;

    /// # Panics
    /// If the result has been returned before.
    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        self.control.result.poll(context)
    }
}

impl Drop for JobHandle {
    fn drop(&mut self) {
        if !self.is_detached && !self.is_finished() {
            self.cancel();
        }
    }
}
