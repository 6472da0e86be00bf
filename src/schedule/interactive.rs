//! Interactive clients: while one is registered, tasks are small, so that threads come free soon.

use super::Service;
use super::service::Inner;
use std::fmt;
use std::sync::Arc;

/// A registered interactive client ([`Service::interactive`]). Dropping it takes it off the list.
#[must_use = "dropping it takes the client off the list"]
pub struct InteractiveClient {
    inner: Arc<Inner>,
}

impl Service {
    /// Registers an interactive client: a caller that is about to submit jobs or queries of
    /// [`super::Priority::Interactive`] and wait for them. While one is registered, and while an interactive job
    /// runs, no task of a host thread takes much longer than half a millisecond. Frames are up to 5 % slower then.
    ///
    /// ```
    /// use raystream::schedule::{JobOptions, Priority, Service, Tracers};
    /// use raystream::stream::Ray;
    ///
    /// /// The primitives that a user points at, while frames are rendered.
    /// fn pick(service: &Service, tracers: &Tracers, pointer: impl Iterator<Item = Ray>) -> Vec<u32> {
    ///     let _client = service.interactive();
    ///     let options = JobOptions::default().with_priority(Priority::Interactive);
    ///     let ask = |ray: Ray| service.closest(tracers.clone(), [ray].into(), options.clone()).ok()?.wait().ok();
    ///     pointer.filter_map(ask).map(|(hits, _)| hits[0].primitive).collect()
    /// }
    /// ```
    pub fn interactive(&self) -> InteractiveClient {
        let inner = Arc::clone(&self.inner);
        inner.change(|state, _| state.register(true));
        InteractiveClient { inner }
    }
}

impl Drop for InteractiveClient {
    fn drop(&mut self) {
        self.inner.change(|state, _| state.register(false));
    }
}

impl fmt::Debug for InteractiveClient {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("InteractiveClient").finish_non_exhaustive()
    }
}
