//! Units of jobs on their way to workers and back, in one process or over many machines.
//!
//! ```text
//! serve::runner - offer -> WorkBus (in process, or NATS JetStream) - lease -> Worker -> OpenJob::patch
//!      ^ Desk: join, report, start, files, result, failure                     |
//!      +---------------------------- ask --------------------------------------+
//! serve::live - request, with a deadline -> WorkBus -> LiveDesk: rows of a moving frame, as a display shows them
//! ```
//!
//! The ledger of the service is the record. A bus only carries: whatever it loses is offered again, whatever it carries
//! twice is committed once. `docs/design/farm.md` has the protocol and its invariants.

mod bus;
#[cfg(test)]
mod contract;
mod desk;
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

pub use bus::{Backlog, BusError, Lane, Lease, Offered, WorkBus};
pub use desk::{
    Answer, Ask, Build, Card, Desk, FailureReport, FilePart, FinishedUnit, Orders, Report, SceneFile, Start,
    Verdict, Welcome,
};
pub use live::{LiveAnswer, LiveAnswered, LiveAsk, LiveDesk, LiveReply, LiveScene, Tile, TileAsk};
pub use local::LocalBus;
pub use scenes::{DiskScenes, NoScene, SceneSource};
pub use unit::{Unit, UnitId};
pub use watch::UnitWatch;
pub use worker::{Worker, WorkerOptions};

use std::time::Duration;

/// The most bytes of a part of a film or scene that travels in one message. Servers take messages of 1 MiB.
pub const PART_BYTES: usize = 512 << 10;

/// The most units of a bus, waiting or leased. The coordinator offers two a slot; this is a guard.
pub const QUEUED_UNITS: usize = 20_000;

/// Units that workers may have at the same time.
pub const LEASED_UNITS: usize = 10_000;

/// Questions that the coordinator answers at the same time.
pub const ANSWERED_TOGETHER: usize = 32;

/// How long a worker may be silent about a unit before another one gets it.
pub const LEASE: Duration = Duration::from_secs(15);

/// Beats of a worker within a lease: a lost one is no reason to give its unit to another.
pub const BEATS: u32 = 3;

/// How often a worker reports. Orders to stop come back with the answer, so a job is cancelled everywhere within a
/// second.
pub const REPORT: Duration = Duration::from_millis(400);
