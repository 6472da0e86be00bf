//! Rows of the tables.

use super::usage::Quotas;
use crate::backend::JobCost;
use crate::coordinator::request::Webhook;
use raystream::render::BLOCK;
use raystream::schedule::Priority;
use rusqlite::Row;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The state of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JobState {
    /// Waits for its first unit.
    Queued,
    /// Has begun.
    Running,
    /// Waits until someone resumes it.
    Paused,
    /// Has all its pictures.
    Done,
    /// Cannot go on.
    Failed,
    /// Was abandoned by a request.
    Cancelled,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 6] =
        [Self::Queued, Self::Running, Self::Paused, Self::Done, Self::Failed, Self::Cancelled];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// True if the job has ended.
    pub fn has_ended(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Cancelled)
    }
}

impl fmt::Display for JobState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for JobState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::name).join(", ");
        let found = Self::ALL.into_iter().find(|state| state.name() == text);
        found.ok_or_else(|| format!("{text:?} is no state; ask for one of {}", names()))
    }
}

/// A job.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its place in the order of arrival.
    pub seq: i64,
    /// Its name in requests.
    pub id: String,
    /// The tenant that it belongs to.
    pub tenant: String,
    /// Its state.
    pub state: JobState,
    /// The request, as JSON.
    pub request: String,
    /// The name of the request that submitted it; empty if an older raystream took it.
    pub request_id: String,
    /// The span that it is a part of, as a `traceparent`; empty if there is none.
    pub trace_parent: String,
    /// Its cost: pixels, samples and frames.
    pub demand: JobCost,
    /// The SHA-256 of its scene.
    pub scene: String,
    /// Its priority.
    pub priority: Priority,
    /// Milliseconds since 1970.
    pub created_ms: i64,
    /// The time at which its first unit could begin, in milliseconds since 1970.
    pub began_ms: Option<i64>,
    /// Milliseconds since 1970.
    pub ended_ms: Option<i64>,
    /// The reason why it failed.
    pub error: Option<String>,
    /// True if its frames and units are known.
    pub is_planned: bool,
    /// Time that its pictures by seconds have taken.
    pub spent_ms: i64,
    /// True if it is kept until someone deletes it.
    pub is_pinned: bool,
}

impl Job {
    pub(super) const COLUMNS: &str = "seq, id, state, request, demand, scene, priority, created_ms, ended_ms, error, \
        planned, spent_ms, tenant, began_ms, pinned, request_id, trace_parent";

    /// The job and the request that submitted it, as lines of the log begin.
    pub fn subject(&self) -> String {
        let Self { id, request_id, .. } = self;
        match &**request_id {
            "" => format!("job {id}"),
            request => format!("job {id}, request {request}"),
        }
    }

    pub(super) fn of(row: &Row<'_>) -> rusqlite::Result<Self> {
        let text = |column: usize| row.get::<_, String>(column);
        let wrong = |column: usize| {
            rusqlite::Error::InvalidColumnType(column, "job".into(), rusqlite::types::Type::Text)
        };
        let priority = priority(&text(6)?).ok_or_else(|| wrong(6))?;
        Ok(Self {
            seq: row.get(0)?,
            id: text(1)?,
            state: text(2)?.parse().map_err(|_| wrong(2))?,
            request: text(3)?,
            demand: serde_json::from_str(&text(4)?).map_err(|_| wrong(4))?,
            scene: text(5)?,
            priority,
            created_ms: row.get(7)?,
            ended_ms: row.get(8)?,
            error: row.get(9)?,
            is_planned: row.get(10)?,
            spent_ms: row.get(11)?,
            tenant: text(12)?,
            began_ms: row.get(13)?,
            is_pinned: row.get(14)?,
            request_id: row.get(15)?,
            trace_parent: row.get(16)?,
        })
    }
}

/// The priority of a name.
pub fn priority(name: &str) -> Option<Priority> {
    Priority::ALL.into_iter().find(|priority| priority.name() == name)
}

/// A job to be accepted.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Its name in requests.
    pub id: String,
    /// The tenant that it belongs to.
    pub tenant: String,
    /// The request, as JSON.
    pub request: String,
    /// The name of the request.
    pub request_id: String,
    /// The span that it is a part of, as a `traceparent`; empty if there is none.
    pub trace_parent: String,
    /// The SHA-256 of what its pictures depend on.
    pub request_hash: String,
    /// Its cost: pixels, samples and frames.
    pub demand: JobCost,
    /// The SHA-256 of its scene.
    pub scene: String,
    /// Its priority.
    pub priority: Priority,
    /// The client's name of the request, if it gives one.
    pub idempotency_key: Option<String>,
    /// The address that is called when it ends.
    pub webhook: Option<Webhook>,
    /// Its title; empty if it has none.
    pub title: String,
    /// Words by which it is found.
    pub labels: Vec<String>,
    /// Bounds of what the tenant may use.
    pub quotas: Quotas,
    /// The place in the order of arrival behind which a job of the same request may be this one's answer; `None` if
    /// none may.
    pub shared_after: Option<i64>,
}

/// The jobs of a list. What is `None` is not asked for.
#[derive(Clone, Debug, Default)]
pub struct JobFilter {
    /// Their tenant; `None` for all.
    pub tenant: Option<String>,
    /// Their state.
    pub state: Option<JobState>,
    /// A piece of their title, of a label or of their name, in any case.
    pub text: Option<String>,
    /// One of their labels.
    pub label: Option<String>,
    /// They were submitted at this time or later, in milliseconds since 1970.
    pub since_ms: Option<i64>,
    /// They were submitted before, in milliseconds since 1970.
    pub until_ms: Option<i64>,
}

/// The jobs whose events are asked for.
#[derive(Clone, Copy, Debug)]
pub enum EventsOf<'a> {
    /// One job.
    Job(&'a str),
    /// Those of a tenant.
    Tenant(&'a str),
    /// All.
    All,
}

/// Something that happened to a job.
#[derive(Clone, Debug, Serialize)]
pub struct Event {
    /// Its number; later events have larger ones.
    pub seq: i64,
    /// The job.
    pub job: String,
    /// Milliseconds since 1970.
    pub time_ms: i64,
    /// The kind of event.
    pub kind: String,
    /// More about it, as JSON.
    pub data: String,
}

/// A picture of a job.
#[derive(Clone, Debug)]
pub struct FrameRow {
    /// Its number.
    pub number: u32,
    /// The name of its camera.
    pub name: String,
    /// The hash of its radiance, once it is finished.
    pub hash: Option<String>,
    /// The hashes of its layers by name, as JSON, once it is finished.
    pub layers: Option<String>,
    /// Facts about the picture, as JSON, once it is finished.
    pub metadata: Option<String>,
    /// The sums of its files by their extensions, as JSON, if they are objects of a storage.
    pub objects: Option<String>,
}

/// The state of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum UnitState {
    /// It is to be rendered.
    Open,
    /// Its sums are in a file of their own.
    Kept,
    /// They are in the frame's file of sums, or the frame has its picture.
    Folded,
}

/// A piece of a frame's pass: the same samples of some neighbours in the pass's list of blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitRow {
    /// The frame.
    pub frame: u32,
    /// The pass.
    pub pass: u64,
    /// Its number in the pass.
    pub number: u32,
    /// The first of its blocks, in the pass's list.
    pub block: u32,
    /// The number of its blocks.
    pub blocks: u32,
    /// Its first sample.
    pub first: u32,
    /// The sample after its last.
    pub end: u32,
    /// Its state.
    pub state: UnitState,
    /// The key of the worker that has rendered it.
    pub worker: Option<String>,
    /// The SHA-256 of its sums.
    pub digest: Option<String>,
}

impl UnitRow {
    /// Its samples of all pixels, as if its blocks were whole.
    pub fn samples(&self) -> u64 {
        u64::from(BLOCK * BLOCK) * u64::from(self.blocks) * u64::from(self.end - self.first)
    }

    pub(super) const COLUMNS: &str = "frame, pass, number, block, blocks, first, end, state, worker, digest";

    pub(super) fn of(row: &Row<'_>) -> rusqlite::Result<Self> {
        let state = match row.get::<_, i64>(7)? {
            0 => UnitState::Open,
            1 => UnitState::Kept,
            _ => UnitState::Folded,
        };
        Ok(Self {
            frame: row.get(0)?,
            pass: row.get::<_, i64>(1)? as u64,
            number: row.get(2)?,
            block: row.get(3)?,
            blocks: row.get(4)?,
            first: row.get(5)?,
            end: row.get(6)?,
            state,
            worker: row.get(8)?,
            digest: row.get(9)?,
        })
    }
}

/// A unit that is kept and is to be compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Pending {
    /// The unit, with the key of who has rendered it and the digest of its sums.
    pub unit: UnitRow,
    /// Its blocks.
    pub blocks: Vec<u32>,
    /// The worker's name.
    pub name: String,
}

impl Pending {
    pub(super) fn of(row: &Row<'_>, frame: u32) -> rusqlite::Result<Self> {
        let list: Vec<u8> = row.get(5)?;
        let (list, _) = list.as_chunks();
        let blocks: Vec<u32> = list.iter().copied().map(u32::from_le_bytes).collect();
        let unit = UnitRow {
            frame,
            pass: row.get::<_, i64>(0)? as u64,
            number: row.get(1)?,
            block: row.get(2)?,
            blocks: blocks.len() as u32,
            first: row.get(3)?,
            end: row.get(4)?,
            state: UnitState::Kept,
            worker: row.get(6)?,
            digest: row.get(8)?,
        };
        Ok(Self { unit, blocks, name: row.get(7)? })
    }
}

/// The checks of a job's workers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Checks {
    /// Units whose sums two workers have made.
    pub compared: u64,
    /// Workers that took part in that.
    pub keys: u32,
    /// Names of workers that were found wrong later, and whose sums are in the job's pictures.
    pub suspects: Vec<String>,
}

/// The rendering of a unit, as the coordinator saw it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rendering {
    /// The time at which its worker was told to render it, in milliseconds since 1970.
    pub began_ms: f64,
    /// The time at which its sums had come, in milliseconds since 1970.
    pub came_ms: f64,
    /// Seconds that its worker took, with opening its scene.
    pub seconds: f64,
    /// Seconds that opening the scene took.
    pub opening_s: f64,
    /// Its blocks.
    pub blocks: u32,
    /// Pixels × samples, with whole blocks at the edges of the picture.
    pub samples: u64,
    /// Bytes of its sums.
    pub bytes: u64,
    /// The number of times that it was leased.
    pub deliveries: u64,
}

/// The part of a job that is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Totals {
    /// Frames in all.
    pub frames: u64,
    /// Finished frames.
    pub frames_done: u64,
    /// Units that have been cut so far. More are cut as they are needed.
    pub units: u64,
    /// Units whose films are kept or whose frames are finished.
    pub units_done: u64,
    /// The share of the samples that have been taken, from 0 to 1. A job with a noise to end at may take fewer.
    pub share: f64,
}
