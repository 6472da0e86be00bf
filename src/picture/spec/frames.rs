//! An animation.

use super::form;
use super::option::spec_group;

/// Frames per second of a scene's animation, unless an option says another number.
const FPS: f64 = 24.0;

/// Moments at which a scene is seen while the shutter is open, unless an option says another number.
const STEPS: u32 = 16;

spec_group! {
    /// An animation.
    pub struct FramesSpec {
        /// Render frames A to B - 1. The output name numbers them, as in out.%04d.png. A frame does not depend on
        /// which others are rendered.
        maybe "frames" frames: form::Frames, "A..B";
        /// Turn the camera around the centre of the scene by this angle per frame.
        maybe "turntable" turntable: form::Angle, "DEG";
        /// Move the camera along the key poses of a .json file.
        maybe "camera-path" camera_path: form::File, "FILE";
        /// Frames per second of the scene's own animation (glTF); frame 0 is at --time, or at its start
        /// [default: 24].
        maybe "fps" fps: form::Rate, "N";
        /// Blur what moves while the shutter is open for this long, half of it before the picture's time and half
        /// after.
        maybe "shutter" shutter: form::Span, "SECONDS";
        /// Moments at which the scene is seen while the shutter is open; they share the samples [default: 16].
        maybe "shutter-steps" shutter_steps: form::Samples, "N";
    }
}

impl FramesSpec {
    /// Frames per second of the scene's own animation.
    pub fn rate(&self) -> f64 {
        self.fps.unwrap_or(FPS)
    }

    /// Moments at which the scene is seen: one, unless the shutter is open for a time.
    pub fn steps(&self) -> u32 {
        self.shutter.map_or(1, |_| self.shutter_steps.unwrap_or(STEPS))
    }

    /// The time of a step, in seconds after that of the picture.
    pub fn offset(&self, step: u32) -> f64 {
        let steps = f64::from(self.steps());
        self.shutter.unwrap_or(0.0) * ((f64::from(step) + 0.5) / steps - 0.5)
    }
}
