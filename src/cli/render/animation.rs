//! Which frames there are, what they show and what they are called.

use crate::cli::args::{FramesArgs, RenderArgs};
use crate::scene::{Camera, CameraMotion, CameraPath, Scene};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Frames after each other.
pub struct Animation {
    /// Their numbers.
    pub frames: Range<u32>,
    motion: Motion,
    names: Names,
}

/// How the camera moves from frame to frame.
enum Motion {
    /// So many degrees a frame around a point.
    Turntable { degrees: f32, own: Camera, centre: Vec3 },
    /// Along the key poses of a file.
    Path(CameraPath),
    /// As the scene's file says, at so many frames a second.
    Scene(CameraMotion, f64),
}

/// File names with a number in them.
struct Names {
    before: String,
    digits: usize,
    after: String,
}

impl Animation {
    /// Refuses, before the scene is read, what cannot be asked of several frames. Returns whether there are several.
    pub fn check(args: &RenderArgs) -> Result<bool> {
        let FramesArgs { frames, turntable, .. } = &args.animation;
        if frames.is_none() {
            return Ok(false);
        }
        Names::new(&args.output)?;
        if let Some(degrees) = turntable {
            ensure!(degrees.is_finite(), "--turntable {degrees}: give a finite angle");
        }
        if args.progress.seconds.is_some() {
            bail!(
                "--seconds is for one picture: each of several frames would end wherever this machine is by then; say \
                 with --spp or --noise how good they are to be"
            );
        }
        if args.progress.save_every.is_some() {
            bail!(
                "--save-every is for one picture: each of several frames is written as soon as it is done, and one \
                 that is not done would look as if it were"
            );
        }
        Ok(true)
    }

    /// What the flags ask for in this scene, where `own` is the camera of a still picture.
    pub fn new(args: &RenderArgs, scene: &Scene, own: Camera) -> Result<Option<Self>> {
        let FramesArgs { frames, turntable, camera_path, fps, .. } = &args.animation;
        let Some(frames) = frames.clone() else { return Ok(None) };
        let motion = match (turntable, camera_path, &scene.camera_motion) {
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
                    args.camera.is_silent(),
                    "--eye, --target, --up and --fov are for cameras that stand still; the scene's own moves"
                );
                Motion::Scene(motion.clone(), *fps)
            }
            (None, None, None) => bail!(
                "--frames: nothing would move; the scene's file moves no camera, so say how with --turntable DEG or \
                 --camera-path FILE"
            ),
        };
        Ok(Some(Self { frames, motion, names: Names::new(&args.output)? }))
    }

    /// The camera of a frame.
    pub fn camera(&self, frame: u32) -> Camera {
        match &self.motion {
            Motion::Turntable { degrees, own, centre } => {
                let degrees = (f64::from(*degrees) * f64::from(frame)) % 360.0;
                own.turned(*centre, degrees as f32)
            }
            Motion::Path(path) => path.at(f64::from(frame)),
            Motion::Scene(motion, fps) => motion.at(f64::from(frame) / fps),
        }
    }

    /// The file of a frame.
    pub fn file(&self, frame: u32) -> PathBuf {
        self.names.of(frame)
    }
}

impl Names {
    /// Of a name that holds `%d` or, for a width of three digits, `%03d`, once.
    fn new(pattern: &Path) -> Result<Self> {
        let wrong = || {
            let path = pattern.display();
            format!("{path}: the name of several frames needs one place for their number, as in out.%04d.png")
        };
        let text = pattern.to_str().with_context(wrong)?;
        let (before, rest) = text.split_once('%').with_context(wrong)?;
        let (digits, after) = rest.split_once('d').with_context(wrong)?;
        let digits = if digits.is_empty() {
            0
        } else {
            digits.parse().ok().filter(|&n| n <= 32).with_context(wrong)?
        };
        if after.contains('%') {
            bail!(wrong());
        }
        Ok(Self { before: before.into(), digits, after: after.into() })
    }

    fn of(&self, frame: u32) -> PathBuf {
        let Self { before, digits, after } = self;
        format!("{before}{frame:0digits$}{after}").into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered() {
        let name = |pattern: &str| Names::new(Path::new(pattern)).map(|names| names.of(7));
        assert_eq!(name("a/out.%04d.png").unwrap(), PathBuf::from("a/out.0007.png"));
        assert_eq!(name("%d.exr").unwrap(), PathBuf::from("7.exr"));
        for bad in ["out.png", "out.%04x.png", "%d.%d.png", "%99d.png", "%-3d.png"] {
            assert!(name(bad).is_err(), "{bad}");
        }
    }
}
