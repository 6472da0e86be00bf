//! Which of several frames are done, kept in a file.

use super::animation::Animation;
use super::checkpoint::identity;
use crate::cli::args::RenderArgs;
use crate::cli::setup::Setup;
use crate::files::write_whole;
use crate::render::{Identity, Settings, compare};
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// A checkpoint of several frames: whole frames, each in its own file. A frame under way is begun anew.
pub struct FinishedFrames {
    path: PathBuf,
    pages: Pages,
}

/// What the file holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pages {
    /// What the pictures are a function of, but for the camera.
    raystream_frames: Identity,
    /// Of each frame that is done its camera and its picture's hash.
    done: BTreeMap<u32, (String, String)>,
}

impl FinishedFrames {
    /// What the flags ask for, if they do: a new one, or the one that is there.
    pub fn open(args: &RenderArgs, setup: &Setup, settings: &Settings) -> Result<Option<Self>> {
        let Some(path) = args.progress.checkpoint.clone() else { return Ok(None) };
        let name = path.display().to_string();
        let identity = identity(args, setup, settings);
        let none = Pages { raystream_frames: identity.clone(), done: BTreeMap::new() };
        let pages = match std::fs::read(&path) {
            Ok(kept) if args.progress.resume => {
                let pages: Pages = serde_json::from_slice(&kept)
                    .with_context(|| format!("{name}: it is no checkpoint of several frames"))?;
                compare(&pages.raystream_frames, &identity)
                    .with_context(|| format!("{name}: cannot go on from it; remove it to begin anew"))?;
                log::info!("{name}: {} frames have been done", pages.done.len());
                pages
            }
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("{name}: cannot be read"));
            }
            _ => none,
        };
        Ok(Some(Self { path, pages }))
    }

    /// The hash of a frame that has been done with the same camera, if its picture is still there.
    pub fn hash(&self, animation: &Animation, frame: u32) -> Option<&str> {
        let (camera, hash) = self.pages.done.get(&frame)?;
        let same = *camera == format!("{:?}", animation.camera(frame));
        (same && animation.file(frame).exists()).then_some(hash)
    }

    /// Notes that a frame is done and written.
    pub fn note(&mut self, animation: &Animation, frame: u32, hash: &str) -> Result<()> {
        let camera = format!("{:?}", animation.camera(frame));
        self.pages.done.insert(frame, (camera, hash.to_owned()));
        let text = serde_json::to_vec_pretty(&self.pages)?;
        write_whole(&self.path, |file| {
            file.write_all(&text)?;
            file.flush()?;
            file.get_ref().sync_all()
        })?;
        Ok(())
    }
}
