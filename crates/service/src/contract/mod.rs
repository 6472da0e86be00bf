//! The words between a coordinator, its workers and its clients: units, leases, messages, tiles, names, refusals.
//!
//! Whoever speaks is a stranger: what comes in is checked here, by the same code on both sides.

mod digits;
pub mod failpoint;
mod lease;
mod limits;
mod messages;
mod names;
mod pack;
mod pose;
mod private_file;
mod problem;
mod scene_folder;
mod tiles;
mod times;
mod unit;
mod watch;

pub use digits::{from_hex, hex, random_hex};
pub use failpoint::Failpoint;
pub use lease::{MOST_SLOTS, digest};
pub use limits::Limits;
pub use messages::{
    Answer, Ask, Build, Coordinator, FailureReport, FilePart, FinishedUnit, Granted, Held, JoinReply, Leased,
    Report, ReportReply, ResultReply, SceneFile, Wanted, WorkerInfo,
};
pub use names::{TEXT_BYTES, entry_name, inside, is_name, is_sha256, sentence};
pub use pack::{Pack, ScenePack};
pub use pose::{Lens, Pose};
pub use private_file::{private_key, write_private};
pub use problem::Problem;
pub use scene_folder::{entry_in, refused};
pub use tiles::{LiveAnswer, LiveAsk, LiveReply, LiveScene, ShaderTexts, Tile, TileAsk, TileServer};
pub use times::{ANSWERED_TOGETHER, BEATS, LEASE, PART_BYTES, REPORT};
pub use unit::{Unit, UnitId};
pub use watch::UnitWatch;
