//! What workers ask of the coordinator.

use super::unit::UnitId;
use crate::render::{PARTIAL_FILM_VERSION, PICTURE_VERSION};
use crate::scene::FINGERPRINT_VERSION;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What must be the same for two processes to make the same patches. Shaders are parts of scenes, whose fingerprints
/// are compared for each frame; the binary is not compared, because machines of several kinds render one picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Build(BTreeMap<String, String>);

/// Counts incompatible messages between coordinator and workers.
const PROTOCOL_VERSION: u32 = 4;

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

/// What a worker is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Its name: no other worker's.
    pub worker: String,
    /// Its machine.
    pub host: String,
    /// Its build.
    pub build: Build,
    /// Units that it renders at the same time.
    pub slots: u32,
    /// What traces there, in words.
    pub units: String,
    /// The address at which it is asked for tiles of live views. None if it renders none.
    #[serde(default)]
    pub live: Option<String>,
}

/// The answer to a worker that joins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Welcome {
    /// It may take units, and its leases last this long.
    Joined {
        /// Milliseconds.
        lease_ms: u64,
    },
    /// It may not, and why.
    Refused(String),
}

/// What a worker tells from time to time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Its name.
    pub worker: String,
    /// The units that it has leased.
    pub units: Vec<UnitId>,
    /// Whether it takes no more units.
    pub is_draining: bool,
    /// Scenes that it found in its cache, and scenes that it fetched.
    pub cache: (u64, u64),
    /// Rays that it has traced.
    pub rays: u64,
}

/// The answer to a report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Orders {
    /// Units that it is to stop.
    pub stop: Vec<UnitId>,
    /// Why it may take no more units.
    pub refused: Option<String>,
    /// Whether the coordinator does not know it: it is to join again.
    pub is_unknown: bool,
}

/// The answer to a worker that is about to render a unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Start {
    /// It is to be rendered.
    Go,
    /// It needs no work any more.
    Skip,
    /// Not now, or not by this worker.
    Wait,
    /// The worker may take no units.
    Refused(String),
}

/// A rendered unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinishedUnit {
    /// The unit.
    pub unit: UnitId,
    /// Who has rendered it.
    pub worker: String,
    /// What the worker's frame is a function of ([`crate::serve::OpenJob::identity`]).
    pub identity: String,
    /// The SHA-256 of the sums.
    pub digest: String,
    /// How long it took, with opening its scene.
    pub seconds: f64,
    /// How long opening its scene took: fetching and reading it, where it was not there.
    pub opening_s: f64,
    /// [`crate::render::Patch::sums`]. They travel beside the rest.
    #[serde(skip)]
    pub sums: Arc<Vec<u8>>,
}

/// What became of a rendered unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// It is on the disk and in the ledger.
    Kept,
    /// It was there already.
    Duplicate,
    /// No one wants it any more.
    Stale,
    /// The disk or the ledger refuses now; send it again later.
    Later,
    /// It is not what was asked for, and why.
    Refused(String),
}

/// That a unit cannot be rendered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureReport {
    /// The unit.
    pub unit: UnitId,
    /// Who has tried.
    pub worker: String,
    /// Why not.
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

/// Where bytes of a file of a scene begin.
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
    Join(Card),
    /// This is what I do; what shall I stop?
    Report(Report),
    /// I take no more units and have none.
    Leave(String),
    /// Shall I render this? With the worker's name and the number of deliveries.
    Start(UnitId, String, u64),
    /// The files of a scene, from a number on.
    Files(String, u32),
    /// At most [`super::PART_BYTES`] of a file.
    File(FilePart),
    /// Keep this.
    Result(FinishedUnit),
    /// I cannot render this.
    Failure(FailureReport),
}

/// An answer of the coordinator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// To [`Ask::Join`].
    Welcome(Welcome),
    /// To [`Ask::Report`].
    Orders(Orders),
    /// To [`Ask::Leave`] and [`Ask::Failure`].
    Noted,
    /// To [`Ask::Start`].
    Start(Start),
    /// To [`Ask::Files`], with the number of all files. None if there is no such scene.
    Files(Option<(Vec<SceneFile>, u32)>),
    /// To [`Ask::File`]; none if it cannot be read. The bytes travel beside the rest.
    File(#[serde(skip)] Option<Vec<u8>>),
    /// To [`Ask::Result`].
    Verdict(Verdict),
}

/// Answers workers.
pub trait Desk: Send + Sync {
    /// Answers. It may be called by many threads at the same time.
    fn answer(&self, ask: Ask) -> Answer;
}
