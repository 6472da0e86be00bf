//! An animation: its frames, their cameras and file names.

use crate::cli::args::{FramesArgs, RenderArgs};
use crate::film::Exposure;
use crate::scene::{Camera, CameraMotion, CameraPath, Scene};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The frames of an animation.
pub struct Animation {
    /// Frame numbers.
    pub frames: Range<u32>,
    motion: Motion,
    names: Names,
}

/// How the camera moves from frame to frame.
enum Motion {
    /// Rotation about a point by an angle per frame.
    Turntable { degrees: f32, own: Camera, centre: Vec3 },
    /// Along the key poses of a file.
    Path(CameraPath),
    /// The scene's own animation, at a number of frames per second.
    Scene(CameraMotion, f64),
}

/// Numbered file names.
struct Names {
    before: String,
    digits: usize,
    after: String,
}

impl Animation {
    /// Refuses options that exclude each other, before the scene is read. Returns the pictures to be written.
    pub fn check(args: &RenderArgs) -> Result<Vec<PathBuf>> {
        let FramesArgs { frames, .. } = &args.animation;
        let names = Names::new(&args.output);
        let Some(frames) = frames.clone() else {
            ensure!(
                names.is_err(),
                "{}: the name has a place for a frame number, but there is one picture; add --frames A..B",
                args.output.display()
            );
            return Ok(vec![args.output.clone()]);
        };
        let names = names?;
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
        Ok(frames.map(|frame| names.of(frame)).collect())
    }

    /// The animation that the options describe, if any; `own` is the camera of a still picture.
    pub fn new(args: &RenderArgs, scene: &Scene, own: Camera) -> Result<Option<Self>> {
        let FramesArgs { frames, turntable, camera_path, fps, .. } = &args.animation;
        let Some(frames) = frames.clone() else { return Ok(None) };
        ensure!(
            args.look.exposure != Exposure::Auto,
            "--exposure auto: an animation would flicker; render one frame to see its stops and give that number"
        );
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
                    args.camera.is_default(),
                    "--eye, --target, --up and --fov cannot be combined with the scene's own camera animation; \
                     add --turntable or --camera-path"
                );
                Motion::Scene(motion.clone(), *fps)
            }
            (None, None, None) => bail!(
                "--frames: the scene has no camera animation; add --turntable DEG or --camera-path FILE"
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
    /// Parses a pattern that holds `%d`, or `%03d` for three digits, exactly once.
    fn new(pattern: &Path) -> Result<Self> {
        let wrong = || {
            let path = pattern.display();
            format!("{path}: the output of an animation needs a frame number in its name, as in out.%04d.png")
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
