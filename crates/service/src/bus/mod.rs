//! Buses carry questions and answers between a coordinator and its workers: in one process, or over NATS.

mod bell;
mod local;
pub mod nats;
#[cfg(test)]
mod promises;

pub use bell::Bell;
pub use local::LocalBus;

use crate::contract::{Answer, Ask, Coordinator, LiveAnswer, LiveAsk, TileServer};
use std::sync::Arc;
use std::time::Duration;

/// The reason why a bus did not do something. It may the next time.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The server or the other side does not answer.
    #[error("{0} does not answer")]
    Silent(String),
    /// The server refuses.
    #[error("{0}")]
    Refused(String),
    /// A message that cannot be read: the other side is of another version, or not raystream.
    #[error("a message cannot be read: {0}")]
    Unreadable(String),
}

/// Takes an answer, or why there is none.
pub type LiveAnswered = Box<dyn FnOnce(Result<LiveAnswer, BusError>) + Send>;

/// Carries questions of workers to the coordinator, and questions for tiles of live views to workers. It keeps nothing:
/// which units there are, and who has them, the coordinator knows alone.
/// Implementations pass the same tests (`promises.rs`).
pub trait WorkBus: Send + Sync {
    /// Lets a coordinator answer what workers ask, until the bus is dropped.
    ///
    /// # Errors
    /// [`BusError`].
    fn attend(&self, coordinator: Arc<dyn Coordinator>) -> Result<(), BusError>;

    /// Asks the coordinator, which is told who asks ([`Coordinator::answer`]).
    ///
    /// # Errors
    /// [`BusError`].
    fn ask(&self, ask: Ask) -> Result<Answer, BusError>;

    /// Tells all workers that wait for a unit that there are some. It may be lost: they ask from time to time anyway.
    fn ring(&self);

    /// What a worker waits at.
    fn bell(&self) -> &Bell;

    /// How long a worker may be silent about a unit before another one gets it.
    fn lease_time(&self) -> Duration;

    /// Lets a server of tiles answer what the coordinator asks of this worker, until the bus is dropped.
    ///
    /// # Errors
    /// [`BusError`].
    fn listen(&self, tiles: Arc<dyn TileServer>) -> Result<(), BusError>;

    /// Asks the worker of a key. Returns at once. `answered` is called by another thread, with an error if there is no
    /// answer within `patience`. Nothing is kept for a worker that is not there.
    fn request(&self, key: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered);
}
