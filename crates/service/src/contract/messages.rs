//! What workers ask of the coordinator.

use super::unit::{Unit, UnitId};
use raystream::render::{PARTIAL_FILM_VERSION, PICTURE_VERSION};
use raystream::scene::FINGERPRINT_VERSION;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// The versions that must be the same for two processes to make the same patches. Shaders are parts of scenes, whose
/// fingerprints are compared for each frame; the binary is not compared, because machines of several kinds render one
/// picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Build(BTreeMap<String, String>);

/// Counts incompatible messages between coordinator and workers.
const PROTOCOL_VERSION: u32 = 7;

impl Build {
    /// This process's.
    pub fn own() -> Self {
        let parts = [
            ("raystream", env!("CARGO_PKG_VERSION").to_owned()),
            ("pictures", PICTURE_VERSION.to_string()),
            ("films", PARTIAL_FILM_VERSION.to_string()),
            ("fingerprints", FINGERPRINT_VERSION.to_string()),
            ("messages", PROTOCOL_VERSION.to_string()),
        ];
        Self(parts.into_iter().map(|(name, version)| (name.to_owned(), version)).collect())
    }

    /// The first difference from another build, in words.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let names = self.0.keys().chain(other.0.keys());
        let mut differing = names.filter(|name| self.0.get(*name) != other.0.get(*name));
        let name = differing.next()?;
        let of = |build: &Self| build.0.get(name).cloned().unwrap_or_else(|| "none".into());
        Some(format!("the version of {name} is {} there and {} here", of(other), of(self)))
    }
}

/// The description of a worker, with which it joins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkerInfo {
    /// Its name, for people. Its key is what it is known by.
    pub worker: String,
    /// Its machine.
    pub host: String,
    /// Its build.
    pub build: Build,
    /// A number that its process has drawn: another process of the same key has none of the units of this one.
    pub session: u64,
    /// Units that it renders at the same time.
    pub slots: u32,
    /// The units that trace there, in words.
    pub units: String,
    /// True if it is asked for tiles of live views.
    pub is_live: bool,
}

/// The answer to a worker that joins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum JoinReply {
    /// It may ask for units, and its leases last this long.
    Joined {
        /// Milliseconds.
        lease_ms: u64,
    },
    /// It may not, and why.
    Refused(String),
}

/// A question for a unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wanted {
    /// The process that asks ([`WorkerInfo::session`]).
    pub session: u64,
    /// The units that it has. One that it was given and does not name is given again: the answer was lost.
    pub have: Vec<UnitId>,
}

/// A unit that a worker is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leased {
    /// The unit.
    pub unit: Unit,
    /// Shows that this worker has it. It is a function of the unit, the worker's key and a secret of the coordinator.
    pub token: String,
}

/// The answer to a worker that asks for a unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Granted {
    /// A unit.
    Unit(Box<Leased>),
    /// There is none now.
    None,
    /// The worker does not help now: it is to ask again after a lease's time, and to report as rarely as it may.
    StandBy,
    /// The worker gets none for a while, and why.
    Rests(String),
    /// The worker may take no units.
    Refused(String),
    /// The coordinator does not know it: it is to join.
    Unknown,
}

/// A unit that a worker has, with the token that shows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Held {
    /// The unit.
    pub unit: UnitId,
    /// [`Leased::token`].
    pub token: String,
}

/// The report that a worker sends from time to time. It renews the leases of the units that it names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// The units that it has and that do not hang.
    pub units: Vec<Held>,
    /// True if it takes no more units.
    pub is_draining: bool,
    /// Scenes that it found in its cache, and scenes that it fetched.
    pub cache: (u64, u64),
    /// Rays that it has traced.
    pub rays: u64,
}

/// The answer to a report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReportReply {
    /// Units that it is to stop.
    pub stop: Vec<UnitId>,
    /// The reason why it may take no more units, if so.
    pub refused: Option<String>,
    /// True if the coordinator does not know it: it is to join again.
    pub is_unknown: bool,
}

/// A rendered unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinishedUnit {
    /// The unit, and the token that shows that it was given to this worker.
    pub held: Held,
    /// The hash of all that the worker's frame is a function of ([`crate::backend::OpenJob::identity`]).
    pub identity: String,
    /// The blocks that were rendered.
    pub blocks: Vec<u32>,
    /// The samples of each of their pixels.
    pub samples: Range<u32>,
    /// [`super::lease::digest`] of all that.
    pub digest: String,
    /// Seconds that it took, with opening its scene.
    pub seconds: f64,
    /// Seconds that opening its scene took: fetching and reading it, where it was not there.
    pub opening_s: f64,
    /// [`raystream::render::Patch::sums`]. They travel beside the rest.
    #[serde(skip)]
    pub sums: Arc<Vec<u8>>,
}

/// The coordinator's answer to a rendered unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResultReply {
    /// It is on the disk and in the ledger.
    Kept,
    /// It was there already.
    Duplicate,
    /// No one wants it any more.
    Stale,
    /// The disk or the ledger refuses now; send it again later.
    Later,
    /// It is of another picture, and why: the worker is to fetch the scene anew.
    Anew(String),
    /// It is not what was asked for, and why.
    Refused(String),
}

/// That a unit cannot be rendered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureReport {
    /// The unit.
    pub held: Held,
    /// The reason why it cannot be rendered.
    pub error: String,
}

/// A file of a scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Its path in the scene's folder.
    pub path: String,
    /// Its length.
    pub bytes: u64,
    /// The SHA-256 of its content.
    pub sha256: String,
}

/// The place in a file of a scene from which bytes are asked for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilePart {
    /// The scene.
    pub scene: String,
    /// The number of the file in the scene's list.
    pub file: u32,
    /// The first byte.
    pub offset: u64,
}

/// A question to the coordinator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Ask {
    /// May I work for you?
    Join(WorkerInfo),
    /// This is what I do; what shall I stop?
    Report(Report),
    /// I take no more units and have none.
    Leave,
    /// Give me a unit.
    Lease(Wanted),
    /// Give this to someone else.
    GiveBack(Held),
    /// The files of a scene, from a number on.
    Files(String, u32),
    /// At most [`super::times::PART_BYTES`] of a file.
    File(FilePart),
    /// Keep this.
    Result(FinishedUnit),
    /// I cannot render this.
    Failure(FailureReport),
}

/// An answer of the coordinator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// To [`Ask::Join`]. Workers of older builds read a refusal by its first name.
    #[serde(rename = "Welcome")]
    Joined(JoinReply),
    /// To [`Ask::Report`].
    Reported(ReportReply),
    /// To [`Ask::Leave`], [`Ask::GiveBack`] and [`Ask::Failure`].
    Noted,
    /// To [`Ask::Lease`].
    Granted(Granted),
    /// To [`Ask::Files`], with the number of all files. None if there is no such scene.
    Files(Option<(Vec<SceneFile>, u32)>),
    /// To [`Ask::File`]; none if it cannot be read. The bytes travel beside the rest.
    File(#[serde(skip)] Option<Vec<u8>>),
    /// To [`Ask::Result`].
    Result(ResultReply),
}

/// Answers workers. What they say is the word of a stranger, but for their key: the bus vouches for it where the server
/// knows keys.
pub trait Coordinator: Send + Sync {
    /// Answers the worker of a key. It may be called by many threads at the same time.
    fn answer(&self, key: &str, ask: Ask) -> Answer;

    /// True if parts of a result of so many bytes may be collected for the worker of a key.
    fn expects(&self, key: &str, finished: &FinishedUnit, bytes: u64) -> bool;
}
