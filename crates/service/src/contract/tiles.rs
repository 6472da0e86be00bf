//! Tiles of live views: what a coordinator asks of workers, and what they answer.

use raystream::picture::RenderSpec;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// A scene that views show.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LiveScene {
    /// The SHA-256 by which it was uploaded.
    pub sha256: String,
    /// The scene file in an archive; `None` for the one that is found in it.
    pub entry: Option<String>,
    /// The hash of all that its picture is a function of ([`crate::backend::OpenJob::identity`]). A worker that finds
    /// another one makes other pixels, and refuses.
    pub identity: String,
}

/// Texts of shaders in WGSL, by the files that a spec's surfaces name.
pub type ShaderTexts = BTreeMap<String, String>;

/// Rows of a frame that are wanted soon. They are a function of all but `view`, `frame`, `is_metered` and `budget_ms`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TileAsk {
    /// The view. Of its frames only the newest is wanted.
    pub view: u64,
    /// The frame's number in its view, which rises.
    pub frame: u64,
    /// The whole frame: size, samples, bounces, seed, camera, look, materials, surfaces, time, animation, and nothing
    /// else. Its exposure is a number of stops.
    pub spec: Box<RenderSpec>,
    /// The shaders of its surfaces.
    pub shaders: ShaderTexts,
    /// The rows of the tile. The first one is a multiple of [`crate::live::STRIP_ROWS`].
    pub rows: Range<u32>,
    /// True if noise is removed from the tile.
    pub is_denoised: bool,
    /// True if [`Tile::light`] is wanted.
    pub is_metered: bool,
    /// Milliseconds after which the tile comes too late.
    pub budget_ms: u32,
}

/// A question to a worker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum LiveAsk {
    /// Have this scene ready.
    Prepare(LiveScene),
    /// Render rows of it, if it is ready.
    Tile(LiveScene, TileAsk),
}

/// Rows of a frame as a display shows them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tile {
    /// The rows.
    pub rows: Range<u32>,
    /// Sum of the binary logarithms of the luminances of lit pixels, and their number, from which automatic exposure
    /// follows. 0 unless asked for.
    pub light: (f64, u32),
    /// Seconds that rendering and encoding took.
    pub seconds: f64,
    /// A JPEG of the rows, with a restart marker after each strip. It travels beside the rest.
    #[serde(skip)]
    pub jpeg: Arc<Vec<u8>>,
}

/// A worker's answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum LiveAnswer {
    /// It has the scene.
    Ready,
    /// It fetches and reads the scene; ask again.
    Loading,
    /// There is no tile by the time at which it was wanted, or a newer frame is wanted.
    Late,
    /// It will not, and why.
    Refused(String),
    /// The rows.
    Tile(Tile),
}

/// Takes an answer. It may be dropped: then there is none.
pub type LiveReply = Box<dyn FnOnce(LiveAnswer) + Send>;

/// Answers what coordinators ask of a worker.
pub trait TileServer: Send + Sync {
    /// Answers now or later. It returns at once.
    fn take(&self, ask: LiveAsk, reply: LiveReply);
}
