//! What the service leaves to its owner: checking options, reading scenes, rendering.

use crate::engine::PreparedScene;
use crate::film::Picture;
use crate::film::tev::Tev;
use crate::render::{Pass, Patch};
use crate::schedule::{Priority, Service};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Checks options, reads scenes and renders. Errors are sentences for whoever sent the request.
pub trait Pictures: Send + Sync + 'static {
    /// The scheduler that all jobs and views share.
    fn service(&self) -> &Arc<Service>;

    /// Checks the options of a job, by their long names on the command line of `raystream render`, before its scene is
    /// read. Files that options name lie in `folder`.
    ///
    /// # Errors
    /// What is wrong with an option.
    fn check(&self, options: &Map<String, Value>, scene: &Path, folder: &Path) -> Result<Demand, String>;

    /// Looks whether a scene can be read, in a process of its own whose memory and time are limited.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn try_scene(
        &self,
        options: &Map<String, Value>,
        scene: &Path,
        folder: &Path,
        time: Duration,
    ) -> Result<u64, String>;

    /// Reads the scene of a job that has been checked, or finds it in the cache.
    ///
    /// # Errors
    /// Why it cannot be read, or what options and scene have against each other.
    fn open(
        &self,
        options: &Map<String, Value>,
        scene: &Path,
        folder: &Path,
    ) -> Result<Box<dyn Shots>, String>;

    /// The viewer that live views are shown in, too.
    fn viewer(&self) -> Option<Arc<Tev>>;

    /// Lets go of the scenes of a folder that the cache holds: none of them will be asked for again.
    fn forget(&self, folder: &Path);
}

/// How the samples of a job's pictures are decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Kind {
    /// A number of samples: any units add up to the picture.
    Samples,
    /// A noise to end at: passes whose places follow from the sums of earlier ones.
    Noise,
    /// A time: one unit a frame, and a picture that is no function of the request.
    Seconds,
}

/// What a job asks for, as far as its options tell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Demand {
    /// Width and height of the whole picture in pixels.
    pub size: (u32, u32),
    /// The most samples per pixel.
    pub spp: u32,
    /// The number of frames; `None` if the scene decides.
    pub frames: Option<u32>,
    /// How samples are decided.
    pub kind: Kind,
}

impl Demand {
    /// A demand.
    pub const fn new(size: (u32, u32), spp: u32, frames: Option<u32>, kind: Kind) -> Self {
        Self { size, spp, frames, kind }
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> u64 {
        u64::from(self.size.0) * u64::from(self.size.1)
    }

    /// Pixels × samples × frames, with one frame where the scene decides.
    pub fn samples(&self) -> u64 {
        let frames = u64::from(self.frames.unwrap_or(1));
        self.pixels().saturating_mul(self.spp.into()).saturating_mul(frames)
    }
}

/// A picture of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Frame {
    /// Its number.
    pub number: u32,
    /// The name of its camera, where cameras have names.
    pub name: String,
}

impl Frame {
    /// A frame.
    pub fn new(number: u32, name: impl Into<String>) -> Self {
        Self { number, name: name.into() }
    }
}

/// What a unit under way tells and is told.
pub trait Watch: Sync {
    /// How urgent the unit is.
    fn priority(&self) -> Priority;

    /// Whether the unit is to stop.
    fn is_stopped(&self) -> bool;

    /// Counts rays that have been traced.
    fn traced(&self, rays: u64, seconds: f64);

    /// Tells what share of the unit is done, from 0 to 1.
    fn progress(&self, share: f64);
}

/// A job whose scene has been read.
pub trait Shots: Send + Sync {
    /// Its scene.
    fn prepared(&self) -> &PreparedScene;

    /// Its pictures.
    ///
    /// # Errors
    /// What options and scene have against each other.
    fn frames(&self) -> Result<Vec<Frame>, String>;

    /// What a frame is a function of, as a hash. Processes with the same hash make the same patches.
    ///
    /// # Errors
    /// If the job has no such frame.
    fn identity(&self, frame: u32) -> Result<String, String>;

    /// Renders the samples of a piece of a frame's pass.
    ///
    /// # Errors
    /// Why not.
    fn patch(&self, frame: u32, piece: Pass, watch: &dyn Watch) -> Result<Patch, String>;

    /// A frame whose patches are to be added up: from its first sample, or from what [`Gathering::save`] wrote.
    ///
    /// # Errors
    /// Why not.
    fn gather(&self, frame: u32, saved: Option<&[u8]>) -> Result<Box<dyn Gathering>, String>;

    /// Renders a frame whose samples the time decides. What has been rendered is kept in `checkpoint` from
    /// time to time and when the unit is stopped, and is gone on from. `None` if it was stopped.
    ///
    /// # Errors
    /// Why not.
    fn whole(
        &self,
        frame: u32,
        checkpoint: &Path,
        spent: Duration,
        watch: &dyn Watch,
    ) -> Result<Option<Picture>, String>;

    /// Writes a picture as the options ask, in the format of the file's name.
    ///
    /// # Errors
    /// Why it cannot be written.
    fn write(&self, picture: &Picture, path: &Path) -> Result<(), String>;
}

/// A frame whose passes are rendered in pieces, which are added up here.
pub trait Gathering: Send {
    /// The passes that may be rendered now, with their numbers. None once the frame is complete.
    fn passes(&self) -> Vec<(u64, Pass)>;

    /// Adds a patch of an open pass. No sample must be added twice. An error changes nothing.
    ///
    /// # Errors
    /// Why the patch is none of the pass.
    fn add(&mut self, pass: u64, patch: &Patch) -> Result<(), String>;

    /// Whether all samples have been taken that are wanted.
    fn is_complete(&self) -> bool;

    /// Writes all sums.
    ///
    /// # Errors
    /// If the file system refuses.
    fn save(&self, to: &mut dyn io::Write) -> io::Result<()>;

    /// The picture of all complete passes.
    ///
    /// # Errors
    /// What options and scene have against each other.
    fn develop(&self) -> Result<Picture, String>;
}
