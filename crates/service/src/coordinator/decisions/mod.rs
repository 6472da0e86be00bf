//! What the coordinator decides, as functions of what it knows: how units are cut, which are offered, who renders them,
//! who stands by, when sums are written into one file. Nothing here knows of threads, clocks, files or a bus, so the
//! simulator (`crate::plan`) decides with the same code.

mod cut;
mod fair;
mod folding;
mod leases;
mod offers;
mod pass_units;
mod standby;

pub use crate::coordinator::ledger::UnitRow;
pub use cut::{BLOCK_PIXELS, Sizes, Speed};
pub use fair::{Candidate, Share, entry, next};
pub use folding::{MOST_FILES, is_to_be_folded};
pub use leases::{
    Asked, FIRST_COMPARED, Holding, REST_LEASES, Taking, is_compared, is_fruitless, losses, taking,
};
pub use offers::{OPEN_FRAMES, at_once, wanted, wants_frame};
pub use pass_units::PassUnits;
pub use standby::{FIRST_FETCHES, FIRST_WORKERS, Fetch, Load, is_to_fetch, most_workers};

use std::time::Duration;

/// The time for which the planner rests if it is not woken.
pub const PLANNER_PAUSE: Duration = Duration::from_millis(250);

/// Threads for what is no unit: plans, pictures, frames whose samples the time decides.
pub const TASK_THREADS: usize = 4;

/// The number of workers that try a unit before its job fails.
pub const MOST_ATTEMPTS: u32 = 5;
