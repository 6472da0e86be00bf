//! An animation.

use super::form;
use super::option::spec_group;

/// Frames per second of a scene's animation, unless an option says another number.
const FPS: f64 = 24.0;

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
    }
}

impl FramesSpec {
    /// Frames per second of the scene's own animation.
    pub fn rate(&self) -> f64 {
        self.fps.unwrap_or(FPS)
    }
}
