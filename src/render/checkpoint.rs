//! What is kept of a frame, so that it can be gone on with after the process has ended in whatever way.

use super::progressive::State;
use super::{Blocks, Integrator, Pass, PassOptions, Progressive};
use crate::film::{Noise, take};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::ops::Range;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// What a picture is a function of, by name: scene, camera, settings, seed. Only a frame that agrees in
/// all of it may go on from a checkpoint.
pub type Identity = BTreeMap<String, String>;

/// How a checkpoint begins.
const MAGIC: &[u8; 20] = b"raystream checkpoint";

/// Counts incompatible formats.
const VERSION: u32 = 2;

/// The part of a checkpoint that is text.
#[derive(Serialize, Deserialize)]
struct Header {
    identity: Identity,
    blocks: Vec<u32>,
    todo: Range<u32>,
    begun: Vec<(Vec<u32>, Range<u32>)>,
    passes: u64,
    noise: bool,
}

/// Why a checkpoint is of no use.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Something else.
    #[error("it is not a checkpoint of raystream")]
    Foreign,
    /// From another version of raystream.
    #[error("it has version {0}, this raystream reads version {VERSION}")]
    Version(u32),
    /// Cut or changed.
    #[error("it is damaged")]
    Damaged,
    /// Of another picture.
    #[error("it is of another picture: {what} was {was}, now it is {is}")]
    Mismatch {
        /// What differs.
        what: String,
        /// In the checkpoint.
        was: String,
        /// As asked.
        is: String,
    },
}

impl<I: Integrator> Progressive<I> {
    /// Writes all that is needed to go on after the last complete pass. The format, all little-endian: the
    /// 20 bytes "raystream checkpoint"; a version (u32); the length (u64) and the bytes of a JSON header;
    /// bits after the point (u32), dropped splats (u64), sums (3 × i64 a pixel) and sample counts (u32 a pixel)
    /// of the film; if the header says so, each pixel's spread (f32) and passes (u16); XXH3 (u64) of all before it.
    ///
    /// # Errors
    /// When the file system refuses.
    pub fn save(&self, identity: &Identity, to: impl Write) -> std::io::Result<()> {
        let State { film, noise, blocks, todo, passes, .. } = self.state();
        let header = Header {
            identity: identity.clone(),
            blocks: blocks.to_vec(),
            todo: todo.clone(),
            begun: self.incomplete().map(|pass| (pass.blocks().to_vec(), pass.samples())).collect(),
            passes: *passes,
            noise: noise.is_some(),
        };
        let header = serde_json::to_vec(&header)?;
        let mut to = Summed { to, sum: Xxh3::new() };
        to.write_all(MAGIC)?;
        to.write_all(&VERSION.to_le_bytes())?;
        to.write_all(&(header.len() as u64).to_le_bytes())?;
        to.write_all(&header)?;
        film.save(&mut to)?;
        if let Some(noise) = noise {
            noise.save(&mut to)?;
        }
        let sum = to.sum.digest();
        to.to.write_all(&sum.to_le_bytes())?;
        to.to.flush()
    }

    /// Goes on from what [`Progressive::save`] wrote about the same frame.
    ///
    /// # Errors
    /// When it is not that, or not whole.
    pub fn resume(
        integrator: I,
        options: PassOptions,
        identity: &Identity,
        saved: &[u8],
    ) -> Result<Self, CheckpointError> {
        let rest = saved.strip_prefix(MAGIC).ok_or(CheckpointError::Foreign)?;
        let mut rest = rest;
        let version = u32::from_le_bytes(*take(&mut rest).ok_or(CheckpointError::Damaged)?);
        if version != VERSION {
            return Err(CheckpointError::Version(version));
        }
        let (content, sum) = saved.split_last_chunk().ok_or(CheckpointError::Damaged)?;
        if u64::from_le_bytes(*sum) != xxh3_64(content) {
            return Err(CheckpointError::Damaged);
        }
        let header = header(&mut rest).ok_or(CheckpointError::Damaged)?;
        compare(&header.identity, identity)?;
        let state = restore(&integrator, header, rest).ok_or(CheckpointError::Damaged)?;
        Ok(Self::with_state(integrator, options, state))
    }
}

fn header(rest: &mut &[u8]) -> Option<Header> {
    let length = usize::try_from(u64::from_le_bytes(*take(rest)?)).ok()?;
    let (header, after) = rest.split_at_checked(length)?;
    *rest = after;
    serde_json::from_slice(header).ok()
}

/// Looks for what differs between two pictures.
///
/// # Errors
/// [`CheckpointError::Mismatch`] names the first thing that does.
pub fn compare(was: &Identity, is: &Identity) -> Result<(), CheckpointError> {
    let nothing = || "not given".to_owned();
    for what in was.keys().chain(is.keys()) {
        let (was, is) = (was.get(what), is.get(what));
        if was != is {
            let [was, is] = [was, is].map(|value| value.cloned().unwrap_or_else(nothing));
            return Err(CheckpointError::Mismatch { what: what.clone(), was, is });
        }
    }
    Ok(())
}

fn restore(integrator: &impl Integrator, header: Header, mut rest: &[u8]) -> Option<State> {
    let Header { blocks, todo, begun, passes, noise, .. } = header;
    let frame = integrator.frame();
    let film = frame.film().restored(&mut rest)?;
    let noise = if noise { Some(Noise::restored(&film, &mut rest)?) } else { None };
    let is_pass = |blocks: &[u32], samples: &Range<u32>| {
        fits(frame.blocks(), blocks) && samples.end <= frame.settings().spp
    };
    // The sum is only there against accidents; whoever forges one gets an error, not a panic.
    let sound = rest.len() == size_of::<u64>()
        && is_pass(&blocks, &todo)
        && begun.iter().all(|(blocks, samples)| is_pass(blocks, samples));
    let begun = begun.into_iter().map(|(blocks, samples)| Pass::new(blocks.into(), samples)).collect();
    sound.then(|| State { film: film.into(), noise, blocks: blocks.into(), todo, begun, passes })
}

fn fits(all: Blocks, blocks: &[u32]) -> bool {
    blocks.iter().all(|&block| (block as usize) < all.count())
}

/// Writes and takes the sum of what is written.
struct Summed<W> {
    to: W,
    sum: Xxh3,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.sum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }
}
