//! The pictures of a spec and their cameras: a still, the frames of an animation, or one picture for each of several
//! cameras.

use super::spec::{FramesSpec, RenderSpec};
use super::views::Views;
use crate::film::Exposure;
use crate::scene::{Camera, CameraMotion, CameraPath, NamedCamera, Scene};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;
use std::ops::Range;

/// The pictures of a spec and their cameras.
#[derive(Clone, Debug)]
pub struct Frames {
    numbers: Range<u32>,
    motion: Motion,
}

/// How the camera moves from frame to frame.
#[derive(Clone, Debug)]
enum Motion {
    /// Not from frame to frame. The scene's own animation, if it has one, moves it while the shutter is open.
    Still(Camera, Option<CameraMotion>),
    /// Rotation about a point by an angle per frame.
    Turntable { degrees: f32, own: Camera, centre: Vec3 },
    /// Along the key poses of a file.
    Path(CameraPath),
    /// The scene's own animation, at a number of frames per second.
    Scene(CameraMotion, f64),
    /// Another camera for each picture.
    Cameras(Vec<NamedCamera>),
}

impl Frames {
    /// Refuses options that exclude each other, before the scene is read.
    ///
    /// # Errors
    /// Which options they are.
    pub fn check(spec: &RenderSpec) -> Result<()> {
        if !spec.has_several() {
            return Ok(());
        }
        if spec.stop.seconds.is_some() {
            bail!(
                "--seconds is for single pictures, because frames would differ in quality from machine to machine; \
                 use --spp or --noise"
            );
        }
        let optics = &spec.optics;
        if spec.animation.frames.is_none() {
            ensure!(
                !(optics.views.is_some() && optics.is_all()),
                "--camera all and --views exclude each other"
            );
            ensure!(
                spec.part.region.is_none() && spec.part.samples.is_none(),
                "--region and --samples are for single pictures and animations; name one camera"
            );
            // Told before the scene is read.
            optics.views.as_ref().map_or(Ok(()), |views| Views::read(views, spec.size).map(drop))?;
            ensure!(
                optics.views_file().is_none() || spec.camera.is_default(),
                "--views with a file of cameras renders each where it is; leave out --fov"
            );
            ensure!(
                !optics.is_all() || spec.camera.is_default() && optics.world_to_camera.is_none(),
                "--camera all renders every camera where it is; leave out --eye, --target, --up, --fov and \
                 --world-to-camera"
            );
            return Ok(());
        }
        ensure!(!optics.is_all(), "--camera all renders still pictures; animate one camera by --camera NAME");
        if spec.animation.camera_path.is_some() {
            let other = optics.world_to_camera.as_ref().map(|_| "--world-to-camera");
            if let Some(option) = optics.projection_option().or(other) {
                bail!(
                    "{option} and --camera-path exclude each other: the path's keys have a field of view and a pose"
                );
            }
        }
        Ok(())
    }

    /// The pictures that a spec describes of a scene.
    ///
    /// # Errors
    /// What the options and the scene have against each other.
    pub fn new(spec: &RenderSpec, scene: &Scene) -> Result<Self> {
        let own = still_camera(spec, scene)?;
        let FramesSpec { frames, turntable, camera_path, .. } = &spec.animation;
        if spec.optics.is_all() {
            ensure!(!scene.cameras.is_empty(), "--camera all: the scene has no cameras");
            return Ok(Self::of_cameras(scene.cameras.clone()));
        }
        if let Some(views) = &spec.optics.views {
            let views = Views::read(views, spec.size)?;
            return Ok(Self::of_cameras(views.cameras(&spec.optics, own, scene, spec.size)?));
        }
        let own_motion = match &spec.optics.camera {
            None => scene.camera_motion.as_ref(),
            Some(name) => named_camera(scene, name)?.motion.as_ref(),
        };
        let Some(numbers) = frames.clone() else {
            let motion = own_motion.filter(|_| spec.loading.time.is_some());
            return Ok(Self { numbers: 0..1, motion: Motion::Still(own, motion.cloned()) });
        };
        ensure!(
            spec.look.exposure != Exposure::Auto,
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
                    spec.camera.is_default() && spec.optics.world_to_camera.is_none(),
                    "--eye, --target, --up, --fov and --world-to-camera cannot be combined with the scene's own camera \
                     animation; add --turntable or --camera-path"
                );
                Motion::Scene(motion.clone(), spec.animation.rate())
            }
            (None, None, None) if scene.is_animated || scene.reads_moment() => Motion::Still(own, None),
            (None, None, None) => {
                bail!(
                    "--frames: the scene has no animation; add --turntable DEG or --camera-path FILE, or a shader \
                     that reads the time"
                )
            }
        };
        Ok(Self { numbers, motion })
    }

    /// One picture for each camera.
    fn of_cameras(cameras: Vec<NamedCamera>) -> Self {
        Self { numbers: 0..cameras.len() as u32, motion: Motion::Cameras(cameras) }
    }

    /// The numbers of the frames.
    pub fn numbers(&self) -> Range<u32> {
        self.numbers.clone()
    }

    /// The camera of a frame.
    ///
    /// # Errors
    /// If there is no such frame, or the options have something against its camera.
    pub fn camera(&self, spec: &RenderSpec, frame: u32) -> Result<Camera> {
        self.camera_at(spec, frame, 0.0)
    }

    /// The camera so many seconds after the time of a frame.
    ///
    /// # Errors
    /// If there is no such frame, or the options have something against its camera.
    pub fn camera_at(&self, spec: &RenderSpec, frame: u32, offset: f64) -> Result<Camera> {
        ensure!(self.numbers.contains(&frame), "there is no frame {frame}");
        let start = spec.loading.time.unwrap_or(0.0);
        let moment = f64::from(frame) + offset * spec.animation.rate();
        let camera = match &self.motion {
            Motion::Still(_, Some(motion)) if offset != 0.0 => {
                let own = motion.at(start + offset);
                spec.camera.apply(Some(own), || own)
            }
            // The options have been applied before.
            Motion::Still(camera, _) => return Ok(*camera),
            Motion::Turntable { degrees, own, centre } => {
                let degrees = (f64::from(*degrees) * moment) % 360.0;
                return Ok(own.turned(*centre, degrees as f32));
            }
            Motion::Path(path) => path.at(moment),
            Motion::Scene(motion, fps) => motion.at(start + f64::from(frame) / fps + offset),
            Motion::Cameras(cameras) => {
                let NamedCamera { camera, motion, .. } = &cameras[frame as usize];
                let motion = motion.as_ref().filter(|_| offset != 0.0);
                motion.map_or(*camera, |motion| motion.at(start + offset))
            }
        };
        spec.optics.apply(camera, spec.size).with_context(|| format!("picture {frame}"))
    }

    /// The name of a frame's camera; empty if one camera moves.
    pub fn name(&self, frame: u32) -> &str {
        match &self.motion {
            Motion::Cameras(cameras) => &cameras[frame as usize].name,
            _ => "",
        }
    }
}

impl RenderSpec {
    /// The sentence about the camera that frames a scene without one; `None` if there is one.
    pub(super) fn assumed_camera(&self, scene: &Scene) -> Option<&'static str> {
        let is_posed = self.camera.eye.is_some()
            || self.optics.world_to_camera.is_some()
            || self.optics.views.is_some()
            || self.animation.camera_path.is_some();
        (scene.camera.is_none() && self.optics.camera.is_none() && !is_posed)
            .then_some("no camera: one frames the scene in three-quarter view (--eye and --target choose)")
    }
}

/// The camera of a still picture.
fn still_camera(spec: &RenderSpec, scene: &Scene) -> Result<Camera> {
    let own = match &spec.optics.camera {
        Some(name) if !spec.optics.is_all() => Some(named_camera(scene, name)?.camera),
        _ => scene.camera,
    };
    let (width, height) = spec.size;
    let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
    spec.optics.apply(spec.camera.apply(own, framed), spec.size)
}

/// The camera of a scene with a name.
fn named_camera<'a>(scene: &'a Scene, name: &str) -> Result<&'a NamedCamera> {
    let names = || scene.cameras.iter().map(|camera| format!("{:?}", camera.name)).collect::<Vec<_>>();
    scene.cameras.iter().find(|camera| camera.name == name).with_context(|| match &names()[..] {
        [] => format!("--camera {name}: the scene has no cameras"),
        names => {
            format!("--camera {name}: the scene has no camera of that name; it has {}", names.join(", "))
        }
    })
}
