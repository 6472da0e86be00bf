//! What a worker is given.

use raystream::picture::RenderSpec;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// The name of a unit.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitId {
    /// The job.
    pub job: String,
    /// The frame.
    pub frame: u32,
    /// The number of times that the frame has begun anew: units of one round have nothing to do with those of another.
    pub round: u32,
    /// The pass of the frame.
    pub pass: u64,
    /// Its number in the pass.
    pub number: u32,
    /// 0, or 1 for a second rendering that is compared with the first.
    pub copy: u32,
}

impl fmt::Display for UnitId {
    /// In letters, digits and dots, as in subjects.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { job, frame, round, pass, number, copy } = self;
        write!(f, "{job}.{frame}.{round}.{pass}.{number}.{copy}")
    }
}

/// Samples of some blocks of a frame, and all that is needed to render them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unit {
    /// Its name.
    pub id: UnitId,
    /// The SHA-256 of the scene.
    pub scene: String,
    /// The scene file in a pack, if there are several.
    pub entry: Option<String>,
    /// The picture, without the scene.
    pub spec: RenderSpec,
    /// The name of its priority.
    pub priority: String,
    /// The blocks of the frame.
    pub blocks: Vec<u32>,
    /// The samples of each of their pixels.
    pub samples: Range<u32>,
}
