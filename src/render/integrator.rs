//! What renders frames in passes and from several cameras.

use super::{Frame, Pass};
use crate::scene::{Camera, CameraError};
use crate::schedule::Renderer;

/// A renderer that works on a [`Frame`], and could as well on another.
pub trait Integrator: Renderer + Sized {
    /// What it works on.
    fn frame(&self) -> &Frame;

    /// The same integrator at work on another frame.
    fn with_frame(&self, frame: Frame) -> Self;

    /// Bytes that it has allocated for loop stacks.
    fn loop_stack_bytes(&self) -> usize {
        0
    }

    /// The same frame seen by another camera, on a film of its own.
    ///
    /// # Errors
    /// When the camera gives no view.
    fn seen_by(&self, camera: &Camera) -> Result<Self, CameraError> {
        Ok(self.with_frame(self.frame().seen_by(camera)?))
    }

    /// Another pass over the same frame, on a film of its own.
    fn with_pass(&self, pass: Pass) -> Self {
        self.with_frame(self.frame().with_pass(pass))
    }
}
