//! The trait of integrators: renderers of frames, in passes and from several cameras.

use super::{AovError, AovSet, Frame, Part, Pass, SettingsError};
use crate::lanes::SimdLevel;
use crate::scene::{Camera, CameraError, Scene};
use std::sync::Arc;

/// A renderer of a [`Frame`] that can be given another frame of the same scene. A job runs it as a
/// [`crate::schedule::Renderer`].
pub trait Integrator: Sized + Send + Sync + 'static {
    /// The frame that it renders.
    fn frame(&self) -> &Frame;

    /// The same integrator for another frame of the same scene.
    fn with_frame(&self, frame: Frame) -> Self;

    /// The same integrator, shading at this SIMD level; with one lane at [`SimdLevel::Scalar`]. The picture is the
    /// same.
    fn with_simd(self, simd: SimdLevel) -> Self {
        let frame = self.frame();
        self.with_frame(frame.with_pass(frame.pass().clone()).with_simd(simd))
    }

    /// True if the integrator tells which of its rays come from the camera, which layers need
    /// ([`super::HitShader::camera_sample`]).
    fn tells_camera_rays(&self) -> bool {
        false
    }

    /// The same frame with layers besides the picture, with its own film. [`Frame::develop`] gives the picture with its
    /// layers. They cost no pass of their own: what camera rays hit is added to them while it is shaded.
    ///
    /// # Errors
    /// If the integrator or the settings allow no such layers, or the system does not give the film's memory.
    fn with_aovs(&self, aovs: &AovSet) -> Result<Self, AovError> {
        if !aovs.is_empty() && !self.tells_camera_rays() {
            return Err(AovError::NoFirstHits);
        }
        Ok(self.with_frame(self.frame().with_aovs(aovs)?))
    }

    /// Bytes allocated for loop stacks.
    fn loop_stack_bytes(&self) -> usize {
        0
    }

    /// The same frame seen by another camera, with its own film.
    ///
    /// # Errors
    /// If the camera is invalid (eye equals target, for example).
    fn seen_by(&self, camera: &Camera) -> Result<Self, CameraError> {
        Ok(self.with_frame(self.frame().seen_by(camera)?))
    }

    /// The same frame of the scene with another appearance ([`crate::engine::PreparedScene::with_scene`]), with its own
    /// film.
    fn with_scene(&self, scene: &Arc<Scene>) -> Self {
        self.with_frame(self.frame().with_scene(scene))
    }

    /// A part of the same frame, with its own film ([`Frame::with_part`]).
    ///
    /// # Errors
    /// If the frame does not have all samples of the part, or the part has none.
    fn with_part(&self, part: Part) -> Result<Self, SettingsError> {
        Ok(self.with_frame(self.frame().with_part(part)?))
    }

    /// Another pass over the same frame, with its own film.
    fn with_pass(&self, pass: Pass) -> Self {
        self.with_frame(self.frame().with_pass(pass))
    }
}
