//! Checkpoints: the state of a frame, from which rendering continues after the process has ended in any way.

use super::progressive::{State, UnfinishedPass};
use super::summed::Summed;
use super::{Frame, Integrator, PICTURE_VERSION, Pass, PassOptions, Progressive};
use crate::film::{Noise, take};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::ops::Range;
use xxhash_rust::xxh3::xxh3_64;

/// All that a picture is a function of, by name: scene, camera, settings, seed, and always [`PICTURE_VERSION`]. A frame
/// continues from a checkpoint only if it agrees in all of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Identity(BTreeMap<String, String>);

impl Identity {
    /// The name of [`PICTURE_VERSION`].
    const PICTURES: &str = "the version of the pictures";

    /// Of a picture of this build that is a function of these, by name.
    pub fn new(parts: impl IntoIterator<Item = (String, String)>) -> Self {
        let version = (Self::PICTURES.to_owned(), PICTURE_VERSION.to_string());
        Self(parts.into_iter().chain([version]).collect())
    }

    /// Looks for what differs between this, which was kept, and the picture that is requested now.
    ///
    /// # Errors
    /// [`CheckpointError::Mismatch`] names the first thing that does.
    pub fn compare(&self, now: &Self) -> Result<(), CheckpointError> {
        let nothing = || "not given".to_owned();
        match self.difference(now) {
            Some((what, values)) => {
                let [was, is] = values.map(|value| value.map_or_else(nothing, str::to_owned));
                Err(CheckpointError::Mismatch { what: what.to_owned(), was, is })
            }
            None => Ok(()),
        }
    }

    /// The name and the two values of the first thing in which two pictures differ: their version before all, since
    /// another build may write the other things in another way.
    pub fn difference<'a>(&'a self, other: &'a Self) -> Option<(&'a str, [Option<&'a str>; 2])> {
        let names: BTreeSet<&str> = self.0.keys().chain(other.0.keys()).map(String::as_str).collect();
        [Self::PICTURES].into_iter().chain(names).find_map(|what| {
            let values = [self, other].map(|of| of.0.get(what).map(String::as_str));
            (values[0] != values[1]).then_some((what, values))
        })
    }

    /// The same picture with one more thing that it is a function of.
    pub fn with(mut self, what: impl Into<String>, value: impl Into<String>) -> Self {
        self.0.insert(what.into(), value.into());
        self
    }

    /// All that the picture is a function of, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(what, value)| (what.as_str(), value.as_str()))
    }
}

/// The first bytes of a checkpoint.
const MAGIC: &[u8; 20] = b"raystream checkpoint";

/// Counts incompatible formats of checkpoints, those of several frames included.
pub const CHECKPOINT_VERSION: u32 = 5;

/// The JSON header of a checkpoint.
#[derive(Serialize, Deserialize)]
struct Header {
    identity: Identity,
    /// The names of the layers.
    layers: String,
    blocks: Vec<u32>,
    todo: Range<u32>,
    unfinished: Vec<PassHeader>,
    passes: u64,
    noise: bool,
}

/// Header's part about an unfinished pass.
#[derive(Serialize, Deserialize)]
struct PassHeader {
    blocks: Vec<u32>,
    samples: Range<u32>,
    /// Tiles that have been taken.
    taken: u64,
    /// True if their film follows.
    film: bool,
}

impl PassHeader {
    fn of(UnfinishedPass { rest, film }: &UnfinishedPass) -> Self {
        let (blocks, taken) = (rest.blocks().to_vec(), rest.taken());
        Self { blocks, samples: rest.samples(), taken, film: film.is_some() }
    }

    fn restore(self, frame: &Frame, from: &mut &[u8]) -> Option<UnfinishedPass> {
        let Self { blocks, samples, taken, film } = self;
        let whole =
            is_pass(frame, &blocks, &samples).then(|| frame.whole_pass(Pass::new(blocks.into(), samples)))?;
        let film = if film { Some(frame.film().restored(from)?.into()) } else { None };
        Some(UnfinishedPass { rest: whole.after(taken)?, film })
    }
}

/// Error of using a checkpoint.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file is not a checkpoint.
    #[error("it is not a checkpoint of raystream")]
    Foreign,
    /// In another format.
    #[error("it is a checkpoint of version {0}, and this raystream reads version {CHECKPOINT_VERSION} only")]
    Version(u32),
    /// The file is truncated or damaged.
    #[error("it is damaged")]
    Damaged,
    /// The checkpoint is of another picture.
    #[error("it is of another picture: {what} was {was}, now it is {is}")]
    Mismatch {
        /// The name of what differs.
        what: String,
        /// Its value in the checkpoint.
        was: String,
        /// Its requested value.
        is: String,
    },
}

impl<I: Integrator> Progressive<I> {
    /// Writes the state after the last complete pass, and what stopped passes have taken. The format, all
    /// little-endian: the 20 bytes "raystream checkpoint"; a version (u32); the length (u64) and the bytes of a JSON
    /// header; bits after the point (u32), dropped and clamped splats (2 × u64), sums (3 × i64 a pixel) and sample
    /// counts (u32 a pixel) of the film, and its layers; if the header says so, each pixel's spread (f32) and passes
    /// (u16); the film of each unfinished pass that has one; XXH3 (u64) of all before it.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn save(&self, identity: &Identity, to: impl Write) -> std::io::Result<()> {
        let State { film, noise, blocks, todo, unfinished, passes } = self.state();
        let header = Header {
            identity: identity.clone(),
            layers: layers(self.integrator().frame()),
            blocks: blocks.to_vec(),
            todo: todo.clone(),
            unfinished: unfinished.iter().map(PassHeader::of).collect(),
            passes: *passes,
            noise: noise.is_some(),
        };
        let header = serde_json::to_vec(&header)?;
        let mut to = Summed::new(to);
        to.write_all(MAGIC)?;
        to.write_all(&CHECKPOINT_VERSION.to_le_bytes())?;
        to.write_all(&(header.len() as u64).to_le_bytes())?;
        to.write_all(&header)?;
        film.save(&mut to)?;
        if let Some(noise) = noise {
            noise.save(&mut to)?;
        }
        for film in unfinished.iter().filter_map(|pass| pass.film.as_ref()) {
            film.save(&mut to)?;
        }
        to.finish()
    }

    /// Continues from what [`Progressive::save`] wrote for the same frame.
    ///
    /// # Errors
    /// If it is of another frame, or damaged.
    pub fn resume(
        integrator: I,
        options: PassOptions,
        identity: &Identity,
        saved: &[u8],
    ) -> Result<Self, CheckpointError> {
        let rest = saved.strip_prefix(MAGIC).ok_or(CheckpointError::Foreign)?;
        let mut rest = rest;
        let version = u32::from_le_bytes(*take(&mut rest).ok_or(CheckpointError::Damaged)?);
        if version != CHECKPOINT_VERSION {
            return Err(CheckpointError::Version(version));
        }
        let (content, sum) = saved.split_last_chunk().ok_or(CheckpointError::Damaged)?;
        if u64::from_le_bytes(*sum) != xxh3_64(content) {
            return Err(CheckpointError::Damaged);
        }
        let header = header(&mut rest).ok_or(CheckpointError::Damaged)?;
        header.identity.compare(identity)?;
        let layers = layers(integrator.frame());
        if header.layers != layers {
            let (what, was) = ("the list of layers".to_owned(), header.layers);
            return Err(CheckpointError::Mismatch { what, was, is: layers });
        }
        let state = restore(&integrator, header, rest).ok_or(CheckpointError::Damaged)?;
        Ok(Self::with_state(integrator, options, state))
    }
}

/// The names of a frame's layers.
fn layers(frame: &Frame) -> String {
    match frame.aovs() {
        none if none.is_empty() => "empty".into(),
        aovs => aovs.to_string(),
    }
}

fn header(rest: &mut &[u8]) -> Option<Header> {
    let length = usize::try_from(u64::from_le_bytes(*take(rest)?)).ok()?;
    let (header, after) = rest.split_at_checked(length)?;
    *rest = after;
    serde_json::from_slice(header).ok()
}

fn restore(integrator: &impl Integrator, header: Header, mut rest: &[u8]) -> Option<State> {
    let Header { blocks, todo, unfinished, passes, noise, .. } = header;
    let frame = integrator.frame();
    let film = frame.film().restored(&mut rest)?;
    let noise = if noise { Some(Noise::restored(&film, &mut rest)?) } else { None };
    let unfinished: Option<_> = unfinished.into_iter().map(|pass| pass.restore(frame, &mut rest)).collect();
    // The sum is only there against accidents; whoever forges one gets an error, not a panic.
    let sound = rest.len() == size_of::<u64>() && is_pass(frame, &blocks, &todo);
    let (film, blocks, unfinished) = (film.into(), blocks.into(), unfinished?);
    sound.then_some(State { film, noise, blocks, todo, unfinished, passes })
}

/// True if a frame has these blocks and samples.
fn is_pass(frame: &Frame, blocks: &[u32], samples: &Range<u32>) -> bool {
    let all = frame.blocks().count();
    blocks.iter().all(|&block| (block as usize) < all) && samples.end <= frame.settings().spp
}
