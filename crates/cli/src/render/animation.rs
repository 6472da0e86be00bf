//! The files of several pictures of one scene.

use super::names::Names;
use crate::args::RenderArgs;
use anyhow::{Result, bail, ensure};
use raystream::picture::{Frames, Rendering};
use raystream::scene::Camera;
use std::path::{Path, PathBuf};

/// The frames of an animation, or one picture for each of several cameras, with their files.
pub struct Animation<'a> {
    rendering: &'a Rendering,
    pictures: Option<Names>,
    partials: Option<Names>,
}

/// Files that show pictures or have their sums.
#[derive(Default)]
pub struct Files {
    pub pictures: Vec<PathBuf>,
    pub partials: Vec<PathBuf>,
}

impl<'a> Animation<'a> {
    /// Refuses files that do not fit what is rendered, before the scene is read. Returns the files to be written, as
    /// far as they do not depend on the scene.
    pub fn check(args: &RenderArgs) -> Result<Files> {
        ensure!(
            args.partial.is_none() || !args.spec.optics.has_several(),
            "--partial is for single pictures and animations; name one camera"
        );
        let (output, partial) = (args.picture_path(), args.partial.as_deref());
        if !args.spec.has_several() {
            if let Some(pattern) = output.into_iter().chain(partial).find(|file| Names::is_pattern(file)) {
                bail!(
                    "{}: the name has a place for a frame number or a camera's name, but there is one picture; add \
                     --frames A..B, --camera all or --views",
                    pattern.display()
                );
            }
            let owned = |file: Option<&Path>| file.map(Path::to_owned).into_iter().collect();
            return Ok(Files { pictures: owned(output), partials: owned(partial) });
        }
        if args.saving.save_every.is_some() {
            bail!(
                "--save-every is for single pictures; each frame of an animation is written once, when it is finished"
            );
        }
        let Some(frames) = args.spec.animation.frames.clone() else {
            output.map(Names::of_cameras).transpose()?;
            return Ok(Files::default());
        };
        let files = |pattern: Option<&Path>| -> Result<Vec<PathBuf>> {
            let names = pattern.map(Names::of_frames).transpose()?;
            Ok(names.map_or_else(Vec::new, |names| frames.clone().map(|frame| names.of(frame, "")).collect()))
        };
        Ok(Files { pictures: files(output)?, partials: files(partial)? })
    }

    /// The pictures of a rendering.
    pub fn new(args: &RenderArgs, rendering: &'a Rendering) -> Result<Self> {
        let is_animation = args.spec.animation.frames.is_some();
        let names =
            |pattern| if is_animation { Names::of_frames(pattern) } else { Names::of_cameras(pattern) };
        let pictures = args.picture_path().map(names).transpose()?;
        let partials = args.partial.as_deref().map(names).transpose()?;
        Ok(Self { rendering, pictures, partials })
    }

    /// The frames.
    pub fn frames(&self) -> &Frames {
        self.rendering.frames()
    }

    /// The camera of a frame.
    pub fn camera(&self, frame: u32) -> Result<Camera> {
        self.rendering.camera(frame)
    }

    /// The files to be written.
    pub fn files(&self) -> Files {
        let all = |file: fn(&Self, u32) -> Option<PathBuf>| {
            self.frames().numbers().filter_map(|frame| file(self, frame)).collect()
        };
        Files { pictures: all(Self::picture), partials: all(Self::partial) }
    }

    /// The picture of a frame, if one is wanted.
    pub fn picture(&self, frame: u32) -> Option<PathBuf> {
        self.pictures.as_ref().map(|names| names.of(frame, self.frames().name(frame)))
    }

    /// The partial film of a frame, if one is wanted.
    pub fn partial(&self, frame: u32) -> Option<PathBuf> {
        self.partials.as_ref().map(|names| names.of(frame, self.frames().name(frame)))
    }

    /// The subject of messages about a frame: its first file.
    pub fn subject(&self, frame: u32) -> String {
        let file = self.picture(frame).or_else(|| self.partial(frame));
        file.map_or_else(|| format!("frame {frame}"), |file| file.display().to_string())
    }
}
