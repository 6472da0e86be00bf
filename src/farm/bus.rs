//! What carries units and messages between a coordinator and its workers.

use super::desk::{Answer, Ask, Desk};
use super::live::{LiveAnswered, LiveAsk, LiveDesk};
use super::unit::Unit;
use std::sync::Arc;
use std::time::Duration;

/// Why a bus did not do something. It may the next time.
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

/// Units of one lane are leased before those of the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lane {
    /// Of interactive jobs.
    Hi,
    /// Of all others.
    Lo,
}

impl Lane {
    /// All lanes.
    pub const ALL: [Self; 2] = [Self::Hi, Self::Lo];

    /// Its name in subjects.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hi => "hi",
            Self::Lo => "lo",
        }
    }
}

/// What became of an offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offered {
    /// A worker will get it.
    New,
    /// The same round of the unit was offered just before; it may be on its way or gone.
    Duplicate,
    /// Too many units wait; offer it again later.
    Full,
}

/// What a bus holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backlog {
    /// Units that wait or are leased.
    pub units: u64,
    /// Whether the bus has lost all it held since the last call.
    pub is_new: bool,
}

/// Carries units to workers, at least once each unless it loses all, requests of workers to the coordinator, and
/// requests for tiles of live views to workers.
/// Implementations pass the same tests (`contract.rs`).
pub trait WorkBus: Send + Sync {
    /// Offers a unit to workers. Rounds tell a repeated offer that is meant from one that is not.
    ///
    /// # Errors
    /// [`BusError`].
    fn offer(&self, lane: Lane, unit: &Unit, round: u32) -> Result<Offered, BusError>;

    /// What the bus holds. A bus that has lost its queue gets a new one.
    ///
    /// # Errors
    /// [`BusError`].
    fn backlog(&self) -> Result<Backlog, BusError>;

    /// Lets a desk answer what workers ask, until the bus is dropped.
    ///
    /// # Errors
    /// [`BusError`].
    fn attend(&self, desk: Arc<dyn Desk>) -> Result<(), BusError>;

    /// Leases the next unit; `None` if there is none within this time.
    ///
    /// # Errors
    /// [`BusError`].
    fn lease(&self, patience: Duration) -> Result<Option<Box<dyn Lease>>, BusError>;

    /// Asks the coordinator.
    ///
    /// # Errors
    /// [`BusError`].
    fn ask(&self, ask: Ask) -> Result<Answer, BusError>;

    /// How long a worker may be silent about a unit before another one gets it.
    fn lease_time(&self) -> Duration;

    /// Lets a desk answer what the coordinator asks of this worker, until the bus is dropped. Returns the worker's
    /// address.
    ///
    /// # Errors
    /// [`BusError`].
    fn listen(&self, desk: Arc<dyn LiveDesk>) -> Result<String, BusError>;

    /// Asks a worker at an address. Returns at once. `answered` is called by another thread, with an error if there is
    /// no answer within `patience`. Nothing is kept for a worker that is not there.
    fn request(&self, address: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered);
}

/// A unit that a worker has. If the lease is dropped without a word, another worker gets the unit once the lease has
/// expired. After that its first holder can give nothing back. It can still say that the unit is done, which ends the
/// other's lease too: the coordinator offers a unit again that no one has and that has no sums.
pub trait Lease: Send + Sync {
    /// The unit.
    fn unit(&self) -> &Unit;

    /// How often it has been leased, this time included.
    fn deliveries(&self) -> u64;

    /// Renews the lease.
    fn beat(&self);

    /// Ends it: the unit needs no more work, as far as this worker knows.
    fn done(&self);

    /// Ends it: another worker gets the unit after this time.
    fn give_back(&self, delay: Duration);
}
