//! Units of jobs on their way to workers and back, in one process or over many machines.
//!
//! ```text
//! serve::runner - Desk: join, lease, report, files, result, failure <- ask - WorkBus <- Worker -> OpenJob::patch
//!                                                                      (in process, or NATS)
//! serve::live - request, with a deadline -> WorkBus -> LiveDesk: rows of a moving frame, as a display shows them
//! ```
//!
//! The ledger of the service is the record, and the coordinator knows who has which unit. A bus only carries: what it
//! loses is asked again, what it carries twice is committed once. A worker is a stranger: what it says is checked
//! where it comes in. `docs/design/farm.md` has the protocol, its invariants and what each key can do.

mod bell;
mod bus;
#[cfg(test)]
mod contract;
mod desk;
mod lease;
mod live;
mod local;
#[cfg(feature = "farm")]
pub mod nats;
mod painter;
pub mod plan;
mod scenes;
mod unit;
mod watch;
mod worker;

pub use bell::Bell;
pub use bus::{BusError, WorkBus};
pub use desk::{
    Answer, Ask, Build, Card, Desk, FailureReport, FilePart, FinishedUnit, Granted, Held, Leased, Orders,
    Report, SceneFile, Verdict, Wanted, Welcome,
};
pub use lease::{MOST_SLOTS, TEXT_BYTES, digest, is_name, sentence};
pub use live::{LiveAnswer, LiveAnswered, LiveAsk, LiveDesk, LiveReply, LiveScene, Tile, TileAsk};
pub use local::LocalBus;
pub use scenes::{DiskScenes, NoScene, SceneSource};
pub use unit::{Unit, UnitId};
pub use watch::UnitWatch;
pub use worker::{Mischief, Worker, WorkerOptions};

use std::time::Duration;

/// The most bytes of a part of a film or scene that travels in one message. Servers take messages of 1 MiB.
pub const PART_BYTES: usize = 512 << 10;

/// Questions that the coordinator answers at the same time.
pub const ANSWERED_TOGETHER: usize = 32;

/// How long a worker may be silent about a unit before another one gets it.
pub const LEASE: Duration = Duration::from_secs(15);

/// Reports of a worker within a lease, at least: a lost one is no reason to give its unit to another.
pub const BEATS: u32 = 3;

/// How often a worker reports, which renews its leases. Orders to stop come back with the answer, so a job is cancelled
/// everywhere within a second.
pub const REPORT: Duration = Duration::from_millis(400);
