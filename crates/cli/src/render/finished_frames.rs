//! The checkpoint of an animation: which frames are finished.

use super::animation::Animation;
use crate::args::RenderArgs;
use anyhow::{Context, Result};
use raystream::files;
use raystream::picture::Rendering;
use raystream::render::{CHECKPOINT_VERSION, CheckpointError, Identity};
use raystream::scene::Camera;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// The checkpoint of an animation. It lists finished frames. Beside it, an interrupted run keeps the samples of
/// unfinished ones (`Checkpoint::of_frame`).
pub struct FinishedFrames {
    path: PathBuf,
    content: Content,
    /// True if the file has another content.
    has_changed: bool,
}

/// The file's content.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    /// [`CHECKPOINT_VERSION`]. Files of version 2 and before do not have it.
    #[serde(default = "Content::unwritten_version")]
    version: u32,
    /// Everything that the pictures depend on except their cameras.
    raystream_frames: Identity,
    /// Camera and picture hash of each finished frame.
    done: BTreeMap<u32, (String, String)>,
}

impl Content {
    /// The version of a file that does not tell its own.
    fn unwritten_version() -> u32 {
        2
    }
}

impl FinishedFrames {
    /// The checkpoint that the options name, if any: the existing file with `--resume`, else a new one.
    pub fn open(args: &RenderArgs, rendering: &Rendering) -> Result<Option<Self>> {
        let Some(path) = args.saving.checkpoint.clone() else { return Ok(None) };
        let name = path.display().to_string();
        let identity = rendering.identity(None);
        let version = CHECKPOINT_VERSION;
        let none = Content { version, raystream_frames: identity.clone(), done: BTreeMap::new() };
        let content = match std::fs::read(&path) {
            Ok(kept) if args.saving.resume => {
                let content: Content = serde_json::from_slice(&kept)
                    .with_context(|| format!("{name}: not a checkpoint of an animation"))?;
                let same = match content.version {
                    CHECKPOINT_VERSION => content.raystream_frames.compare(&identity),
                    other => Err(CheckpointError::Version(other)),
                };
                same.with_context(|| format!("{name}: cannot resume from it; remove it to start over"))?;
                log::info!("{name}: {} frames are finished", content.done.len());
                content
            }
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("{name}: cannot be read"));
            }
            _ => none,
        };
        Ok(Some(Self { path, content, has_changed: false }))
    }

    /// The hash of a frame finished with the same camera, if its files still exist.
    pub fn hash(&self, animation: &Animation, frame: u32, camera: &Camera) -> Option<&str> {
        let (finished, hash) = self.content.done.get(&frame)?;
        let same = *finished == camera.to_string();
        let files = [animation.picture(frame), animation.partial(frame)];
        (same && files.iter().flatten().all(|file| file.exists())).then_some(hash)
    }

    /// Notes that a frame is finished and its picture written.
    pub fn note(&mut self, frame: u32, camera: &Camera, hash: &str) {
        self.content.done.insert(frame, (camera.to_string(), hash.to_owned()));
        self.has_changed = true;
    }

    /// Writes the notes, if there are new ones.
    pub fn write(&mut self) -> Result<()> {
        if !self.has_changed {
            return Ok(());
        }
        let text = serde_json::to_vec_pretty(&self.content)?;
        files::write(&self.path, |file| {
            file.write_all(&text)?;
            file.flush()?;
            file.get_ref().sync_all()
        })?;
        self.has_changed = false;
        Ok(())
    }
}
