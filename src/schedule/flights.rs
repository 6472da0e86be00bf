//! Bundles with devices, of all jobs. The device thread waits for them in the order of submission, whatever has become
//! of their jobs meanwhile: a job whose streams host threads have taken back ends without its bundles.

use super::policy;
use super::state::JobId;
use super::task::Work;
use crate::stream::{ChunkScratch, Resolve, Ticket, catching, drop_quietly};
use crate::sync::{Mutex, PoisonError};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Identifies a bundle for as long as the service lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BundleId(u64);

/// A bundle that a job has submitted.
pub(super) struct Submitted {
    pub ticket: Box<dyn Ticket>,
    /// Number of its streams.
    pub streams: usize,
}

/// What became of a bundle: what resolves each of its streams, or why the device failed.
pub(super) type Answers = Result<Vec<Box<dyn Resolve>>, String>;

/// A bundle with a device.
struct Flight {
    id: BundleId,
    job: JobId,
    bundle: Submitted,
}

/// The bundles with devices.
#[derive(Default)]
pub(super) struct Flights {
    next_id: u64,
    /// Those that no thread waits for, the first submitted first.
    flights: VecDeque<Flight>,
    /// The one that the device thread waits for.
    waited: Option<(BundleId, JobId)>,
    wait: Arc<Wait>,
}

impl Flights {
    /// Bundles with devices.
    pub fn len(&self) -> usize {
        self.flights.len() + usize::from(self.waited.is_some())
    }

    /// True if there is a bundle to wait for.
    pub fn may_be_waited_for(&self) -> bool {
        !self.flights.is_empty()
    }

    /// The number of the bundle that is submitted next.
    pub fn next_id(&self) -> BundleId {
        BundleId(self.next_id)
    }

    /// Adds the bundle with the next number.
    pub fn push(&mut self, job: JobId, bundle: Submitted) {
        self.flights.push_back(Flight { id: self.next_id(), job, bundle });
        self.next_id += 1;
    }

    /// Has the device thread wait for the bundle that was submitted first; returns its job, and the wait.
    ///
    /// # Panics
    /// If there is none.
    pub fn start_wait(&mut self, queued: usize) -> (JobId, Arc<dyn Work>) {
        let Flight { id, job, bundle } = self.flights.pop_front().expect("a bundle is with a device");
        self.waited = Some((id, job));
        self.wait.swap(WaitSlot::Wait(bundle, policy::wait_time(queued)));
        (job, Arc::clone(&self.wait) as _)
    }

    /// Ends the wait; returns the bundle that was waited for, its job, and what has become of it: `None` if the device
    /// is still at work.
    pub fn finish_wait(&mut self) -> (BundleId, JobId, Option<Answers>) {
        let (id, job) = self.waited.take().expect("a bundle was waited for");
        let answers = match self.wait.swap(WaitSlot::Empty) {
            WaitSlot::Waited(bundle) => {
                self.flights.push_front(Flight { id, job, bundle });
                None
            }
            WaitSlot::Over(answers) => Some(answers),
            WaitSlot::Empty | WaitSlot::Wait(..) => unreachable!("a thread finishes after its work"),
        };
        (id, job, answers)
    }
}

/// The device thread's wait. The holder of the lists' lock fills and empties the slot; between the two only the thread
/// uses it.
#[derive(Default)]
struct Wait {
    slot: Mutex<WaitSlot>,
}

#[derive(Default)]
enum WaitSlot {
    #[default]
    Empty,
    Wait(Submitted, Duration),
    /// The device is still at work.
    Waited(Submitted),
    Over(Answers),
}

impl Wait {
    fn swap(&self, slot: WaitSlot) -> WaitSlot {
        std::mem::replace(&mut *self.slot.lock().unwrap_or_else(PoisonError::into_inner), slot)
    }
}

impl Work for Wait {
    fn work(&self, _: usize, _: &mut ChunkScratch) -> Option<u64> {
        let WaitSlot::Wait(bundle, timeout) = self.swap(WaitSlot::Empty) else {
            unreachable!("a thread works after it was given a task")
        };
        let Submitted { mut ticket, streams } = bundle;
        let answers = match catching(|| ticket.wait(timeout).map_err(|error| error.to_string())) {
            Ok(None) => {
                self.swap(WaitSlot::Waited(Submitted { ticket, streams }));
                return None;
            }
            Ok(Some(answers)) if answers.len() == streams => Ok(answers),
            Ok(Some(_)) => Err("it did not answer for each stream".to_owned()),
            Err(reason) => Err(reason),
        };
        // What the device has of the streams goes before they come back.
        drop_quietly(ticket);
        self.swap(WaitSlot::Over(answers));
        None
    }

    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }
}
