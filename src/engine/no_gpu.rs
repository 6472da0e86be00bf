//! What stands in the GPU's place in a build without it: nothing opens.

use super::units::UnitsError;
use crate::bvh::{Bvh, Filter};
use crate::stream::{DeviceTracer, Tracer};
use crate::trace::cpu::SimdLevel;
use std::sync::Arc;

/// A panic of a driver cannot happen.
pub(super) const ABORTS: bool = false;

/// Options of a choice that only a GPU has: none.
#[derive(Clone, Debug, Default)]
pub(super) struct GpuOptions;

impl GpuOptions {
    /// True if a failure of the GPU is to be injected.
    pub(super) fn injects(&self) -> bool {
        false
    }
}

/// An open GPU: there is none.
#[derive(Clone, Debug)]
pub(super) enum OpenGpu {}

impl OpenGpu {
    /// The reason why there is no GPU.
    pub(super) fn open(
        _: Option<&str>,
        _: SimdLevel,
        _: &GpuOptions,
    ) -> Result<Result<Self, String>, UnitsError> {
        Ok(Err("this build has no GPU tracer: it was built without the feature `gpu`".into()))
    }

    /// Waits until the GPU is open.
    pub(super) fn wait(&self) -> Result<(), String> {
        match *self {}
    }

    /// Name of the adapter.
    pub(super) fn name(&self) -> Result<String, String> {
        match *self {}
    }

    /// The fault to inject, as its name, if it has not happened yet.
    pub(super) fn idle_fault(&self) -> Option<String> {
        match *self {}
    }

    /// The GPU with a tree.
    pub(super) fn device(
        &self,
        _: &Arc<Bvh>,
        _: Option<Arc<dyn Filter>>,
        _: &Arc<dyn Tracer>,
    ) -> Result<Device, String> {
        match *self {}
    }
}

/// A GPU that has a tree: there is none.
#[derive(Clone)]
pub(super) enum Device {}

impl Device {
    /// Waits until the GPU has the tree.
    pub(super) fn wait(&self) -> Result<Option<String>, String> {
        match *self {}
    }

    /// The tracer of the tree.
    pub(super) fn tracer(&self) -> Arc<dyn DeviceTracer> {
        match *self {}
    }

    /// The same tree with another filter.
    pub(super) fn with_filter(&self, _: Option<Arc<dyn Filter>>, _: Arc<dyn Tracer>) -> Self {
        match *self {}
    }
}
