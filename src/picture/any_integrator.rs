//! Integrators whose type is erased: what renders pictures is compiled once, not once an integrator.

use crate::engine::PreparedScene;
use crate::render::{Frame, Integrator};
use crate::schedule::{JobHandle, JobOptions, LimitsError, Renderer, Service};
use std::fmt;
use std::sync::Arc;

/// An integrator of any type.
#[derive(Clone)]
pub struct AnyIntegrator(Arc<dyn Erased>);

impl AnyIntegrator {
    /// Erases an integrator's type.
    pub fn new(integrator: impl Integrator + Renderer) -> Self {
        Self(Arc::new(integrator))
    }

    /// Submits the frame as a job that a scene's tracers trace.
    ///
    /// # Errors
    /// If the integrator shades another scene, or sizes do not fit each other.
    pub fn submit(
        &self,
        prepared: &PreparedScene,
        service: &Service,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        Arc::clone(&self.0).submit(prepared, service, options)
    }
}

impl fmt::Debug for AnyIntegrator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("AnyIntegrator").field(self.0.frame()).finish()
    }
}

impl Integrator for AnyIntegrator {
    fn frame(&self) -> &Frame {
        self.0.frame()
    }

    fn with_frame(&self, frame: Frame) -> Self {
        self.0.with_frame(frame)
    }

    fn tells_camera_rays(&self) -> bool {
        self.0.tells_camera_rays()
    }

    fn loop_stack_bytes(&self) -> usize {
        self.0.loop_stack_bytes()
    }
}

/// What an [`AnyIntegrator`] asks of the integrator within.
trait Erased: Send + Sync {
    fn frame(&self) -> &Frame;
    fn with_frame(&self, frame: Frame) -> AnyIntegrator;
    fn tells_camera_rays(&self) -> bool;
    fn loop_stack_bytes(&self) -> usize;
    fn submit(
        self: Arc<Self>,
        prepared: &PreparedScene,
        service: &Service,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError>;
}

impl<I: Integrator + Renderer> Erased for I {
    fn frame(&self) -> &Frame {
        Integrator::frame(self)
    }

    fn with_frame(&self, frame: Frame) -> AnyIntegrator {
        AnyIntegrator::new(Integrator::with_frame(self, frame))
    }

    fn tells_camera_rays(&self) -> bool {
        Integrator::tells_camera_rays(self)
    }

    fn loop_stack_bytes(&self) -> usize {
        Integrator::loop_stack_bytes(self)
    }

    fn submit(
        self: Arc<Self>,
        prepared: &PreparedScene,
        service: &Service,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        prepared.submit(service, self, options)
    }
}
