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
    names: Names,
    args: &'a RenderArgs,
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
    /// Refuses options that exclude each other, before the scene is read. Returns the pictures to be written, as far as
    /// they do not depend on the scene.
    pub fn check(args: &RenderArgs) -> Result<Vec<PathBuf>> {
        let FramesArgs { frames, .. } = &args.animation;
        ensure!(
            args.part.partial.is_none() || !args.optics.has_several(),
            "--partial is for single pictures; name one camera"
        );
        let Some(output) = args.picture_path() else { return Ok(Vec::new()) };
        if frames.is_none() && !args.optics.has_several() {
            ensure!(
                !Names::is_pattern(output),
                "{}: the name has a place for a frame number or a camera's name, but there is one picture; add \
                 --frames A..B, --camera all or --views",
                output.display()
            );
            return Ok(vec![output.to_owned()]);
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
            Names::of_cameras(output)?;
            return Ok(Vec::new());
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
        let names = Names::of_frames(output)?;
        Ok(frames.map(|frame| names.of(frame, "")).collect())
    }

    /// The pictures to be written.
    pub fn files(&self) -> Vec<PathBuf> {
        self.frames.clone().map(|frame| self.file(frame)).collect()
    }

    /// The animation that the options describe, if any; `own` is the camera of a still picture.
    pub fn new(args: &'a RenderArgs, scene: &Scene, own: Camera) -> Result<Option<Self>> {
        let FramesArgs { frames, turntable, camera_path, fps, .. } = &args.animation;
        let Some(output) = args.picture_path() else { return Ok(None) };
        if args.optics.is_all() {
            ensure!(!scene.cameras.is_empty(), "--camera all: the scene has no cameras");
            return Self::of_cameras(args, scene.cameras.clone(), output).map(Some);
        }
        if let Some(views) = &args.optics.views {
            let views = Views::read(views, args.size)?;
            let cameras = views.cameras(&args.optics, own, scene, args.size)?;
            return Self::of_cameras(args, cameras, output).map(Some);
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
        Ok(Some(Self { frames, motion, names: Names::of_frames(output)?, args }))
    }

    /// One picture for each camera.
    fn of_cameras(args: &'a RenderArgs, cameras: Vec<NamedCamera>, output: &Path) -> Result<Self> {
        let frames = 0..cameras.len() as u32;
        let (motion, names) = (Motion::Cameras(cameras), Names::of_cameras(output)?);
        Ok(Self { frames, motion, names, args })
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

    /// The file of a frame.
    pub fn file(&self, frame: u32) -> PathBuf {
        self.names.of(frame, self.name(frame))
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
