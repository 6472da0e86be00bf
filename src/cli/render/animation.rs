//! Several pictures of one scene: the frames of an animation or the cameras of a file, with their file names.

use super::names::Names;
use super::views::{self, Views};
use crate::cli::args::{FramesArgs, RenderArgs};
use crate::film::Exposure;
use crate::scene::{Camera, CameraMotion, CameraPath, NamedCamera, Scene};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The frames of an animation, or one picture for each of several cameras.
pub struct Animation<'a> {
    /// Frame numbers.
    pub frames: Range<u32>,
    motion: Motion,
    pictures: Option<Names>,
    partials: Option<Names>,
    args: &'a RenderArgs,
}

/// Files that show pictures or have their sums.
#[derive(Default)]
pub struct Files {
    pub pictures: Vec<PathBuf>,
    pub partials: Vec<PathBuf>,
}

/// How the camera moves from frame to frame.
enum Motion {
    /// Rotation about a point by an angle per frame.
    Turntable { degrees: f32, own: Camera, centre: Vec3 },
    /// Along the key poses of a file.
    Path(CameraPath),
    /// The scene's own animation, at a number of frames per second.
    Scene(CameraMotion, f64),
    /// Another camera for each picture.
    Cameras(Vec<NamedCamera>),
}

impl<'a> Animation<'a> {
    /// Refuses options that exclude each other, before the scene is read. Returns the files to be written, as far as
    /// they do not depend on the scene.
    pub fn check(args: &RenderArgs) -> Result<Files> {
        let FramesArgs { frames, .. } = &args.animation;
        ensure!(
            args.part.partial.is_none() || !args.optics.has_several(),
            "--partial is for single pictures and animations; name one camera"
        );
        let (output, partial) = (args.picture_path(), args.part.partial.as_deref());
        if frames.is_none() && !args.optics.has_several() {
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
        if args.progress.seconds.is_some() {
            bail!(
                "--seconds is for single pictures, because frames would differ in quality from machine to machine; \
                 use --spp or --noise"
            );
        }
        if args.progress.save_every.is_some() {
            bail!(
                "--save-every is for single pictures; each frame of an animation is written once, when it is finished"
            );
        }
        let Some(frames) = frames.clone() else {
            ensure!(
                !(args.optics.views.is_some() && args.optics.is_all()),
                "--camera all and --views exclude each other"
            );
            ensure!(
                args.part.region.is_none() && args.part.samples.is_none() || !args.optics.has_several(),
                "--region and --samples are for single pictures and animations; name one camera"
            );
            // Told before the scene is read.
            args.optics.views.as_ref().map_or(Ok(()), |views| Views::read(views, args.size).map(drop))?;
            ensure!(
                views::file(args).is_none() || args.camera.is_default(),
                "--views with a file of cameras renders each where it is; leave out --fov"
            );
            ensure!(
                !args.optics.is_all() || args.camera.is_default() && args.optics.world_to_camera.is_none(),
                "--camera all renders every camera where it is; leave out --eye, --target, --up, --fov and \
                 --world-to-camera"
            );
            output.map(Names::of_cameras).transpose()?;
            return Ok(Files::default());
        };
        ensure!(
            !args.optics.is_all(),
            "--camera all renders still pictures; animate one camera by --camera NAME"
        );
        if args.animation.camera_path.is_some() {
            let other = args.optics.world_to_camera.as_ref().map(|_| "--world-to-camera");
            if let Some(option) = args.optics.projection_option().or(other) {
                bail!(
                    "{option} and --camera-path exclude each other: the path's keys have a field of view and a pose"
                );
            }
        }
        let files = |pattern: Option<&Path>| -> Result<Vec<PathBuf>> {
            let names = pattern.map(Names::of_frames).transpose()?;
            Ok(names.map_or_else(Vec::new, |names| frames.clone().map(|frame| names.of(frame, "")).collect()))
        };
        Ok(Files { pictures: files(output)?, partials: files(partial)? })
    }

    /// The files to be written.
    pub fn files(&self) -> Files {
        let all = |file: fn(&Self, u32) -> Option<PathBuf>| {
            self.frames.clone().filter_map(|frame| file(self, frame)).collect()
        };
        Files { pictures: all(Self::picture), partials: all(Self::partial) }
    }

    /// The animation that the options describe, if any; `own` is the camera of a still picture.
    pub fn new(args: &'a RenderArgs, scene: &Scene, own: Camera) -> Result<Option<Self>> {
        let FramesArgs { frames, turntable, camera_path, fps, .. } = &args.animation;
        if args.optics.is_all() {
            ensure!(!scene.cameras.is_empty(), "--camera all: the scene has no cameras");
            return Self::of_cameras(args, scene.cameras.clone()).map(Some);
        }
        if let Some(views) = &args.optics.views {
            let views = Views::read(views, args.size)?;
            let cameras = views.cameras(&args.optics, own, scene, args.size)?;
            return Self::of_cameras(args, cameras).map(Some);
        }
        let Some(frames) = frames.clone() else { return Ok(None) };
        let own_motion = match &args.optics.camera {
            None => scene.camera_motion.as_ref(),
            Some(name) => named_camera(scene, name)?.motion.as_ref(),
        };
        ensure!(
            args.look.exposure != Exposure::Auto,
            "--exposure auto: an animation would flicker; render one frame to see its stops and give that number"
        );
        let motion = match (turntable, camera_path, own_motion) {
            (Some(degrees), ..) => {
                Motion::Turntable { degrees: *degrees, own, centre: scene.bounds().centre() }
            }
            (None, Some(path), _) => {
                let name = path.display();
                let text =
                    std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read"))?;
                Motion::Path(CameraPath::parse(&text).with_context(|| name.to_string())?)
            }
            (None, None, Some(motion)) => {
                ensure!(
                    args.camera.is_default() && args.optics.world_to_camera.is_none(),
                    "--eye, --target, --up, --fov and --world-to-camera cannot be combined with the scene's own camera \
                     animation; add --turntable or --camera-path"
                );
                Motion::Scene(motion.clone(), *fps)
            }
            (None, None, None) => bail!(
                "--frames: the scene has no camera animation; add --turntable DEG or --camera-path FILE"
            ),
        };
        let pictures = args.picture_path().map(Names::of_frames).transpose()?;
        let partials = args.part.partial.as_deref().map(Names::of_frames).transpose()?;
        Ok(Some(Self { frames, motion, pictures, partials, args }))
    }

    /// One picture for each camera.
    fn of_cameras(args: &'a RenderArgs, cameras: Vec<NamedCamera>) -> Result<Self> {
        let frames = 0..cameras.len() as u32;
        let pictures = args.picture_path().map(Names::of_cameras).transpose()?;
        Ok(Self { frames, motion: Motion::Cameras(cameras), pictures, partials: None, args })
    }

    /// The camera of a frame.
    pub fn camera(&self, frame: u32) -> Result<Camera> {
        let camera = match &self.motion {
            Motion::Turntable { degrees, own, centre } => {
                let degrees = (f64::from(*degrees) * f64::from(frame)) % 360.0;
                // The options have been applied before.
                return Ok(own.turned(*centre, degrees as f32));
            }
            Motion::Path(path) => path.at(f64::from(frame)),
            Motion::Scene(motion, fps) => motion.at(f64::from(frame) / fps),
            Motion::Cameras(cameras) => cameras[frame as usize].camera,
        };
        self.args.optics.apply(camera, self.args.size).with_context(|| format!("picture {frame}"))
    }

    /// The picture of a frame, if one is wanted.
    pub fn picture(&self, frame: u32) -> Option<PathBuf> {
        self.pictures.as_ref().map(|names| names.of(frame, self.name(frame)))
    }

    /// The partial film of a frame, if one is wanted.
    pub fn partial(&self, frame: u32) -> Option<PathBuf> {
        self.partials.as_ref().map(|names| names.of(frame, self.name(frame)))
    }

    /// What messages call a frame: the name of its first file.
    pub fn subject(&self, frame: u32) -> String {
        let file = self.picture(frame).or_else(|| self.partial(frame));
        file.map_or_else(|| format!("frame {frame}"), |file| file.display().to_string())
    }

    /// The name of a frame's camera; empty if one camera moves.
    pub fn name(&self, frame: u32) -> &str {
        match &self.motion {
            Motion::Cameras(cameras) => &cameras[frame as usize].name,
            _ => "",
        }
    }
}

/// The camera of a scene with a name.
pub fn named_camera<'a>(scene: &'a Scene, name: &str) -> Result<&'a NamedCamera> {
    let names = || scene.cameras.iter().map(|camera| format!("{:?}", camera.name)).collect::<Vec<_>>();
    scene.cameras.iter().find(|camera| camera.name == name).with_context(|| match &names()[..] {
        [] => format!("--camera {name}: the scene has no cameras"),
        names => {
            format!("--camera {name}: the scene has no camera of that name; it has {}", names.join(", "))
        }
    })
}
